"""Tests of the frames of single runs: settings, learning curves and provenance."""

import json

import numpy as np
import pandas as pd
import pytest

from jbench.report.data import build
from jbench.report.data.points import run_points
from jbench.report.frames import Frames
from jbench.report.runs import provenance_frame, readable_provenance


@pytest.fixture
def found(fabric):
    fabric.run(np.arange(8) * 100.0, seed=0, evaluated={4000: 300.0, 8000: 700.0})
    fabric.run(np.arange(8) * 10.0, seed=1)
    fabric.run([5.0], seed=2, algo="ddpg", hyperparameters={"learning_rate": 3e-4})
    fabric.run([], seed=3, status="unfinished", steps=1000)
    return Frames(fabric.results)


def test_run_has_evaluation_and_training_curves(found):
    def curve(seed, returns):
        rows = found.run_curves
        return rows[(rows["seed"] == seed) & (rows["returns"] == returns)]

    assert curve(0, "evaluation")[["steps", "value"]].values.tolist() == [[4000, 300], [8000, 700]]
    # The window is a quarter of 8 episodes; the first and the last window are truncated.
    assert curve(0, "training")["value"].tolist() == [0, 50, 150, 250, 350, 450, 550, 650, 700]
    assert curve(1, "evaluation").empty
    assert curve(2, "training")["value"].tolist() == [5]


def test_settings_are_named_by_path_and_include_omitted_ones(found):
    runs = found.runs.set_index("seed")
    first, second, third = (runs.loc[seed, "settings"] for seed in range(3))
    assert first["seed"] == "0"
    assert first["hyperparameters.learning_rate"] == "1e-04"
    assert third["hyperparameters.learning_rate"] == "3e-04"
    assert first["precision"] == "float32"  # the record omits this default
    fields = ("task", "algo", "representation", "seed", "encoder")
    assert [name for name in first if name in fields] == [*fields]
    assert {name for name in first if first[name] != second.get(name)} == {
        "seed",
        "evaluate_episodes",
    }


def test_run_without_episodes_is_in_no_configuration(found):
    runs = found.runs.set_index("seed")
    assert runs.loc[3, "configuration"] == ""
    assert "The run face_direction/r0004 (unfinished) has no episodes yet." in found.notes
    assert runs.loc[0, "configuration"] == runs.loc[1, "configuration"] != ""
    assert runs["final"].isna().to_dict() == {0: False, 1: True, 2: True, 3: True}


def test_configurations_look_up_their_own_runs_only(fabric, monkeypatch):
    """Of 3,000 runs, a look at all of them for each configuration took a tenth of a report."""

    class Points(dict):
        def __iter__(self):
            raise AssertionError("all runs were looked at")

    monkeypatch.setattr(build, "run_points", lambda *table: Points(run_points(*table)))
    for algo in ("td3", "sac"):
        fabric.flat([100.0, 200.0], algo=algo)
    configurations, notes = fabric.configurations()
    assert [len(config.runs) for config in configurations] == [2, 2]
    assert notes == []


def test_values_of_a_name_stand_together_in_the_order_in_which_names_come():
    recorded = [{"cores": "2", "torch": "2.12"}, {"cores": "1", "torch": "2.12"}, {"numpy": "2"}]
    rows = provenance_frame(pd.DataFrame({"provenance": recorded}))
    assert rows.values.tolist() == [
        ["cores", "2", 1],
        ["cores", "1", 1],
        ["torch", "2.12", 2],
        ["numpy", "2", 1],
    ]


def test_provenance_of_any_content_is_read():
    recorded = {"packages": {"torch": "2.13"}, "git_revision": None, "command": ["jbench", "train"]}
    assert readable_provenance(json.dumps(recorded)) == {"command": "jbench train", "torch": "2.13"}
    assert readable_provenance('{"packages": [], "command": 3}') == {"command": "3"}
    assert readable_provenance("[]") == {}
