"""Tests of the worker processes of `jbench train`: requests, interrupts and retries."""

import subprocess
import sys

import pytest

from jbench.cli import main
from jbench.errors import ElsewhereError
from jbench.store import Results
from jbench.sweeps.executors import Local
from jbench.training.events import Finished
from tests.training.small_runs import small_run

TD3 = {"batch_size": 8, "learning_starts": 500, "train_freq": 100, "gradient_steps": 2}
SHORT = {"engine": "batched", "steps": 1000, "evaluate_every": 1000, "evaluate_episodes": 0}

# SIGINT is sent when the worker is started but not yet known to its parent. The worker must not
# handle it, not even before its first line, which makes it ignore SIGINT.
INTERRUPTED = """
import os, signal, subprocess, sys, time
from jbench.cli import main
from jbench.sweeps import executors

start = subprocess.Popen

def is_in(name, process):
    with open(f"/proc/{process.pid}/status") as status:
        (mask,) = (line.split()[1] for line in status if line.startswith(name))
    return int(mask, 16) & 1 << signal.SIGINT - 1

def popen(arguments, **more):
    process = start(arguments, **more)
    if "jbench.training.worker" in arguments:
        assert is_in("SigBlk:", process)
        os.kill(os.getpid(), signal.SIGINT)
        while not is_in("SigIgn:", process):
            time.sleep(0.01)
    return process

signal.signal(signal.SIGINT, signal.default_int_handler)
subprocess.Popen = popen
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_request_of_many_seeds_may_exceed_argument_limit(tmp_path):
    # Linux limits an argument to 128 KiB. The runs are finished, so nothing is trained.
    results, long = Results(tmp_path), {**TD3, "hidden_layers": [8] * 5000}
    runs = [small_run("td3", long, seed=seed, **SHORT) for seed in range(15)]
    assert sum(len(run.model_dump_json()) for run in runs) > 2**17
    for run in runs:
        results.create("run", run.id, run.model_dump(mode="json")).finish({})
    events = list(Local(results, 1).train(runs))
    assert events == [Finished(run.id) for run in runs]


@pytest.mark.slow
def test_interrupt_during_start_of_worker_ends_worker(tmp_path):
    arguments = ("train", "--algo", "td3", "--set", "hidden_layers=[8]", "--seeds", "0")
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, *arguments, "--results", tmp_path],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        # Otherwise this waits for a training of five million control steps.
        _, printed = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode == 130
    assert printed.splitlines()[-1].startswith(("Stopped. Of 1 run, 0 are", "Stopped. No run has"))
    assert "Traceback" not in printed


def test_failed_runs_are_retried_only_with_option(tmp_path, capsys, monkeypatch):
    results, asked = Results(tmp_path), []
    monkeypatch.setattr("jbench.sweeps.scheduler.forecasts", lambda *_: [])
    monkeypatch.setattr(
        "jbench.sweeps.scheduler._Scheduler.train", lambda _, runs: asked.append(runs) or {}
    )
    arguments = ["train", "--seeds", "0-1", "--results", str(tmp_path)]
    assert main(arguments) == ElsewhereError.exit_code  # nothing is trained here
    ((failed, new),) = asked
    results.create("run", failed.id, failed.model_dump(mode="json")).fail("out of luck")
    capsys.readouterr()
    assert main(arguments) == 1
    printed = capsys.readouterr()
    assert f"The run {failed.id} failed before: out of luck\n" in printed.out
    assert printed.err == "Error: 1 of 2 runs failed; --retry-failed tries again.\n"
    # The run remains failed, because nothing is trained here.
    assert main([*arguments, "--retry-failed"]) == 1
    assert "1 run failed before; trying again." in capsys.readouterr().out
    assert asked[1:] == [[new], [failed, new]]


def test_run_that_must_fail_again_is_not_retried(tmp_path, capsys, monkeypatch):
    results, asked = Results(tmp_path), []
    monkeypatch.setattr("jbench.sweeps.scheduler.forecasts", lambda *_: [])
    monkeypatch.setattr(
        "jbench.sweeps.scheduler._Scheduler.train", lambda _, runs: asked.extend(runs) or {}
    )
    arguments = ["train", "--seeds", "0-1", "--retry-failed", "--results", str(tmp_path)]
    assert main(arguments) == ElsewhereError.exit_code  # nothing is trained here
    diverged, other = asked
    sentence = "The agent diverged: its weights are not finite at control step 7."
    for run, made_on in ((diverged, {}), (other, {"processor": "another one"})):
        record = results.create("run", run.id, run.model_dump(mode="json"), made_on)
        record.fail(sentence, {"diverged": {"update": None, "control_steps": 7, "what": "weights"}})
    asked.clear()
    capsys.readouterr()
    assert main(arguments) == 1
    assert asked == [other]
    printed = capsys.readouterr().out
    assert "1 run of these would fail again: the same numbers, code and machine" in printed
    assert "1 run failed before; trying again." in printed
