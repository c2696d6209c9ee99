"""Tests of system faults (full disk, permissions): committed rows survive, errors are reported."""

import errno
import os
import stat
from contextlib import nullcontext

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


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_permissions_of_files_are_those_of_the_umask(umask, mode, results):
    """A group that shares results can lock records, and private ones are private."""
    before = os.umask(umask)
    try:
        with results.folder("run", "a/b").lock():
            record = results.create("run", "a/b", {})
    finally:
        os.umask(before)
    assert {path.stat().st_mode & 0o777 for path in record.path.iterdir()} == {mode}
    assert names(record.path) == {"manifest.json", "lock"}


def test_results_may_lie_where_nobody_may_list(tmp_path, results):
    """As in a folder of a cluster, in which everybody may make one."""
    (tmp_path / "all").mkdir()
    (tmp_path / "all").chmod(0o333)
    script = f"""
store_faults.drop_privileges()
print(Results(Path({str(tmp_path)!r}, "all", "mine")).create("run", "a/b", {{}}).id)
"""
    assert run_script(results, script) == ["a/b"]


@pytest.mark.parametrize(
    ("code", "is_written"), [(errno.EINVAL, True), (errno.ENOTSUP, True), (errno.EIO, False)]
)
def test_file_system_may_lack_the_sync_of_a_directory(code, is_written, tmp_path, monkeypatch):
    def fsync(handle):
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "fsync", fsync)
    expected = nullcontext() if is_written else pytest.raises(WorkError, match="error")
    with expected:
        write_atomic(tmp_path / "file", b"new")


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
