"""Tests of `jbench sweep`: new, failed, interrupted and concurrent sweeps.

Sweeps that are started as processes have short episodes.
"""

import json
import os
import signal
from functools import partial

import pytest

from jbench.cli import main
from jbench.commands.stopped import stopped_runs
from jbench.errors import RequestError
from jbench.store import Results
from jbench.sweeps import executors
from jbench.training import request
from tests import sweep_matrices
from tests.command_line import SHORT, jbench, wait_until
from tests.short_episodes import shorten_episodes
from tests.sweep_matrices import (
    committed,
    end_all,
    ended,
    held,
    rows,
    runs_of_matrix,
    start,
    states,
    workers,
)

write_matrix = partial(sweep_matrices.write_matrix, steps=3 * SHORT, dataset=3 * SHORT)


@pytest.fixture(autouse=True)
def no_process_left():
    yield
    end_all()


@pytest.fixture
def results(tmp_path):
    return tmp_path / "results"


@pytest.fixture
def short(monkeypatch):
    """Allows short runs and datasets in this process too, as it reads the matrix."""
    shorten_episodes(monkeypatch.setattr, SHORT)


def sweep(matrix, results, *arguments):
    return jbench("sweep", matrix, *arguments, results=results, short=True)


def kill(pid):
    os.kill(pid, signal.SIGKILL)


@pytest.mark.usefixtures("short", "brief_measurements")
def test_sweep_makes_prerequisites_and_repeating_it_changes_nothing(tmp_path, results, run_command):
    matrix = write_matrix(tmp_path, representations='"full", "pca3"', seeds="0")
    done = sweep(matrix, results, "--json")
    assert done.returncode == 0
    document = json.loads(done.stdout)
    assert [cell["finished"] for cell in document["configurations"]] == [1, 1]
    assert (document["failures"], document["made_first"]) == ({}, [])
    assert "2 of 2 runs ended" in done.stderr
    runs = runs_of_matrix(matrix, results)
    assert [id for cell in document["configurations"] for id in cell["runs"]] == [
        run.id for run in runs
    ]
    assert states(runs, results) == ["finished"] * 2

    before = {path: path.read_bytes() for path in results.rglob("manifest.json")}
    code, printed, _ = run_command("sweep", matrix, results=results)
    assert code == 0
    assert "2 of 2 runs are already finished; nothing to do." in printed
    # The forecast of more runs is based on a measurement of this machine, not on its records.
    more = ("--seeds", "0-1", "--dry-run", "--json")
    code, printed, _ = run_command("sweep", matrix, *more, results=results)
    assert code == 0
    assert {path: path.read_bytes() for path in results.rglob("manifest.json")} == before
    cells = json.loads(printed)["configurations"]
    assert [(cell["finished"], cell["missing"], cell["estimate"]) for cell in cells] == [
        (1, 1, "a quick measurement")
    ] * 2
    assert run_command("verify", results=results)[0] == 0


@pytest.mark.usefixtures("short", "short_encoder_evaluation")
def test_failed_run_stops_no_other_and_is_retried_by_option(tmp_path, results):
    matrix = write_matrix(tmp_path, representations='"pca3", "full"', seeds="0")
    encoded, full = runs_of_matrix(matrix, results)
    where = ("--results", str(results))
    assert main(["collect", "--steps", str(3 * SHORT), *where]) == 0
    assert main(["train-encoder", "--kind", "pca", "--latent", "3", *where]) == 0
    (weights,) = results.rglob("encoder.safetensors")
    whole = weights.read_bytes()
    weights.write_bytes(whole[:-1])

    done = sweep(matrix, results)
    assert done.returncode == 1
    assert f"Warning: the run {encoded.id} failed: " in done.stderr
    assert "1 of 2 runs failed; --retry-failed tries again." in done.stderr
    assert states([encoded, full], results) == ["failed", "finished"]
    assert "is damaged" in Results(results).find("run", encoded.id).manifest.summary["error"]

    weights.write_bytes(whole)
    done = sweep(matrix, results, "--json")
    assert done.returncode == 1
    assert "1 run failed before; --retry-failed tries again." in done.stderr
    assert list(json.loads(done.stdout)["failures"]) == [encoded.id]
    assert states([encoded], results) == ["failed"]
    assert sweep(matrix, results, "--retry-failed").returncode == 0
    assert states([encoded, full], results) == ["finished"] * 2


@pytest.mark.usefixtures("short", "short_encoder_evaluation")
def test_encoders_are_trained_on_requested_device(tmp_path, results, monkeypatch):
    matrix = write_matrix(tmp_path, representations='"pca3"', seeds="0")
    # This torch may have no CUDA: computing there would fail.
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    monkeypatch.setattr("jbench.sweeps.scheduler.forecasts", lambda *_: [])
    monkeypatch.setattr("jbench.sweeps.scheduler._Scheduler.train", lambda *_: {})
    assert main(["sweep", matrix, "--device", "cpu", "--results", str(results)]) == 0
    (encoder,) = Results(results).scan("encoder")[0]
    assert (encoder.status, encoder.manifest.summary["device"]) == ("finished", "cpu")


@pytest.mark.slow
def test_sweep_stopped_by_ctrl_c_resumes(tmp_path, results):
    matrix = write_matrix(tmp_path, steps=100 * SHORT, seeds="0")
    (run,) = runs_of_matrix(matrix, results)
    nothing = "No run has begun yet; the same command begins again."
    assert stopped_runs([run], Results(results)) == nothing
    process = start(matrix, "--checkpoint-every", "0", results=results)
    wait_until(lambda: committed(run, results), process)
    (pid,) = workers(process)
    os.kill(pid, signal.SIGSTOP)  # so that the run cannot finish
    os.killpg(process.pid, signal.SIGINT)
    printed = ended(process)
    assert process.returncode == 130
    kept = "Stopped. Of 1 run, 0 are finished and 1 begun; the same command continues it from its"
    assert f"{kept} last checkpoint." in printed
    assert "Traceback" not in printed
    assert (held([run], results), states([run], results)) == ([], ["unfinished"])
    again = start(matrix, results=results)
    printed = ended(again)
    assert again.returncode == 0
    assert f"{run.id} was interrupted or failed; it resumes at control step" in printed
    assert committed(run, results) == 100


@pytest.mark.slow
def test_killed_worker_is_restarted_limited_number_of_times(tmp_path, results):
    matrix = write_matrix(tmp_path, seeds="0-1", steps=100 * SHORT)
    runs = runs_of_matrix(matrix, results)
    process = start(matrix, "--jobs", "1", results=results)
    killed = set()
    for _ in range(3):
        (pid,) = wait_until(lambda: set(workers(process)) - killed, process)
        killed.add(pid)
        kill(pid)
    printed = ended(process)
    assert process.returncode == 1
    assert printed.count("The process of seeds 0, 1 of td3 face_direction full died") == 2
    assert "each is tried again in a process of its own" in printed
    assert "1 of 2 runs failed" in printed
    assert states(runs, results) == ["failed", "finished"]
    process = start(matrix, "--jobs", "1", "--retry-failed", results=results)
    (pid,) = wait_until(lambda: held(runs, results) and workers(process), process)
    kill(pid)
    printed = ended(process)
    assert process.returncode == 0
    assert "it is tried again" in printed
    assert states(runs, results) == ["finished"] * 2


@pytest.mark.slow
def test_second_sweep_takes_over_runs_of_killed_sweep(tmp_path, results):
    matrix = write_matrix(tmp_path, algos='"td3", "ppo"', seeds="0", steps=100 * SHORT)
    td3, ppo = runs = runs_of_matrix(matrix, results)
    first = start(matrix, "--jobs", "1", results=results)
    wait_until(lambda: held([td3], results), first)
    (pid,) = workers(first)
    os.kill(pid, signal.SIGSTOP)  # it still holds its run
    second = start(matrix, "--jobs", "1", results=results)
    wait_until(lambda: states([ppo], results) == ["finished"], second)
    assert held([td3], results) == [td3]
    assert states([td3], results) != ["finished"]
    for process in (first.pid, pid):
        kill(process)
    first.communicate()
    printed = ended(second)
    assert second.returncode == 0
    assert "Another process is training seed 0 of td3 face_direction full; it is wai" in printed
    assert states(runs, results) == ["finished"] * 2
    # The rows equal those of a single sweep.
    alone = tmp_path / "alone"
    assert sweep(matrix, alone).returncode == 0
    assert rows(runs, results) == rows(runs, alone)


@pytest.mark.usefixtures("short")
@pytest.mark.slow
def test_two_concurrent_sweeps_finish_all_runs(tmp_path, results):
    matrix = write_matrix(tmp_path, representations='"full", "pca3"')
    runs = runs_of_matrix(matrix, results)
    both = [start(matrix, "--jobs", "1", results=results) for _ in range(2)]
    printed = [ended(process) for process in both]
    assert [process.returncode for process in both] == [0, 0], printed
    assert states(runs, results) == ["finished"] * 4
    assert [committed(run, results) for run in runs] == [3] * 4


@pytest.mark.parametrize(("jobs", "processes"), [("0", 1), ("3", 3)])
@pytest.mark.parametrize("command", [("train",), ("sweep", "smoke")])
def test_gpu_has_one_process_unless_jobs_are_given(command, jobs, processes, results, monkeypatch):
    given = []

    def local(database, at_a_time, device, **options):
        given.append((at_a_time, device))
        raise RequestError("Nothing is trained here.")

    monkeypatch.setattr(request, "training_device", lambda *_: "cuda")
    monkeypatch.setattr(executors, "Local", local)
    assert main([*command, "--jobs", jobs, "--results", str(results)]) == 2
    assert given == [(processes, "cuda")]
