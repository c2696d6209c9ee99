"""Every verb of the command line, in an order in which each finds what it needs.

Its episodes are short. `view` needs a display, `render` an off-screen renderer, and `demo` is the
other verbs at a length that takes minutes; all three have tests of their own.
"""

import importlib.util
import json

from tests.command_line import SHORT, train

ELSEWHERE = {"demo", "render", "view"}

# One process types them all: seconds of imports are spent once.
TYPED = """
import contextlib, io, json, sys
from jbench.cli import main
ended = []
for arguments in json.loads(sys.argv[1]):
    with contextlib.redirect_stdout(io.StringIO()) as said:
        code = main(arguments)
    ended.append([code, said.getvalue()])
print(json.dumps(ended))
"""

_RUN = "face_direction/td3/full/s00"
_STEPS = ("--steps", str(2 * SHORT))
_VERBS = (
    (["collect", *_STEPS], "Dataset random/s00-"),
    (["datasets"], "1 dataset in"),
    (["train-dae", "--latent", "2", "--epochs", "1", "--batch", "64"], "face_direction/dae2/s00-"),
    (["train-encoder", "--kind", "pca", "--latent", "2"], "face_direction/pca2/s00-"),
    ([*train("td3", "none"), "--seeds", "0", *_STEPS], f"{_RUN}-"),
    (["sweep", "smoke", "--dry-run"], "face_direction"),
    (["runs"], f"{_RUN}-"),
    (["tail", "--once"], f"{_RUN}-"),
    (["query", "SELECT count(*) AS episodes FROM episodes"], "2"),
    (["evaluate", "--policy", _RUN, "--episodes", "1"], "face_direction"),
    (["reproduce", _RUN, "--episodes", "1"], "equal"),
    (["import", "--from", "csv", "--seed-column", "seed", "--algo", "mine"], "mine"),
    (["merge"], "Merged into "),
    (["report", "--window", "2", "--format", "png"], "Wrote "),
    (["verify"], "all of them intact"),
    (["repair", "--dry-run"], "Nothing to set aside"),
    (["export"], "Exported random/s00-"),
    (["algorithms"], "td3"),
    (["leaderboard"], "face_direction"),
)
PRINTED = {verb[0]: said for verb, said in _VERBS}
"""What each verb prints, besides other things."""


def typed(place):
    """Returns the arguments of each verb as JSON, for `TYPED`.

    Args:
        place: directory of the results, and of the files that verbs read.
    """
    curves, other = place / "curves.csv", place / "other"
    curves.write_text("control_steps,episode_return,seed\n100,5.0,0\n200,7.0,0\n")
    (other / "runs").mkdir(parents=True)
    more = {
        "algorithms": [],
        "leaderboard": [str(place / "results")],
        "merge": [str(other)],
        "import": ["--task", "face_direction", str(curves)],
    }
    where = ["--results", str(place / "results")]
    lines = []
    for verb, _ in _VERBS:
        arguments = [*verb, *more.get(verb[0], [])]
        lines.append(arguments if verb[0] in ("algorithms", "leaderboard") else arguments + where)
    return json.dumps(lines)


def missing():
    """Returns the verbs that need a package of an extra which is not installed."""
    return set() if importlib.util.find_spec("minari") else {"export"}
