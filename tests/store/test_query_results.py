"""Tests of queries on a results directory: the tables that one reads, notes on names."""

import duckdb
import pytest

import jbench
from jbench.errors import RequestError
from jbench.store import query
from jbench.store.shipped import results_to_read
from jbench.store.tables import read_tables
from tests.store.store_rows import add_run, listed
from tests.store.test_damage import truncate


@pytest.fixture
def filled(results):
    add_run(results, "a", [10.0, 20.0])
    add_run(results, "b", [60.0], seed=1)
    return results


def rows(results, sql):
    found, problems, _ = query.query_results(results, sql)
    assert problems == []
    return found.to_numpy().tolist()


@pytest.mark.parametrize(
    "sql",
    [
        "SELECT run, sum(episode_return) FROM episodes GROUP BY run ORDER BY run",
        'SELECT RUN, SUM(episode_return) FROM "Episodes" GROUP BY run ORDER BY run',
        "WITH runs AS (FROM episodes) SELECT run, sum(episode_return) FROM runs GROUP BY 1 "
        "ORDER BY 1",
        "SELECT run, (SELECT sum(episode_return) FROM episodes e WHERE e.run = runs.run) FROM runs "
        "ORDER BY run",
        "SELECT run, sum(episode_return) FROM query_table('epi' || 'sodes') GROUP BY 1 ORDER BY 1",
        "SELECT run, sum(x) FROM (UNPIVOT (SELECT run, episode_return FROM episodes) ON "
        "episode_return INTO NAME n VALUE x) GROUP BY 1 ORDER BY 1",
    ],
)
def test_table_is_found_however_query_refers_to_it(filled, sql):
    assert rows(filled, sql) == [["a", 30.0], ["b", 60.0]]


def test_show_tables_lists_all_tables(filled):
    assert {name for (name,) in rows(filled, "SHOW TABLES")} == set(read_tables(filled).tables)


def test_files_of_unused_tables_are_not_read(filled):
    damaged = filled.find("run", "a")
    truncate(damaged.path / listed(damaged)[0])
    assert rows(filled, "SELECT run FROM runs ORDER BY run") == [["a"], ["b"]]
    sql = "SELECT run, count(*) FROM episodes JOIN runs USING (run) GROUP BY 1"
    found, problems, _ = query.query_results(filled, sql)
    assert (found.to_numpy().tolist(), len(problems)) == ([["b", 1]], 1)


NETWORK = [
    "'https://example.com/a.parquet'",
    "read_csv('http://example.com/a.csv')",
    "read_parquet('s3://bucket/a.parquet')",
    "read_text('hf://datasets/a/b')",
]


@pytest.mark.parametrize("source", NETWORK)
def test_query_cannot_access_network(filled, source):
    with pytest.raises(RequestError, match=r"disabled|Missing Extension|does not exist"):
        query.query_results(filled, f"FROM {source}")


def test_query_never_spills_to_disk(filled):
    sql = "SELECT current_setting('temp_directory') AS place"
    assert duckdb.connect().execute(sql).fetchall() == [(".tmp",)]  # the default of DuckDB
    assert rows(filled, sql) == [[""]]


@pytest.mark.parametrize(
    ("condition", "unknown"),
    [
        ("representation = 'dae12'", ["dae12"]),
        ("representation = 'full'", []),
        ("r.\"representation\" NOT IN ('full', 'pca4', 'it''s')", ["it's", "pca4"]),
        ("'dae12' <> r.representation", ["dae12"]),
        # Other texts are no representations.
        ("r.run = 'dae12' AND representation LIKE 'd%'", []),
        ("representation = 'full' AND algo = 'sac'", []),
    ],
)
def test_a_query_for_an_unknown_representation_gets_those_that_there_are(
    results, condition, unknown
):
    assert query.query_results(results, f"SELECT run FROM runs r WHERE {condition}").notes == []
    add_run(results, "full/s0", [10.0], representation="full")
    add_run(results, "planar/s0", [10.0], representation="planar12")
    found = query.query_results(results, f"SELECT run FROM runs r WHERE {condition}")
    assert found.notes == [
        f"No row has the representation '{name}'; there are full, planar12." for name in unknown
    ]


def test_a_query_with_the_name_that_reports_show_gets_the_one_in_sql(results, run_command):
    add_run(results, "planar/s0", [10.0], representation="planar12", encoder="e/planar12/s0")
    sql = "SELECT run FROM runs WHERE representation = {}"
    says = (
        "No row has the representation 'planar': SQL has whole names. Type "
        "representation IN ('planar12')."
    )
    for name, notes in (("'planar'", [says]), ("'planar12'", [])):
        assert query.query_results(results, sql.format(name)).notes == notes

    shipped = results_to_read("reference")  # it has encoders of the kind planar, for three tasks
    of_encoders = "SELECT encoder FROM encoders WHERE representation = 'planar'"
    (note,) = query.query_results(shipped, of_encoders).notes
    assert note.endswith("Type representation IN ('planar12', 'planar13', 'planar14').")
    (note,) = query.query_results(shipped, sql.format("'planar'")).notes
    assert note.endswith("Type representation IN ('planar12').")  # the only one with runs
    of_kind = "SELECT representation FROM encoders WHERE kind = 'planar'"
    assert query.query_results(shipped, of_kind).notes == []

    code, out, err = run_command("query", sql.format("'planar'"), "--csv", results=results.path)
    assert (code, out, err) == (0, "run\n", f"Warning: {says}\n")
    with pytest.warns(UserWarning, match="No row has the representation 'planar'"):
        assert jbench.open(results.path).query(sql.format("'planar'")).empty
