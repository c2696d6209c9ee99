"""Tests of the report on unusual results: few seeds, unequal lengths, NaN, untrusted values."""

import json
import math
import re

import numpy as np
import pyarrow as pa
import pytest

from jbench.errors import RequestError, WorkError
from jbench.report import contents
from jbench.report.analysis.scores import statistics_frame
from jbench.report.report import gather, write_report
from jbench.report.request import Request
from jbench.report.tables import files
from jbench.store import schema

pytestmark = pytest.mark.usefixtures("no_png")

ALL = Request(window=4, claims=True, each_seed=True, formats=("svg",))
FLAT = np.full(40, 500.0)


class GatheredReport:
    """Data and summary of a report that is not written to files."""

    def __init__(self, fabric):
        self.data = gather(fabric.results, ALL)
        self.document = contents.document(self.data)
        self.rows = self.data.table.to_dict("records")
        self.summary = " ".join(self.document.summary)
        (view,) = self.data.views  # none of these runs has evaluations
        frame = statistics_frame(view.statistics)
        self.statistics = frame.set_index(["measure", "statistic"])

    def table(self, name):
        (found,) = [item for item in contents.tables(self.document) if item.name == name]
        return files.to_markdown(found)

    def findings(self, claim):
        return [f for f in self.data.findings if (f.claim, f.source) == (claim, "ours")]


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_seeds_have_no_interval_and_no_verdict(fabric, count):
    for seed in range(count):
        fabric.run(FLAT + 400 + seed, seed)
    report = GatheredReport(fabric)
    (row,) = report.rows
    assert row["seeds"] == count
    assert f"only {count} seed" in row["notes"]
    assert report.statistics["low"].isna().all()
    (solved,) = report.findings("g")
    assert (solved.verdict, solved.seeds, solved.seeds_needed) == ("undecided", count, None)
    assert "but uncertain" in report.summary


@pytest.mark.parametrize(("count", "verdict"), [(5, "undecided"), (6, "supported")])
def test_verdict_needs_six_seeds(fabric, count, verdict):
    for seed in range(count):
        fabric.run(FLAT + 450 + seed, seed)
    report = GatheredReport(fabric)
    (solved,) = report.findings("g")
    assert solved.verdict == verdict
    assert ("but uncertain" in report.summary) == (count == 5)


def test_median_that_rounds_to_900_contradicts_claim(fabric):
    for seed in range(6):
        fabric.run(FLAT + 399.6, seed)
    assert "| 899.6 [899.6, 899.6] |  | contradicted |" in GatheredReport(fabric).table("claims")


def test_label_that_reads_like_algorithm_of_paper_has_own_row(fabric):
    for seed in range(3):
        fabric.run(FLAT, seed)
        fabric.run(FLAT + 200, seed, algo="TD3", engine="external")
    table = GatheredReport(fabric).table("final_returns")
    assert "| TD3 | full | 40k | 500 [500, 500], n = 3 |" in table
    assert "| TD3 (label) | full | 40k | 700 [700, 700], n = 3 |" in table


def test_unequal_lengths_are_noted_with_compared_steps(fabric):
    for seed in range(3):
        fabric.run(FLAT, seed)
        fabric.run(FLAT[: 20 + seed], seed, representation="dae12")
    report = GatheredReport(fabric)
    notes = {row["representation"]: row["notes"] for row in report.rows}
    assert "seeds of unequal length, 20 to 22 episodes" in notes["dae12"]
    (similar,) = report.findings("a")
    assert similar.remark == "at 20k of 40k control steps, the last that every seed has"
    assert re.search(r"\| 3, 3 \| 20k \|.*\| 20k \|", report.table("comparisons"))


@pytest.mark.parametrize("status", ["failed", "unfinished"])
def test_failed_or_unfinished_run_is_counted_and_noted(fabric, status):
    fabric.run(FLAT, 0)
    fabric.run(FLAT[:30], 1, status=status, steps=40_000)
    report = GatheredReport(fabric)
    (row,) = report.rows
    assert (row["seeds"], row["episodes_min"], row["episodes_max"]) == (2, 30, 40)
    assert f"seed 1 {status} after 30 episodes" in row["notes"]
    assert f"Of all runs, 1 {status}." in report.summary


def test_non_finite_returns_are_counted_in_notes(fabric):
    fabric.run(np.r_[FLAT[:39], math.nan], 0)
    fabric.run(np.full(40, math.nan), 1)
    fabric.run(np.r_[math.inf, FLAT[:39]], 2)
    report = GatheredReport(fabric)
    (row,) = report.rows
    for part in ("1 return of seed 0 is", "40 returns of seed 1 are", "1 return of seed 2 is"):
        assert part in row["notes"]
    assert row["training_return_median"] == 500
    # Seed 1 has no final return and is not counted in n.
    assert report.statistics.loc[("final_return", "median"), "seeds"] == 2
    assert "500 [500, 500], n = 2" in report.table("final_returns")


def test_run_with_only_nan_returns_is_reported(fabric, out):
    fabric.run(np.full(40, math.nan))
    report = GatheredReport(fabric)
    assert math.isnan(report.rows[0]["training_return_median"])
    assert "| TD3 | full | 40k |  |" in report.table("final_returns")
    assert write_report(fabric.results, out, ALL).files


def test_cell_with_one_representation_has_no_comparison(fabric):
    for seed in range(3):
        fabric.run(FLAT, seed, representation="dae12")
    report = GatheredReport(fabric)
    assert report.data.comparisons == []
    assert not report.findings("a")
    assert not any("ratio" in statistic for _, statistic in report.statistics.index)
    assert "| TD3 | dae12 | 40k | 500" in report.table("final_returns")


def test_spread_of_identical_seeds_is_undecided(fabric):
    for seed in range(6):
        fabric.run(FLAT, seed)
        fabric.run(FLAT, seed, representation="dae12")
    (spread,) = GatheredReport(fabric).findings("b")
    assert math.isnan(spread.effect.value)
    assert spread.verdict == "undecided"


def test_augmented_robots_are_separate_cells_and_test_no_claim(fabric):
    for seed in range(3):
        fabric.run(FLAT, seed)
        fabric.run(FLAT + 100, seed, representation="dae12", augment=3)
        fabric.run(FLAT + 100, seed, augment=0, robots=2)
    report = GatheredReport(fabric)
    assert len(report.rows) == 3
    assert not report.findings("a")
    # Claim (g) is tested only on the cell of the unchanged robot.
    assert len(report.findings("g")) == 1
    all_notes = [row["notes"] for row in report.rows]
    assert sum("trained on 2 augmented robots in sequence" in notes for notes in all_notes) == 1


def test_two_engines_are_two_variants(fabric):
    for seed in range(3):
        fabric.run(FLAT, seed, engine="sb3")
        fabric.run(FLAT + 100, seed, engine="batched")
    report = GatheredReport(fabric)
    assert [(row["settings"], row["seeds"]) for row in report.rows] == [
        ("engine=batched", 3),
        ("engine=sb3", 3),
    ]
    (one,) = report.data.comparisons
    assert {one.ours.settings.engine, one.theirs.settings.engine} == {"sb3", "batched"}


def evaluated(fabric, policy, returns, **settings):
    """Adds an evaluation of a policy on face_direction, with these episode returns."""
    id = f"face_direction/{policy}/e{len(returns)}-{len(settings)}"
    settings = {"task": "face_direction", "policy": policy, "episodes": len(returns), **settings}
    record = fabric.results.create("evaluation", id, settings)
    columns = {
        "evaluation": [id] * len(returns),
        "episode": range(len(returns)),
        "episode_return": returns,
        "length": [1000] * len(returns),
    }
    names = schema.POLICY_EPISODES.names
    rows = [{n: columns[n][i] if n in columns else 0.0 for n in names} for i in range(len(returns))]
    record.append({"policy_episodes": pa.Table.from_pylist(rows, schema.POLICY_EPISODES)})
    record.finish({"median": float(np.median(returns))})


def test_heuristics_are_judged_by_longest_evaluation_on_unchanged_robot(fabric):
    fabric.run(FLAT)
    evaluated(fabric, "heuristic", [100.0] * 4)
    evaluated(fabric, "heuristic", [950.0, 960.0, 970.0, 940.0, 930.0, 980.0])
    evaluated(fabric, "heuristic", [1.0] * 9, augment=3)
    evaluated(fabric, "random", [2.0] * 9)
    report = GatheredReport(fabric)
    (found,) = report.findings("h")
    assert (found.compared, found.seeds, found.verdict) == ("face_direction", 6, "supported")
    assert found.effect.value == 955
    (note,) = [note for note in report.document.notes if "Claim (h)" in note]
    assert "not tested on move_from_origin, move_in_direction" in note


class TestDatabases:
    def test_empty_database_reports_command_to_type(self, fabric, out):
        with pytest.raises(RequestError, match="run `jbench train"):
            write_report(fabric.results, out, ALL)

    def test_damaged_database_reports_repair_command(self, fabric, out):
        record = fabric.run(FLAT)
        (record.path / "manifest.json").write_text("{")
        with pytest.raises(WorkError, match=r"`jbench repair --results .*` sets it aside"):
            write_report(fabric.results, out, ALL)

    def test_invalid_settings_and_provenance_are_tolerated(self, fabric):
        for seed, robots in enumerate((0, "many", [1], None, -3)):
            record = fabric.run(FLAT, seed, augment="x", robots=robots, steps=40_000)
            path = record.path / "manifest.json"
            manifest = json.loads(path.read_text())
            path.write_text(json.dumps({**manifest, "provenance": {"packages": [], "command": 3}}))
        report = GatheredReport(fabric)
        assert sum(row["seeds"] for row in report.rows) == 5
        assert len(report.document.provenance) == 5
