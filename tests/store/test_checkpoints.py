"""Tests of checkpoints: each is committed together with its rows and replaces its predecessor."""

from tests.store.store_rows import listed, names, numbers, read

ROLE = "checkpoint.safetensors"


def test_new_checkpoint_replaces_older_one_of_its_role(results, record):
    assert ROLE not in record.roles()
    record.append({}, {"other.json": b"first"})
    for n in range(3):
        record.append({"t": numbers(n)}, {ROLE: b"after %d" % n})
    again = results.find("run", "a/b")
    assert ROLE in again.roles()
    assert (again.read_file(ROLE), read(again)) == (b"after 2", [0, 1, 2])
    assert again.read_file("other.json") == b"first"
    assert names(record.path) == {"manifest.json", *listed(record)}
    assert len([name for name in listed(record) if name.endswith(".safetensors")]) == 1


def test_dropped_roles_are_removed_with_their_files(results, record):
    record.append({"t": numbers(1)}, {"replay-1.json": b"one", "replay-2.json": b"two"})
    record.append({"t": numbers(2)}, {"replay-3.json": b"three"}, drop=["replay-1.json"])
    again = results.find("run", "a/b")
    assert again.roles() == ["replay-2.json", "replay-3.json"]
    assert sorted(path.name[:8] for path in record.path.glob("replay-*")) == [
        "replay-2",
        "replay-3",
    ]
    assert read(again) == [1, 2]


def test_append_with_replace_replaces_all_rows_of_table(results, record):
    record.append({"t": numbers(1), "u": numbers(7)}, {ROLE: b"one"})
    record.append({"t": numbers(2)})
    record.append({"t": numbers(1, 2, 3)}, replace=("t",))
    again = results.find("run", "a/b")
    assert (read(again), read(again, "u")) == ([1, 2, 3], [7])
    assert len(again.parts("t")) == 1
    assert len(list(record.path.glob("t-*"))) == 1
    assert ROLE in again.roles()
    # Identical rows give the same file, which is kept.
    record.append({"t": numbers(1, 2, 3)}, replace=("t",))
    assert read(results.find("run", "a/b")) == [1, 2, 3]


def test_resume_records_control_step_and_changed_provenance(results, record):
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
    # Values of a wrong type are tolerated, and fields that were not recorded are not compared.
    record._update(provenance={"continued": 3, "packages": 4, "python": "2.7"})
    assert set(record.resume({})) == {"python"}
