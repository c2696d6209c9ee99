"""Tests of the worker processes of `jbench train`: requests, interrupts and retries."""

import subprocess
import sys

import pytest

from jbench.cli import main
from jbench.store import Results
from jbench.sweeps.executors import Local
from jbench.training.events import Event
from jbench.training.status import plan
from tests.sweep_matrices import write_matrix
from tests.training.small_runs import small_run

TD3 = {"batch_size": 8, "learning_starts": 500, "train_freq": 100, "gradient_steps": 2}
SHORT = {"engine": "batched", "steps": 1000, "evaluate_every": 1000, "evaluate_episodes": 0}

# SIGINT is sent when the worker is started but not yet known to its parent. The worker must not
# handle it, not even before its first line.
INTERRUPTED = """
import os, signal, subprocess, sys, time
from jbench.cli import main
from jbench.sweeps import executors

start = subprocess.Popen

def popen(arguments, **more):
    process = start(arguments, **more)
    if "jbench.training.worker" in arguments:
        with open(f"/proc/{process.pid}/status") as status:
            (mask,) = (line.split()[1] for line in status if line.startswith("SigBlk:"))
        assert int(mask, 16) & 1 << signal.SIGINT - 1
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)
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
    assert events == [Event("finished", run.id) for run in runs]


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["train", "sweep"])
def test_interrupt_during_start_of_worker_ends_worker(verb, tmp_path):
    arguments = {
        "train": ("--algo", "td3", "--set", "hidden_layers=[8]"),
        "sweep": (write_matrix(tmp_path), "--steps", "5e6"),
    }[verb]
    process = subprocess.Popen(
        [
            sys.executable,
            "-c",
            INTERRUPTED,
            verb,
            *arguments,
            "--seeds",
            "0",
            "--results",
            tmp_path,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        # Otherwise this waits for a training of five million control steps.
        _, printed = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 1
    assert printed.splitlines()[-1].startswith("Stopped. The same command continues")
    assert "Traceback" not in printed


def test_failed_runs_are_retried_only_with_option(tmp_path, capsys, monkeypatch):
    results, asked = Results(tmp_path), []
    monkeypatch.setattr("jbench.sweeps.scheduler.forecasts", lambda *_: [])
    monkeypatch.setattr(
        "jbench.sweeps.scheduler._Scheduler.train", lambda _, runs: asked.append(runs) or {}
    )
    arguments = ["train", "--seeds", "0-3", "--results", str(tmp_path)]
    assert main(arguments) == 0
    (runs,) = asked
    finished, interrupted, failed, new = runs
    for run in (finished, interrupted, failed):
        results.create("run", run.id, run.model_dump(mode="json"))
    results.find("run", finished.id).finish({})
    results.find("run", failed.id).fail("out of luck")
    assert plan(runs, results).to_do(retry_failed=False) == [interrupted, new]
    capsys.readouterr()
    assert main(arguments) == 1
    printed = capsys.readouterr()
    assert asked[1:] == [[interrupted, new]]
    assert f"The run {failed.id} failed before: out of luck\n" in printed.out
    assert printed.err == "Error: 1 of 4 runs failed; --retry-failed tries again.\n"
    # The run remains failed, because nothing is trained here.
    assert main([*arguments, "--retry-failed"]) == 1
    assert asked[2:] == [[interrupted, failed, new]]
    assert "1 run failed before; trying again." in capsys.readouterr().out
