"""Tests that damaged, misplaced and newer records are refused by a message that names them."""

import os
import shutil

import pytest

from jbench.errors import WorkError
from jbench.store import Results
from jbench.store.tables import read_tables
from jbench.store.verify import verify
from tests.store.store_rows import add_run, alter_manifest, listed, manifest_of, numbers, read


def truncate(path):
    path.write_bytes(path.read_bytes()[:-1])


def flip_a_byte(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def remove(path):
    path.unlink()


def link(path):
    """Replaces the file by a symbolic link to the same content."""
    elsewhere = path.parents[3] / "elsewhere"
    shutil.move(path, elsewhere)
    path.symlink_to(elsewhere)


def make_directory(path):
    path.unlink()
    path.mkdir()


DAMAGES = [
    (truncate, "bytes, not"),
    (flip_a_byte, "its checksum differs"),
    (remove, "No such file"),
    (link, "a link to another place"),
    (make_directory, "Is a directory"),
]


@pytest.mark.parametrize("part", range(3))
@pytest.mark.parametrize(("damage", "reason"), DAMAGES)
def test_damaged_part_is_reported_with_its_record(results, record, part, damage, reason):
    for n in range(3):
        record.append({"t": numbers(n)})
    name = listed(record)[part]
    damage(record.path / name)
    again = results.find("run", "a/b")
    for use in (lambda: read(again), lambda: again.finish({})):
        with pytest.raises(WorkError, match=f"{name} is damaged.*{reason}") as error:
            use()
        repair = f"set it aside with `jbench repair --results {results.path}`."
        assert str(error.value).endswith(repair)


BROKEN_MANIFESTS = {
    "empty": lambda text: b"",
    "half": lambda text: text[: len(text) // 2],
    "list": lambda text: b"[]",
    "not UTF-8": lambda text: b"\xff" + text,
    "no kind": lambda text: text.replace(b'"kind"', b'"mind"'),
    "no status": lambda text: text.replace(b'"unfinished"', b'"perhaps"'),
    "negative": lambda text: text.replace(b'"rows": 1', b'"rows": -1'),
    "deep": lambda text: b"[" * 100_000,
}


@pytest.mark.parametrize("breaking", BROKEN_MANIFESTS.values(), ids=BROKEN_MANIFESTS)
def test_broken_manifest_is_reported_and_other_records_are_read(results, record, breaking):
    record.append({"t": numbers(1)})
    results.create("run", "c", {}).append({"t": numbers(2)})
    path = record.path / "manifest.json"
    path.write_bytes(breaking(path.read_bytes()))
    records, problems = results.scan("run")
    assert [(other.id, read(other)) for other in records] == [("c", [2])]
    (problem,) = problems
    assert problem.startswith(f"{path} is not a manifest that can be read (")
    with pytest.raises(WorkError) as refusal:
        results.find("run", "a/b")
    assert str(refusal.value) == problem
    assert str(next(f for f in verify(results, 1).findings if f.id == "a/b")) == problem


@pytest.mark.parametrize(
    "name", ["../x", "../x.parquet", "/etc/passwd", "a/b", ".", "..", "", ".x", "manifest.json"]
)
def test_manifest_with_file_outside_its_directory_is_refused(results, record, name):
    record.append({"t": numbers(1)})
    (entry,) = manifest_of(record)["files"]
    shutil.copy(record.path / entry["name"], record.path.parent / "x.parquet")
    alter_manifest(record, files=[{**entry, "name": name}])
    with pytest.raises(WorkError, match="is not a manifest that can be read"):
        results.find("run", "a/b")


@pytest.mark.parametrize("change", [{"id": "a/c"}, {"kind": "encoder"}])
def test_manifest_with_other_kind_or_id_is_refused(results, record, change):
    alter_manifest(record, **change)
    called = f"{change.get('kind', 'run')} {change.get('id', 'a/b')}"
    expected = f"{record.path}/manifest.json calls itself {called}; it is not read."
    with pytest.raises(WorkError) as refusal:
        results.find("run", "a/b")
    (found,) = verify(results, 1).findings
    assert str(refusal.value) == str(found) == expected


@pytest.mark.parametrize("linked", ["out", "out/in"])
def test_record_behind_link_out_of_results_is_not_read(tmp_path, results, linked):
    others = Results(tmp_path / "others")
    add_run(others, "out/in/r", [5.0])
    add_run(results, "mine", [1.0])
    (results.path / "runs" / linked).parent.mkdir(exist_ok=True)
    os.symlink(others.path / "runs" / linked, results.path / "runs" / linked)
    with pytest.raises(WorkError, match="out/in/r leads out of the results directory"):
        results.find("run", "out/in/r")
    tables = read_tables(results).tables
    assert tables["runs"]["run"].to_pylist() == ["mine"]
    assert tables["episodes"]["episode_return"].to_pylist() == [1.0]


def test_record_is_not_written_through_link_out_of_results(tmp_path, results):
    (tmp_path / "outside").mkdir()
    (results.path / "runs").mkdir(parents=True)
    (results.path / "runs" / "out").symlink_to(tmp_path / "outside")
    with pytest.raises(WorkError, match="leads out of the results directory"):
        results.create("run", "out/r", {})
    assert list((tmp_path / "outside").iterdir()) == []
