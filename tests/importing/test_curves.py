"""Tests of imported curves as runs, on rows of `imports` and `import_points` that are given."""

import json

import pandas as pd
import pytest

from jbench.importing.curves import as_imports, as_runs, to_json

PROVENANCE = {"jbench": "0.1.0", "command": ["jbench", "import"], "host": "turing"}
"""Of which the machine's name is not that of the training."""


def runs_with_curves(*curves):
    """Returns the imported runs; a curve is what differs from training returns of seed 0."""
    imports = []
    points = []
    for number, changes in enumerate(curves):
        about = {"import": f"i{number}", "task": "walk", "algo": "td3", "representation": "full"}
        about |= {"seed": 0, "returns": "training", "points": 2, "control_steps": 2000}
        about |= {"status": "finished", "format": "csv", "provenance": json.dumps(PROVENANCE)}
        about |= changes
        imports.append(about)
        for point in range(about["points"] or 0):
            value = 100 * number + point
            row = {"import": about["import"], "point": point, "episode": 0}
            points.append(row | {"control_steps": 1000 * (point + 1), "episode_return": value})
    return as_runs(pd.DataFrame(imports), pd.DataFrame(points))


def returns_in_table(imported, table):
    rows = imported.tables[table].to_pandas()
    return {run: each["episode_return"].tolist() for run, each in rows.groupby("run")}


def test_both_kinds_of_returns_of_a_seed_are_one_run_with_the_id_of_its_training():
    imported = runs_with_curves({"returns": "evaluation", "points": 3, "control_steps": 3000}, {})
    assert imported.tables["runs"]["run"].to_pylist() == ["i1"]
    assert returns_in_table(imported, "evaluations") == {"i1": [0, 1, 2]}
    assert returns_in_table(imported, "episodes") == {"i1": [100, 101]}


def test_points_of_training_are_episodes_and_those_of_evaluations_are_evaluations():
    imported = runs_with_curves({"points": 3}, {"returns": "evaluation", "points": 3})
    assert imported.tables["episodes"]["episode"].to_pylist() == [0, 1, 2]
    evaluations = imported.tables["evaluations"]
    assert evaluations["evaluation"].to_pylist() == [0, 1, 2]
    assert evaluations["episode"].to_pylist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("other", "used"),
    [
        ({"control_steps": 3000}, "i1"),
        ({"control_steps": 1000}, "i0"),
        ({"points": 3}, "i1"),  # as many control steps
        ({"points": 1}, "i0"),
        ({}, "i0"),  # alike: the first by its id
    ],
)
def test_longest_of_several_curves_of_a_seed_is_used_and_the_others_are_counted(other, used):
    imported = runs_with_curves({}, other)
    assert [*returns_in_table(imported, "episodes")] == [used]
    said = "1 imported curve is not used, since a longer one of the same seed was imported."
    assert imported.notes[-1] == said


@pytest.mark.parametrize(
    "lacking", ["task", "algo", "representation", "seed", "returns", "points", "control_steps"]
)
def test_import_that_lacks_what_tells_runs_apart_is_a_problem(lacking):
    imported = runs_with_curves({"seed": 1}, {lacking: None})
    assert imported.tables["runs"]["run"].to_pylist() == ["i0"]
    (problem,) = imported.problems
    assert problem.startswith("The import i1 lacks a label, a seed, its kind of return or its ")


def test_import_that_is_not_finished_is_no_run():
    imported = runs_with_curves({}, {"seed": 1, "status": "unfinished"})
    assert imported.tables["runs"]["run"].to_pylist() == ["i0"]
    assert imported.problems == []


def test_machine_of_an_import_is_not_that_of_the_training():
    (kept,) = runs_with_curves({}).tables["runs"]["provenance"].to_pylist()
    assert json.loads(kept) == {"jbench": "0.1.0", "command": ["jbench", "import"]}


@pytest.mark.parametrize(
    ("format", "notes"),
    [
        ("sb3-monitor", 1),
        ("sb3-evaluations", 1),
        ("csv", 2),  # points need not be episodes
    ],
)
def test_points_of_logs_are_said_to_be_values_that_need_not_be_returns(format, notes):
    imported = runs_with_curves({"format": format})
    assert imported.notes[0].startswith(f"1 imported curve ({format}) is not verified: ")
    assert len(imported.notes) == notes
    assert runs_with_curves({"status": "unfinished"}).notes == []


def test_curves_of_a_file_are_imports_with_their_number_of_points():
    rows = [("walk", "A", 0, 1000, 5.0), ("walk", "A", 0, 2500, 6.0), ("walk", "A", 1, 1000, 7.0)]
    points = pd.DataFrame(rows, columns=["task", "method", "seed", "steps", "return"])
    imports, numbered = as_imports(points, "evaluation")
    assert imports[["algo", "seed", "returns", "points", "control_steps"]].to_numpy().tolist() == [
        ["A", 0, "evaluation", 2, 2500],
        ["A", 1, "evaluation", 1, 1000],
    ]
    assert numbered["point"].tolist() == [0, 1, 0]
    assert returns_in_table(as_runs(imports, numbered), "evaluations") == {
        "curve 1": [5, 6],
        "curve 2": [7],
    }


def test_json_has_the_returns_of_each_seed_by_millions_of_control_steps():
    rows = [("walk", "A", 0, 1500, 5.0), ("walk", "A", 0, 2500, 6.0), ("walk", "B", 3, 10, -1.0)]
    points = pd.DataFrame(rows, columns=["task", "method", "seed", "steps", "return"])
    assert json.loads(to_json(points)) == {
        "walk": {
            "A": {"seed_0": {"million_steps": [0.0015, 0.0025], "return": [5, 6]}},
            "B": {"seed_3": {"million_steps": [0.00001], "return": [-1]}},
        }
    }
