"""Tests that docs/database.md names exactly the tables, fields and versions of the schema."""

import re
from pathlib import Path

from jbench.store import schema
from jbench.store.manifest import OLDEST_SCHEMA_VERSION, SCHEMA_VERSION, FileEntry, Manifest

TEXT = (Path(__file__).parents[2] / "docs" / "database.md").read_text()


def section(title):
    """The text below a heading, up to the next."""
    found = re.search(rf"^## {title}$\n(.*?)(?=^## |\Z)", TEXT, re.M | re.S)
    assert found, f"no heading {title!r}"
    return found[1]


def rows(title):
    """The rows of the tables below a heading, without their headers."""
    lines = [line for line in section(title).splitlines() if line[:1] == "|"]
    headers = [i for i, line in enumerate(lines) if line.startswith("|---")]
    return [
        re.split(r" *\| *", line.strip("| "))
        for i, line in enumerate(lines)
        if i not in headers and i + 1 not in headers
    ]


def test_documented_tables_are_those_of_schema():
    assert [name.strip("`") for name, _ in rows("Tables")] == list(schema.FILES)


def test_every_field_of_manifest_is_documented():
    described = rows("The manifest")
    assert [name.strip("`") for name, _ in described] == list(Manifest.model_fields)
    named = set(re.findall(r"`(\w+)`", described[-1][1]))
    assert named == set(FileEntry.model_fields)


def test_documented_versions_are_those_that_are_read():
    described = [int(row[0]) for row in rows("Versions")]
    assert described == list(range(OLDEST_SCHEMA_VERSION, SCHEMA_VERSION + 1))
    assert f"writes version {SCHEMA_VERSION} and reads" in section("Versions")
