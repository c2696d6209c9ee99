"""Tests of comparisons of representations with full and scaled, on runs of known outcome."""

import numpy as np
import pandas as pd
import pytest

from jbench.names import kind_of
from jbench.report.analysis import reduction
from jbench.report.figures.predictions import returns_figure
from jbench.report.figures.reduction_figure import reduction_figure
from jbench.report.report import write_report
from jbench.report.request import Request
from jbench.report.tables import reduction_items

pytestmark = pytest.mark.usefixtures("undrawn")

CLOSE = np.linspace(-10, 10, 8)
FINALS = {
    "full": 600 + CLOSE,
    "scaled16": 620 + CLOSE,
    "planar12": 800 + CLOSE,
    "dae12": 400 + 10 * CLOSE,
    "pca4": 610 + CLOSE,
}


def learn(fabric, finals=FINALS, steps=80, **settings):
    """Adds a run per seed with return 0, then from half of its episodes on its final return."""
    for representation, numbers in finals.items():
        for seed, final in enumerate(numbers):
            returns = np.repeat([0.0, final], steps // 2)
            fabric.run(returns, seed, representation=representation, **settings)


def found_in(fabric):
    return reduction.reductions(fabric.cells()[0])


def test_ratio_by_episodes_stands_beside_ratio_of_deviations(fabric):
    # Half of the last 20 episodes are `swing` above a seed's mean, half below.
    for representation, swing in {"full": 20.0, "planar12": 5.0}.items():
        for seed, mean in enumerate(500 + CLOSE):
            returns = mean + np.resize([swing, -swing], 80)
            fabric.run(returns, seed, representation=representation)
    (one,) = found_in(fabric)
    assert one.finding("b").effect.value == pytest.approx(1)
    assert one.finding("b").by_episodes == pytest.approx(0.25)
    (answer,) = reduction_items.answers("b", [one])
    assert "TD3 on planar12 (1.00 [" in answer
    assert "]; by episodes alone 0.25)" in answer


def test_each_representation_is_compared_with_both_baselines(fabric):
    learn(fabric)
    found = {(one.cell.representation, one.baseline): one for one in found_in(fabric)}
    reduced = {
        (name, base) for name in ("planar12", "dae12", "pca4") for base in ("full", "scaled")
    }
    # scaled16 against full shows the effect of scaling alone.
    assert {*found} == {*reduced, ("scaled16", "full")}
    outcomes = {
        key: [reduction_items.outcome(finding) for finding in one.findings]
        for key, one in found.items()
    }
    higher, lower = "higher by more than 50", "lower by more than 50"
    assert outcomes["planar12", "full"] == [higher, "undecided", "faster"]
    assert outcomes["dae12", "full"] == [lower, "more variable", "slower"]
    assert outcomes["pca4", "scaled"][0] == "similar"
    planar = found["planar12", "scaled"].findings
    assert planar[0].effect.value == pytest.approx(180)  # 800 - 620
    assert found["dae12", "full"].findings[1].effect.value == pytest.approx(10)
    # The mean over the whole run is half of the final return.
    assert planar[2].effect.value == pytest.approx(90)


def test_answer_has_outcomes_with_interval_and_seeds(fabric):
    learn(fabric, {name: FINALS[name] for name in ("full", "scaled16", "planar12", "dae12")})
    against_full, against_scaled = reduction_items.answers("a", found_in(fabric))
    assert against_full.startswith(
        "(a) Final training return against full (n = 8, 8). "
        "Higher by more than 50: TD3 on planar12 (+200 ["
    )
    assert "Lower by more than 50: TD3 on dae12 (-200 [" in against_full
    assert "TD3 on planar12 (+180 [" in against_scaled


def test_answer_names_seeds_and_tasks_if_they_differ(fabric):
    learn(fabric, {"full": FINALS["full"], "dae12": FINALS["dae12"][:6]})
    learn(fabric, {name: FINALS[name] for name in ("full", "dae12")}, task="move_to_pose")
    (printed,) = reduction_items.answers("a", found_in(fabric))
    assert printed.startswith("(a) Final training return against full. Lower by more than 50: ")
    assert "; n = 6, 8), TD3 on dae12 on move_to_pose (-200 [" in printed


def test_few_seeds_are_undecided(fabric):
    learn(fabric, {name: FINALS[name][:5] for name in ("full", "planar12")})
    (one,) = found_in(fabric)
    assert [reduction_items.outcome(finding) for finding in one.findings] == ["undecided"] * 3


def test_cells_with_other_differences_are_not_compared(fabric):
    learn(fabric, {"full": FINALS["full"]})
    for seed, final in enumerate(FINALS["planar12"]):
        fabric.run([0.0, final], seed, representation="planar12", engine="batched")
    cells = fabric.cells()[0]
    assert reduction.reductions(cells) == []
    assert reduction.groups(cells) == []


def test_figure_compares_at_common_step_and_lists_shorter_cells(fabric):
    learn(fabric)
    learn(fabric, {"random12": 500 + CLOSE}, steps=20)
    (group,) = reduction.groups(fabric.cells()[0])
    assert group.control_steps == 80_000
    assert [cell.representation for cell in group.short] == ["random12"]
    points = {point.cell.representation: point for point in group.points}
    assert {*points} == {*FINALS}
    assert (points["planar12"].input_size, points["full"].input_size) == (12, None)
    # The interquartile mean of final returns that are symmetric about 800.
    assert points["planar12"].estimate.value == pytest.approx(800)
    figure = reduction_figure([group])
    (panel,) = figure.panels
    assert panel.x.names == ["pca4", "dae12", "planar12"]
    drawn = {series.label: series for series in panel.series if series.label}
    planar = drawn["planar12"]
    assert planar.y == pytest.approx([800])
    (interval,) = planar.bands
    assert interval.bars
    assert planar.detail == "n = 8"
    seeds = "Seeds: face_direction, TD3 at 80k control steps: full 8, dae12 8, pca4 8, planar12 8, "
    assert seeds in figure.caption
    assert 790 < interval.low[0] < 800 < interval.high[0] < 810
    baselines = {line.label: line for line in panel.references}
    assert baselines["full"].at == pytest.approx(600)
    assert baselines["full"].interval == pytest.approx((594, 606), abs=5)
    assert {label: series.x.tolist() for label, series in drawn.items()} == {
        "pca4": [0],
        "dae12": [1],
        "planar12": [2],
    }
    assert "random12" in figure.caption


def test_returns_are_drawn_against_r2_of_predictions(fabric):
    learn(fabric)
    groups = reduction.groups(fabric.cells()[0])
    r2 = {"planar12": 0.9, "dae12": 0.4, "pca4": -0.2, "vae8": 0.5}
    table = pd.DataFrame(
        [
            {"task": "face_direction", "kind": kind_of(name), "yaw_rate": value}
            | {"latents": int(name.removeprefix(kind_of(name)))}
            | {"forward_speed": 0.7, "tilt_rate": 0.6, "reward": 0.5}
            for name, value in r2.items()
        ]
    )
    panels = returns_figure(groups, table).panels
    assert [panel.x.label for panel in panels] == [
        f"R² of the {name}" for name in ("yaw rate", "forward speed", "tilt rate", "reward")
    ]
    drawn = {series.label: (series.x[0], series.y[0]) for series in panels[0].series}
    # Interquartile means of the final returns; a negative R² is drawn at 0.
    assert drawn == {
        "planar12": pytest.approx((0.9, 800)),
        "dae12": pytest.approx((0.4, 400)),
        "pca4": pytest.approx((0, 610)),
    }
    # With two encoders named dae12, only two representations remain, too few for a figure.
    assert returns_figure(groups, pd.concat([table, table[table["kind"] == "dae"]])) is None


def test_report_answers_by_evaluation_returns_first(fabric, out):
    for name, numbers in FINALS.items():
        for seed, final in enumerate(numbers):
            evaluated = {1000: 0.0, 2000: final}
            fabric.run([0.0, 1.0], seed, representation=name, evaluated=evaluated)
    report = write_report(fabric.results, out, Request(reference=False))
    section = report.document.sections[0]
    assert section.title == "Does reduction help?"
    assert section.answers[0].startswith("(a) Final evaluation return")
    assert section.text[1].startswith("(a) Final training return")
    assert [item.name for item in section.items] == [
        *("reduction", "reduction-training"),
        *("reduction_tests", "reduction_tests-training"),
    ]
    printed, _ = [one for one in report.document.summary if one.startswith("Does reduction help?")]
    assert "planar12 (+200 [" in printed
    numbers = (out / "reduction.csv").read_text().splitlines()
    assert numbers[0].startswith("source,task,algo,representation")
    assert len(numbers) == 1 + 2 * len(FINALS)  # by both kinds of return


def test_number_of_inputs_of_agent():
    assert reduction.input_size("ofe12", "a task of another package") == 12
    # The representation of a recorded run is a label that can end with any digits.
    assert reduction.input_size("dae" + 30 * "9", "face_direction") is None
    assert kind_of("lld-vae12") == "lld-vae"
    assert reduction.input_size("lld-vae12", "face_direction") == 12
    assert reduction.input_size("full", "face_direction") is None
    # The observation of face_direction has 16 numbers, that of move_to_pose 19.
    assert reduction.input_size("ofe12", "face_direction") == 12
    assert reduction.input_size("ofe240", "face_direction") == 256
    assert reduction.input_size("ofe240", "move_to_pose") == 259
