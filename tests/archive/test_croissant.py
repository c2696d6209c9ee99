"""Tests of Croissant metadata: mlcroissant loads them, and reads the rows of `jbench query`."""

import math

import pytest

from jbench.archive.croissant import write_croissant
from jbench.store import Results
from jbench.store.tables import read_tables

croissant = pytest.importorskip("mlcroissant")


def read(path, table):
    """Returns the rows of a record set by column, as mlcroissant reads them."""
    dataset = croissant.Dataset(jsonld=str(path / "metadata.json"))
    assert not dataset.metadata.issues.errors
    prefix = f"{table}/"
    return [
        {name.removeprefix(prefix): plain(value) for name, value in row.items()}
        for row in dataset.records(table)
    ]


def plain(value):
    value = value.decode() if isinstance(value, bytes) else value
    return None if value is None or (isinstance(value, float) and math.isnan(value)) else value


def test_rows_are_those_of_query(demo_results, tmp_path, document):
    told = document(
        "export", "--format", "croissant", "--out", tmp_path / "out", results=demo_results.path
    )
    assert told["path"] == str(tmp_path / "out" / "metadata.json")
    tables = read_tables(demo_results).tables
    for table in ("runs", "evaluations", "encoders"):
        expected = [
            {name: plain(value) for name, value in row.items()} for row in tables[table].to_pylist()
        ]
        assert read(tmp_path / "out", table) == expected


def test_dataset_is_described(demo_results, tmp_path, run_command):
    (dataset,) = demo_results.scan("dataset")[0]
    more = ("--dataset", dataset.id, "--out", tmp_path / "out")
    code, *_ = run_command("export", "--format", "croissant", *more, results=demo_results.path)
    assert code == 0
    rows = read(tmp_path / "out", "dataset_episodes")
    assert len(rows) == dataset.rows("dataset_episodes")


def test_license_and_responsible_fields_are_there(demo_results, tmp_path, run_command):
    run_command("export", "--format", "croissant", "--out", tmp_path, results=demo_results.path)
    metadata = croissant.Dataset(jsonld=str(tmp_path / "metadata.json")).metadata
    assert "licenses/by/4.0" in str(metadata.license)
    assert "MuJoCo" in str(metadata.data_collection)
    assert "ACRA 2020" in metadata.cite_as


def test_results_that_are_the_working_directory_have_its_name(demo_results, tmp_path, monkeypatch):
    monkeypatch.chdir(demo_results.path)
    write_croissant(Results("."), tmp_path)
    metadata = croissant.Dataset(jsonld=str(tmp_path / "metadata.json")).metadata
    assert metadata.name == demo_results.path.name


def test_empty_results_are_refused(tmp_path, refused):
    (tmp_path / "results").mkdir()
    error = refused("export", "--format", "croissant", results=Results(tmp_path / "results").path)
    assert "has no rows; train or collect first" in error
