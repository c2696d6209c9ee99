"""Tests of the figures of learning curves: their data, styles, texts and files."""

import io
import itertools
import struct
from dataclasses import replace

import numpy as np
import pytest

from jbench.names import ALGORITHMS, TASKS
from jbench.report.figure import DOTS
from jbench.report.figures import plotting
from jbench.report.figures.curve_series import SOLVED_LINE
from jbench.report.figures.encoders import look_of
from jbench.report.figures.learning_curves import (
    ALGORITHM_COLORS,
    algorithm_colors,
    comparison_figures,
    grid_figure,
)
from jbench.report.request import Request
from tests.report.conftest import labels

RETURNS = np.linspace(0, 800, 40)


@pytest.fixture
def grid(fabric, published):
    return lambda order="quantile-first", window=4: grid_figure(
        fabric.learned(order, window), published, Request(order=order, window=window)
    )


@pytest.fixture
def comparisons(fabric, published):
    return lambda order="quantile-first", window=4: comparison_figures(
        fabric.learned(order, window), published, Request(order=order, window=window)
    )


def titles(figure):
    return [panel.title for panel in figure.panels]


def panel(figure, title):
    (found,) = [panel for panel in figure.panels if panel.title == title]
    return found


def key(figure):
    return [label for label, _ in figure.key]


def series(panel, label):
    (found,) = [series for series in panel.series if series.label == label]
    return found


def edges(panel):
    """Returns the edges of published bands: thin and pale."""
    return [series for series in panel.series if series.style.width == 0.6]


def seeds(fabric, count, returns=RETURNS, **settings):
    for seed in range(count):
        fabric.run(np.asarray(returns) + seed, seed=seed, **settings)


class TestGrid:
    def test_one_task_has_one_panel(self, fabric, grid):
        seeds(fabric, 1)
        assert titles(grid()) == ["face_direction"]

    def test_two_tasks_have_panels_of_all_five_tasks(self, fabric, grid):
        seeds(fabric, 1, task="move_to_pose")
        seeds(fabric, 1, task="face_direction")
        figure = grid()
        assert titles(figure) == list(TASKS)
        texts = {panel.title: panel.text for panel in figure.panels}
        assert texts == {
            task: "" if task in ("move_to_pose", "face_direction") else "no runs yet"
            for task in TASKS
        }

    def test_panel_of_custom_task_is_last(self, fabric, grid):
        seeds(fabric, 1, task="face_direction")
        seeds(fabric, 1, task="dance")
        assert titles(grid()) == [*TASKS, "dance"]

    def test_every_panel_has_grey_line_of_solved_tasks(self, fabric, grid):
        seeds(fabric, 1, task="move_to_pose")
        seeds(fabric, 1)
        figure = grid()
        for task in TASKS:
            assert list(panel(figure, task).references) == [SOLVED_LINE]
        style = SOLVED_LINE.style
        assert (SOLVED_LINE.at, style.color, style.width) == (900, "#8a8a8a", 0.8)
        assert "solved (900)" in key(figure)

    def test_curve_is_median_with_seeds_and_window_in_detail(self, fabric, grid):
        seeds(fabric, 3)
        drawn = panel(grid(), "face_direction")
        assert labels(drawn) == ["TD3"]
        median = series(drawn, "TD3")
        assert median.detail == "3 seeds, window 4"
        # The median of a ramp plus 0, 1 and 2 is the ramp plus 1, for every window.
        assert median.x.tolist() == [1000, *(1500 + 1000 * i for i in range(39)), 40_000]
        ramp = np.interp(median.x, np.arange(1, 41) * 1000, RETURNS)
        np.testing.assert_allclose(median.y[2:-2], ramp[2:-2] + 1)
        # At the ends, windows are truncated to two episodes.
        assert median.y[0] == pytest.approx(RETURNS[:2].mean() + 1)
        assert median.y[-1] == pytest.approx(RETURNS[-2:].mean() + 1)

    def test_long_curves_are_thinned_and_keep_both_ends(self, fabric, grid):
        seeds(fabric, 1, returns=np.zeros(3000))
        (learned,) = fabric.learned(window=100)
        drawn = series(panel(grid(window=100), "face_direction"), "TD3")
        assert len(drawn.x) < 1000 < len(learned.curve.control_steps)
        assert drawn.x[[0, -1]].tolist() == learned.curve.control_steps[[0, -1]].tolist()

    def test_band_needs_three_seeds(self, fabric, grid):
        seeds(fabric, 2, algo="ddpg")
        seeds(fabric, 3, algo="sac")
        drawn = panel(grid(), "face_direction")
        two, three = (series(drawn, label) for label in labels(drawn))
        assert two.style.color == ALGORITHM_COLORS["ddpg"]
        assert list(two.bands) == []
        (band,) = three.bands
        # 10th and 90th of 0, 1 and 2.
        assert band.low[0] == pytest.approx(RETURNS[:2].mean() + 0.2)
        assert band.high[-1] == pytest.approx(RETURNS[-2:].mean() + 1.8)

    def test_band_ends_where_fewer_than_three_seeds_remain(self, fabric, grid):
        seeds(fabric, 2)
        fabric.run(np.zeros(20), seed=9)
        (band,) = panel(grid(), "face_direction").series[0].bands
        there = np.isfinite(band.low)
        x = panel(grid(), "face_direction").series[0].x
        assert x[there][-1] == 18_500
        assert np.isnan(band.high[~there]).all()

    def test_color_of_algorithm_is_independent_of_other_algorithms(self, fabric, grid):
        seeds(fabric, 1, algo="sac")
        alone = series(panel(grid(), "face_direction"), "SAC").style.color
        for algo in ("ddpg", "ppo", "td3", "another"):
            seeds(fabric, 1, algo=algo)
        drawn = panel(grid(), "face_direction")
        assert series(drawn, "SAC").style.color == alone
        assert len({series(drawn, label).style.color for label in labels(drawn)}) == 5

    def test_published_curve_is_dashed_in_color_of_algorithm(self, fabric, grid, published):
        seeds(fabric, 3)
        drawn = panel(grid(), "face_direction")
        (dashed,) = [series for series in drawn.series if series.style.dash == "--"]
        (curve,) = [
            c for c in published if (c.figure, c.task, c.algo) == ("fig9", "face_direction", "td3")
        ]
        ours = series(drawn, labels(drawn)[0])
        assert dashed.y.tolist() == curve.quantiles[50].tolist()
        assert dashed.style.color == ours.style.color
        assert dashed.style.width < ours.style.width
        assert [edge.y.tolist() for edge in edges(drawn)] == [
            curve.quantiles[10].tolist(),
            curve.quantiles[90].tolist(),
        ]
        assert {edge.style.color for edge in edges(drawn)} == {ours.style.color}

    def test_curve_is_dotted_after_first_seed_ends(self, fabric, grid):
        seeds(fabric, 2)
        assert not panel(grid(), "face_direction").series[0].partial.any()
        fabric.run(np.zeros(20), seed=9)
        drawn = panel(grid(), "face_direction")
        curve = drawn.series[0]
        assert (curve.label, curve.detail) == ("TD3", "3 seeds, 2 at the end, window 4")
        # The last window of the shortest run is centered at 18.5 episodes; the lines meet there.
        assert curve.x[~curve.partial][-1] == 18_500
        axes = plotting.draw(grid()).axes[0]
        solid, dotted = (
            [
                line
                for line in axes.lines
                if line.get_linestyle() == style and len(line.get_xdata()) > 2
            ]
            for style in ("-", DOTS)
        )
        ends = [x[0].get_xdata()[np.isfinite(x[0].get_ydata())][[0, -1]] for x in (solid, dotted)]
        assert [end.tolist() for end in ends] == [[1000, 18_500], [18_500, 40_000]]

    def test_each_variant_has_line_style_and_label(self, fabric, grid):
        for rate in (1e-4, 1e-3, 1e-2, 2e-2, 5e-2):
            seeds(fabric, 1, hyperparameters={"learning_rate": rate})
        drawn = panel(grid(), "face_direction")
        assert labels(drawn)[0] == "TD3, learning_rate=1e-04"
        styles = [series(drawn, label).style for label in labels(drawn)]
        assert len({style.color for style in styles}) == 1
        assert len({(style.dash, style.marker) for style in styles}) == 5

    def test_encoded_runs_are_drawn_only_without_full_runs(self, fabric, grid):
        seeds(fabric, 1, algo="sac", representation="dae12")
        seeds(fabric, 1, algo="td3", representation="dae12")
        seeds(fabric, 1, algo="td3")
        assert labels(panel(grid(), "face_direction")) == [
            "SAC on dae12",
            "TD3",
        ]

    @pytest.mark.parametrize(
        ("episodes", "unit", "last"), [(40, "thousands", "40"), (2000, "millions", "2")]
    )
    def test_steps_are_in_thousands_or_millions(self, fabric, grid, episodes, unit, last):
        seeds(fabric, 1, returns=np.zeros(episodes))
        axis = panel(grid(), "face_direction").x
        assert axis.label == f"control steps ({unit})"
        assert axis.limits == (0, episodes * 1000)
        assert f"{axis.limits[1] * axis.unit:g}" == last
        drawn = plotting.draw(grid()).axes[0]
        assert drawn.xaxis.get_major_formatter()(episodes * 1000, 0) == last

    def test_caption_explains_order_window_and_band(self, fabric, grid):
        seeds(fabric, 1)
        text = grid("smooth-first", 4).caption
        assert "Order: smooth-first, a moving average per seed, then quantiles" in text
        assert "Window: 4 episodes" in text
        assert (
            "10th\N{EN DASH}90th percentile across seeds (spread, not a confidence interval)"
            in text
        )
        assert "PPO" not in text
        assert "Order: quantile-first" in grid().caption

    def test_caption_warns_about_published_steps_of_ppo(self, fabric, grid):
        seeds(fabric, 1, algo="ppo", environments=8)
        assert "probably those of one of 8 environments" in grid().caption

    def test_run_of_one_point_is_drawn_as_marker(self, fabric, grid):
        seeds(fabric, 1, returns=[300])
        point = series(panel(grid(), "face_direction"), "TD3")
        assert (point.style.marker, point.style.every, point.y.tolist()) == ("o", 1, [300])


class TestComparison:
    def test_comparison_needs_runs_or_published_curve_to_compare(self, fabric, comparisons):
        seeds(fabric, 1, task="move_to_pose", algo="sac")
        seeds(fabric, 1, task="face_direction", algo="ppo", representation="dae12")
        assert comparisons() == {}
        seeds(fabric, 1, task="move_to_pose", algo="sac", representation="pca9")
        seeds(fabric, 1, task="move_in_direction", algo="ddpg")
        assert list(comparisons()) == [("move_in_direction", "ddpg"), ("move_to_pose", "sac")]

    def test_colors_of_representations_differ_from_those_of_algorithms(self, fabric, comparisons):
        for representation in ("full", "ae3", "dae12", "vae6"):
            seeds(fabric, 1, representation=representation)
        (drawn,) = comparisons()["face_direction", "td3"].panels
        colors = {label.split()[0]: series(drawn, label).style.color for label in labels(drawn)}
        kinds = {"full": "full", "ae3": "ae", "dae12": "dae", "vae6": "vae"}
        assert colors == {name: look_of(kind)[0] for name, kind in kinds.items()}
        assert len(set(colors.values())) == 4
        taken = {color.lower() for color in ALGORITHM_COLORS.values()}
        assert not taken & {color.lower() for color in colors.values()}

    def test_comparison_has_two_quantile_bands(self, fabric, comparisons):
        seeds(fabric, 3)
        seeds(fabric, 2, representation="dae12")
        (drawn,) = comparisons()["face_direction", "td3"].panels
        outer, inner = drawn.series[0].bands
        start = RETURNS[:2].mean()
        assert outer.low[0] == pytest.approx(start + 0.2)
        assert inner.low[0] == pytest.approx(start + 0.5)
        assert list(drawn.series[1].bands) == []

    def test_published_figure_8_is_drawn_with_its_quartiles(self, fabric, comparisons, published):
        seeds(fabric, 3, task="move_in_direction", algo="ddpg")
        figure = comparisons()["move_in_direction", "ddpg"]
        drawn = panel(figure, "move_in_direction, DDPG")
        # The published curve shares the color and the legend entry of our representation.
        assert labels(drawn) == ["full", "dae12"]
        ours, theirs = (one for one in drawn.series if "full" in one.entries and one.detail)
        assert theirs.detail == "published full (Figure 8, 10 seeds)"
        assert (theirs.style.dash, theirs.style.color) == ("--", ours.style.color)
        assert series(drawn, "dae12").style.color == look_of("dae")[0]
        quartiles = [
            c.quantiles[q].tolist()
            for c in sorted(published, key=lambda c: c.representation, reverse=True)
            for q in (25, 75)
            if c.figure == "fig8"
        ]
        assert [edge.y.tolist() for edge in edges(drawn)] == quartiles
        (of_edges,) = (name for name in key(figure) if name.startswith("published: 25th"))
        assert all(of_edges in edge.entries for edge in edges(drawn))
        assert "Published Figure 8: training returns, 10 seeds, smooth-first" in figure.caption

    def test_published_figure_7_is_drawn_as_single_seeds(self, fabric, comparisons):
        seeds(fabric, 1, algo="ddpg", representation="dae12")
        figure = comparisons()["face_direction", "ddpg"]
        drawn = panel(figure, "face_direction, DDPG")
        assert labels(drawn) == ["dae12", "full"]
        assert series(drawn, "full").detail == "Figure 7, 1 seed"
        assert edges(drawn) == []
        assert "published: one seed" in key(figure)


def test_other_algorithms_take_unused_colors():
    colors = algorithm_colors(["zeta", "ppo", "alpha"])
    assert {name: colors[name] for name in ALGORITHMS} == ALGORITHM_COLORS
    assert len(set(colors.values())) == 6


class TestFiles:
    def test_svg_is_reproducible_and_has_no_date(self, fabric, grid):
        seeds(fabric, 3)
        first, second = (plotting.to_svg(plotting.draw(grid())) for _ in range(2))
        assert first == second
        assert b"dc:date" not in first
        assert b"Matplotlib v" not in first

    def test_png_has_150_dpi_and_no_metadata(self, fabric, grid):
        seeds(fabric, 1)
        figure = plotting.draw(grid())
        png = io.BytesIO(plotting.to_png(figure))
        assert png.read(8) == b"\x89PNG\r\n\x1a\n"
        chunks = {}
        while header := png.read(8):
            length, kind = struct.unpack(">I4s", header)
            chunks[kind] = png.read(length)
            png.read(4)
        assert not chunks.keys() & {b"tEXt", b"zTXt", b"iTXt", b"tIME"}
        size = struct.unpack(">II", chunks[b"IHDR"][:8])
        assert size == pytest.approx(figure.get_size_inches() * 150, abs=1)

    def test_texts_and_panels_are_inside_figure_without_overlap(self, fabric, grid, comparisons):
        for rate in (1e-4, 1e-3, 1e-2):
            seeds(
                fabric, 1, algo="ddpg", encoder="face_direction/dae12/s00-12345678",
                hyperparameters={"learning_rate": rate, "noise": {"sigma": rate}},
            )  # fmt: skip
        seeds(fabric, 3, task="move_to_pose", algo="ppo")
        seeds(fabric, 3, task="move_in_direction", algo="a_name_that_is_far_too_long_" * 4)
        for figure in (grid(), *comparisons().values()):
            drawn = plotting.draw(figure)
            plotting.to_png(drawn)
            renderer = drawn.canvas.get_renderer()
            boxes = [
                item.get_window_extent(renderer)
                for item in (*drawn.axes, *drawn.legends, *drawn.texts)
            ]
            for box in boxes:
                assert box.x0 >= 0
                assert box.y0 >= 0
                assert box.x1 <= drawn.bbox.x1
                assert box.y1 <= drawn.bbox.y1
            assert not [1 for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]

    def test_names_with_mathtext_characters_are_drawn_literally(self, fabric, published):
        # The store refuses such names in records, but other sources may contain them.
        name = "$\\frac{a$}"
        seeds(fabric, 1)
        order, window = "quantile-first", 4
        learned = [
            item._replace(cell=replace(item.cell, task=name, algo=name))
            for item in fabric.learned(order, window)
        ]
        figure = grid_figure(learned, published, Request(order=order, window=window))
        assert plotting.to_svg(plotting.draw(figure)).startswith(b"<?xml")
        assert labels(panel(figure, name)) == [name]
