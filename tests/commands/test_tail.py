"""Tests of `jbench tail`, and of `--log`, which copies rows to an experiment tracker."""

import json
import signal
from functools import partial

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from jbench.store import Results
from tests.command_line import start, succeed, train, wait_until
from tests.store.store_rows import listed
from tests.store.store_whole import add_whole_run


def test_tail_prints_each_committed_row_until_ctrl_c(tmp_path):
    (tmp_path / "results").mkdir()
    tail = start("tail", "--json", results=tmp_path / "results")
    waiting = f"No such runs in {tmp_path / 'results'} yet; they are printed here as they come.\n"
    wait_until(lambda: tail.said() == waiting, tail)
    training = train("td3", "none", "--log", "tensorboard", "--steps", "200")
    succeed(*training, results=tmp_path / "results", short=True)
    runs = Results(tmp_path / "results").scan("run")[0]
    assert len(runs) == 2
    wait_until(lambda: tail.printed().count('"finished"') == len(runs), tail)
    tail.send_signal(signal.SIGINT)
    printed, errors = tail.communicate(timeout=300)
    assert (tail.returncode, errors) == (0, waiting)
    lines = [json.loads(line) for line in printed.splitlines()]
    for run in runs:
        rows = [line for line in lines if line["run"] == run.id]
        for table in ("episodes", "evaluations"):
            committed = run.read(table).to_pylist()
            assert committed
            assert [row for row in rows if row["table"] == table] == [
                {"table": table, **row} for row in committed
            ]
        assert rows[0]["table"] == "runs"
        assert [row["status"] for row in rows if row["table"] == "runs"][-1] == "finished"
        events = EventAccumulator(str(tmp_path / "results" / "tensorboard" / run.id))
        events.Reload()
        logged = [event.value for event in events.Scalars("training/episode_return")]
        returns = run.read("episodes")["episode_return"].to_pylist()
        assert logged == pytest.approx(returns, rel=1e-6)  # float32


@pytest.fixture
def results(tmp_path):
    results = Results(tmp_path / "results")
    add_whole_run(results, [10.0, 20.0, 60.0])
    add_whole_run(results, [5.0], finish=False, seed=1, algo="sac")
    return results


@pytest.fixture
def tail(results, run_command):
    """Returns a function that prints what is committed: exit code, output, errors."""
    return partial(run_command, "tail", "--once", results=results.path)


def test_tail_prints_line_per_episode_and_final_status(results, tail):
    (run,) = (run.id for run in results.scan("run")[0] if run.settings["algo"] == "ddpg")
    code, out, _ = tail("--algo", "ddpg", "--last", "2")
    assert code == 0
    assert out.splitlines() == [
        f"{run}: episode 1, return 20.0, 2,000 control steps, 4 s",
        f"{run}: episode 2, return 60.0, 3,000 control steps, 6 s",
        f"{run}: finished",
    ]
    code, out, _ = tail("--status", "unfinished")
    assert code == 0
    assert out.endswith(": episode 0, return 5.0, 1,000 control steps, 2 s\n")
    nothing = f"No such runs in {results.path}.\n"
    assert tail("--algo", "ppo") == (0, nothing, "")
    assert tail("--algo", "ppo", "--json") == (0, "", nothing)


def test_damaged_run_is_reported_and_others_are_printed(results, tail):
    damaged = results.scan("run")[0][0]
    path = damaged.path / listed(damaged)[0]
    path.write_bytes(path.read_bytes()[:-1])
    code, out, err = tail()
    assert (code, "sac" in out, damaged.id in out, damaged.id in err) == (1, True, False, True)
    assert "1 run is left out" in err


def test_missing_library_is_reported_before_training(tmp_path, refused, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "torch.utils.tensorboard", None)
    arguments = ("train", "--log", "tensorboard", "--seeds", "0")
    error = refused(*arguments, results=tmp_path / "results")
    assert "type pip install 'jbench[tensorboard]'" in error
    assert not (tmp_path / "results" / "runs").exists()
