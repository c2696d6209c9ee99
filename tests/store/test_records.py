"""Tests of records: committed rows are read in order, uncommitted files are ignored."""

import importlib.metadata
import os
import platform
import shutil
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbench.errors import RequestError, WorkError
from jbench.store import Results
from tests.store.store_rows import alter_manifest, listed, manifest_of, names, numbers, read


def test_rows_are_read_in_order_of_appends(results, record):
    for rows in ((3, 1), (), (2,), (2,), (0, 9, 4)):
        record.append({"t": numbers(*rows)})
    again = results.find("run", "a/b")
    assert read(record) == read(again) == [3, 1, 2, 2, 0, 9, 4]
    assert again.rows("t") == 7
    # No file is without rows.
    assert [part.rows for part in again.parts("t")] == [2, 1, 1, 3]


def test_texts_and_gaps_survive_as_values_and_as_dictionary(record):
    rows = pa.table({"run": ["a", None, "a", ""], "n": [1, 2, 3, 4]})
    record.append({"t": rows})
    (part,) = record.parts("t")
    coded = rows.schema.set(0, pa.field("run", pa.dictionary(pa.int32(), pa.string())))
    assert record.read_part(part).equals(rows)
    assert record.read_part(part, coded).cast(rows.schema).equals(rows)


def test_file_missing_from_manifest_is_not_read(results, record):
    record.append({"t": numbers(1)})
    (name,) = listed(record)
    shutil.copy(record.path / name, record.path / "t-00001-0badc0de.parquet")
    pq.write_table(numbers(7), record.path / "t-00002.parquet")
    again = results.find("run", "a/b")
    assert read(again) == [1]
    again.append({"t": numbers(2)})
    assert read(again) == [1, 2]


def test_directory_without_manifest_is_no_record(results, record):
    record.append({"t": numbers(1)})
    (record.path / "manifest.json").unlink()
    results.create("run", "c", {})
    assert results.find("run", "a/b") is results.find("run", "a/b/c") is None
    assert results.find("encoder", "c") is None
    records, problems = results.scan("run")
    assert ([found.id for found in records], problems) == (["c"], [])


def test_finish_compacts_each_table_into_one_file(results, record):
    for n in range(5):
        record.append({"t": numbers(n, n), "u": numbers(-n)}, {"checkpoint.json": b"%d" % n})
    before = read(record), read(record, "u")
    record.finish({"best": 4}, {"policy.json": b"{}"})
    again = results.find("run", "a/b")
    assert (
        (read(again), read(again, "u"))
        == before
        == ([0, 0, 1, 1, 2, 2, 3, 3, 4, 4], [*range(0, -5, -1)])
    )
    assert [len(again.parts(table)) for table in ("t", "u")] == [1, 1]
    assert names(record.path) == {"manifest.json", *listed(record)}
    assert (again.status, again.manifest.summary) == ("finished", {"best": 4})
    assert (again.roles(), again.read_file("policy.json")) == ([], b"{}")


def test_uncommitted_file_cannot_be_read(record):
    (record.path / "policy.json").write_bytes(b"{}")
    with pytest.raises(WorkError, match=r"The run a/b has no file policy.json"):
        record.read_file("policy.json")


def test_create_over_existing_record_removes_its_files(results, record):
    record.append({"t": numbers(1)})
    for stray in ("t-00009-0badc0de.parquet", ".writing-x1", "old.safetensors", "old.json"):
        (record.path / stray).write_bytes(b"left by a killed process")
    (record.path / "notes.txt").write_text("a user's")
    again = results.create("run", "a/b", {"seed": 2})
    assert read(again) == []
    assert results.find("run", "a/b").settings == {"seed": 2}
    assert names(record.path) == {"manifest.json", "notes.txt"}


def test_manifest_records_provenance(record):
    made = manifest_of(record)["provenance"]
    assert made["jbench"] == importlib.metadata.version("jbench")
    assert made["python"] == ".".join(map(str, sys.version_info[:3]))
    assert made["system"] == platform.platform()
    for package in ("mujoco", "numpy", "torch", "stable-baselines3"):
        assert made["packages"][package] == importlib.metadata.version(package)
    assert made["command"][1:] == sys.argv[1:]
    assert made["cores"] >= 1
    assert {"processor", "threads", "git_revision"} <= made.keys()


def test_scan_returns_records_of_kind_oldest_first(results):
    for id, created in (("b", "2020"), ("a/x", "2022"), ("c/y/z", "2021")):
        alter_manifest(results.create("run", id, {}), created=created)
    results.create("dataset", "d", {})
    records, problems = results.scan("run")
    assert [record.id for record in records] == ["b", "c/y/z", "a/x"]
    assert problems == []


def test_missing_results_directory_reads_as_empty(tmp_path):
    results = Results(str(tmp_path / "missing"))
    assert results.path == tmp_path / "missing"
    assert results.find("run", "a") is None
    assert results.scan("run") == ([], [])
    assert not (tmp_path / "missing").exists()


def test_id_that_a_table_has_shortened_is_completed(results):
    for id in ("a/td3/s00-11", "a/td3/s01-22", "a/sac/s00-33"):
        results.create("run", id, {})
    assert results.complete_id("run", "a…s01-22") == "a/td3/s01-22"
    assert results.complete_id("run", "a/t…-11") == "a/td3/s00-11"
    with pytest.raises(RequestError, match=r"several runs are: a/sac/s00-33, a/td3/s00-11; type"):
        results.complete_id("run", "a…s00-…")
    with pytest.raises(
        RequestError, match=r"a…-99 is short for an id, and no run is; type a whole"
    ):
        results.complete_id("run", "a…-99")


def test_unique_prefix_of_id_is_completed(results, monkeypatch):
    for id in ("a/td3/s00-11", "a/td3/s01-22", "a/sac/s00-33", "a/td3/s00"):
        results.create("run", id, {})
    assert results.complete_id("run", "a/sac") == "a/sac/s00-33"
    assert results.complete_id("run", "a/sac/") == "a/sac/s00-33"
    assert results.complete_id("run", "a/td3/s01-2") == "a/td3/s01-22"
    # A complete id, although another id starts with it.
    assert results.complete_id("run", "a/td3/s00") == "a/td3/s00"
    assert results.complete_id("run", "b") == "b"
    # A path that a shell has completed, relative or absolute.
    monkeypatch.chdir(results.path.parent)
    folder = results.folder("run", "a/sac/s00-33").path
    relative = Path(os.path.relpath(folder))
    for text in (f"{folder}", f"{relative}/", f"./{relative.parent}"):
        assert results.complete_id("run", text) == "a/sac/s00-33"
    assert results.complete_id("encoder", "a/sac") == "a/sac"
    date = r"\(\d{4}-\d\d-\d\d \d\d:\d\d UTC\)"
    several = rf"Several runs begin with a/td3: a/td3/\S+ {date}, a/td3/"
    with pytest.raises(RequestError, match=several):
        results.complete_id("run", "a/td3")


def test_id_is_completed_with_the_representation_as_reports_show_it(results):
    ids = ("a/td3/planar12/s00-11", "a/td3/planar-mirror12/s00-22", "a/td3/dae12/s00-33")
    for id in ids:
        results.create("run", id, {})
    assert results.complete_id("run", "a/td3/planar/s00") == ids[0]
    assert results.complete_id("run", "a/td3/planar/s00-1") == ids[0]
    assert results.complete_id("run", "a/td3/planar-mirror/") == ids[1]
    # Its number of latents is the user's choice, so it is part of the name.
    assert results.complete_id("run", "a/td3/dae/s00") == "a/td3/dae/s00"
    results.create("run", "a/td3/planar12/s00-44", {})
    with pytest.raises(RequestError, match=r"begin with a/td3/planar/s00: a/td3/planar12/s00-11 "):
        results.complete_id("run", "a/td3/planar/s00")
