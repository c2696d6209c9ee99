"""Tests of the SQL sandbox and its output: one SELECT on the tables, no files or variables."""

import json

import duckdb
import pyarrow as pa
import pytest

from jbench.commands.output import json_text
from jbench.errors import RequestError
from jbench.store.query import records, run_sql, to_csv

TABLES = {"runs": pa.table({"run": ["a", "b"], "score": [1.5, None]})}
OUTSIDE = pa.table({"password": ["hunter2"]})  # DuckDB would find it by its Python name


@pytest.fixture
def secret(tmp_path):
    """A file that exists and that DuckDB could read."""
    path = tmp_path / "secret.csv"
    path.write_text("password\nhunter2\n")
    return path


READERS = ["read_csv('{}')", "read_text('{}')", "read_blob('{}')", "glob('{}')", "'{}'"]
READERS += ["read_text('file://{}')", "sniff_csv('{}')"]


@pytest.mark.parametrize("reader", READERS)
def test_query_cannot_read_files(secret, reader):
    sql = f"select * from {reader.format(secret)}"
    counting = f"select count(*) from ({sql})"
    assert duckdb.connect().execute(counting).fetchall() == [(1,)]  # plain DuckDB reads it
    with pytest.raises(RequestError, match="disabled by configuration") as refusal:
        run_sql(sql, TABLES)
    assert "hunter2" not in str(refusal.value)


@pytest.mark.parametrize(
    "sql",
    [
        "copy (select 1) to '{}/out.csv'",
        "export database '{}/out'",
        "attach '{}/out.db'",
        "install httpfs",
        "set enable_external_access = true",
        "pragma enable_profiling",
        "create macro f() as 1",
        "insert into runs values ('c', 1)",
        "drop view runs",
        "begin",
        "explain analyze select 1",
        "select 1; select 2",
        "select 1; copy (select 1) to '{}/out.csv'",
        "",
        ";",
        "-- nothing",
    ],
)
def test_anything_but_one_select_is_refused_without_effect(tmp_path, sql):
    with pytest.raises(RequestError, match="A query is one SELECT statement"):
        run_sql(sql.format(tmp_path), TABLES)
    assert list(tmp_path.iterdir()) == []


def test_select_cannot_write_files(tmp_path):
    log = f"enable_logging('QueryLog', storage := 'file', storage_path := '{tmp_path}')"
    with pytest.raises(RequestError, match="the configuration has been locked"):
        run_sql(f"select * from {log}", TABLES)
    assert list(tmp_path.iterdir()) == []


def test_query_cannot_read_python_variables():
    inside = OUTSIDE.to_pandas()
    assert duckdb.sql("select * from inside").fetchall() == [("hunter2",)]  # plain DuckDB reads it
    assert duckdb.sql("select * from OUTSIDE").fetchall() == [tuple(inside.iloc[0])]
    for name in ("inside", "OUTSIDE", "TABLES", "tables"):
        with pytest.raises(RequestError, match="does not exist"):
            run_sql(f"select * from {name}", TABLES)


def test_error_is_one_line_that_lists_tables():
    with pytest.raises(RequestError) as refusal:
        run_sql("select * from run", {**TABLES, "episodes": TABLES["runs"]})
    message = str(refusal.value)
    assert "\n" not in message
    assert "run does not exist" in message
    assert message.endswith("(tables: episodes, runs).")


@pytest.mark.parametrize(
    ("sql", "hint"),
    [
        ("select * from run", 'Did you mean "runs"?'),
        ("select sed from runs", 'The nearest columns: "seed". DESCRIBE with a table lists'),
        ("select control_steps from runs", 'The nearest columns: "steps", '),
        ("from runs where algo = td3", "text is in single quotes, such as 'td3'."),
        ("select seed from episodes", "seed is a column of runs: JOIN runs USING (run)."),
        ("select e.algo from episodes e", "algo is a column of runs: JOIN runs USING (run)."),
    ],
)
def test_error_says_what_to_type_instead(sql, hint):
    rows = pa.table({"run": ["a"], "seed": [0], "algo": ["td3"]})
    with pytest.raises(RequestError) as refusal:
        run_sql(sql, {"runs": rows, "episodes": pa.table({"run": ["a"], "episode": [0]})})
    assert hint in str(refusal.value)


def test_json_is_list_of_objects_with_null_for_missing_values():
    sql = """
        select 1 as whole, null::int as none, 'a' as text, null::varchar as no_text,
               1.5::double as real, 'nan'::double as nan, 'inf'::double as infinite,
               [1.5::double, 'nan'::double, null] as list, [[1], [2, 3]] as nested,
               {'a': 'inf'::double, 'b': [null, 4]} as struct, map {1: 'nan'::float} as map,
               '75e6f7ab-b270-4aa0-9b11-47858b540e74'::uuid as id, date '200000-01-02' as day
        union all select 9007199254740993, 7, 'b', 'c', null, 2, 3, [], [], null, null, null, null
        order by 1
    """
    first, second = json.loads(json_text(records(run_sql(sql, TABLES))))
    assert first["real"] == 1.5
    assert [first[name] for name in ("none", "no_text", "nan", "infinite")] == [None] * 4
    assert second["real"] is None
    # An integer beyond float64's precision, and a column with a null, remain integers.
    assert (second["whole"], second["none"]) == (2**53 + 1, 7)
    assert isinstance(second["none"], int)
    assert (first["list"], first["nested"]) == ([1.5, None, None], [[1], [2, 3]])
    assert (first["struct"], first["map"]) == ({"a": None, "b": [None, 4]}, {"1": None})
    # pandas would read memory outside of the text of a UUID, and has no year after 9999.
    assert first["id"] == "75e6f7ab-b270-4aa0-9b11-47858b540e74"
    assert first["day"].startswith("200000-01-02")


def test_sums_of_integers_and_dates_keep_their_types():
    sql = """
        select sum(x) as n, sum(case when x > 1 then x end) as gap, sum(x * (2::hugeint ** 60)) as
               large, null::date as no_day, date '2020-01-02' as day
        from (values (8050000), (8050000)) t(x) union all
        select 2, null, 1, date '2020-01-03', null order by n desc
    """
    frame = run_sql(sql, TABLES)
    first, second = json.loads(json_text(records(frame)))
    many = run_sql("SELECT range(2000) AS many", {})
    assert to_csv(many) == f'many\n"{[*range(2000)]}"\n'  # with the middle
    assert to_csv(frame[["n", "gap", "day"]]) == "n,gap,day\n16100000,16100000,2020-01-02\n2,,\n"
    assert '"n": 16100000,' in json_text(records(frame))
    assert isinstance(first["large"], float)
    assert first["large"] == 16100000 * 2.0**60
    assert (first["day"], second["no_day"]) == ("2020-01-02", "2020-01-03")
    assert (second["gap"], second["day"], first["no_day"]) == (None, None, None)
