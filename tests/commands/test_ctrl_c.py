"""Tests of Ctrl-C in a terminal, which reaches a command and all of its processes at once."""

import re
import signal
import sys

import pytest

from jbench.store import Results
from jbench.store.verify import verify
from tests.command_line import TRAINING, succeed, wait_until
from tests.on_terminal import CTRL_C, OnTerminal

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="the processes of a terminal are in /proc"),
]

NEVER_ENDS = "10M"

MATRIX = """
tasks = ["face_direction"]
algos = ["td3"]
representations = ["full"]
seeds = "0-1"
steps = 10_000_000

[hyperparameters.td3]
hidden_layers = [8]
batch_size = 8
"""


def stop(terminal, when):
    """Types Ctrl-C once a condition is true; returns what was shown after it has ended.

    No process may be left, and the command must end as a signal ends one.
    """
    wait_until(when, terminal)
    terminal.type(CTRL_C)
    code, shown = terminal.ended()
    assert code == -signal.SIGINT, shown
    assert "Traceback" not in shown
    assert "Error" not in shown
    wait_until(lambda: not terminal.processes())
    return " ".join(shown.split())


def has_checkpoint(results, kind, count=1):
    """Returns whether this number of records have a checkpoint to resume from."""
    records, _ = Results(results).scan(kind)
    return sum(bool(record.roles()) for record in records) >= count


def check(results):
    """Asserts that nothing is damaged."""
    assert {flaw.sort for flaw in verify(Results(results), 1).findings} <= {"leftover"}


@pytest.fixture
def results(tmp_path):
    return tmp_path / "results"


def test_encoder_keeps_its_epochs(results, tmp_path):
    succeed("collect", "--steps", "2000", results=results)
    training = ("train-dae", "--latent", "2", "--epochs", "1000000", "--results", results)
    with OnTerminal(*training, cwd=tmp_path) as terminal:
        shown = stop(terminal, lambda: has_checkpoint(results, "encoder"))
    kept = r"Stopped\. ([\d,]+) of 1,000,000 epochs are kept; the same command continues there\."
    assert int(re.search(kept, shown)[1].replace(",", "")) > 0
    check(results)


def test_runs_of_a_sweep_and_their_workers_stop(results, tmp_path):
    (tmp_path / "own.toml").write_text(MATRIX)
    sweep = ("sweep", "own.toml", "--jobs", "2", "--checkpoint-every", "0", "--results", results)
    with OnTerminal(*sweep, cwd=tmp_path) as terminal:
        shown = stop(terminal, lambda: has_checkpoint(results, "run", 2))
    kept = "Stopped. Of 2 runs, 0 are finished and 2 begun; the same command continues each"
    assert f"{kept} of these from its last checkpoint." in shown
    check(results)


def test_training_that_waits_for_its_first_episode_says_that_nothing_is_kept(results, tmp_path):
    training = ("train", "--algo", "td3", "--seeds", "0", "--steps", NEVER_ENDS, *TRAINING["td3"])
    with OnTerminal(*training, "--results", results, cwd=tmp_path) as terminal:
        shown = stop(terminal, lambda: any(results.rglob("lock")))
    assert re.search(
        r"Stopped\. (No run has begun yet|Of 1 run, 0 are finished and 1 begun)", shown
    )
    check(results)


def test_earlier_report_stays(results, tmp_path):
    out = tmp_path / "report"
    out.mkdir()
    (out / "index.html").write_text("an earlier page")
    report = ("report", "--results", "reference", "--out", out)
    with OnTerminal(*report, cwd=tmp_path) as terminal:
        shown = stop(terminal, lambda: terminal.has_loaded("ft2font"))  # which draws
    kept = f"Stopped. The earlier report in {out} is still there; the same command writes the new"
    assert f"{kept} one." in shown
    assert (out / "index.html").read_text() == "an earlier page"


def test_demo_stops_with_the_command_that_it_runs(tmp_path):
    results = tmp_path / "demo-results"
    with OnTerminal("demo", cwd=tmp_path) as terminal:
        shown = stop(terminal, lambda: any(results.rglob("lock")))
    assert "control steps are kept" in shown or "No control step is kept" in shown
    assert "The same command continues the demo." in shown
    check(results)
