"""Tests of merging results directories: records are copied, conflicting content is refused."""

import contextlib
import math
import random
import signal
import time

import pyarrow as pa
import pytest

from jbench.errors import RequestError
from jbench.names import POLICY_FILES
from jbench.store import Results, files, schema
from jbench.store import merge as merging
from jbench.store.merge import merge
from jbench.store.schema import TIMES
from jbench.store.verify import verify
from tests.store.store_faults import Script
from tests.store.store_rows import (
    RUN_SETTINGS,
    alter_manifest,
    episodes,
    listed,
    manifest_of,
    names,
)
from tests.store.store_whole import add, add_chain, add_whole_run, snapshot
from tests.store.test_damage import truncate


@pytest.fixture
def other(tmp_path):
    return Results(tmp_path / "other")


def outcomes(results, *sources):
    return {one.record.split(" ")[1]: one.outcome for one in merge(results, sources)}


def add_timed(results, returns, seconds, finish=True, **columns):
    """A run whose episodes took `seconds` each, with the values of `columns` in every row."""
    rows = [
        {**row, **dict.fromkeys(TIMES, seconds * (row["episode"] + 1)), **columns}
        for row in episodes("r", returns).to_pylist()
    ]
    tables = {"episodes": lambda id: pa.Table.from_pylist(rows, schema.EPISODES)}
    files = {"policy.json": b"{}"}
    return add(results, "run", "face_direction/ddpg/full", RUN_SETTINGS, tables, files, finish)


def returns_of(results, id):
    return results.find("run", id).read("episodes")["episode_return"].to_pylist()


def test_records_of_all_kinds_are_copied_byte_for_byte(results, other):
    records = add_chain(other)
    mine = add_whole_run(results, seed=3)
    before = snapshot(other.path)
    assert outcomes(results, other) == dict.fromkeys((r.id for r in records), "copied")
    assert snapshot(other.path) == before
    merged = snapshot(results.path)
    assert {path: merged[path] for path in before} == before
    assert outcomes(results, other) == dict.fromkeys((r.id for r in records), "same")
    assert snapshot(results.path) == merged
    assert results.find("run", mine.id) is not None
    found = verify(results, 2)
    assert (found.records, found.findings) == (5, [])


def test_runs_that_differ_only_in_time_are_same(results, other):
    mine, theirs = add_timed(results, [1.0, 2.0], 3.0), add_timed(other, [1.0, 2.0], 5.0)
    assert mine.manifest.files != theirs.manifest.files
    before = snapshot(results.path)
    assert outcomes(results, other) == {mine.id: "same"}
    before[f"runs/{mine.id}/lock"] = b""
    assert snapshot(results.path) == before


def test_runs_that_differ_only_in_file_layout_and_paths_are_same(results, other):
    mine = add_timed(results, [1.0, 2.0, 3.0], 3.0)
    theirs = other.create("run", mine.id, mine.settings)
    rows = mine.read("episodes")
    for first, count in ((0, 1), (1, 0), (1, 2)):
        theirs.append({"episodes": rows.slice(first, count)})
    path = {"run": mine.id, "evaluation": 0, "control_steps": 1000, "x": 0.5}
    theirs.append({"paths": pa.Table.from_pylist([path], schema.PATHS)})
    theirs.finish({}, {"policy.json": b"{}"}, join=False)
    assert len(theirs.parts("episodes")) == 2
    assert outcomes(results, other) == {mine.id: "same"}


@pytest.mark.parametrize("is_source_split", [True, False])
def test_rows_of_later_files_are_compared_whatever_the_layout(
    results, other, is_source_split, tmp_path
):
    whole, split = (results, other) if is_source_split else (other, results)
    run = add_timed(whole, [1.0, 2.0, 3.0], 3.0)
    rows = add_timed(Results(tmp_path / "changed"), [1.0, 2.0, 2.5], 3.0).read("episodes")
    changed = split.create("run", run.id, run.settings)
    for first, count in ((0, 1), (1, 2)):
        changed.append({"episodes": rows.slice(first, count)})
    changed.finish({}, {"policy.json": b"{}"}, join=False)
    assert len(changed.parts("episodes")) == 2
    (one,) = merge(results, [other])
    assert (one.outcome, "episode_return of episodes" in one.reason) == ("refused", True)


def test_nan_equals_nan_and_differs_from_null(results, other):
    mine = add_timed(results, [1.0], 3.0, actor_loss=math.nan)
    add_timed(other, [1.0], 5.0, actor_loss=math.nan)
    assert outcomes(results, other) == {mine.id: "same"}
    again = Results(other.path.parent / "again")
    add_timed(again, [1.0], 5.0, actor_loss=None)
    (one,) = merge(results, [again])
    assert (one.outcome, "actor_loss of episodes" in one.reason) == ("refused", True)


@pytest.mark.parametrize(
    ("returns", "says"),
    [
        ([1.0, 2.5, 3.0], "episode_return of episodes"),
        ([1.0, 2.0, 3.0, 4.0], "another number of rows"),
        ([1.0, 2.0], "another number of rows"),
    ],
)
def test_run_with_conflicting_rows_is_refused_and_others_are_merged(results, other, returns, says):
    mine = add_timed(results, [1.0, 2.0, 3.0], 3.0)
    theirs = add_timed(other, returns, 3.0)
    more = add_whole_run(other, seed=7)
    before, source = snapshot(results.path), snapshot(other.path)
    merged = merge(results, [other])
    assert {one.outcome for one in merged if more.id in one.record} == {"copied"}
    (refused,) = (one for one in merged if one.outcome == "refused")
    assert refused.record == f"run {mine.id}"
    assert refused.reason == (
        f"{theirs.path} has the settings of {mine.path}, but other content ({says}); neither is "
        "changed."
    )
    after = snapshot(results.path)
    assert {path: after[path] for path in before} == before
    assert snapshot(other.path) == source


def test_what_was_made_of_another_encoder_of_the_same_id_is_refused(results, other):
    """Else one curve would join agents of both encoders, and call the encoders one."""
    mine, encoder, run, _ = add_chain(results)
    add_chain(other)
    theirs = other.create("encoder", encoder.id, encoder.settings)
    theirs.finish({}, {"encoder.json": b"{ }"})
    agent = add_whole_run(other, representation="dae12", encoder=encoder.id, seed=5)
    settings = {"task": "face_direction", "policy": agent.id, "seed": 0}
    evaluation = add(other, "evaluation", "face_direction/agent", settings)
    plain = add_whole_run(other, seed=5)

    before = snapshot(results.path)
    merged = merge(results, [other])
    found = {one.record.split(" ")[1]: one.outcome for one in merged}
    assert {id for id, outcome in found.items() if outcome == "refused"} == {
        encoder.id,
        agent.id,
        evaluation.id,
    }
    assert (found[mine.id], found[run.id], found[plain.id]) == ("same", "same", "copied")
    (reason,) = (one.reason for one in merged if one.record == f"run {agent.id}")
    assert f"was made with another encoder {encoder.id} than that of {results.path}" in reason
    after = snapshot(results.path)
    assert {path: after[path] for path in before} == before
    # Without an encoder of that id, all are copied.
    empty = Results(other.path.parent / "empty")
    assert {*outcomes(empty, other).values()} == {"copied"}


def test_run_with_conflicting_policy_is_refused(results, other):
    mine = add_whole_run(results)
    theirs = other.create("run", mine.id, mine.settings)
    theirs.append({"episodes": mine.read("episodes")})
    theirs.finish({}, {"policy.json": b"[]"})
    (one,) = merge(results, [other])
    assert (one.outcome, "(in policy.json)" in one.reason) == ("refused", True)


def test_policy_in_the_format_of_an_older_version_is_no_conflict(results, other):
    mine = add_whole_run(results)
    theirs = other.create("run", mine.id, mine.settings)
    theirs.append({"episodes": mine.read("episodes")})
    weights = {"policy.safetensors": b"same weights by other names"}
    theirs.finish({}, {"policy.json": b'{"network": []}', **weights})
    older = Results(other.path.parent / "older")
    run = older.create("run", mine.id, mine.settings)
    run.append({"episodes": mine.read("episodes")})
    run.finish({}, {"policy.json": b'{"layers": 1}', "policy.safetensors": b"weights"})
    assert outcomes(older, other) == {mine.id: "same"}


@pytest.mark.parametrize(("with_policy", "outcome"), [("mine", "kept"), ("theirs", "replaced")])
def test_copy_with_the_policy_wins_over_one_without(results, other, with_policy, outcome):
    """A wheel leaves out most policies of the shipped runs, and a checkout has them."""
    policy = dict.fromkeys(POLICY_FILES, b"same")
    mine = add_timed(results, [1.0, 2.0], 3.0, finish=False)
    theirs = add_timed(other, [1.0, 2.0], 3.0, finish=False)
    mine.finish({}, policy if with_policy == "mine" else {})
    theirs.finish({}, policy if with_policy == "theirs" else {})
    assert outcomes(results, other) == {mine.id: outcome}
    kept = {entry.name for entry in results.find("run", mine.id).manifest.files}
    assert kept >= {*POLICY_FILES}


def test_finished_run_replaces_unfinished_run_which_is_set_aside(results, other):
    mine = add_whole_run(results, [1.0, 2.0], finish=False)
    theirs = add_whole_run(other, [1.0, 2.5, 4.0])
    before = snapshot(mine.path)
    assert outcomes(results, other) == {mine.id: "replaced"}
    assert returns_of(results, mine.id) == [1.0, 2.5, 4.0]
    assert manifest_of(mine) == manifest_of(theirs)
    (folder,) = (results.path / "set-aside").iterdir()
    assert snapshot(folder / "runs" / mine.id) == before
    assert verify(results, 2).findings == []


class _KilledError(BaseException):
    """In place of a kill."""


@pytest.mark.parametrize("moves", [0, 1, 2, 3])
def test_run_that_is_half_set_aside_loses_nothing(moves, results, other, monkeypatch):
    """The next writer of the record removes files that no manifest lists."""
    mine = add_whole_run(results, [1.0, 2.0], finish=False)
    mine.append({}, {"checkpoint.safetensors": b"state"})
    add_whole_run(other, [1.0, 2.5, 4.0])
    before = snapshot(mine.path)
    move = files.move
    moved = []

    def move_or_die(path, to):
        if len(moved) == moves:
            raise _KilledError
        moved.append(path)
        move(path, to)

    monkeypatch.setattr(files, "move", move_or_die)
    with contextlib.suppress(_KilledError):
        merge(results, [other])
    assert len(before) == 3
    assert len(moved) == moves
    monkeypatch.setattr(files, "move", move)
    assert len(outcomes(results, other)) == 1
    assert returns_of(results, mine.id) == [1.0, 2.5, 4.0]
    kept = snapshot(results.path / "set-aside").values()
    assert {*before.values()} == {*kept}
    assert verify(results, 2).findings == []


def test_unfinished_or_failed_run_never_replaces_finished_run(results, other):
    mine = add_whole_run(results)
    theirs = add_whole_run(other, [1.0], finish=False)
    for _ in range(2):
        assert outcomes(results, other) == {mine.id: "kept"}
        theirs.fail("it diverged")
    assert returns_of(results, mine.id) == [10.0, 20.0, 60.0]


def test_longer_of_two_unfinished_runs_is_kept(results, other):
    mine = add_whole_run(results, [1.0, 2.0], finish=False)
    theirs = add_whole_run(other, [1.0, 2.0, 3.0], finish=False)
    add_whole_run(again := Results(other.path.parent / "again"), [1.0, 2.5, 3.0], finish=False)
    assert outcomes(results, again) == {mine.id: "refused"}
    assert outcomes(other, results) == {mine.id: "kept"}
    assert outcomes(results, other) == {mine.id: "replaced"}
    assert returns_of(results, mine.id) == returns_of(other, theirs.id) == [1.0, 2.0, 3.0]


def add_evaluated(results, episode_count, evaluation_count):
    """An unfinished run with as many episodes, and evaluations of one episode each."""
    evaluations = [
        {"run": "r", "evaluation": number, "control_steps": 1000 * (number + 1)}
        for number in range(evaluation_count)
    ]
    tables = {
        "episodes": lambda id: episodes(id, [1.0] * episode_count),
        "evaluations": lambda id: pa.Table.from_pylist(evaluations, schema.EVALUATIONS),
    }
    return add(results, "run", "face_direction/ddpg/full", RUN_SETTINGS, tables, finish=False)


@pytest.mark.parametrize(
    ("mine", "theirs", "outcome"),
    [
        ((3, 1), (2, 1), "kept"),
        ((2, 1), (3, 1), "replaced"),
        ((2, 2), (2, 1), "kept"),
        ((3, 1), (2, 2), "refused"),
    ],
)
def test_unfinished_run_with_more_rows_of_one_table_is_kept(results, other, mine, theirs, outcome):
    run = add_evaluated(results, *mine)
    add_evaluated(other, *theirs)
    (one,) = merge(results, [other])
    assert one.outcome == outcome
    assert ("(each has rows that the other has not)" in one.reason) == (outcome == "refused")
    expected = theirs if outcome == "replaced" else mine
    kept = results.find("run", run.id)
    assert (kept.rows("episodes"), kept.rows("evaluations")) == expected


def test_record_with_invalid_manifest_or_wrong_id_is_refused(results, other):
    broken, newer, renamed, cut = (add_whole_run(other, seed=seed) for seed in range(4))
    truncate(cut.path / "policy.json")
    (broken.path / "manifest.json").write_bytes(b"{")
    alter_manifest(newer, schema_version=7)
    alter_manifest(renamed, settings={"seed": 5})
    reasons = [one.reason for one in merge(results, [other]) if one.outcome == "refused"]
    for says in ("not a manifest", "version 7", "not those that its id", "1 bytes, not 2"):
        assert sum(says in reason for reason in reasons) == 1
    assert results.scan("run") == ([], [])


def test_damaged_or_locked_record_in_target_is_kept_and_reported(results, other):
    damaged = add_whole_run(results)
    (damaged.path / "manifest.json").write_bytes(b"{")
    locked = add_whole_run(results, finish=False, seed=1)
    for seed in (0, 1):
        add_whole_run(other, seed=seed)
    with locked.folder.lock():
        one, two = merge(results, [other])
    assert (one.outcome, "not a manifest" in one.reason) == ("refused", True)
    assert (damaged.path / "manifest.json").read_bytes() == b"{"
    assert two.reason.startswith(f"Another process is writing the run {locked.id};")
    assert results.find("run", locked.id).status == "unfinished"


def test_run_of_source_whose_files_are_joined_meanwhile_is_copied(results, other, monkeypatch):
    run = add_whole_run(other, [1.0], finish=False)
    run.append({"episodes": episodes(run.id, [1.0, 2.0]).slice(1)})
    before = merging.examine(other, "run", run.id)
    run.finish({})
    (run.path / "stray.json").write_bytes(b"listed by no manifest")
    monkeypatch.setattr(merging, "examine", lambda *_: before)
    assert outcomes(results, other) == {run.id: "copied"}
    assert results.find("run", run.id).status == "finished"
    assert verify(results, 1).findings == []


def test_file_of_a_source_that_no_manifest_lists_is_not_copied(results, other):
    run = add_whole_run(other)
    (run.path / "stray.json").write_bytes(b"left by a kill")
    assert outcomes(results, other) == {run.id: "copied"}
    merged = results.find("run", run.id)
    assert names(merged.path) == {*listed(merged), "manifest.json", "lock"}


def test_source_without_results_or_equal_to_target_is_refused(tmp_path, results):
    add_whole_run(results)
    (tmp_path / "empty").mkdir()
    for path in (tmp_path / "missing", tmp_path / "empty"):
        with pytest.raises(RequestError, match="holds no results; name a directory with datasets"):
            merge(results, [Results(path)])
    (tmp_path / "link").symlink_to(results.path)
    for path in (results.path, tmp_path / "link"):
        with pytest.raises(RequestError, match="is the results directory itself"):
            merge(results, [Results(path)])


MERGING = """
from contextlib import nullcontext
from jbench.store.merge import merge
show = lambda done: print(done, flush=True)
merge(results, [Results(Path(sys.argv[2]))], lambda total: nullcontext(show))
"""


@pytest.mark.slow
def test_killed_merge_is_completed_by_next_merge(results, other):
    for seed in range(12):
        add_whole_run(other, seed=seed)
    source = snapshot(other.path)
    for kill in range(4):
        with Script(results, MERGING, other.path) as process:
            for done in range(1, 2 + 2 * kill):
                assert int(process.stdout.readline()) == done
            time.sleep(random.Random(kill).uniform(0, 0.02))
            process.send_signal(signal.SIGKILL)
        # Committed records are intact; only leftover files may be found.
        assert {f.sort for f in verify(results, 2).findings} <= {"leftover"}
    merge(results, [other])
    merged = snapshot(results.path)
    assert {path: text for path, text in merged.items() if not path.endswith("lock")} == source
    assert snapshot(other.path) == source
