"""A command line of every jbench command, each after the commands whose output it needs.

Episodes are short. `view` needs a display, `render` an off-screen renderer, and `demo` takes
minutes; these three are tested elsewhere.
"""

import importlib.util
import json

from tests.command_line import SHORT, train

WITHOUT_RESULTS = {"algorithms", "tasks", "leaderboard", "check", "schema"}
"""Commands without --results."""

TESTED_ELSEWHERE = {"demo", "render", "view"}

# One process runs all commands, so that it imports the libraries once.
PROGRAM = """
import contextlib, io, json, sys
from jbench.cli import main
ended = []
for arguments in json.loads(sys.argv[1]):
    # A terminal that has few characters.
    with contextlib.redirect_stdout(io.TextIOWrapper(io.BytesIO(), "ascii")) as said:
        code = main(arguments)
    said.flush()
    ended.append([code, said.buffer.getvalue().decode("ascii")])
print(json.dumps(ended))
"""

_RUN = "face_direction/td3/full/s00"
_STEPS = ("--steps", str(2 * SHORT))
_VERBS = (
    (["collect", *_STEPS], "Dataset random/s00-"),
    (["datasets"], "1 dataset in"),
    (
        ["train-dae", "--latent", "2", "--epochs", "1", "--batch", "64"],
        "dae2-batch-64-epochs-1/s00-",
    ),
    (["train-encoder", "--kind", "pca", "--latent", "2"], "face_direction/pca2/s00-"),
    ([*train("td3", "none"), "--seeds", "0", *_STEPS], f"{_RUN}-"),
    (["sweep", "smoke", "--dry-run"], "face_direction"),
    (["runs"], f"{_RUN}-"),
    (["tail", "--once"], f"{_RUN}-"),
    (["query", "SELECT count(*) AS episodes FROM episodes"], "2"),
    (["evaluate", _RUN, "--episodes", "1"], "face_direction"),
    (["reproduce", _RUN, "--episodes", "1"], "equal"),
    (["import", "--from", "csv", "--seed-column", "seed", "--algo", "mine"], "mine"),
    (["merge"], "Merged into "),
    (["report", "--window", "2", "--format", "png"], "Wrote "),
    (["verify"], "all of them intact"),
    (["repair", "--dry-run"], "Nothing to set aside"),
    (["export"], "Exported random/s00-"),
    (["algorithms"], "td3"),
    (["tasks"], "face_direction"),
    (["leaderboard"], "face_direction"),
    (["doctor"], "no record is being written"),
    (["schema"], "manifest"),
    (["archive"], "without names"),
    (["check", "pca", "--latent", "2"], "the same seed gives the same weights"),
)
PRINTED = {verb[0]: printed for verb, printed in _VERBS}
"""A text that the output of each command contains."""


def command_lines(place):
    """Returns the arguments of each command as JSON, for `PROGRAM`.

    Args:
        place: directory of the results, and of the files that commands read.
    """
    curves, other = place / "curves.csv", place / "other"
    curves.write_text("control_steps,episode_return,seed\n100,5.0,0\n200,7.0,0\n")
    (other / "runs").mkdir(parents=True)
    more = {
        "leaderboard": [str(place / "results")],
        "archive": ["--out", str(place / "a.zip"), "--blind"],
        "merge": [str(other)],
        "import": ["--task", "face_direction", str(curves)],
    }
    where = ["--results", str(place / "results")]
    lines = []
    for verb, _ in _VERBS:
        arguments = [*verb, *more.get(verb[0], [])]
        lines.append(arguments if verb[0] in WITHOUT_RESULTS else arguments + where)
    return json.dumps(lines)


def missing():
    """Returns the commands that need an extra which is not installed."""
    return set() if importlib.util.find_spec("minari") else {"export"}
