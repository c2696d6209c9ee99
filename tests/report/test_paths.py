"""Tests of reading the robots' paths for the runs of a report."""

import numpy as np
import pyarrow as pa
import pytest

from jbench.report.data.points import PATHS, run_paths
from jbench.report.frames import Frames
from jbench.report.run_details import run_details
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
    table = pa.concat_tables([schema.PATHS.empty_table(), *paths]).select(PATHS)
    return run_paths(table, evaluations("a", evaluated or {}))


def test_paths_have_points_target_and_episode_return():
    found = read(
        path("b", 3, [0, 1]),
        path("a", 0, [0, 0.25, 0.5], target_yaw=0.5),
        path("a", 2, [0, -1], target_x=0.125, target_y=-0.25),
        evaluated={1000: 100.0, 2000: 200.0, 3000: 300.0},
    )
    first, last = (found[(found["run"] == "a") & (found["steps"] == at)] for at in (1000, 3000))
    assert first[["x", "y"]].values.tolist() == [[0, 0], [0.25, 0.5], [0.5, 1]]
    assert first["heading"].tolist() == [0, 0.5, 1]
    targets = ["target_x", "target_y", "target_yaw"]
    np.testing.assert_array_equal(first[targets].iloc[0], [np.nan, np.nan, 0.5])
    np.testing.assert_array_equal(last[targets].iloc[0], [0.125, -0.25, np.nan])
    # The return of the first of two episodes is 5 below their mean.
    assert set(first["episode_return"]) == {95.0}
    assert set(last["episode_return"]) == {295.0}
    assert found[found["run"] == "b"]["episode_return"].isna().all()


@pytest.mark.parametrize("x", [[], [0.0], [0.0, np.nan], [np.inf, None]])
def test_fewer_than_two_points_are_no_path(x):
    assert run_paths(None, evaluations("a", {})).empty  # of results without that table
    rows = path("a", 0, [0.0] * len(x))
    index = rows.schema.get_field_index("x")
    assert read(rows.set_column(index, rows.schema.field("x"), pa.array(x, pa.float32()))).empty


def test_report_assigns_paths_to_runs(fabric):
    with_path, _ = (fabric.run([1.0, 2.0], seed=seed) for seed in (0, 1))
    with_path.append({"paths": path(with_path.id, 0, [0, 0.5])})
    found = Frames(fabric.results).paths
    assert set(found["run"]) == {with_path.id}
    assert set(found["source"]) == {"own"}
    assert found[["x", "y"]].values.tolist() == [[0, 0], [0.5, 1]]


def test_page_has_the_first_and_the_last_path_of_each_run_without_waiting(fabric):
    paths = {0: [0, 0.25, 0.25, 0.5], 1: [0, 9], 2: [0, -1]}  # metres, by evaluation
    runs = [fabric.run([1.0, 2.0], seed=seed) for seed in (0, 1, 2)]
    target = {"target_x": 0.125, "target_y": -0.25}
    first = [path(runs[0].id, at, x, **(target if at == 2 else {})) for at, x in paths.items()]
    runs[0].append({"paths": pa.concat_tables(first)})
    runs[2].append({"paths": path(runs[2].id, 0, [0.5, 0])})
    found = [detail.paths for detail in run_details(Frames(fabric.results)).runs]
    # In tenths of a millimeter; y is twice x.
    assert found[0] == [
        {"heading": 1.5, "points": [0, 0, 2500, 5000, 5000, 10_000]},
        {"x": 0.125, "y": -0.25, "heading": 0.5, "points": [0, 0, -10_000, -20_000]},
    ]
    assert found[1:] == [[], [{"heading": 0.5, "points": [5000, 10_000, 0, 0]}]]
