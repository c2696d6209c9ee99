"""Tests of the files of a report."""

import csv
import html
import json
import math
import re

import numpy as np
import pandas as pd
import pytest

from jbench.errors import RequestError, WorkError
from jbench.policies.evaluate import evaluate
from jbench.report.data.curves import QUANTILES
from jbench.report.report import gather, write_report
from jbench.report.request import Request
from jbench.settings.evaluation import EvaluationSettings
from tests.report.conftest import drawn_files

KEY = ["task", "algo", "representation", "variant", "source", "returns"]
FLAT = np.full(400, 500.0)


@pytest.mark.usefixtures("no_png")
def test_all_files_are_written_and_listed(fabric, out):
    for seed in range(3):
        fabric.run(FLAT, seed=seed, algo="ddpg")
        fabric.run(FLAT, seed=seed, algo="ddpg", representation="dae12")
    report = write_report(fabric.results, out)
    tables = ["final_returns", "statistics", "spread", "learning_speed", "comparisons"]
    tables += ["reduction_tests", "leaderboard"]
    figures = ["figure9", "forest", "reduction", "matrix", "profiles"]
    figures.append("comparison-face_direction-ddpg")
    assert drawn_files(report) == [f"{name}.{kind}" for name in figures for kind in ("png", "svg")]
    assert sorted(report.files) == sorted(out.iterdir())
    assert {path.name for path in report.files} - {*drawn_files(report)} == {
        "aggregate.parquet",
        "aggregate.csv",
        "reduction.csv",
        "table.csv",
        "seed_statistics.csv",
        "seed_comparisons.csv",
        *(f"{name}.{kind}" for name in tables for kind in ("md", "tex", "csv")),
        "index.html",
        "report.json",
    }
    assert report.data.problems == []
    assert report.data.notes == [
        "No run has evaluations: the report leads with training returns, exploration included.",
        "No cell has the processor times of all its runs, so return against processor time is not "
        "drawn.",
    ]


@pytest.mark.usefixtures("no_png")
def test_same_results_give_identical_files(fabric, tmp_path):
    for seed in range(3):
        fabric.run(FLAT + seed, seed=seed)
    first = write_report(fabric.results, tmp_path / "a")
    second = write_report(fabric.results, tmp_path / "b")
    for one, other in zip(first.files, second.files, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


class TestAggregate:
    def test_aggregate_has_sorted_row_per_point(self, fabric):
        for task, algo in (("move_to_pose", "ddpg"), ("face_direction", "td3")):
            for representation in ("full", "dae12"):
                for seed in range(2):
                    fabric.run(FLAT, seed=seed, task=task, algo=algo, representation=representation)
        frame = gather(fabric.results, Request(window=50)).aggregate
        assert list(frame) == [
            *KEY, "order", "window", "control_steps", "seeds", *[f"q{q}" for q in QUANTILES]
        ]  # fmt: skip
        assert len(frame) == 4 * (400 + 1)
        assert frame.equals(frame.sort_values([*KEY, "control_steps"], ignore_index=True))
        assert set(frame["window"]) == {*range(25, 51)}

    @pytest.mark.usefixtures("undrawn")
    def test_csv_and_parquet_hold_same_numbers(self, fabric, out):
        rng = np.random.default_rng(0)
        for seed in range(3):
            fabric.run(rng.uniform(0, 1000, 400 - 50 * seed), seed=seed)
        report = write_report(fabric.results, out, Request(window=10))
        parquet = pd.read_parquet(out / "aggregate.parquet")
        pd.testing.assert_frame_equal(parquet, report.data.aggregate)
        text = pd.read_csv(out / "aggregate.csv")
        pd.testing.assert_frame_equal(text, report.data.aggregate, check_dtype=False, rtol=1e-12)
        assert set(report.data.aggregate["seeds"]) == {1, 2, 3}

    def test_aggregate_uses_requested_order(self, fabric):
        turns = np.tile([0.0, 10.0], 4)
        for seed, returns in enumerate((turns, 10 - turns, np.full(8, 4.0))):
            fabric.run(returns, seed=seed)
        for order, median in (("quantile-first", 4), ("smooth-first", 5)):
            frame = gather(fabric.results, Request(order=order, window=2)).aggregate
            assert set(frame["order"]) == {order}
            assert frame["q50"].tolist()[1:-1] == [median] * 7

    def test_window_larger_than_run_is_reduced_and_noted(self, fabric):
        fabric.run(np.arange(12.0))
        report = gather(fabric.results, Request(window=1000))
        assert set(report.aggregate["window"]) == {2, 3}
        assert any("window of 3 instead of 1000 episodes" in note for note in report.notes)

    def test_same_note_on_several_cells_is_merged(self, fabric):
        for algo in ("ddpg", "sac", "td3"):
            fabric.run(np.arange(12.0), algo=algo)
        notes = gather(fabric.results, Request(window=1000)).notes
        (note,) = [note for note in notes if "instead of 1000" in note]
        assert re.match(r"3 cells, such as face_direction ddpg full: window of 3 instead", note)


@pytest.mark.usefixtures("undrawn")
class TestTable:
    def test_row_has_own_and_published_numbers(self, fabric, out):
        for seed, end in enumerate((900.0, 950.0, 1000.0)):
            fabric.run(np.r_[np.zeros(4900), np.full(100, end)], seed=seed)
        row = write_report(fabric.results, out).data.table.iloc[0]
        assert row[KEY[:3]].tolist() == ["face_direction", "td3", "full"]
        assert (row["seeds"], row["episodes_min"], row["episodes_max"]) == (3, 5000, 5000)
        assert (row["steps_min"], row["steps_max"]) == (5_000_000, 5_000_000)
        assert row["training_return_median"] == 950
        band = row["training_return_q10"], row["training_return_q90"]
        assert band == pytest.approx((910, 990))
        assert row["training_return_steps"] == 4_950_500
        assert math.isnan(row["evaluation_return_median"])
        assert (round(row["published_median"]), row["published_figure"]) == (963, "fig9")
        with (out / "table.csv").open() as file:
            (written,) = csv.DictReader(file)
        assert float(written["training_return_median"]) == 950

    def test_published_columns_are_blank_without_published_curve(self, fabric, out):
        fabric.run(np.zeros(20))
        fabric.run(np.zeros(400), algo="sac", representation="dae12")
        table = write_report(fabric.results, out).data.table
        assert table["published_median"].isna().all()
        assert table["published_figure"].isna().all()
        with (out / "table.csv").open() as file:
            assert {row["published_median"] for row in csv.DictReader(file)} == {""}

    def test_row_of_ppo_notes_published_steps(self, fabric):
        fabric.run(FLAT, algo="ppo", environments=8)
        fabric.run(FLAT, algo="sac")
        notes = gather(fabric.results, Request()).table.set_index("algo")["notes"]
        assert "probably those of one of 8 environments" in notes["ppo"]
        assert "environments" not in notes["sac"]

    def test_unequal_failed_and_repeated_runs_are_noted(self, fabric, out):
        fabric.run(FLAT, seed=0)
        fabric.run(FLAT[:200], seed=0)
        fabric.run(FLAT[:300], seed=1, status="failed")
        fabric.run(np.r_[FLAT[:399], math.nan], seed=2, status="unfinished")
        report = write_report(fabric.results, out, Request(window=10))
        (row,) = report.data.table.to_dict("records")
        assert (row["seeds"], row["episodes_min"], row["episodes_max"]) == (3, 300, 400)
        assert row["training_return_median"] == 500
        for part in (
            "seed 0 has 2 runs: the longest is used, of 400 episodes, not that of 200",
            "seed 1 failed after 300 episodes",
            "seed 2 unfinished after 400 episodes",
            "seeds of unequal length, 300 to 400 episodes",
            "1 return of seed 2 is not finite",
        ):
            assert part in row["notes"]
            assert any(
                part in note and "face_direction td3 full" in note for note in report.data.notes
            )
        page = (out / "index.html").read_text()
        assert "seed 1 failed after 300 episodes" in page


@pytest.mark.usefixtures("undrawn")
class TestDamage:
    def test_damaged_run_is_reported_and_others_are_used(self, fabric, out):
        damaged = fabric.run(FLAT, seed=0)
        fabric.run(FLAT, seed=1)
        (file,) = damaged.path.glob("*.parquet")
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 255
        file.write_bytes(content)
        report = write_report(fabric.results, out)
        assert len(report.data.problems) == 1
        assert file.name in report.data.problems[0]
        assert damaged.id in report.data.problems[0]
        assert report.data.table["seeds"].tolist() == [1]
        assert html.escape(report.data.problems[0]) in (out / "index.html").read_text()

    def test_only_damaged_runs_are_refused(self, fabric, out):
        damaged = fabric.run(FLAT)
        (damaged.path / "manifest.json").write_text("{")
        with pytest.raises(WorkError, match=r"can be reported.*manifest\.json"):
            write_report(fabric.results, out)
        assert not out.exists()


@pytest.mark.usefixtures("undrawn")
class TestRequests:
    def test_empty_database_reports_train_command(self, fabric, out):
        command = "`jbench train --task face_direction --steps 100000 --seeds 0-1 --results "
        with pytest.raises(RequestError, match=command):
            write_report(fabric.results, out)
        assert not out.exists()

    def test_evaluated_policies_are_drawn_without_runs(self, fabric, short_episodes, out):
        settings = EvaluationSettings(
            task="move_in_direction", policy="constant:0.5", episodes=1, states=True
        )
        evaluate(settings, fabric.results, threads=1)
        report = write_report(fabric.results, out)
        assert {name.partition(".")[0] for name in drawn_files(report)} == {
            "figure4-move_in_direction",
            "figure5-move_in_direction",
        }
        assert "There are no runs yet" in (out / "index.html").read_text()
        assert len(report.data.table) == 0
        with pytest.raises(RequestError, match="There are no runs"):
            write_report(fabric.results, out, Request(task="move_to_pose"))

    def test_runs_without_episodes_are_refused(self, fabric, out):
        fabric.run([], status="unfinished", steps=1000)
        with pytest.raises(RequestError, match=r"No run has an episode yet.*r0001"):
            write_report(fabric.results, out)

    @pytest.mark.parametrize(
        ("filters", "asked"),
        [
            ({"task": "dance"}, "task 'dance'"),
            ({"algo": "dqn"}, "algo 'dqn'"),
            ({"task": "face_direction", "algo": "ddpg"}, "task 'face_direction' and algo 'ddpg'"),
            ({"task": ""}, "task ''"),
        ],
    )
    def test_filter_without_match_lists_available_cells(self, fabric, filters, asked):
        fabric.run(FLAT, algo="td3")
        fabric.run(FLAT, algo="sac")
        fabric.run(FLAT, task="move_to_pose", algo="ddpg")
        with pytest.raises(RequestError) as error:
            gather(fabric.results, Request(**filters))
        assert asked in str(error.value)
        assert "face_direction with sac, td3; move_to_pose with ddpg" in str(error.value)

    def test_filter_excludes_other_cells(self, fabric):
        fabric.run(FLAT, algo="td3")
        fabric.run(FLAT, algo="ddpg")
        fabric.run(FLAT, task="move_to_pose", algo="ddpg")
        report = gather(fabric.results, Request(task="face_direction", algo="ddpg"))
        assert report.table[["task", "algo"]].to_numpy().tolist() == [["face_direction", "ddpg"]]
        assert set(report.aggregate["algo"]) == {"ddpg"}

    @pytest.mark.parametrize(
        ("wrong", "printed"),
        [
            ({"window": 0}, "window of 0"),
            ({"window": 1.5}, "window of 1.5"),
            ({"window": -5}, "window of -5"),
            ({"order": "random"}, "quantile-first or smooth-first"),
        ],
    )
    def test_invalid_window_or_order_is_refused(self, wrong, printed):
        with pytest.raises(RequestError, match=printed):
            Request(**wrong)

    def test_report_path_that_is_file_is_refused(self, fabric, out):
        fabric.run(FLAT)
        out.write_text("mine")
        with pytest.raises(RequestError, match="is a file"):
            write_report(fabric.results, out)
        assert out.read_text() == "mine"


HOSTILE = '<script>alert("1")</script>&amp;<img src=x onerror=alert(1)>'


@pytest.mark.usefixtures("undrawn")
def test_names_with_path_separators_write_no_file_outside(fabric, out):
    for name in ("face_direction", "x/../../../etc/passwd"):
        for representation in ("full", "x/../../y"):
            fabric.run(FLAT[:4], task=name, algo=name, representation=representation)
    report = write_report(fabric.results, out)
    assert sorted(report.files) == sorted(out.rglob("*"))


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("setting", ["task", "algo", "representation", "engine"])
def test_record_with_hostile_name_is_skipped_and_reported(fabric, out, setting):
    fabric.run(FLAT[:4])
    manifest = fabric.run(FLAT[:4], seed=1).path / "manifest.json"
    content = json.loads(manifest.read_text())
    content["settings"][setting] = HOSTILE
    manifest.write_text(json.dumps(content))
    report = write_report(fabric.results, out)
    (problem,) = report.data.problems
    assert str(manifest) in problem
    assert list(report.data.table["seeds"]) == [1]
    assert not any(b"alert(1)" in path.read_bytes() for path in report.files)


@pytest.mark.usefixtures("undrawn")
def test_page_shows_table_and_explains_orders(fabric, out):
    for seed in range(3):
        fabric.run(np.full(5000, 910.0 + seed), seed=seed)
    write_report(fabric.results, out)
    page = (out / "index.html").read_text()
    assert "911 [910, 912], n = 3" in page
    assert "963 (Figure 9)" in page
    printed = html.unescape(page)
    assert "Quantile-first, the order of the paper's Figure 9" in printed
    assert "Smooth-first, the order of Figure 8" in printed
