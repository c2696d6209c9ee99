"""A checkpoint is committed with the rows that it goes with, and replaces the one before it."""

import random
import signal
import time

import pytest

from jbench.errors import WorkError
from jbench.store import Results
from tests.store.store_faults import Script
from tests.store.store_rows import listed, manifest_of, names, numbers, read

ROLE = "checkpoint.safetensors"

# The checkpoint says how many rows were committed with it.
WRITING = """
record = results.find("run", "a/b")
n = record.rows("t")
while True:
    record.append({"t": numbers(n)}, {"checkpoint.safetensors": str(n + 1).encode()})
    print(n, flush=True)
    n += 1
"""


def test_checkpoint_is_read_by_its_role_and_the_newest_is_the_only_one(results, record):
    assert ROLE not in record.roles()
    for n in range(3):
        record.append({"t": numbers(n)}, {ROLE: b"after %d" % n})
    again = results.find("run", "a/b")
    assert ROLE in again.roles()
    assert (again.read_file(ROLE), read(again)) == (b"after 2", [0, 1, 2])
    assert names(record.path) == {"manifest.json", *listed(record)}
    assert len([name for name in listed(record) if name.endswith(".safetensors")]) == 1


def test_checkpoints_of_different_roles_replace_only_their_own(results, record):
    record.append({}, {"a.json": b"1", "b.json": b"2"})
    record.append({}, {"a.json": b"3"})
    again = results.find("run", "a/b")
    assert (again.read_file("a.json"), again.read_file("b.json")) == (b"3", b"2")


def test_same_content_again_stays(results, record):
    for _ in range(2):
        record.append({"t": numbers(1)}, {ROLE: b"same"})
    assert results.find("run", "a/b").read_file(ROLE) == b"same"


def test_rows_without_a_checkpoint_leave_the_one_there_is(results, record):
    record.append({}, {ROLE: b"kept"})
    record.append({"t": numbers(1)})
    assert results.find("run", "a/b").read_file(ROLE) == b"kept"


def test_finishing_drops_the_checkpoints_and_keeps_the_files(results, record):
    record.append({"t": numbers(1)}, {ROLE: b"state"})
    record.finish({}, {"policy.json": b"{}"})
    again = results.find("run", "a/b")
    assert ROLE not in again.roles()
    assert (again.read_file("policy.json"), read(again)) == (b"{}", [1])
    assert names(record.path) == {"manifest.json", *listed(record)}
    assert all("role" not in entry for entry in manifest_of(record)["files"])


def test_altered_checkpoint_is_refused(results, record):
    record.append({}, {ROLE: b"state"})
    (name,) = listed(record)
    (record.path / name).write_bytes(b"stole")
    with pytest.raises(WorkError, match=f"{name} of the run a/b is damaged .its checksum differs"):
        results.find("run", "a/b").read_file(ROLE)


@pytest.mark.parametrize("kills", [4, pytest.param(8, marks=pytest.mark.slow)])
def test_killed_writer_leaves_rows_and_the_checkpoint_that_goes_with_them(results, record, kills):
    for kill in range(kills):
        with Script(results, WRITING) as process:
            process.stdout.readline()
            time.sleep(random.Random(kill).uniform(0, 0.1))
            process.send_signal(signal.SIGKILL)
        again = Results(results.path).find("run", "a/b")
        done = again.rows("t")
        assert read(again) == list(range(done))
        assert again.read_file(ROLE) == str(done).encode()
    again.clean()
    assert names(record.path) == {"manifest.json", *listed(record)}


def test_roles_that_are_dropped_are_gone_with_their_files(results, record):
    record.append({"t": numbers(1)}, {"replay-1.json": b"one", "replay-2.json": b"two"})
    record.append({"t": numbers(2)}, {"replay-3.json": b"three"}, drop=["replay-1.json"])
    again = results.find("run", "a/b")
    assert again.roles() == ["replay-2.json", "replay-3.json"]
    assert sorted(path.name[:8] for path in record.path.glob("replay-*")) == [
        "replay-2",
        "replay-3",
    ]
    assert read(again) == [1, 2]


def test_rows_that_come_anew_take_the_place_of_all_that_there_were(results, record):
    record.append({"t": numbers(1), "u": numbers(7)}, {ROLE: b"one"})
    record.append({"t": numbers(2)})
    record.append({"t": numbers(1, 2, 3)}, replace=("t",))
    again = results.find("run", "a/b")
    assert (read(again), read(again, "u")) == ([1, 2, 3], [7])
    assert len(again.parts("t")) == 1
    assert len(list(record.path.glob("t-*"))) == 1
    assert ROLE in again.roles()
    # The same rows again are the same file, which stays.
    record.append({"t": numbers(1, 2, 3)}, replace=("t",))
    assert read(results.find("run", "a/b")) == [1, 2, 3]


def test_work_that_resumes_says_from_where_and_what_has_changed(results, record):
    record.fail("no room")
    known = record.manifest.provenance
    assert record.resume({"control_steps": 3000}) == {}
    record._update(provenance={**record.manifest.provenance, "processor": "a toaster"})
    assert record.resume({"control_steps": 5000}) == {
        "processor": ["a toaster", known["processor"]]
    }
    again = results.find("run", "a/b")
    assert (again.status, again.manifest.summary) == ("unfinished", {})
    first, second = again.manifest.provenance["continued"]
    assert (first["control_steps"], first["changed"]) == (3000, {})
    assert second["changed"] == {"processor": ["a toaster", known["processor"]]}
    # A manifest may hold anything there, and what was not recorded is not compared.
    record._update(provenance={"continued": 3, "packages": 4, "python": "2.7"})
    assert set(record.resume({})) == {"python"}
