"""Tests that docs/database.md describes exactly the tables, fields and versions of the schema."""

import re
from pathlib import Path

import pytest

from jbench.store import schema
from jbench.store.manifest import OLDEST_SCHEMA_VERSION, SCHEMA_VERSION, FileEntry, Manifest

TEXT = (Path(__file__).parents[2] / "docs" / "database.md").read_text()

OF_FILES = {
    "policy_states": schema.POLICY_STATES,
    "steps": schema.STEPS,
    "dataset_episodes": schema.DATASET_EPISODES,
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


def expected(columns):
    """The Markdown table expected for these columns."""
    lines = ["| column | type | unit |", "|---|---|---|"]
    for field in columns:
        unit = (field.metadata or {}).get(b"unit", b"").decode()
        lines.append(f"| `{field.name}` | {field.type} |{f' {unit}' if unit else ''} |")
    return "\n".join(lines)


@pytest.mark.parametrize(("name", "columns"), [*schema.TABLES.items(), *OF_FILES.items()])
def test_every_column_of_table_is_documented(name, columns):
    table = expected(columns)
    assert table in section(f"### `{name}`"), f"what should stand there:\n\n{table}\n"


def test_documented_tables_are_those_of_schema():
    described = re.findall(r"^### `(\w+)`$", TEXT, re.M)
    assert described == [*schema.TABLES, *OF_FILES]


def test_every_field_of_manifest_is_documented():
    described = rows("## The manifest")
    assert [name.strip("`") for name, _ in described] == list(Manifest.model_fields)
    named = set(re.findall(r"`(\w+)`", described[-1][1]))
    assert named == set(FileEntry.model_fields)


def test_documented_versions_are_those_that_are_read():
    described = [int(row[0]) for row in rows("## Versions")]
    assert described == list(range(OLDEST_SCHEMA_VERSION, SCHEMA_VERSION + 1))
    assert f"writes version {SCHEMA_VERSION} and reads" in section("## Versions")
