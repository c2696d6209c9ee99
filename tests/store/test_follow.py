"""Tests that a follower yields each committed row once, also when files are compacted meanwhile."""

import pyarrow as pa

from jbench.store import schema
from jbench.store.follow import Follower
from tests.store.store_rows import episodes, listed
from tests.store.store_whole import add_whole_run, restart
from tests.store.test_damage import truncate


def append(record, *returns, first):
    """Commits episodes that follow the first ones."""
    rows = episodes(record.id, [0.0] * first + list(returns)).slice(first)
    record.append({"episodes": rows})


def returns_of(follower):
    return [
        row["episode_return"]
        for change in follower.changes()
        for table, row in change.rows
        if table == "episodes"
    ]


def test_each_row_is_yielded_once_despite_compaction(results):
    run = add_whole_run(results, [1.0, 2.0], finish=False)
    follower = Follower(results, {})
    assert returns_of(follower) == [1, 2]
    assert list(follower.changes()) == []
    append(run, 3.0, first=2)
    append(run, 4.0, float("nan"), first=3)
    assert returns_of(follower) == [3, 4, None]
    before = listed(run)
    run.finish({"wall_time": 1.0})
    assert len(before) == 3
    assert len(listed(run)) == 1
    (change,) = follower.changes()
    assert (change.rows, change.is_new, change.status_changed) == ([], False, True)
    assert change.record.status == "finished"


def test_rows_committed_and_compacted_between_looks_are_yielded(results):
    run = add_whole_run(results, [1.0], finish=False)
    follower = Follower(results, {})
    assert returns_of(follower) == [1]
    append(run, 2.0, first=1)
    run.finish({"wall_time": 1.0})
    (change,) = follower.changes()
    assert [row["episode_return"] for _, row in change.rows] == [2]
    assert change.status_changed


def test_restarted_run_is_new_and_its_rows_are_yielded(results):
    run = add_whole_run(results, [1.0, 2.0], finish=False)
    follower = Follower(results, {})
    assert returns_of(follower) == [1, 2]
    restart(run)
    append(run, 5.0, 6.0, first=0)
    (change,) = follower.changes()
    assert change.is_new
    assert [row["episode_return"] for _, row in change.rows] == [5, 6]


def test_only_matching_runs_are_followed_until_finished(results):
    run = add_whole_run(results, [1.0], finish=False)
    add_whole_run(results, [7.0], seed=1)
    follower = Follower(results, {"status": ["unfinished"]})
    assert returns_of(follower) == [1]
    append(run, 2.0, first=1)
    run.finish({})
    assert returns_of(follower) == [2]


def test_damaged_run_is_reported_once_and_others_are_followed(results):
    damaged = add_whole_run(results, [1.0])
    truncate(damaged.path / listed(damaged)[0])
    other = add_whole_run(results, [2.0], finish=False, seed=1)
    follower = Follower(results, {})
    sentence, change = follower.changes()
    assert damaged.id in sentence
    assert change.record.id == other.id
    append(other, 3.0, first=1)
    assert returns_of(follower) == [3]


def test_evaluation_is_yielded_after_episodes_that_precede_it(results):
    run = add_whole_run(results, [1.0, 2.0, 3.0], finish=False)
    row = {"run": run.id, "evaluation": 0, "control_steps": 2000, "episode": 0}
    row["episode_return"] = 9.0
    row["length"] = 1000
    row["wall_time"] = 1.0
    run.append({"evaluations": pa.Table.from_pylist([row], schema.EVALUATIONS)})
    (change,) = Follower(results, {}).changes()
    assert [row["episode_return"] for _, row in change.rows] == [1, 2, 9, 3]
