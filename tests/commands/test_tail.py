"""Tests of `jbench tail`, and of `--log`, which copies rows to an experiment tracker."""

import json
import signal
import subprocess

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from jbench.cli import main
from jbench.store import Results
from tests.command_line import INTERRUPTIBLE, succeed, train, wait_until
from tests.store.store_rows import listed
from tests.store.store_whole import add_whole_run


def test_tail_prints_each_committed_row_until_ctrl_c(tmp_path):
    out = tmp_path / "rows.jsonl"
    (tmp_path / "results").mkdir()
    with out.open("w") as stdout:
        tail = subprocess.Popen(
            [*INTERRUPTIBLE, "tail", "--json", "--results", str(tmp_path / "results")],
            stdout=stdout,
            stderr=subprocess.PIPE,
            text=True,
        )
    training = train("td3", "none", "--log", "tensorboard", "--steps", "200")
    succeed(*training, results=tmp_path / "results", short=True)
    runs = Results(tmp_path / "results").scan("run")[0]
    wait_until(lambda: out.read_text().count('"finished"') == len(runs), tail)
    tail.send_signal(signal.SIGINT)
    assert tail.communicate(timeout=60)[1] == ""
    assert tail.returncode == 0
    lines = [json.loads(line) for line in out.read_text().splitlines()]
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


def tail(results, *arguments):
    return main(["tail", "--once", *arguments, "--results", str(results.path)])


def test_tail_prints_line_per_episode_and_final_status(results, capsys):
    assert tail(results, "--algo", "ddpg", "--last", "2") == 0
    (run,) = (run.id for run in results.scan("run")[0] if run.settings["algo"] == "ddpg")
    assert capsys.readouterr().out.splitlines() == [
        f"{run}: episode 1, return 20.0, 2,000 control steps, 4 s",
        f"{run}: episode 2, return 60.0, 3,000 control steps, 6 s",
        f"{run}: finished",
    ]
    assert tail(results, "--status", "unfinished") == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.endswith(": episode 0, return 5.0, 1,000 control steps, 2 s")


def test_tail_says_that_no_run_matches(results, capsys):
    assert tail(results, "--algo", "ppo") == 0
    assert capsys.readouterr().out == f"No such runs in {results.path}.\n"
    assert tail(results, "--algo", "ppo", "--json") == 0
    assert capsys.readouterr() == ("", f"No such runs in {results.path}.\n")


def test_damaged_run_is_reported_and_others_are_printed(results, capsys):
    damaged = results.scan("run")[0][0]
    path = damaged.path / listed(damaged)[0]
    path.write_bytes(path.read_bytes()[:-1])
    assert tail(results) == 1
    printed = capsys.readouterr()
    assert "sac" in printed.out
    assert damaged.id not in printed.out
    assert damaged.id in printed.err
    assert "1 run is damaged" in printed.err


def test_missing_library_is_reported_before_training(tmp_path, refused, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "torch.utils.tensorboard", None)
    arguments = ("train", "--log", "tensorboard", "--seeds", "0")
    error = refused(*arguments, results=tmp_path / "results")
    assert "type pip install 'jbench[tensorboard]'" in error
    assert not (tmp_path / "results" / "runs").exists()
