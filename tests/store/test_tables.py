"""Tests of the tables of results: columns, rows, and records that are left out."""

import json

import pyarrow as pa
import pytest

import jbench
from jbench.settings.recorded import variant
from jbench.store import query, schema
from jbench.store.tables import read_tables
from tests.store.store_rows import RUN_SETTINGS, add_run, alter_manifest, listed
from tests.store.test_damage import truncate

ENCODER = "face_direction/dae12/s00-0000abcd"
DAE = {"representation": "dae12", "encoder": ENCODER}


def fetch(results, sql):
    return [tuple(row) for row in query.run_sql(sql, read_tables(results).tables).to_numpy()]


@pytest.fixture
def filled(results):
    """Two seeds with full observations, and one seed with an encoder."""
    add_run(results, "full/s0", [10.0, 20.0, 60.0]).finish({"wall_time": 7.5})
    add_run(results, "full/s1", [100.0], seed=1)
    add_run(results, "dae/s0", [1.0, 3.0], **DAE).fail("killed")
    return results


def test_empty_results_have_every_table_and_column(results):
    loaded = read_tables(results)
    assert {name: table.schema for name, table in loaded.tables.items()} == schema.TABLES
    assert {name for name, table in loaded.tables.items() if table.num_rows} == {"published"}
    assert loaded.problems == []


def test_run_row_holds_settings_and_status(filled):
    expected = [
        ("dae/s0", "ddpg", "dae12", ENCODER, 0, 3000, "failed", 2, None),
        ("full/s0", "ddpg", "full", None, 0, 3000, "finished", 3, 7.5),
        ("full/s1", "ddpg", "full", None, 1, 3000, "unfinished", 1, None),
    ]
    found = query.run_sql(
        "select run, algo, representation, encoder, seed, steps, status, episodes, wall_time "
        "from runs order by run",
        read_tables(filled).tables,
    )
    found = found.astype(object).where(found.notna(), None)
    assert [tuple(row) for row in found.to_numpy()] == expected


def test_settings_and_provenance_are_queryable_json(filled):
    sql = "select settings->>'engine', settings->'steps', provenance from runs where run='full/s1'"
    ((engine, steps, provenance),) = fetch(filled, sql)
    assert (engine, int(steps)) == ("sb3", 3000)
    assert json.loads(provenance)["packages"].keys() >= {"mujoco", "torch"}


def test_variant_ignores_seed_and_steps(results):
    for id, change in (("a", {}), ("b", {"seed": 1}), ("c", {"steps": 9000}), ("d", DAE)):
        add_run(results, id, **change)
    a, b, c, d = (variant for (variant,) in fetch(results, "select variant from runs order by run"))
    assert a == b == c != d
    assert a == variant(RUN_SETTINGS)


def test_dataset_row_counts_control_steps_not_states(results):
    record = results.create("dataset", "random/s07", {"seed": 7, "steps": 3000})
    record.append(
        {
            "steps": pa.table({"step": list(range(1001)) * 2}),  # one state more than steps
            "dataset_episodes": pa.table({"episode": [0, 1]}),
        }
    )
    size = sum((record.path / name).stat().st_size for name in listed(record))
    sql = "select dataset, seed, steps, steps_done, status, bytes from datasets"
    assert fetch(results, sql) == [("random/s07", 7, 3000, 2000, "unfinished", size)]


def settings_with(**changes):
    """Returns a function that alters a record's settings."""
    return lambda record: alter_manifest(record, settings={**record.settings, **changes})


@pytest.mark.parametrize(
    "damage",
    [
        lambda record: truncate(record.path / listed(record)[0]),
        lambda record: (record.path / "manifest.json").write_bytes(b"{"),
        settings_with(seed="one"),
        settings_with(seed=2**64),
        settings_with(algo=5),
    ],
)
def test_damaged_run_is_skipped_in_all_tables_and_reported(filled, damage):
    damaged = filled.find("run", "full/s0")
    damage(damaged)
    tables, (problem,) = read_tables(filled)
    assert problem.startswith(f"{damaged.path}/")
    for table in ("runs", "episodes"):
        assert {*tables[table]["run"].to_pylist()} == {"dae/s0", "full/s1"}


def test_final_returns_are_those_of_python_with_errors(filled):
    found = query.query_results(filled, "SELECT * FROM final_returns ORDER BY run")[0]
    # The last quarter of three episodes is one.
    names = ("run", "seed", "evaluation_return", "training_return", "wall_time", "error")
    rows = found.astype(object).where(found.notna(), None)[[*names]].to_numpy().tolist()
    assert [row[:4] for row in rows] == [
        ["dae/s0", 0, None, 3.0],
        ["full/s0", 0, None, 60.0],
        ["full/s1", 1, None, 100.0],
    ]
    assert [row[5] for row in rows] == ["killed", None, None]
    assert rows[1][4] == 7.5
    errors = query.query_results(filled, "SELECT error FROM runs WHERE status = 'failed'")[0]
    assert errors["error"].tolist() == ["killed"]
    python = jbench.open(filled.path).runs().set_index("run").sort_index()
    assert python["training_return"].tolist() == [3, 60, 100]
    assert python["error"].dropna().to_dict() == {"dae/s0": "killed"}
    assert python.loc["full/s0", "wall_time"] == 7.5
