"""Tests of untrusted results directories: no access outside of them, no hang, no traceback."""

import os
import signal
import subprocess

import pytest

from jbench.cli import main
from jbench.errors import RequestError, WorkError
from jbench.store import Results, query
from jbench.store.listing import list_runs
from jbench.store.tables import read_tables
from jbench.store.verify import verify
from tests.store.store_rows import RUN_SETTINGS, alter_manifest, listed, manifest_of
from tests.store.store_whole import add_whole_run, snapshot

SECRET = b"root:hunter2"
ESCAPE = "\x1b]0;owned\x07\x1b[2J"


@pytest.fixture
def secret(tmp_path):
    """A file outside of the results, in a directory that must not change."""
    path = tmp_path / "outside" / "secret"
    path.parent.mkdir()
    path.write_bytes(SECRET)
    return path


@pytest.fixture
def untrusted(tmp_path):
    """Results from an untrusted source, with one valid run."""
    results = Results(tmp_path / "theirs")
    add_whole_run(results, [7.0])
    yield results
    # shutil.rmtree would exceed the recursion limit on the deeply nested directories.
    subprocess.run(["rm", "-rf", str(results.path)], check=True)


@pytest.fixture(autouse=True)
def _limit_test_time():
    signal.alarm(120)
    yield
    signal.alarm(0)


def first_entry(run, **changes):
    """Alters the manifest's entry of its first file."""
    first, *rest = manifest_of(run)["files"]
    alter_manifest(run, files=[{**first, **changes}, *rest])


def replace(path, make):
    path.unlink()
    make(path)


def deep(run):
    """Creates nested directories deeper than Python's recursion limit."""
    at = os.open(run.path, os.O_RDONLY)
    for _ in range(1100):
        os.mkdir("d", dir_fd=at)
        below = os.open("d", os.O_RDONLY, dir_fd=at)
        os.close(at)
        at = below
    os.close(at)


def huge(run):
    """Extends the manifest to a sparse file of one gigabyte."""
    with open(run.path / "manifest.json", "r+b") as file:
        file.truncate(2**30)


HOSTILE = {
    "manifest is a link": lambda run, out: replace(
        run.path / "manifest.json", lambda p: p.symlink_to(out)
    ),
    "manifest is a pipe": lambda run, out: replace(run.path / "manifest.json", os.mkfifo),
    "manifest is a folder": lambda run, out: replace(run.path / "manifest.json", os.mkdir),
    "manifest is huge": lambda run, out: huge(run),
    "file is a link": lambda run, out: replace(
        run.path / listed(run)[0], lambda p: p.symlink_to(out)
    ),
    "file is a device": lambda run, out: replace(
        run.path / listed(run)[0], lambda p: p.symlink_to("/dev/zero")
    ),
    "file is a pipe": lambda run, out: replace(run.path / listed(run)[0], os.mkfifo),
    "file above": lambda run, out: first_entry(run, name="../../../../../outside/secret"),
    "size without end": lambda run, out: first_entry(run, bytes=2**62),
    "rows without end": lambda run, out: first_entry(run, rows=2**62),
    "id above": lambda run, out: alter_manifest(run, id="../../outside"),
    "id is absolute": lambda run, out: alter_manifest(run, id=str(out.parent)),
    "settings are of other types": lambda run, out: alter_manifest(
        run, settings={name: [{"a": []}] for name in manifest_of(run)["settings"]}
    ),
    "summary is of other types": lambda run, out: alter_manifest(
        run, summary={"wall_time": {"a": 1}, "steps_done": "x"}
    ),
    "encoder above": lambda run, out: alter_manifest(
        run, settings={**manifest_of(run)["settings"], "encoder": "../../outside"}
    ),
    "runs lead elsewhere": lambda run, out: (
        run.path.parents[3].rename(out.parent.parent / "elsewhere"),
        run.path.parents[3].symlink_to(out.parent.parent / "elsewhere"),
    ),
    "imports lead in a circle": lambda run, out: (
        run.path.parents[4].joinpath("imports").symlink_to("imports")
    ),
    "folders without end": lambda run, out: deep(run),
}


SLOW = (
    *("manifest is a folder", "file is a device", "file is a pipe", "size without end"),
    *("id is absolute", "summary is of other types", "folders without end"),
)
"""What is much like another of these, or takes longest."""


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(make, id=name, marks=pytest.mark.slow if name in SLOW else ())
        for name, make in HOSTILE.items()
    ],
)
def test_no_command_accesses_files_outside_or_prints_traceback(
    tmp_path, untrusted, secret, make, capsys
):
    run = untrusted.scan("run")[0][0]
    add_whole_run(untrusted, [1.0], seed=1)
    make(run, secret)
    mine = tmp_path / "mine"
    outside = snapshot(secret.parent)
    for verb in (
        ("runs", "--returns"),
        ("query", "FROM runs JOIN episodes USING (run)"),
        ("verify",),
        ("repair", "--dry-run"),
        ("merge", str(untrusted.path)),
        ("repair",),
    ):
        path = mine if verb[0] == "merge" else untrusted.path
        code = main([*verb, "--results", str(path)])
        printed = capsys.readouterr()
        assert code in (0, 1), printed.err
        assert "Traceback" not in printed.err
        assert "hunter2" not in printed.out + printed.err
        assert "\x1b" not in printed.out + printed.err
        assert snapshot(secret.parent) == outside
    assert read_tables(Results(mine)).problems == []


@pytest.mark.parametrize("target", ["secret", "new"])
def test_lock_that_links_elsewhere_is_not_opened(untrusted, secret, target):
    run = untrusted.scan("run")[0][0]
    (run.path / "lock").symlink_to(secret.parent / target)
    with pytest.raises(WorkError, match="lock can't be opened"):
        run.folder.lock().__enter__()
    assert snapshot(secret.parent) == {"secret": SECRET}


def test_lock_that_is_pipe_does_not_block(untrusted):
    run = untrusted.scan("run")[0][0]
    os.mkfifo(run.path / "lock")
    with run.folder.lock():
        pass


UNREADABLE = {
    "terminal codes in a name": {"settings": {"algo": ESCAPE}},
    "text that runs backwards": {"settings": {"algo": "\u202e"}},
    "lines in a key": {"settings": {"hyperparameters": {"a\nb": 1}}},
    "terminal codes in provenance": {"provenance": {"packages": [ESCAPE]}},
    "text without end": {"settings": {"algo": "a" * 100_000}},
    "integer without end": {"settings": {"seed": 10**4000}},
    "integer without end in a summary": {"summary": {"steps_done": 10**4000}},
    "number that is none": {"settings": {"hyperparameters": [float("nan")]}},
    "file without a name": {"files": [{"name": "", "bytes": 0, "sha256": "0" * 64}]},
    "file twice": {"files": [{"name": "a", "bytes": 0, "sha256": "0" * 64}] * 2},
}


@pytest.mark.parametrize("changes", UNREADABLE.values(), ids=UNREADABLE)
def test_manifest_that_cannot_be_shown_is_reported_and_left_out(untrusted, changes):
    bad = untrusted.scan("run")[0][0]
    good = add_whole_run(untrusted, [1.0], seed=1)
    before = manifest_of(bad)
    alter_manifest(
        bad,
        **{
            field: {**before[field], **change} if isinstance(change, dict) else change
            for field, change in changes.items()
        },
    )
    loaded = read_tables(untrusted)
    assert loaded.tables["runs"]["run"].to_pylist() == [good.id]
    (problem,) = loaded.problems
    assert problem.startswith(f"{bad.path}/manifest.json is not a manifest that can be read (")
    lines, problems = list_runs(untrusted, {})
    assert ([line.run for line in lines], problems) == ([good.id], [problem])
    (flaw,) = verify(untrusted, 1).findings
    assert (flaw.sort, flaw.id) == ("damaged", bad.id)


@pytest.mark.parametrize("algo", ["cleanrl-td3", "sb3:TQC", "=cmd|' /C calc'!A0", "<b>[/b]"])
def test_any_printable_name_is_read_and_is_no_formula_in_csv(untrusted, algo, capsys):
    untrusted.create("run", "a/b", {**RUN_SETTINGS, "algo": algo})
    assert main(["query", "SELECT algo FROM runs", "--results", str(untrusted.path)]) == 0
    assert algo in capsys.readouterr().out
    rows, problems, _ = query.query_results(untrusted, "SELECT algo FROM runs WHERE run = 'a/b'")
    assert (rows["algo"].tolist(), problems) == ([algo], [])
    written = f"'{algo}" if algo[0] == "=" else algo
    assert query.to_csv(rows) == f"algo\n{written}\n"


def test_record_that_could_not_be_read_is_not_created(results):
    with pytest.raises(RequestError, match="The run a/b can't be saved"):
        results.create("run", "a/b", {**RUN_SETTINGS, "algo": ESCAPE})
    assert results.find("run", "a/b") is None
