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


def entries(title):
    """The names that begin the list below a heading, and their descriptions."""
    return re.findall(r"^- `(\w+)`: (.*(?:\n  .*)*)", section(title), re.M)


def test_documented_tables_are_those_of_schema():
    assert [name for name, _ in entries("Tables")] == list(schema.FILES)


def test_every_field_of_manifest_is_documented():
    described = entries("The manifest")
    assert [name for name, _ in described] == list(Manifest.model_fields)
    assert set(re.findall(r"`(\w+)`", described[-1][1])) == set(FileEntry.model_fields)


def test_documented_versions_are_those_that_are_read():
    described = [int(version) for version in re.findall(r"^- (\d+):", section("Versions"), re.M)]
    # The oldest has no changes.
    assert described == list(range(OLDEST_SCHEMA_VERSION + 1, SCHEMA_VERSION + 1))
    assert f"writes version {SCHEMA_VERSION} and reads" in section("Versions")
