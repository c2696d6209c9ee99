"""Tests of untrusted results directories: no access outside of them, no hang, no traceback."""

import json
import os
import signal
import subprocess
import sys

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbench.cli import main
from jbench.errors import WorkError
from jbench.store import Results, query
from jbench.store.files import sha256
from tests.store.store_rows import alter_manifest, listed, manifest_of
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
    "file by an absolute path": lambda run, out: first_entry(run, name=str(out)),
    "file is the manifest": lambda run, out: first_entry(run, name="manifest.json"),
    "size without end": lambda run, out: first_entry(run, bytes=2**62),
    "numbers that are none": lambda run, out: alter_manifest(
        run,
        settings={**manifest_of(run)["settings"], "seed": float("nan")},
        summary={"wall_time": float("inf")},
    ),
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
    "terminal codes": lambda run, out: alter_manifest(
        run, created=ESCAPE, settings={**manifest_of(run)["settings"], "algo": ESCAPE}
    ),
    "runs lead elsewhere": lambda run, out: (
        run.path.parents[3].rename(out.parent.parent / "elsewhere"),
        run.path.parents[3].symlink_to(out.parent.parent / "elsewhere"),
    ),
    "folders without end": lambda run, out: deep(run),
}


@pytest.mark.parametrize("make", HOSTILE.values(), ids=HOSTILE)
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
    assert query.load(Results(mine)).problems == []


def test_valid_run_beside_hostile_run_is_read(untrusted, secret):
    bad = untrusted.scan("run")[0][0]
    good = add_whole_run(untrusted, [1.0], seed=1)
    HOSTILE["manifest is a pipe"](bad, secret)
    loaded = query.load(untrusted)
    assert loaded.tables["runs"]["run"].to_pylist() == [good.id]
    assert loaded.problems == [f"{bad.path}/manifest.json can't be read (not a plain file)."]


@pytest.mark.parametrize("target", ["secret", "new"])
def test_lock_that_links_elsewhere_is_not_opened(untrusted, secret, target):
    run = untrusted.scan("run")[0][0]
    (run.path / "lock").symlink_to(secret.parent / target)
    with pytest.raises(WorkError, match="lock can't be opened"):
        run.lock().__enter__()
    assert snapshot(secret.parent) == {"secret": SECRET}


def test_lock_that_is_pipe_does_not_block(untrusted):
    run = untrusted.scan("run")[0][0]
    os.mkfifo(run.path / "lock")
    with run.lock():
        pass


def test_small_file_with_huge_row_count_is_refused(untrusted):
    run = untrusted.scan("run")[0][0]
    rows = 60_000_000
    sink = pa.BufferOutputStream()
    same = pa.table({"x": pa.array([True]).take(pa.array([0] * 1_000_000))})
    with pq.ParquetWriter(sink, same.schema, compression="zstd") as writer:
        for _ in range(rows // len(same)):
            writer.write_table(same)
    content = sink.getvalue().to_pybytes()
    assert len(content) < 1_000_000
    (run.path / listed(run)[0]).write_bytes(content)
    first_entry(run, bytes=len(content), sha256=sha256(content), rows=rows)
    with pytest.raises(WorkError, match="60000000 rows are more than a file has"):
        untrusted.find("run", run.id).read("episodes", pa.schema([("x", pa.bool_())]))


def test_manifest_with_deeply_nested_settings_is_refused(untrusted):
    run = untrusted.scan("run")[0][0]
    depth = sys.getrecursionlimit() * 10
    text = json.dumps(manifest_of(run)).replace('"encoder": null', '"encoder": ' + "[" * depth)
    (run.path / "manifest.json").write_text(text)
    with pytest.raises(WorkError, match="is not a manifest that can be read"):
        untrusted.find("run", run.id)
