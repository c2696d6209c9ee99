"""Tests of curves of seeds that were logged at different steps, against numpy's interpolation."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import jbench
from jbench.cli import main
from jbench.report.data.common_steps import means_over_run
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.returns import EVALUATION
from jbench.store import Results

STRANGERS = Path(__file__).parents[1] / "importing" / "strangers"
KINDS = ("evaluation", "training")


def found(path, **request):
    return Frames(None, Request(curves=path, **request))


def write(path, logged, method="A"):
    """Writes a file of curves, each the returns by step, by seed."""
    rows = [
        (method, "walk", seed, step, value)
        for seed, points in enumerate(logged)
        for step, value in points
    ]
    pd.DataFrame(rows, columns=["method", "task", "seed", "steps", "return"]).to_csv(
        path, index=False
    )
    return path


def random_steps(random, count):
    return np.sort(random.choice(np.arange(1, 100_000), count, replace=False))


@pytest.mark.parametrize("order", ["quantile-first", "smooth-first"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("counts", [(7, 31, 80, 200, 3), (60, 60, 60, 60, 60)])
def test_seeds_of_constant_returns_have_their_median_everywhere(kind, order, counts, tmp_path):
    random = np.random.default_rng(sum(counts))
    logged = [
        [(step, 10.0 * seed) for step in random_steps(random, count)]
        for seed, count in enumerate(counts)
    ]
    curve = found(write(tmp_path / "c.csv", logged), returns=kind, order=order).curves
    assert set(curve["median"].round(9)) == {20.0}
    assert set(curve["q10"].round(9)) == {4.0}
    assert set(curve["seeds"]) == {5}
    # No seed is extrapolated.
    firsts, lasts = zip(*((points[0][0], points[-1][0]) for points in logged), strict=True)
    assert curve["steps"].iloc[0] == max(firsts)
    assert curve["steps"].iloc[-1] == min(lasts)


@pytest.mark.parametrize(
    ("file", "median"), [("unaligned-evaluations.csv", 10), ("unequal-episodes.csv", 20)]
)
@pytest.mark.parametrize("kind", KINDS)
def test_strangers_files_have_the_median_of_every_seed(kind, file, median):
    report = found(STRANGERS / file, returns=kind)
    assert set(report.curves["median"]) == {median}
    assert set(report.curves["seeds"]) == {3}
    (note,) = [note for note in report.notes if "logged at different" in note]
    assert "interpolated linearly between its own points" in note


def test_evaluations_are_interpolated_as_by_numpy(tmp_path):
    random = np.random.default_rng(1)
    logged = [
        [(step, random.normal(500, 100)) for step in random_steps(random, count)]
        for count in (9, 20, 33)
    ]
    curve = found(write(tmp_path / "c.csv", logged)).curves
    seeds = [np.interp(curve["steps"], *zip(*points, strict=True)) for points in logged]
    np.testing.assert_allclose(curve["median"], np.median(seeds, axis=0))
    inside = {
        step
        for points in logged
        for step, _ in points
        if curve["steps"].min() <= step <= curve["steps"].max()
    }
    assert {*curve["steps"]} == inside


def test_training_returns_of_single_seeds_are_their_bins(tmp_path):
    """Noisy episodes of random lengths: the curve follows each seed's mean in bins of steps."""
    random = np.random.default_rng(2)
    logged = []
    for shortest in (50, 100, 400, 800, 200):
        steps = np.cumsum(random.integers(shortest, 3 * shortest, 4000))
        steps = steps[steps < 400_000]
        logged.append([(step, step / 1000 + random.normal(0, 30)) for step in steps])
    curve = found(write(tmp_path / "c.csv", logged), returns="training").curves
    # The noise of an episode has a standard deviation of 30, that of the median of means about 4.
    followed = curve.iloc[50:-50]
    assert len(followed) > 1000
    np.testing.assert_allclose(followed["median"], followed["steps"] / 1000, rtol=0, atol=12)


def test_seeds_without_a_common_step_have_no_curve(tmp_path):
    file = write(tmp_path / "c.csv", [[(0, 1), (10, 3)], [(20, 5), (30, 7)]])
    report = found(file)
    assert report.curves.empty
    assert report.seeds["final"].tolist() == [3, 7]
    assert report.seeds["over_run"].tolist() == [2, 6]
    assert any("no control step in common, so it has no curve" in note for note in report.notes)
    assert main(["report", "--curves", str(file), "--out", str(tmp_path), "--format", "svg"]) == 0


def test_mean_over_run_is_by_steps_not_by_points():
    report = found(STRANGERS / "uneven-spacing.csv")
    rows = report.configurations.set_index("label")
    # Returns are a tenth of the steps, of 0 to 10,000, and the number of the seed, of 0 to 5.
    assert rows["over_run"].to_dict() == pytest.approx({"dense": 502.5, "even": 502.5})


def test_methods_that_were_logged_in_different_densities_have_one_mean():
    every = {gap: np.arange(gap, 1_000_001, gap) for gap in (25_000, 50_000)}
    curves = {gap: (steps, 900 * (1 - np.exp(-steps / 2e5))) for gap, steps in every.items()}
    dense, sparse = (
        means_over_run([curves[gap]], [[curves[other]]])[0]
        for gap, other in ((25_000, 50_000), (50_000, 25_000))
    )
    assert dense == pytest.approx(sparse, rel=3e-3)
    grid = np.linspace(50_000, 1_000_000, 20_000)
    assert dense == pytest.approx(np.mean(900 * (1 - np.exp(-grid / 2e5))), rel=3e-3)


def test_equally_spaced_curves_have_the_mean_of_their_points():
    steps = 1000.0 * np.arange(1, 5)
    seeds = [(steps, np.array([1.0, 2, 3, 10])), (steps, np.array([0.0, 0, 0, 8]))]
    assert means_over_run(seeds).tolist() == [4, 2]
    # One that ended earlier: both up to 2,000 control steps.
    seeds[1] = (steps[:2], np.array([0.0, 8]))
    assert means_over_run(seeds) == pytest.approx([1.5, 4])


def test_own_runs_that_stopped_at_different_steps_have_a_curve_of_all_seeds(fabric):
    for seed, episodes in enumerate((40, 40, 24)):
        evaluated = dict.fromkeys(range(4000, 1000 * episodes + 1, 4000), 100.0 * seed)
        fabric.run(np.full(episodes, 100.0 * seed), seed, evaluated=evaluated)
    report = Frames(fabric.results)
    for kind in KINDS:
        curve = report.curves[report.curves["returns"] == kind]
        assert set(curve["median"]) == {100}
        assert curve["steps"].max() == 24_000
        longest = report.run_curves[report.run_curves["returns"] == kind]["steps"].max()
        assert longest == 40_000
    assert any(
        "its curve of evaluation returns ends at 24,000 control steps" in note
        for note in report.notes
    )
    seeds = jbench.open(fabric.results.path).curves(returns=EVALUATION, per_seed=True)
    assert seeds.groupby("seed")["control_steps"].max().tolist() == [40_000, 40_000, 24_000]


def test_imported_seeds_of_different_steps_have_their_median(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, kind in (("unaligned-evaluations", "evaluation"), ("unequal-episodes", "training")):
        typed = ["--task", "face_direction", "--algo", name, "--returns", kind]
        assert main(["import", "--from", "csv", *typed, str(STRANGERS / f"{name}.csv")]) == 0
    report = Frames(Results("results"))
    medians = report.curves.groupby("algo")["median"].unique().map(list).to_dict()
    assert medians == {"unaligned-evaluations": [10], "unequal-episodes": [20]}
