"""Tests of reports on imported learning curves, alone and together with runs."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

import jbench
from jbench.cli import main
from jbench.report import contents
from jbench.report.data.cells import IMPORTED
from jbench.report.report import gather, write_report
from jbench.report.request import Request
from jbench.store import Results

pytestmark = pytest.mark.usefixtures("undrawn")

RETURNS = {
    "slow": {seed: 400.0 + 10 * seed for seed in range(6)},
    "fast": {seed: 800.0 + 10 * seed for seed in range(6)},
}
"""Return of every episode, by label and seed."""


def add(results, tmp_path, algo, returns, form="csv", episodes=8, more=()):
    """Imports curves of constant returns."""
    file = tmp_path / f"{algo}-{form}.csv"
    steps = (np.arange(episodes) + 1) * 1000
    frames = [
        pd.DataFrame({"seed": seed, "control_steps": steps, "episode_return": value})
        for seed, value in returns.items()
    ]
    pd.concat(frames).to_csv(file, index=False)
    typed = ("--from", "csv", "--task", "face_direction", "--algo", algo, *more)
    where = ("--seed-column", "seed", "--results", str(results), str(file))
    assert main(["import", *typed, *where]) == 0


@pytest.fixture
def demo(demo_results, tmp_path):
    """A copy of results with runs."""
    shutil.copytree(demo_results.path, tmp_path / "demo")
    return tmp_path / "demo"


@pytest.fixture(scope="module")
def two_imported(tmp_path_factory):
    path = tmp_path_factory.mktemp("two")
    for algo, returns in RETURNS.items():
        add(path / "imported", path, algo, returns)
    return path / "imported"


@pytest.fixture
def imported(two_imported, tmp_path):
    """Results with two imported algorithms and no runs."""
    return shutil.copytree(two_imported, tmp_path / "imported")


def test_report_of_imports_alone_has_statistics(imported, tmp_path):
    request = Request(formats=("svg",))
    written = write_report(Results(imported), tmp_path / "report", request)
    assert list(written.data.table["source"].unique()) == [IMPORTED]
    table = written.data.table.set_index("algo")
    for algo, returns in RETURNS.items():
        low, median, high = np.percentile(list(returns.values()), (10, 50, 90))
        columns = [f"training_return_{name}" for name in ("median", "q10", "q90")]
        assert table.loc[algo, columns].tolist() == pytest.approx([median, low, high])
    statistics = pd.read_csv(tmp_path / "report" / "seed_statistics.csv")
    chosen = (statistics["measure"] == "final_return") & (statistics["statistic"] == "median")
    medians = statistics[chosen].set_index("algo")
    assert (medians["low"] <= medians["value"]).all()
    assert (medians["value"] <= medians["high"]).all()
    assert set(medians["seeds"]) == {6}
    # Every seed of fast is above every seed of slow.
    (one,) = written.data.comparisons
    assert one.improvement.value == (0 if one.ours.algo == "slow" else 1)
    assert IMPORTED in (tmp_path / "report" / "index.html").read_text()


def test_imports_with_evaluations_only_are_reported(tmp_path):
    path = tmp_path / "imported"
    add(path, tmp_path, "fast", RETURNS["fast"], more=("--returns", "evaluation"))
    data = gather(Results(path), Request())
    assert data.table["evaluation_return_median"].tolist() == [825]
    assert data.table["seeds"].tolist() == [6]
    document = contents.document(data)
    assert document.summary[0].startswith("6 runs in 1 cell on 1 task: imported, not verified: fa")
    # Each of the 6 seeds ends at control step 8,000.
    counts = [("6", "runs"), ("1", "cell"), ("1", "task"), ("48k", "control steps")]
    assert document.inventory == counts


def test_imports_with_evaluations_only_are_counted_beside_training(imported, tmp_path):
    add(imported, tmp_path, "other", {0: 500.0, 1: 510.0}, more=("--returns", "evaluation"))
    document = contents.document(gather(Results(imported), Request()))
    assert document.summary[0].startswith("14 runs in 3 cells on 1 task: ")
    counts = [("14", "runs"), ("3", "cells"), ("1", "task"), ("112k", "control steps")]
    assert document.inventory == counts


def test_seeds_with_evaluations_only_are_counted_beside_training_of_label(tmp_path):
    path = tmp_path / "imported"
    add(path, tmp_path, "fast", {0: 800.0})
    add(path, tmp_path, "fast", {0: 810.0, 1: 820.0}, "e", more=("--returns", "evaluation"))
    document = contents.document(gather(Results(path), Request()))
    assert document.summary[0].startswith("2 runs in 1 cell on 1 task: ")
    counts = [("2", "runs"), ("1", "cell"), ("1", "task"), ("16k", "control steps")]
    assert document.inventory == counts


def test_imports_are_reported_if_no_run_was_begun_since_date(demo, tmp_path):
    add(demo, tmp_path, "fast", {0: 800.0})
    data = gather(Results(demo), Request(since="2100-01-01"))
    assert set(data.table["source"]) == {IMPORTED}
    assert any("begun before 2100-01-01 are left out" in note for note in data.notes)


def test_notes_count_only_imports_that_pass_filters(imported):
    notes = gather(Results(imported), Request(algo="fast")).notes
    assert [note for note in notes if "curves (csv)" in note] == [
        "6 imported curves (csv) are not verified: jbench has not run the agents. Imported curves "
        "are in no claim."
    ]


def test_training_and_evaluation_of_label_are_one_cell(tmp_path):
    path = tmp_path / "imported"
    add(path, tmp_path, "fast", RETURNS["fast"])
    add(path, tmp_path, "fast", {0: 900, 1: 910}, "other", more=("--returns", "evaluation"))
    data = gather(Results(path), Request())
    (row,) = data.table.to_dict("records")
    assert (row["training_return_median"], row["evaluation_return_median"]) == (825, 905)
    assert "4 of 6 seeds have no evaluation" in row["notes"]


def test_longest_import_of_seed_is_used(tmp_path):
    path = tmp_path / "imported"
    add(path, tmp_path, "fast", RETURNS["fast"])
    add(path, tmp_path, "fast", {0: 500}, "longer", episodes=12)
    data = gather(Results(path), Request())
    assert data.table["training_return_q10"].tolist() == [655]  # of 500, 810, …, 850
    assert any(note.startswith("1 imported curve is not used") for note in data.notes)


def test_seeds_with_points_at_different_control_steps_are_noted(tmp_path):
    path, file = tmp_path / "imported", tmp_path / "curves.csv"
    file.write_text("seed,at,value\n0,1000,10\n0,2000,20\n1,1300,30\n1,2200,40\n")
    typed = ("--from", "csv", "--task", "face_direction", "--algo", "td3", "--seed-column", "seed")
    columns = ("--steps-column", "at", "--return-column", "value")
    assert main(["import", *typed, *columns, "--results", str(path), str(file)]) == 0
    (row,) = gather(Results(path), Request()).table.to_dict("records")
    assert "the points of its seeds are up to 300 control steps apart" in row["notes"]


def test_seeds_reach_return_at_their_own_control_steps(tmp_path):
    path, file = tmp_path / "imported", tmp_path / "curves.csv"
    file.write_text("seed,control_steps,episode_return\n0,1000,950\n1,7000,950\n2,9000,950\n")
    typed = ("--from", "csv", "--task", "face_direction", "--algo", "td3", "--seed-column", "seed")
    assert main(["import", *typed, "--results", str(path), str(file)]) == 0
    (view,) = gather(Results(path), Request()).views
    reached = view.statistics[0].get("steps_to_solved", "median")
    estimate = reached.estimate
    assert (estimate.value, estimate.low, estimate.high) == (7000, 1000, 9000)


def test_imports_change_no_number_or_claim_of_runs(demo, imported, tmp_path):
    request = Request(claims=True)
    alone = gather(Results(demo), request)
    assert main(["merge", str(imported), "--results", str(demo)]) == 0
    add(demo, tmp_path, "td3", {0: 999.0, 1: 999.0}, more=("--representation", "dae12"))
    both = gather(Results(demo), request)
    ours = both.table[both.table["source"] == "ours"].reset_index(drop=True)
    pd.testing.assert_frame_equal(ours, alone.table, check_dtype=False)
    assert len(both.table) == len(alone.table) + 3
    assert list(both.findings) == list(alone.findings)
    pairs = [(one.ours.source, one.theirs.source) for one in both.comparisons]
    assert {a == b for a, b in pairs} == {True}
    assert len([pair for pair in pairs if pair[0] == "ours"]) == len(alone.comparisons)


def test_baseline_is_drawn_dashed_in_panel_of_its_task(imported):
    data = gather(Results(imported), Request(baseline="slow"))
    figures = [item for item in contents.document(data).items if item.name == "figure9"]
    (panel,) = figures[0].figure.panels
    dashes = {one.label: one.style.dash for one in panel.series if one.label}
    assert dashes == {
        f"{IMPORTED}: fast": "-",
        f"{IMPORTED}: slow on full": "--",
    }
    (line,) = [one for one in panel.series if one.style.dash == "--"]
    assert set(line.y) == {425}
    assert len(data.table) == 2


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        (["--baseline", "sac"], "type one of fast, slow"),
        (["--baseline", "slow", "--algo", "slow"], "no other curves to draw it beside"),
        (["--baseline", "slow", "--compare", "a=1", "b=2"], "exclude each other"),
        (["--algo", "ddpg"], "There are no runs"),
    ],
)
def test_requests_without_curves_are_refused(typed, says, imported, capsys):
    assert main(["report", "--results", str(imported), *typed]) == 2
    assert says in capsys.readouterr().err


def test_damaged_imports_are_skipped_and_reported(imported):
    part = sorted(imported.rglob("import_points-*.parquet"))[0]
    part.write_bytes(b"cut")
    data = gather(Results(imported), Request())
    assert [problem for problem in data.problems if str(part) in problem] == list(data.problems)
    assert len(data.problems) == 1
    assert sorted(data.table["seeds"]) == [5, 6]


def test_imports_without_length_are_skipped_and_reported(imported):
    manifest = sorted(imported.rglob("manifest.json"))[0]
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "summary": {}}))
    data = gather(Results(imported), Request())
    (problem,) = data.problems
    assert "lacks a label, a seed, its kind of return or its length" in problem
    assert sorted(data.table["seeds"]) == [5, 6]


def test_curves_of_opened_results_include_imports(imported):
    curves = jbench.open(imported).curves(algo="fast", returns="training")
    assert set(curves["source"]) == {IMPORTED}
    assert set(curves["q50"]) == {825}
