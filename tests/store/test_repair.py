"""Tests of repair: damaged and leftover files are set aside, never deleted; others are kept."""

import os
import shutil

import pytest

from jbench.errors import WorkError
from jbench.store import Results
from jbench.store.repair import repair
from jbench.store.tables import read_tables
from jbench.store.verify import verify
from tests.store.store_faults import run_script
from tests.store.store_rows import alter_manifest, listed, names, numbers
from tests.store.store_whole import add_chain, add_whole_run, snapshot
from tests.store.test_damage import truncate


def repaired(results, dry_run=False):
    """Verifies the results and repairs the findings; returns what the repair did."""
    return repair(results, verify(results, 2).findings, dry_run)


def content(directory):
    """The sorted contents of all files except locks."""
    found = snapshot(directory)
    return sorted(text for path, text in found.items() if os.path.basename(path) != "lock")


@pytest.fixture
def broken(results):
    """An intact chain of records, an intact run with a leftover file, and three damaged runs."""
    add_chain(results)
    whole = add_whole_run(results, seed=1)
    (whole.path / ".writing-x1").write_bytes(b"half")
    for seed, damage in enumerate((truncate, os.unlink, truncate), start=2):
        run = add_whole_run(results, seed=seed)
        damage(run.path / listed(run)[0])
    (run.path / "manifest.json").write_bytes(b"{")
    (results.path / "runs" / "gone").mkdir()
    (results.path / "runs" / "gone" / "stray.parquet").write_bytes(b"stray")
    return results


def test_repair_leaves_valid_results_and_loses_no_byte(broken):
    before = content(broken.path)
    would = repaired(broken, dry_run=True)
    assert content(broken.path) == before
    assert not (broken.path / "set-aside").exists()
    whole = {record.id for kind in ("dataset", "encoder") for record in broken.scan(kind)[0]}
    done = repaired(broken)
    assert done.left == []
    assert [path for path, _ in would.moved] == [path for path, _ in done.moved]
    assert content(broken.path) == before
    (folder,) = (broken.path / "set-aside").iterdir()
    assert {to for _, to in done.moved} == {
        folder / p.relative_to(broken.path) for p, _ in done.moved
    }
    found = verify(broken, 2)
    assert (found.findings, found.records) == ([], 5)
    assert {r.id for kind in ("dataset", "encoder") for r in broken.scan(kind)[0]} == whole
    assert read_tables(broken).problems == []
    assert repaired(broken) == ([], [], [])


def test_damaged_run_is_set_aside_and_can_be_recreated(results):
    for repairs in (1, 2, 3):  # within a second, in directories of their own
        run = add_whole_run(results)
        damaged = {"manifest.json", *listed(run)}
        with run.folder.lock():
            pass
        truncate(run.path / listed(run)[0])
        repaired(results)
        assert results.find("run", run.id) is None
        assert names(run.path) == {"lock"}
        folders = sorted((results.path / "set-aside").iterdir())
        assert len(folders) == repairs
        assert names(folders[-1] / "runs" / run.id) == damaged
    assert add_whole_run(results).id == run.id
    assert verify(results, 2).findings == []


def test_locked_record_is_kept_and_reported(results):
    run = add_whole_run(results, finish=False)
    other = add_whole_run(results, seed=1)
    for record in (run, other):
        truncate(record.path / listed(record)[0])
    before = snapshot(run.path)
    with run.folder.lock():
        for dry_run in (True, False):
            (left,) = repaired(results, dry_run).left
            assert left.startswith(f"Another process is writing the run {run.id};")
        assert results.find("run", other.id) is None
        assert snapshot(run.path).keys() == before.keys() | {"lock"}
    assert repaired(results).left == []
    assert results.find("run", run.id) is None


def test_record_of_newer_version_is_kept_and_reported(results):
    run = add_whole_run(results)
    alter_manifest(run, schema_version=7)
    before = snapshot(results.path)
    done = repaired(results)
    assert done.moved == []
    assert "is of schema version 7, and this jbench reads 1 to 5" in done.left[0]
    assert snapshot(results.path) == before


def test_nested_records_are_set_aside_separately(results):
    outer = results.create("run", "a", {})
    outer.append({"t": numbers(1)})
    add_whole_run(results)
    shutil.move(results.path / "runs" / "face_direction", outer.path / "face_direction")
    # Both ids are wrong now: each record is set aside with its own files only.
    done = repaired(results)
    assert len(done.moved) == 2 + 3
    assert verify(results, 2).findings == []


def test_directory_in_place_of_file_is_set_aside_with_content(results):
    path = add_whole_run(results).path / "policy.json"
    path.unlink()
    path.mkdir()
    (path / "inner").write_bytes(b"mine")
    repaired(results)
    assert verify(results, 2).findings == []
    assert b"mine" in content(results.path / "set-aside")


def test_record_repaired_meanwhile_is_unchanged(results):
    run = add_whole_run(results)
    path = run.path / listed(run)[0]
    good = path.read_bytes()
    truncate(path)
    findings = verify(results, 2).findings
    path.write_bytes(good)
    assert repair(results, findings) == ([], [], [])
    assert results.find("run", run.id) is not None


def test_set_aside_directory_that_is_link_is_refused(tmp_path, results):
    run = add_whole_run(results)
    truncate(run.path / listed(run)[0])
    (tmp_path / "elsewhere").mkdir()
    (results.path / "set-aside").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(WorkError, match="set-aside leads out of the results directory"):
        repaired(results)
    assert results.find("run", run.id) is not None


@pytest.mark.slow
def test_killed_repair_is_completed_by_next_repair(results):
    record = results.create("run", "a/b", {})
    for n in range(60):
        record.append({"t": numbers(n)})
    alter_manifest(record, id="b/a")
    before = content(results.path)
    script = """
import os, threading, time
from jbench.store.repair import repair
from jbench.store.verify import verify
findings = verify(results, 2).findings
def kill():
    while len(list(results.path.rglob("set-aside/**/*.parquet"))) < 5:
        time.sleep(0.001)
    os.write(1, b"killed\\n")
    os._exit(0)
threading.Thread(target=kill, daemon=True).start()
repair(results, findings)
time.sleep(60)
"""
    assert run_script(results, script) == ["killed"]
    # Files that were not moved yet may have second names, and get others in the next repair.
    assert {*content(results.path)} == {*before}
    repaired(results)
    assert {*content(results.path)} == {*before}
    assert verify(results, 2).findings == []
    assert Results(results.path).scan("run") == ([], [])
