"""Tests of sweeps on a real Ray cluster of two local nodes, one of which is killed."""

import contextlib
import json
import os
import signal
from importlib.util import find_spec
from pathlib import Path

import pytest

from jbench.store.locks import LOCK
from tests.command_line import jbench, succeed, wait_until
from tests.documentation import code_of
from tests.sweep_matrices import (
    committed,
    end_all,
    held,
    rows,
    runs_of_matrix,
    start,
    states,
    workers,
    write_matrix,
)

# Ray takes a third of a second to import, in each process of pytest.
pytestmark = pytest.mark.skipif(find_spec("ray") is None, reason="Ray is not installed")

# A dead node is detected after seconds instead of half a minute.
IMPATIENT = {
    "health_check_initial_delay_ms": 0,
    "health_check_period_ms": 500,
    "health_check_failure_threshold": 5,
}
SMALL = {"num_cpus": 1, "object_store_memory": 80 * 1024 * 1024}


@pytest.fixture(autouse=True)
def no_process_left():
    yield
    end_all()


@pytest.fixture
def cluster(monkeypatch):
    """A cluster of two nodes with one core each; `nodes` are the head and the other node."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "1")
    # With their default niceness, Ray's workers starve beside other tests.
    monkeypatch.setenv("RAY_worker_niceness", "0")
    from ray.cluster_utils import Cluster

    head = {**SMALL, "include_dashboard": False, "_system_config": IMPATIENT}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    cluster.nodes = [cluster.head_node, cluster.add_node(**SMALL)]
    cluster.wait_for_nodes()
    yield cluster
    cluster.shutdown()


def raylet(node):
    """The process id of a node's raylet, the parent of its workers."""
    return node.all_processes["raylet"][0].process.pid


def run_in_progress(node, runs, path):
    """A run that a node trains and has committed an episode of, with its process id, or None."""
    for pid in workers(raylet(node)):
        opened = set()
        with contextlib.suppress(OSError):  # closed or ended meanwhile
            opened = {os.path.realpath(handle) for handle in Path(f"/proc/{pid}/fd").iterdir()}
        for run in runs:
            lock = os.path.realpath(path / "runs" / run.id / LOCK)
            if lock in opened and committed(run, path):
                return run, pid
    return None


@pytest.mark.slow
def test_sweep_with_killed_node_equals_local_sweep(cluster, tmp_path):
    results, local = tmp_path / "results", tmp_path / "local"
    matrix = write_matrix(tmp_path, seeds="0-1", steps=3000)
    runs = runs_of_matrix(matrix, results)
    where = ("--executor", "ray", "--address", cluster.address)
    options = ("--checkpoint-every", "0", "--json")
    process = start(matrix, *where, *options, results=results, short=False)
    head, other = cluster.nodes
    run, pid = wait_until(lambda: run_in_progress(other, runs, results), process)
    os.kill(pid, signal.SIGSTOP)  # it keeps the lock of its run but makes no progress
    assert (held([run], results), states([run], results)) == ([run], ["unfinished"])
    cluster.remove_node(other, allow_graceful=False)
    os.kill(pid, signal.SIGKILL)
    out, err = process.communicate(timeout=600)
    assert process.returncode == 0, err
    assert list(json.loads(out)["failures"]) == []
    assert states(runs, results) == ["finished"] * 2
    succeed("sweep", matrix, results=local)
    assert rows(runs, results) == rows(runs, local)
    assert head.any_processes_alive()


@pytest.mark.slow
def test_environments_that_fall_are_trained_on_a_cluster_as_here(cluster, tmp_path, monkeypatch):
    """One is of a module in the directory of the sweep, which is not that of the cluster."""
    (tmp_path / "sticks.py").write_text(code_of("your-own-robot.md", "python", "class Stick"))
    matrix = write_matrix(tmp_path, tasks='"sticks:stick", "gym:Pendulum-v1"', seeds="0")
    for more in ((), ("--executor", "ray", "--address", cluster.address)):
        results = tmp_path / ("ray" if more else "local")
        done = jbench("sweep", matrix, *more, results=results, cwd=tmp_path)
        assert done.returncode == 0, done.stderr

    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    runs = runs_of_matrix(matrix, tmp_path / "ray")
    assert [run.task for run in runs] == ["sticks:stick", "gym:Pendulum-v1"]
    assert rows(runs, tmp_path / "ray") == rows(runs, tmp_path / "local")


@pytest.mark.parametrize("address", ["127.0.0.1:1", "here", f"127.0.0.1:{10**20}"])
def test_missing_cluster_is_reported(address, tmp_path, run_command):
    more = ("--executor", "ray", "--address", address)
    code, _, err = run_command("sweep", write_matrix(tmp_path), *more, results=tmp_path / "results")
    assert f"No Ray cluster can be joined at {address} (" in err
    assert (code, err.count("\n")) == (2, 1)
