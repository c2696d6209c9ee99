"""Tests of a full disk: one sentence, nothing is damaged, and with room the same command ends."""

import os
import shutil
import subprocess

import pytest

from jbench.store import Results
from jbench.store.verify import verify
from tests.command_line import Process, jbench, succeed, train
from tests.store.store_rows import RUN_SETTINGS
from tests.store.store_whole import add
from tests.sweep_matrices import TINY_TD3

DISK = 64 << 20
"""Bytes of the disk, of which a test leaves little free."""

PIECE = 4 << 10
"""Bytes that a file takes at least."""

COLLECT = ("collect", "--steps", "2000", "--threads", "1")
TRAIN_DAE = ("train-dae", "--latent", "2", "--epochs", "20", "--batch", "64")
TRAIN = train("td3", "none", "--jobs", "1", "--checkpoint-every", "0")


MATRIX = """
tasks = ["face_direction"]
algos = ["td3"]
representations = ["full", "pca2"]
seeds = "0"
steps = 200
dataset.steps = 2000
evaluation.episodes = 1
"""


class Disk:
    """A small disk with a results directory, on which a file may take all room but some."""

    def __init__(self, path):
        self.path = path
        self.results = path / "results"
        self._ballast = path / "ballast"

    def fill(self, free):
        """Leaves this number of bytes free."""
        room = os.statvfs(self.path).f_bavail * PIECE
        with self._ballast.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, room - free)

    def make_room(self):
        self._ballast.unlink()


@pytest.fixture
def disk(tmp_path):
    """A disk of 64 MB; the test is skipped where none can be made."""
    path = tmp_path / "disk"
    path.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", str(path)]
    try:
        subprocess.run(mount, check=True, capture_output=True, text=True)
    except FileNotFoundError:
        pytest.skip("a small disk can't be made: there is no mount")
    except subprocess.CalledProcessError as error:
        pytest.skip(f"a small disk can't be made: {error.stderr.strip()}")
    yield Disk(path)
    subprocess.run(["umount", str(path)], check=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A dataset, and two runs without a checkpoint; beside them, a matrix file."""
    results = tmp_path_factory.mktemp("made") / "results"
    succeed(*COLLECT, results=results, short=True)
    succeed(*TRAIN, results=results, short=True)
    (results.parent / "own.toml").write_text(MATRIX + TINY_TD3)
    return results


VERBS = {
    "collect": (COLLECT, (0, 9)),
    "train-dae": (TRAIN_DAE, (0, 5)),
    "train-encoder": (("train-encoder", "--kind", "pca", "--latent", "2"), (0, 5)),
    "train": ((*TRAIN, "--algo", "ddpg"), (0, 5, 9)),
    "evaluate": (("evaluate", "heuristic", "--episodes", "2", "--threads", "1"), (0, 2)),
    "merge": (("merge", "{made}"), (0, 5)),
    "report": (("report", "--format", "svg"), (0, 9)),
    "sweep": (("sweep", "{made}/../own.toml", "--jobs", "1", "--checkpoint-every", "0"), (0, 9)),
    "archive": (("archive", "--out", "{disk}/results.zip"), (0, 5)),
}
"""What is typed, and for how many pieces there is room: the command ends sooner or later.

Merge begins without results, and collect without a dataset.
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("verb", "free"), [(verb, free) for verb, (_, each) in VERBS.items() for free in each]
)
def test_command_says_that_there_is_no_room_and_ends_when_there_is(verb, free, disk, made):
    if verb not in ("merge", "collect"):
        shutil.copytree(made, disk.results)
    disk.results.mkdir(exist_ok=True)
    places = {"made": made, "disk": disk.path}
    command = [word.format(**places) for word in VERBS[verb][0]]

    disk.fill(free * PIECE)
    stopped = jbench(*command, results=disk.results, short=True)
    assert stopped.returncode == 1, stopped.stdout + stopped.stderr
    errors = [line for line in stopped.stderr.splitlines() if line.startswith("Error: ")]
    assert len(errors) == 1
    assert "No room left to write" in stopped.stderr
    assert "free some space and type the command again" in stopped.stderr
    assert "Traceback" not in stopped.stderr
    assert "refused" not in stopped.stdout + stopped.stderr
    found = verify(Results(disk.results), 1).findings
    assert {flaw.sort for flaw in found} <= {"leftover", "warning"}

    disk.make_room()
    succeed(*command, results=disk.results, short=True)
    assert verify(Results(disk.results), 1).findings == []
    for kind in ("dataset", "encoder", "run", "evaluation"):
        records, problems = Results(disk.results).scan(kind)
        assert {record.status for record in records} <= {"finished"}
        assert problems == []


def test_merge_ends_at_a_full_disk_and_refuses_no_record(tmp_path):
    mine, other = Results(tmp_path / "mine"), Results(tmp_path / "other")
    small, large, last = (
        add(other, "run", "face_direction/td3/full", {**RUN_SETTINGS, "seed": seed}, {}, files)
        for seed, files in enumerate(({}, {"policy.json": 20_000 * b"x"}, {}))
    )
    merge = ("merge", str(other.path), "--results", str(mine.path))
    stopped = Process("tests.store.store_faults:run_limited", 10_000, *merge).finished()
    assert (stopped.returncode, stopped.stdout) == (1, "")
    folder = mine.path / "runs" / large.id
    assert stopped.stderr == (
        f"Error: No room left to write policy.json in {folder}; what was finished is kept: free "
        "some space and type the command again.\n"
    )
    assert [record.id for record in mine.scan("run")[0]] == [small.id]
    done = jbench(*merge)
    assert (done.returncode, done.stdout) == (0, f"Merged into {mine.path}: 1 same, 2 copied.\n")
    assert mine.find("run", last.id) is not None
