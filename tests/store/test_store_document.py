"""docs/database.md says what is so: its tables are those of the schema, and its code runs."""

import re
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest
from store_rows import add_run, alter_manifest

from jbench.datasets import layout
from jbench.store import schema
from jbench.store.manifest import OLDEST_SCHEMA_VERSION, SCHEMA_VERSION, FileEntry, Manifest

TEXT = (Path(__file__).parents[2] / "docs" / "database.md").read_text()

OF_FILES = {
    "policy_states": schema.POLICY_STATES,
    "steps": layout.STEPS,
    "dataset_episodes": layout.EPISODES,
}


def section(title):
    """The text below a heading, up to the next."""
    found = re.search(rf"^{re.escape(title)}$\n(.*?)(?=^#|\Z)", TEXT, re.M | re.S)
    assert found, f"no heading {title!r}"
    return found[1]


def rows(title):
    """The rows of the table below a heading, without its header."""
    cells = [
        re.split(r" *\| *", line.strip("| "))
        for line in section(title).splitlines()
        if line[:1] == "|"
    ]
    return cells[2:]


def code(language):
    """The blocks of code in a language, in order."""
    return re.findall(rf"^```{language}$\n(.*?)^```$", TEXT, re.M | re.S)


def wanted(columns):
    """The table of some columns, as it should stand in the document."""
    lines = ["| column | type | unit |", "|---|---|---|"]
    for field in columns:
        unit = (field.metadata or {}).get(b"unit", b"").decode()
        lines.append(f"| `{field.name}` | {field.type} |{f' {unit}' if unit else ''} |")
    return "\n".join(lines)


@pytest.mark.parametrize(("name", "columns"), [*schema.TABLES.items(), *OF_FILES.items()])
def test_table_is_described_column_by_column(name, columns):
    table = wanted(columns)
    assert table in section(f"### `{name}`"), f"what should stand there:\n\n{table}\n"


def test_no_other_table_is_described():
    described = re.findall(r"^### `(\w+)`$", TEXT, re.M)
    assert described == [*schema.TABLES, *OF_FILES]


def test_manifest_is_described_field_by_field():
    described = rows("## The manifest")
    assert [name.strip("`") for name, _ in described] == list(Manifest.model_fields)
    named = set(re.findall(r"`(\w+)`", described[-1][1]))
    assert named == set(FileEntry.model_fields)


def test_versions_are_those_that_are_read():
    described = [int(row[0]) for row in rows("## Versions")]
    assert described == list(range(OLDEST_SCHEMA_VERSION, SCHEMA_VERSION + 1))
    assert f"writes version {SCHEMA_VERSION} and reads" in section("## Versions")


@pytest.fixture
def filled(results):
    """Two runs in the directory `results`, and a file that no manifest lists."""
    add_run(results, "a/r", [10.0, 20.0]).finish({})
    run = add_run(results, "b/r", [60.0])
    run.append({"episodes": run.read("episodes", schema.EPISODES)})
    add_run(results, "c/r", [1e9])
    (results.path / "runs" / "c" / "r" / "manifest.json").unlink()
    # Settings of runs differ; the lines must do with all.
    alter_manifest(run, settings={"deep": [{"a": 1}]}, summary={"error": "none"})
    return results


def test_pandas_and_polars_read_what_the_manifests_list(filled):
    pandas, polars = code("python")
    # pyarrow may abort a process whose threads have just begun; not what is tested here.
    end = "\nimport os, sys\nsys.stdout.flush()\nos._exit(0)\n"
    command = [
        sys.executable,
        "-c",
        pandas + polars.replace("print", "print('polars');print") + end,
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=filled.path.parent)
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.split("polars\n")
    assert re.findall(r"^(./r) +(\S+)$", first, re.M) == [("a/r", "15.0"), ("b/r", "60.0")]
    assert re.findall(r"(./r)\W+([\d.]+)", second) == [("a/r", "15.0"), ("b/r", "60.0")]


def test_duckdb_reads_what_the_manifests_list(filled, monkeypatch):
    (sql,) = code("sql")
    monkeypatch.chdir(filled.path.parent)
    assert duckdb.connect().execute(sql).fetchall() == [("a/r", 15.0), ("b/r", 60.0)]
