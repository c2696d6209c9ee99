"""Tests of system faults (full disk, permissions): committed rows survive, errors are reported."""

import pytest

from jbench.errors import RequestError, WorkError
from jbench.store.files import write_atomic
from tests.store.store_faults import run_script
from tests.store.store_rows import add_run, listed, names, numbers, read


def test_record_can_finish_after_finish_failed_on_full_disk(results, record):
    for n in range(5):
        record.append({"t": numbers(n)})
    script = """
store_faults.limit_file_size(8192)
try:
    results.find("run", "a/b").finish({}, {"policy.json": b"x" * 10_000})
except WorkError as error:
    print(error)
"""
    (printed,) = run_script(results, script)
    assert printed.startswith("No room left to write policy.json in ")
    again = results.find("run", "a/b")
    assert (again.status, read(again)) == ("unfinished", [0, 1, 2, 3, 4])
    again.finish({}, {"policy.json": b"{}"})
    assert read(results.find("run", "a/b")) == [0, 1, 2, 3, 4]
    assert names(record.path) == {"manifest.json", *listed(record)}


@pytest.mark.parametrize("where", ["manifest.json", "a/b", "a"])
def test_unreadable_record_is_reported_and_others_are_read(results, record, where):
    add_run(results, "c", [1.0])
    path = record.path / where if where == "manifest.json" else results.path / "runs" / where
    mode = path.stat().st_mode
    path.chmod(0o000)
    script = """
store_faults.drop_privileges()
records, problems = results.scan("run")
print([record.id for record in records], *problems, sep="\\n")
"""
    found, problem = run_script(results, script)
    path.chmod(mode)
    assert found == "['c']"
    assert problem.startswith(f"{path} can't be read (Permission denied)")


def test_unwritable_results_directory_is_refused_on_create(tmp_path, results):
    results.path.mkdir()
    results.path.chmod(0o500)
    script = """
store_faults.drop_privileges()
try:
    results.create("run", "a/b", {})
except RequestError as error:
    print(error)
"""
    (printed,) = run_script(results, script)
    assert printed.startswith(
        f"{results.path}/runs/a/b can't be made (Permission denied); name a dir"
    )
    assert list(results.path.iterdir()) == []


def test_written_file_is_readable_by_other_users(tmp_path):
    write_atomic(tmp_path / "file", b"new")
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o644


def test_write_over_directory_is_refused_and_leaves_no_temporary(tmp_path):
    (tmp_path / "there").mkdir()
    with pytest.raises(WorkError, match="there can't be written"):
        write_atomic(tmp_path / "there", b"new")
    assert names(tmp_path) == {"there"}


def test_lock_that_is_directory_is_refused(record):
    (record.path / "lock").mkdir()
    with pytest.raises(WorkError, match=r"lock can't be opened \(Is a directory\)"):
        record.folder.lock().__enter__()


def test_runs_directory_that_is_file_is_refused(results):
    results.path.mkdir()
    (results.path / "runs").write_text("mine")
    assert results.find("run", "a/b") is None
    assert results.scan("run")[1] == [f"{results.path}/runs can't be read (Not a directory)."]
    with pytest.raises(RequestError, match="is a file, or lies in one; name a directory"):
        results.create("run", "a/b", {})


def test_reader_finds_rows_after_record_is_compacted(results, record):
    for n in range(3):
        record.append({"t": numbers(n)})
    reader = results.find("run", "a/b")
    record.finish({})
    with pytest.raises(WorkError, match="No such file"):
        read(reader)
    assert reader.refresh()
    assert read(reader) == [0, 1, 2]
    assert not reader.refresh()
