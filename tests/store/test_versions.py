"""Tests that results written with schema version 1 are still read, verified and merged."""

import shutil
from pathlib import Path

import pytest

from jbench.errors import WorkError
from jbench.store import Results, query
from jbench.store.manifest import SCHEMA_VERSION
from jbench.store.merge import merge
from jbench.store.tables import read_tables
from jbench.store.verify import verify
from tests.store.store_rows import alter_manifest, episodes, manifest_of

KEPT = Path(__file__).parent / "version1"


@pytest.fixture
def old(tmp_path):
    shutil.copytree(KEPT, tmp_path / "old")
    return Results(tmp_path / "old")


def only(results, kind):
    records, problems = results.scan(kind)
    assert problems == []
    return records[0]


def test_renamed_column_is_read_under_new_name(old):
    sql = "SELECT epoch, train_loss, test_mse FROM encoder_epochs ORDER BY 1"
    rows, problems, _ = query.query_results(old, sql)
    assert problems == []
    # The old version wrote train_mse = 1 and 1/2, and test_mse = 1/2 and 1/4.
    assert rows.to_numpy().tolist() == [[1, 1.0, 0.5], [2, 0.5, 0.25]]


def test_columns_missing_from_old_version_are_null(old):
    (row,) = only(old, "encoder").read("encoder_features").to_pylist()
    assert (row["feature"], row["test_mse"], row["test_variance"]) == ("position_x", 0.25, 1.0)
    assert {name for name, value in row.items() if value is None} == {
        "pca_mse",
        "random_mse",
        "heuristic_mse",
        "heuristic_variance",
        "pca_heuristic_mse",
        "random_heuristic_mse",
    }
    (row,) = read_tables(old).tables["encoders"].to_pylist()
    assert (row["test_mse"], row["test_explained"]) == (0.25, None)


def test_old_records_are_valid_and_can_be_merged(tmp_path, old):
    assert verify(old, 2).faults == []
    new = Results(tmp_path / "new")
    assert [one.outcome for one in merge(new, [old])] == ["copied", "copied"]
    assert read_tables(new).tables["encoder_epochs"].num_rows == 2
    assert manifest_of(only(new, "run")) == manifest_of(only(old, "run"))


def test_new_rows_are_read_together_with_old_rows(old):
    run = only(old, "run")
    run.append({"episodes": episodes(run.id, [70.0])})
    rows = only(old, "run").read("episodes")
    assert rows["episode_return"].to_pylist() == [10.0, 20.0, 60.0, 70.0]
    assert rows["wall_time"].to_pylist() == [2.0, 4.0, 6.0, 2.0]


def test_unsupported_old_version_is_refused(old):
    run = only(old, "run")
    alter_manifest(run, schema_version=0)
    says = "is of schema version 0, and this jbench reads 1 to 5; install the jbench that wrote it"
    with pytest.raises(WorkError, match=says):
        old.find("run", run.id)


def test_column_missing_from_current_version_is_damage(old):
    encoder = only(old, "encoder")
    alter_manifest(encoder, schema_version=SCHEMA_VERSION)
    with pytest.raises(WorkError, match="it has no column train_loss: another version"):
        only(old, "encoder").read("encoder_epochs")
