"""Tests of the tables of datasets in the documentation."""

import pytest

from jbench.datasets.by_robot import find_layout
from jbench.settings.records import JITTERBUG
from tests.documentation import ROOT


@pytest.mark.parametrize("robot", [JITTERBUG, "gym:Pendulum-v1"])
def test_page_of_the_database_has_the_tables_of_datasets(robot):
    layout = find_layout(robot)
    page = (ROOT / "docs/database.md").read_text()
    _, _, large = page.partition("These are too large for `jbench query`:")
    for table in (layout.step_table, layout.episode_table):
        assert f"`{table}`" in large
