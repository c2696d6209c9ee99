"""Tests of the report on unusual results: few seeds, unequal lengths, NaN, untrusted values."""

import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jbench.errors import NothingYetError
from jbench.report.frames import Frames
from jbench.report.reading import read
from jbench.report.request import Request
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.store import Results
from jbench.tasks.find import find_task
from tests.store.store_rows import alter_manifest

ALL = Request(window=4, claims=True, each_seed=True)
FLAT = np.full(40, 500.0)


def found(fabric):
    return Frames(fabric.results, ALL)


def findings(fabric, claim):
    claims = found(fabric).claims
    return claims[(claims["claim"] == claim) & (claims["source"] == "own")].to_dict("records")


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_seeds_have_no_interval_and_no_verdict(fabric, count):
    fabric.flat(900 + np.arange(count))
    (row,) = found(fabric).configurations.to_dict("records")
    assert row["seeds"] == count
    assert f"only {count} seed" in row["note"]
    assert math.isnan(row["median_low"])
    assert row["solved"] == "undecided"
    curves = found(fabric).curves
    assert curves[["q10", "q90"]].isna().all(axis=None)
    assert curves["median"].notna().all()
    (solved,) = findings(fabric, "g")
    assert (solved["verdict"], solved["seeds"]) == ("undecided", count)
    assert pd.isna(solved["seeds_needed"])


def test_unequal_lengths_are_noted_with_compared_steps(fabric):
    for seed in range(3):
        fabric.run(FLAT, seed)
        fabric.run(FLAT[: 20 + seed], seed, representation="dae12")
    rows = found(fabric).configurations.set_index("representation")
    assert "seeds of unequal length, 20 to 22 episodes" in rows.loc["dae12", "note"]
    (similar,) = findings(fabric, "a")
    assert similar["remark"] == "at 20k of 40k control steps, the last that every seed has"
    assert set(found(fabric).verdicts["steps"]) == {20_000}


def test_run_with_only_nan_returns_is_reported(fabric):
    fabric.run(np.full(40, math.nan))
    (row,) = found(fabric).configurations.to_dict("records")
    assert math.isnan(row["median"])
    assert row["seeds"] == 0
    assert found(fabric).headline == "There are no returns yet."


def test_profile_beside_agents_with_only_nan_returns_has_the_range_of_the_others(fabric):
    fabric.flat([math.nan] * 3, task="gym:Reacher-v5")
    fabric.flat([-8.0, -6.0, -4.0], task="gym:Reacher-v5", representation="dae12")
    profile = found(fabric).profiles
    assert [profile["final_return"].min(), profile["final_return"].max()] == [-8, -4]
    # Two of three seeds are above -7.
    assert profile.set_index("final_return").loc[-7.0, "share"] == pytest.approx(2 / 3)


def test_variability_of_identical_seeds_is_undecided(fabric):
    fabric.flat([500] * 6)
    fabric.flat([500] * 6, representation="dae12")
    (spread,) = findings(fabric, "b")
    assert math.isnan(spread["effect"])
    assert spread["verdict"] == "undecided"


def test_heuristics_are_judged_by_longest_evaluation_on_unchanged_robot(fabric):
    fabric.run(FLAT)
    fabric.evaluation("heuristic", [100.0] * 4)
    fabric.evaluation("heuristic", [950.0, 960.0, 970.0, 940.0, 930.0, 980.0])
    fabric.evaluation("heuristic", [1.0] * 9, augment=3)
    fabric.evaluation("random", [2.0] * 9)
    claims = found(fabric).claims
    (row,) = claims[claims["claim"] == "h"].to_dict("records")
    assert (row["compared"], row["seeds"], row["verdict"]) == ("face_direction", 6, "supported")
    assert row["effect"] == 955
    (note,) = [note for note in found(fabric).notes if "Claim (h)" in note]
    assert "not tested on move_from_origin, move_in_direction" in note
    assert "`jbench evaluate heuristic --task move_from_origin --results" in note


def test_what_to_type_for_the_shipped_results_writes_into_others(fabric):
    fabric.run(FLAT)
    fabric.results.name = Path("reference")
    (note,) = [note for note in found(fabric).notes if "Claim (h)" in note]
    merge, evaluate, report = re.findall("`(.*?)`", note)
    assert merge == "jbench merge reference"
    assert evaluate == "jbench evaluate heuristic --task move_from_origin"
    assert report == "jbench report --claims"


def test_invalid_settings_and_provenance_are_tolerated(fabric):
    for seed, robots in enumerate((0, "many", [1], None, -3)):
        record = fabric.run(FLAT, seed, augment="x", robots=robots, steps=40_000)
        alter_manifest(record, provenance={"packages": [], "command": 3})
    report = found(fabric)
    assert report.configurations["seeds"].sum() == 5
    assert report.provenance.empty


def test_what_to_type_without_runs_is_of_the_robot_at_hand(tmp_path):
    results = Results(tmp_path)

    def advice(**asked):
        with pytest.raises(NothingYetError) as raised:
            read(results, Request(**asked))
        return re.search("jbench train (.*) --steps 100000", str(raised.value))[1]

    assert advice() == "--task face_direction"
    task = find_task("gym:Pendulum-v1")
    for robot in ({}, dataset_robot(task.name, task.specs)):
        settings = DatasetSettings(**robot)
        results.create("dataset", settings.id, settings.model_dump())
        assert advice() == f"--task {robot.get('robot', 'face_direction')}"

    assert advice(task="gym:Hopper-v5", algo=("sac",)) == "--task gym:Hopper-v5 --algo sac"
