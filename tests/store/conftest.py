"""A results directory and a record in it."""

import pytest

from jbench.store import Results


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results")


@pytest.fixture
def record(results):
    return results.create("run", "a/b", {"seed": 1})
