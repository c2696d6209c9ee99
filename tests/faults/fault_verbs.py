"""The commands that write, and the results that each starts from."""

import errno
from typing import NamedTuple

from tests.faults.fault_injection import Fault
from tests.faults.forked_commands import run_command

SMALL = ("--set", "hidden_layers=[4]", "--set", "batch_size=4")
OFF_POLICY = ("--set", "learning_starts=20", "--set", "train_freq=10", "--set", "gradient_steps=1")
ONE_RUN = (
    "train --algo td3 --seeds 0 --steps 60 --jobs 1 "
    "--evaluate-every 40 --evaluate-episodes 1 --checkpoint-every 0"
)
TRAIN = (*ONE_RUN.split(), *SMALL, *OFF_POLICY)
RETRY = ("--retry-failed",)
COLLECT = ("collect", "--steps", "160", "--threads", "1")
TRAIN_DAE = ("train-dae", "--latent", "2", "--epochs", "2", "--batch", "64", "--device", "cpu")
ONE_FILE = (
    "import --from csv --seed-column seed --task face_direction --algo ppo {path}/../curves.csv"
)
IMPORT = tuple(ONE_FILE.split())
EVALUATE = ("evaluate", "--episodes", "2", "--threads", "1")
SWEEP = """
tasks = ["face_direction"]
algos = ["td3"]
representations = ["full", "pca2"]
seeds = "0"
steps = 40

[evaluation]
every = 40
episodes = 1

[dataset]
steps = 160

[hyperparameters.td3]
hidden_layers = [4]
batch_size = 4
learning_starts = 20
train_freq = 10
gradient_steps = 1
"""

CURVES = """seed,control_steps,episode_return
0,20,1.5
0,40,2.5
1,20,3.5
"""

FILES = {"small.toml": SWEEP, "curves.csv": CURVES}
"""Files next to the results, which commands read."""


class Verb(NamedTuple):
    """A command, what makes the results that it starts from, and options when it is repeated."""

    command: tuple[str, ...]
    before: tuple = ()
    again: tuple[str, ...] = ()


def resumable(path):
    """Makes a run that stopped at a full disk, with a checkpoint."""
    assert run_command(TRAIN, path, Fault("rename", 12, errno.ENOSPC, lasting=True)).code == 1
    assert list(path.rglob("checkpoint-*")), "the training has no checkpoint to resume from"


def another_machine(path):
    """Makes results to merge, and an unfinished run that a finished one replaces."""
    for command in (COLLECT, EVALUATE, TRAIN):
        assert run_command(command, path).code == 0
    path.rename(path.parent / "other")
    path.mkdir()
    (path.parent / "other").rename(path / "other")
    resumable(path)


def broken(path):
    """Makes a damaged run, a record with an unlisted file, and an intact record."""
    for command in (COLLECT, TRAIN, EVALUATE):
        assert run_command(command, path).code == 0
    damaged = next((path / "runs").rglob("episodes-*.parquet"))
    damaged.write_bytes(damaged.read_bytes()[:-1])
    record = next((path / "evaluations").rglob("manifest.json")).parent
    assert (record / "lock").exists()
    (record / "policy_episodes-00009-12345678.parquet").write_bytes(b"left")


VERBS = {
    "collect": Verb(COLLECT),
    "train-dae": Verb(TRAIN_DAE, (COLLECT,)),
    "train-encoder": Verb(("train-encoder", "--kind", "pca", "--latent", "2"), (COLLECT,)),
    "train": Verb(TRAIN, again=RETRY),
    "resume": Verb((*TRAIN, *RETRY), (resumable,)),
    "sweep": Verb(
        ("sweep", "{path}/../small.toml", "--jobs", "1", "--checkpoint-every", "0"), again=RETRY
    ),
    "evaluate": Verb(EVALUATE),
    "merge": Verb(("merge", "{path}/other"), (another_machine,)),
    "repair": Verb(("repair", "--threads", "1"), (broken,)),
    "export": Verb(("export", "--out", "{path}/minari"), (COLLECT,)),
    "import": Verb(IMPORT),
    "report": Verb(("report", "--window", "2", "--format", "svg"), (TRAIN,)),
}
