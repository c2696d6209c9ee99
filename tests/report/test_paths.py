"""Tests of reading the robots' paths for the runs of a report."""

import numpy as np
import pyarrow as pa
import pytest

from jbench.report.contents import document
from jbench.report.data.paths import COLUMNS, run_paths
from jbench.report.report import gather
from jbench.report.request import Request
from jbench.store import schema
from tests.report.conftest import evaluations


def path(run, evaluation, x, **more):
    """Returns rows of the table `paths` with these values of x, and y twice as large."""
    rows = [
        {"run": run, "evaluation": evaluation, "control_steps": 1000 * (evaluation + 1)}
        | {"time": 0.2 * i, "x": value, "y": 2 * value, "heading": i / 2, **more}
        for i, value in enumerate(x)
    ]
    return pa.Table.from_pylist(rows, schema.PATHS)


def read(*paths, evaluated=None):
    table = pa.concat_tables([schema.PATHS.empty_table(), *paths]).select(COLUMNS)
    return run_paths(table, evaluations("a", evaluated or {}))


def test_paths_have_points_target_and_episode_return():
    found = read(
        path("b", 3, [0, 1]),
        path("a", 0, [0, 0.25, 0.5], target_yaw=0.5),
        path("a", 2, [0, -1], target_x=0.125, target_y=-0.25),
        evaluated={1000: 100.0, 2000: 200.0, 3000: 300.0},
    )
    assert set(found) == {"a", "b"}
    first, last = found["a"]
    assert first.points.tolist() == [[0, 0], [0.25, 0.5], [0.5, 1]]
    assert (first.control_steps, first.heading) == (1000, 1.0)
    np.testing.assert_array_equal(first.target, [np.nan, np.nan, 0.5])
    np.testing.assert_array_equal(last.target, [0.125, -0.25, np.nan])
    # The return of the first of two episodes is 5 below their mean.
    assert (first.episode_return, last.episode_return) == (95.0, 295.0)
    (other,) = found["b"]
    assert np.isnan(other.episode_return)


def test_runs_without_paths_give_none():
    assert read() == {}


@pytest.mark.parametrize("x", [[0.0], [0.0, np.nan], [np.inf, None]])
def test_fewer_than_two_points_are_no_path(x):
    rows = path("a", 0, [0.0] * len(x))
    index = rows.schema.get_field_index("x")
    assert read(rows.set_column(index, rows.schema.field("x"), pa.array(x, pa.float32()))) == {}


def test_report_assigns_paths_to_runs(fabric):
    with_path, without = (fabric.run([1.0, 2.0], seed=seed) for seed in (0, 1))
    with_path.append({"paths": path(with_path.id, 0, [0, 0.5])})
    made = {one.name: one.paths for one in document(gather(fabric.results, Request())).runs}
    assert [one.points.tolist() for one in made[with_path.id]] == [[[0, 0], [0.5, 1]]]
    assert made[without.id] == []
