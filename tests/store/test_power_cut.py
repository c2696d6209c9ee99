"""Tests of power cuts: whatever a cut loses of a commit, a record is that before or after it."""

import os
import shutil
import sys
from collections import Counter

import pytest

from jbench.errors import WorkError
from jbench.settings.base import settings_hash
from jbench.store import Results, files
from jbench.store.merge import merge
from jbench.store.repair import repair
from jbench.store.verify import verify
from tests.store.power_cut import put, recorded, states
from tests.store.store_rows import RUN_SETTINGS, episodes
from tests.store.store_whole import add_whole_run, restart

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc/self/fd")

SAMPLE = 5  # states of each commit in `make test`
CHECKPOINT = "checkpoint.safetensors"


def run_of(results):
    (run,) = results.scan("run")[0]
    return run


def rows(*returns):
    return {"episodes": episodes("r", returns)}


def prepare_run(results):
    run = add_whole_run(results, (1.0, 2.0), finish=False)
    run.append(rows(3.0), {CHECKPOINT: b"first state"})


def prepare_nothing(results):
    results.path.mkdir()


def prepare_merge(results):
    """An unfinished run, which a finished one replaces, and a run that is new here."""
    add_whole_run(results, (1.0, 2.0), finish=False)
    other = Results(results.path.parent / "other")
    add_whole_run(other, (1.0, 2.0, 3.0))
    add_whole_run(other, (4.0,), seed=1)


def prepare_damage(results):
    run = add_whole_run(results)
    (run.path / "policy.json").write_bytes(b"damaged")
    add_whole_run(results, seed=1)


def create(results):
    id = f"face_direction/ddpg/full/s00-{settings_hash(RUN_SETTINGS)}"
    results.create("run", id, RUN_SETTINGS)


def append(results):
    run_of(results).append(rows(4.0), {CHECKPOINT: b"second state"})


def replace(results):
    run_of(results).append(rows(5.0, 6.0), replace=["episodes"])


def finish(results):
    run_of(results).finish({"wall_time": 1.0}, {"policy.json": b"{}"})


def fail(results):
    run_of(results).fail("it diverged")


def start_over(results):
    restart(run_of(results))


def merged(results):
    merge(results, [Results(results.path.parent / "other")])


def repaired(results):
    repair(results, verify(results, 1).findings)


COMMITS = {
    "create": (prepare_nothing, create),
    "append": (prepare_run, append),
    "replace": (prepare_run, replace),
    "finish": (prepare_run, finish),
    "fail": (prepare_run, fail),
    "start over": (prepare_run, start_over),
    "merge": (prepare_merge, merged),
}


def content(results):
    """Returns the manifest and the committed files of each record; there is no problem."""
    records, problems = results.scan("run")
    assert problems == []
    return {
        record.id: (
            record.manifest.to_bytes(),
            {entry.name: record.read_file(entry.name) for entry in record.manifest.files},
        )
        for record in records
    }


@pytest.fixture
def commit(tmp_path):
    """Returns a function: the recording of a commit, and the contents before and after it."""

    def record(kind):
        prepare, make = COMMITS[kind]
        results = Results(tmp_path / "results")
        prepare(results)
        before = content(results)
        with recorded(results.path) as recording:
            make(results)
        return recording, before, content(results)

    return record


def check_states(chosen, before, after, tmp_path):
    """Puts each state on the disk, reads it, repairs it, and goes on with it."""
    for number, state in enumerate(chosen):
        place = tmp_path / f"state-{number}"
        put(state, place)
        results = Results(place)
        there = content(results)
        for id in before.keys() | after.keys() | there.keys():
            # A merge sets the old record aside before it copies the new one.
            assert there.get(id) in (before.get(id), after.get(id), None)
        if before.keys() - there.keys():
            assert any((place / "set-aside").rglob("manifest.json"))
        found = verify(results, 1).findings
        assert {flaw.sort for flaw in found} <= {"leftover"}
        repair(results, found)
        assert verify(results, 1).findings == []
        assert content(results) == there
        for run in results.scan("run")[0]:
            with results.locked("run", run.id) as again:
                again.append(rows(9.0), {CHECKPOINT: b"third state"})
        assert verify(results, 1).findings == []
        shutil.rmtree(place)


def sample(every, most):
    every = list(every)
    return every[:: -(-len(every) // most)]


@pytest.mark.parametrize("kind", COMMITS)
def test_some_states_are_whole(commit, kind, tmp_path):
    recording, before, after = commit(kind)
    assert before != after
    check_states(sample(states(recording), SAMPLE), before, after, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", COMMITS)
def test_every_state_is_whole(commit, kind, tmp_path):
    recording, before, after = commit(kind)
    every = list(states(recording))
    assert len(every) >= 5
    # The first state is that before the commit, the last one that after it.
    assert every[0][0] == recording.files
    check_states(every, before, after, tmp_path)


@pytest.mark.parametrize(
    "most", [SAMPLE, pytest.param(10_000, marks=pytest.mark.slow)], ids=["some", "every"]
)
def test_repair_loses_nothing(tmp_path, most):
    results = Results(tmp_path / "results")
    prepare_damage(results)
    with recorded(results.path) as recording:
        repaired(results)
    for number, state in enumerate(sample(states(recording), most)):
        place = tmp_path / f"state-{number}"
        put(state, place)
        repaired(Results(place))
        assert verify(Results(place), 1).findings == []
        assert not lost(recording, place)


@pytest.mark.slow
def test_repeated_merge_loses_nothing_of_what_it_replaces(tmp_path):
    results = Results(tmp_path / "results")
    prepare_merge(results)
    with recorded(results.path) as recording:
        merged(results)
    for number, state in enumerate(states(recording)):
        place = tmp_path / "states" / f"{number}"
        put(state, place)
        merge(Results(place), [Results(tmp_path / "other")])
        assert verify(Results(place), 1).findings == []
        assert not lost(recording, place)


def lost(recording, place):
    """Returns how often each content is missing below a directory that was there before a call."""
    left = Counter(path.read_bytes() for path in place.rglob("*") if path.is_file())
    return Counter(recording.files.values()) - left


def test_single_file_is_old_or_new(tmp_path):
    """As an export and an archive are written."""
    path = tmp_path / "out" / "archive.zip"
    path.parent.mkdir()
    path.write_bytes(b"old")
    with recorded(path.parent) as recording:
        files.write_atomic(path, b"the new content")
    found = {state[0].get("archive.zip") for state in states(recording)}
    assert found == {b"old", b"the new content"}


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["file", "directory"])
def test_missing_sync_is_noticed(tmp_path, missing, monkeypatch):
    """The states are not vacuous: without one of the two syncs, a commit can be damaged."""
    if missing == "directory":
        monkeypatch.setattr(files, "_sync_directory", lambda path: None)
    results = Results(tmp_path / "results")
    prepare_run(results)
    before = content(results)
    sync = os.fsync
    with recorded(results.path) as recording:
        if missing == "file":
            monkeypatch.setattr(os, "fsync", lambda handle: None)
        append(results)
        monkeypatch.setattr(os, "fsync", sync)
    with pytest.raises((AssertionError, WorkError)):
        check_states(states(recording), before, content(results), tmp_path)


SYNCS = {
    # A file is synced before it is renamed, and its directory after it. A new record has five
    # new directories, each of which is a new name in the one above it.
    "create": (1, 6),
    "append": (3, 3),  # rows, checkpoint, manifest
    "replace": (2, 2),
    "finish": (3, 3),  # joined rows, policy, manifest
    "fail": (1, 1),
    "start over": (1, 1),
}


@pytest.mark.parametrize("kind", SYNCS)
def test_number_of_syncs_of_a_commit(commit, kind):
    """Neither a missing nor a needless one comes in."""
    counted = commit(kind)[0].syncs()
    assert (counted["file"], counted["directory"]) == SYNCS[kind]
