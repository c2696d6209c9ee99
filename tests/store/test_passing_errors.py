"""Tests of transient I/O errors: unreadable records are reported and kept, never set aside."""

import errno
import os

import portalocker
import pytest

from jbench.cli import main
from jbench.errors import WorkError
from jbench.store import Results
from jbench.store.repair import repair
from jbench.store.verify import verify
from tests.store.store_rows import listed
from tests.store.store_whole import add_whole_run, snapshot
from tests.store.test_damage import truncate
from tests.training.small_runs import small_run

PASSING = ("EMFILE", "ENFILE", "EIO", "EROFS", "EDQUOT", "ESTALE", "EACCES", "EINTR")


@pytest.fixture
def fail(monkeypatch):
    """Makes a function of `os` fail for a path a number of times; 0 for always."""

    def arm(function, path, code, times=0):
        real, left = getattr(os, function), [times or 10**9]

        def failing(target, *arguments, **named):
            if not isinstance(target, int) and os.fspath(target) == str(path) and left[0]:
                left[0] -= 1
                raise OSError(code, os.strerror(code))
            return real(target, *arguments, **named)

        monkeypatch.setattr(os, function, failing)

    yield arm
    monkeypatch.undo()


@pytest.mark.parametrize("code", PASSING)
@pytest.mark.parametrize("which", ["manifest.json", "data"])
def test_record_that_cannot_be_opened_is_kept_and_reported(
    results, fail, monkeypatch, code, which, capsys
):
    run = add_whole_run(results)
    before = snapshot(results.path)
    path = run.path / (listed(run)[0] if which == "data" else which)
    fail("open", path, getattr(errno, code))
    assert main(["repair", "--results", str(results.path)]) == 1
    printed = capsys.readouterr().err
    assert f"{path} can't be read ({os.strerror(getattr(errno, code))})" in printed
    assert "damaged" not in printed
    monkeypatch.undo()
    assert snapshot(results.path) == before
    assert verify(results, 1).findings == []


def test_damaged_record_that_becomes_unreadable_is_kept(results, fail):
    run = add_whole_run(results)
    broken, other = (run.path / name for name in listed(run))
    truncate(broken)
    findings = verify(results, 1).findings
    assert [finding.sort for finding in findings] == ["damaged"]
    before = snapshot(results.path)
    fail("open", other, errno.EIO)
    done = repair(results, findings)
    assert (done.moved, snapshot(results.path)) == ([], before)
    assert "Input/output error" in done.left[0]


@pytest.mark.parametrize("function", ["scandir", "listdir"])
def test_interrupted_listing_is_retried(results, fail, function):
    run = add_whole_run(results)
    fail(function, run.path, errno.EINTR, times=1)
    assert [found.id for found in results.scan("run")[0]] == [run.id]


@pytest.mark.parametrize("code", [errno.EMFILE, errno.EIO])
def test_directory_that_cannot_be_listed_is_reported(results, fail, code, capsys):
    run = add_whole_run(results)
    fail("scandir", run.path, code)
    for verb in (["runs"], ["verify"], ["repair"], ["tail", "--once"]):
        assert main([*verb, "--results", str(results.path)]) == 1
        printed = capsys.readouterr()
        assert f"{run.path} can't be read ({os.strerror(code)})" in printed.out + printed.err
    with results.locked("run", run.id) as found:  # leftover files are removed the next time
        assert found.id == run.id


def test_file_system_without_locks_is_reported(record, monkeypatch):
    def unlockable(handle, operation):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(portalocker.portalocker, "LOCKER", unlockable)
    with pytest.raises(WorkError, match=r"lock can't be locked \(No locks available\)"):
        record.folder.lock().__enter__()


def test_unreadable_results_directory_is_reported(results, monkeypatch):
    def failing(path):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(type(results.path), "exists", failing)
    with pytest.raises(WorkError, match=r"can't be read \(Input/output error\)"):
        Results(results.path)


def test_cleaning_removes_leftover_of_finished_run(results):
    settings = small_run("td3", {}, steps=1000, evaluate_every=1000, evaluate_episodes=1)
    record = results.create("run", settings.id, settings.model_dump(mode="json"))
    record.finish({})
    left = record.path / ".writing-abc"
    left.write_bytes(b"left")
    with record.folder.lock():
        results.clean("run", settings.id)
        assert left.exists()  # it may belong to the process that holds the lock
    results.clean("run", settings.id)
    assert not left.exists()
