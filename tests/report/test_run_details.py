"""Tests of the details of single runs in a report: settings, learning curves and paths."""

from dataclasses import replace

import numpy as np
import pytest

from jbench.report.contents import document
from jbench.report.data.paths import RunPath
from jbench.report.page import runs
from jbench.report.report import gather
from jbench.report.request import Request


@pytest.fixture
def details(fabric):
    fabric.run(np.arange(8) * 100.0, seed=0, evaluated={4000: 300.0, 8000: 700.0})
    fabric.run(np.arange(8) * 10.0, seed=1)
    fabric.run([5.0], seed=2, algo="ddpg", hyperparameters={"learning_rate": 3e-4})
    made = document(gather(fabric.results, Request()))
    assert [one.name for one in made.runs] == made.provenance["run"].tolist()
    return made.runs


def test_run_has_evaluation_and_training_curves(details):
    first, second, third = details
    evaluated, trained = first.curves
    assert evaluated.label == "evaluation return"
    assert (evaluated.control_steps.tolist(), evaluated.returns.tolist()) == (
        [4000, 8000],
        [300, 700],
    )
    # The window is a quarter of 8 episodes; the first and the last window are truncated.
    assert trained.label == "training return, mean over 2 episodes"
    assert trained.returns.tolist() == [0, 50, 150, 250, 350, 450, 550, 650, 700]
    assert [curve.returns.tolist() for curve in second.curves] == [
        [0, 5, 15, 25, 35, 45, 55, 65, 70]
    ]
    assert [curve.returns.tolist() for curve in third.curves] == [[5]]


def test_settings_are_named_by_path_and_include_omitted_ones(details):
    first, second, third = details
    assert first.settings["seed"] == "0"
    assert first.settings["hyperparameters.learning_rate"] == "1e-04"
    assert third.settings["hyperparameters.learning_rate"] == "3e-04"
    assert first.settings["precision"] == "float32"  # the record omits this default
    assert [*first.settings][:5] == ["task", "algo", "representation", "encoder", "seed"]
    differing = {name for name in first.settings if first.settings[name] != second.settings[name]}
    assert differing == {"seed"}
    assert first.cell == second.cell != third.cell
    assert third.tags["algorithm"] == "DDPG"


def test_packed_runs_share_common_values(details):
    packed = runs.packed(details)
    one, other, third = packed["runs"]
    assert (one["cell"], other["cell"], third["cell"]) == (0, 0, 1)
    # Steps of curves of 8 episodes (shared), of two evaluations and of a single episode.
    assert packed["steps"][0] == (4000, 8000)
    assert packed["steps"][1] == (1000, 1500, 2500, 3500, 4500, 5500, 6500, 7500, 8000)
    assert len(packed["steps"]) == 3
    assert one["curves"][1][1] == other["curves"][0][1] == 1
    assert len(set(one["settings"]) ^ set(other["settings"])) == 2
    unpacked = dict(packed["settings"][index] for index in third["settings"])
    assert unpacked == details[2].settings


def test_paths_are_packed_in_tenths_of_millimeters(details, monkeypatch):
    points = np.array([[0, 0], [0.01, -0.02], [0.12345, 0]])
    path = RunPath(4000.0, 12.34, points, -0.5, np.array([0.1, np.nan, 2.0]))
    unknown = path._replace(episode_return=np.nan)
    packed = runs.packed([replace(details[0], paths=[path, unknown]), details[1]])
    one, other = packed["runs"]
    wanted = [4000, 12.3, [0, 0, 100, -200, 1234, 0], -0.5, [0.1, None, 2.0]]
    assert one["paths"] == [wanted, [4000, None, *wanted[2:]]]
    assert other["paths"] == []
    # Both paths are thinned to two points, the first and the last.
    monkeypatch.setattr(runs, "PAGE_POINTS", 4)
    thin = runs.packed([replace(details[0], paths=[path, path])])
    assert [one[2] for one in thin["runs"][0]["paths"]] == [[0, 0, 1234, 0]] * 2


def test_many_runs_share_point_budget_of_page(details):
    long = (
        details[0].curves[1]._replace(control_steps=np.arange(1000.0), returns=np.full(1000, 1 / 3))
    )
    many = [details[0].__class__("a", ("", ""), {}, [long] * 400, {})]
    (only,) = runs.packed(many)["runs"]
    # 20,000 points are shared by 400 curves.
    assert {len(returns) for _, _, returns in only["curves"]} <= set(range(25, 51))
    assert only["curves"][0][2][0] == 0.3
