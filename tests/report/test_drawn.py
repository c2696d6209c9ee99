"""Tests of statistics figures (profiles, processor time, matrix), single seeds and file formats."""

import itertools
import re

import numpy as np
import pytest

from jbench.names import TASKS
from jbench.report.data.cells import SOLVED
from jbench.report.data.returns import EVALUATION
from jbench.report.figure import Axis, Figure, Panel
from jbench.report.figures import heat_map, layout, plotting, processor, profiles, texts
from jbench.report.figures.learning_curves import ALGORITHM_COLORS, comparison_figures, grid_figure
from jbench.report.report import write_report
from jbench.report.request import Request
from tests.report.conftest import drawn_files, labels

RETURNS = np.linspace(0, 800, 40)


def seeds(fabric, finals, **settings):
    for seed, final in enumerate(finals):
        fabric.run(np.full(40, float(final)), seed, **settings)


def cells(fabric):
    return fabric.cells()[0]


def line(panel, start):
    (found,) = [series for series in panel.series if series.label.startswith(start)]
    return found


class TestProfiles:
    def test_line_is_share_of_seeds_above_each_return(self, fabric):
        seeds(fabric, [101, 301, 501, 701])
        figure = profiles.profiles_figure(cells(fabric))
        drawn = line(figure.panels[0], "TD3")
        share = dict(zip(drawn.x, drawn.y, strict=True))
        assert [share[x] for x in (0, 100, 200, 400, 600, 800)] == [1, 1, 0.75, 0.5, 0.25, 0]

    def test_band_is_interval_and_needs_three_seeds(self, fabric):
        seeds(fabric, [101, 301, 501, 701])
        seeds(fabric, [100, 200], algo="sac")
        (panel,) = profiles.profiles_figure(cells(fabric)).panels
        assert list(line(panel, "SAC").bands) == []
        (band,) = line(panel, "TD3").bands
        # Half of four seeds: the bootstrap's 2.5% and 97.5% of a binomial(4, 1/2) / 4.
        (at_400,) = np.flatnonzero(line(panel, "TD3").x == 400)
        assert (band.low[at_400], band.high[at_400]) == (0, 1)

    def test_tasks_have_equal_weight_in_panel_of_all_tasks(self, fabric):
        seeds(fabric, [500])
        seeds(fabric, [100, 100, 100], task="move_to_pose")
        seeds(fabric, [100], task="move_to_pose", algo="sac")
        figure = profiles.profiles_figure(cells(fabric))
        titles = [panel.title for panel in figure.panels]
        assert titles == ["face_direction", "move_to_pose", "all tasks together"]
        together = line(figure.panels[2], "TD3")
        assert together.detail == "4 runs on 2 tasks, 40k control steps"
        assert together.y[together.x == 200].tolist() == [0.5]
        assert len(labels(figure.panels[2])) == 1

    def test_lines_are_tagged_with_their_task(self, fabric):
        seeds(fabric, [500])
        seeds(fabric, [500], task="move_to_pose")
        panels = profiles.profiles_figure(cells(fabric)).panels
        tasks = [[one.tags.get("task") for one in panel.series] for panel in panels]
        assert tasks == [["face_direction"], ["move_to_pose"], [None]]

    def test_frame_holds_drawn_values(self, fabric):
        seeds(fabric, [101, 301])
        frame = profiles.profiles_frame(cells(fabric))
        assert len(frame) == len(profiles.THRESHOLDS)
        assert frame.loc[frame["final_return"] == 200, "share_above"].tolist() == [0.5]
        assert set(frame["seeds"]) == {2}


class TestProcessorTime:
    def test_median_return_is_drawn_at_median_time_of_seeds(self, fabric):
        for seed, seconds in enumerate((1.0, 2.0, 6.0)):
            fabric.run(RETURNS, seed, seconds=seconds)
        (item,) = fabric.learned(window=4)
        times, median = processor.timed_curve(item)
        # The n-th episode of the middle seed ends after 2 n s.
        assert times.tolist() == (item.curve.control_steps / 1000 * 2).tolist()
        assert (times[0], times[-1]) == (2, 80)
        assert median.tolist() == item.curve.quantile(50).tolist()
        figure = processor.processor_time_figure([item], ["a processor"])
        drawn = line(figure.panels[0], "TD3")
        assert (drawn.x[0], drawn.x[-1]) == (2, 80)
        assert figure.panels[0].x.label == "processor time of a seed (seconds)"
        assert figure.panels[0].y.label == "training return\n(exploration included)"
        assert "a processor" in figure.caption

    def test_curve_ends_with_first_seed_that_ends(self, fabric):
        fabric.run(RETURNS, 0, seconds=1.0)
        fabric.run(RETURNS[:20], 1, seconds=1.0)
        (item,) = fabric.learned(window=4)
        # The last window within 20 episodes is centered between the 18th and the 19th.
        assert processor.timed_curve(item)[0][-1] == 18.5

    def test_representations_of_one_algorithm_have_different_looks(self, fabric):
        kinds = ("full", "dae12", "pca12", "planar12", "random12", "scaled16")
        for representation in kinds:
            evaluated = {10_000: 300.0, 20_000: 500.0}
            fabric.run(RETURNS, representation=representation, evaluated=evaluated, seconds=1.0)
        figure = processor.processor_time_figure(fabric.learned(kind=EVALUATION), [])
        (panel,) = figure.panels
        looks = {(one.style.color, one.style.dash, one.style.marker) for one in panel.series}
        assert len(looks) == len(panel.series) == len(kinds)

    @pytest.mark.usefixtures("undrawn")
    def test_runs_without_processor_time_are_skipped_and_noted(self, fabric, out):
        fabric.run(RETURNS, 0)
        (item,) = fabric.learned(window=4)
        assert processor.processor_time_figure([item], []) is None
        # Only one of two seeds recorded it: the median would not be that of all seeds.
        fabric.run(RETURNS, 1, seconds=1.0)
        fabric.run(RETURNS, 0, algo="sac", seconds=1.0)
        report = write_report(fabric.results, out, Request(formats=("svg",)))
        assert "processor_time.svg" in drawn_files(report)
        (note,) = [note for note in report.data.notes if "processor time" in note]
        assert note.endswith("some of their runs have not recorded it: face_direction td3 full.")


def test_variant_has_same_line_style_in_all_panels(fabric):
    for task, more in (
        ("face_direction", {}),
        ("face_direction", {"precision": "bfloat16"}),
        ("move_to_pose", {"precision": "bfloat16"}),
        ("move_to_pose", {"engine": "sb3"}),
    ):
        settings = {"engine": "batched", **more}
        fabric.run(RETURNS, task=task, seconds=1.0, evaluated={40_000: 300.0}, **settings)
    learned = fabric.learned(window=4)
    for figure in (
        grid_figure(learned, [], Request()),
        grid_figure(fabric.learned(kind=EVALUATION), [], Request()),
        processor.processor_time_figure(learned, []),
        profiles.profiles_figure(cells(fabric)),
    ):
        looks = {}
        for panel in figure.panels:
            for one in panel.series:
                looks.setdefault(one.label, set()).add((one.style.color, one.style.dash))
        looks.pop("", None)
        assert {name: len(of_name) for name, of_name in looks.items()} == {
            "TD3": 1,
            "TD3, bfloat16": 1,
            "TD3, stable-baselines3": 1,
        }
        assert len(set.union(*looks.values())) == 3


class TestMatrix:
    def test_field_shows_median_spread_steps_and_n(self, fabric):
        seeds(fabric, np.arange(0, 1100, 100))
        seeds(fabric, [5], task="move_to_pose", algo="sac")
        (panel,) = heat_map.matrix_figure(cells(fabric)).panels
        assert (panel.x.names, panel.y.names) == (
            ["face_direction", "move_to_pose"],
            ["TD3, full", "SAC, full"],
        )
        assert {(cell.row, cell.column): cell.text for cell in panel.heat_map.texts} == {
            (0, 0): "500 [100, 900]\n40k steps\nn = 11",
            (1, 1): "5\n40k steps\nn = 1",
        }
        np.testing.assert_array_equal(panel.heat_map.values, [[500, np.nan], [np.nan, 5]])

    def test_long_names_are_truncated_and_leave_room_for_panel(self, fabric):
        seeds(fabric, [1], task="t" * 300, algo="a" * 300)
        drawn = plotting.draw(heat_map.matrix_figure(cells(fabric)))
        plotting.to_png(drawn)
        width, height = drawn.axes[0].get_window_extent().size
        assert min(width, height) > 50


class TestEachSeed:
    def test_every_seed_is_thin_line_without_label(self, fabric, published):
        for seed in range(3):
            fabric.run(RETURNS + 10 * seed, seed)
        plain, thin = (
            grid_figure(fabric.learned(window=4), published, Request(window=4, each_seed=each))
            for each in (False, True)
        )
        added = len(thin.panels[0].series) - len(plain.panels[0].series)
        assert added == 3
        (item,) = fabric.learned(window=4)
        drawn = [series for series in thin.panels[0].series if series.style.width == 0.5]
        assert {series.style.color for series in drawn} == {ALGORITHM_COLORS["td3"]}
        for row, one in zip(item.curve.each, drawn, strict=True):
            assert one.y.tolist() == row.tolist()
            assert one.label == ""
        assert "a single seed" in dict(thin.key)
        assert "a single seed" not in dict(plain.key)

    def test_line_of_shorter_seed_ends_early(self, fabric, published):
        fabric.run(RETURNS, 0)
        fabric.run(RETURNS[:20], 1)
        (item,) = fabric.learned(window=4)
        assert np.isfinite(item.curve.each).sum(axis=1).tolist() == [41, 19]


class TestSizesAndFormats:
    @pytest.mark.parametrize(("columns", "width"), [(1, 3.5), (2, 7.15)])
    def test_figures_have_column_width_and_no_overlaps(self, fabric, published, columns, width):
        for algo, task in itertools.product(("td3", "ppo"), ("face_direction", "move_to_pose")):
            seeds(fabric, [500, 600, 700], task=task, algo=algo)
        seeds(fabric, [500, 600, 700], representation="dae12")
        options = fabric.learned(), published, Request(each_seed=True)
        figures = [
            grid_figure(*options),
            *comparison_figures(*options).values(),
            profiles.profiles_figure(cells(fabric)),
        ]
        for figure in figures:
            drawn = plotting.draw(figure, layout.SHEETS[columns])
            plotting.to_png(drawn)
            assert drawn.get_size_inches()[0] == pytest.approx(width)
            assert drawn.texts == []
            assert figure.caption
            renderer = drawn.canvas.get_renderer()
            boxes = [item.get_window_extent(renderer) for item in (*drawn.axes, *drawn.legends)]
            for box in boxes:
                assert box.x0 >= 0
                assert box.y0 >= 0
                assert box.x1 <= drawn.bbox.x1 + 1
                assert box.y1 <= drawn.bbox.y1
            assert not [1 for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]

    @pytest.mark.parametrize("sheet", layout.SHEETS.values())
    @pytest.mark.parametrize(
        "titles",
        [
            [f"move_in_direction, TD3: {name}" for name in ("yaw rate", "forward speed", "reward")],
            ["move_in_direction", "all tasks", "a_long_name_of_a_task"],
        ],
    )
    def test_titles_of_panels_do_not_overlap(self, sheet, titles):
        names = ("stable-baselines3, published", "DDPG")
        axes = Axis("x", (0, 1)), Axis("y", (0, 1), ticks=(0, 1), names=names)
        drawn = plotting.draw(Figure("", [Panel(one, *axes, []) for one in titles], (), []), sheet)
        drawn.set_dpi(300)
        plotting.to_png(drawn)
        renderer = drawn.canvas.get_renderer()
        assert [" ".join(axes.get_title(loc="left").split()) for axes in drawn.axes] == titles
        boxes = [axes.get_tightbbox(renderer) for axes in drawn.axes]
        assert max(box.x1 for box in boxes) <= drawn.bbox.x1
        assert not [1 for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]

    @pytest.mark.parametrize("sheet", layout.SHEETS.values())
    def test_names_below_panel_do_not_overlap(self, sheet):
        names = [f"representation{i}" for i in range(6)]
        x = Axis("representation", (-0.5, 5.5), ticks=range(6), names=names)
        panels = [Panel(title, x, Axis("y", (0, 1)), []) for title in ("one", "two")]
        drawn = plotting.draw(Figure("", panels, (), []), sheet)
        drawn.set_dpi(300)
        plotting.to_png(drawn)
        for axes in drawn.axes:
            labels = axes.get_xticklabels()
            assert [label.get_text() for label in labels] == names
            assert min(label.get_fontsize() for label in labels) >= 6
            boxes = [label.get_window_extent() for label in labels]
            if not labels[0].get_rotation():
                assert all(a.x1 < b.x0 for a, b in itertools.pairwise(boxes))
            assert min(box.y0 for box in boxes) >= 0

    @pytest.mark.parametrize("sheet", layout.SHEETS.values())
    @pytest.mark.parametrize("tasks", [1, 2, 5])
    def test_texts_of_matrix_fit_their_cells(self, fabric, sheet, tasks):
        for task, label in itertools.product(TASKS[:tasks], ("td3", "an_agent_with_a_long_name")):
            seeds(fabric, [500, 600, 700], task=task, algo=label)
        drawn = plotting.draw(heat_map.matrix_figure(cells(fabric)), sheet)
        drawn.set_dpi(300)
        plotting.to_png(drawn)
        matrix = drawn.axes[0]
        width = matrix.get_window_extent().width / tasks
        assert len(matrix.texts) == 2 * tasks
        assert max(text.get_window_extent().width for text in matrix.texts) <= width

    def test_wide_title_is_divided_after_colon(self):
        (title,), size = texts.fitted_titles(["face_direction: tilt rate"], 1.3, 8.0)
        assert title == "face_direction:\ntilt rate"
        assert size == 8.0

    @pytest.mark.usefixtures("undrawn")
    def test_only_requested_formats_are_written_and_others_removed(self, fabric, out):
        seeds(fabric, [500, 600, 700])
        write_report(fabric.results, out)
        report = write_report(fabric.results, out, Request(formats=("pdf",)))
        assert {name[-4:] for name in drawn_files(report)} == {".pdf"}
        assert sorted(report.files) == sorted(out.iterdir())

    @pytest.mark.parametrize("name", ["svg", "pdf", "png"])
    def test_figure_is_reproducible_byte_for_byte(self, fabric, name):
        seeds(fabric, [500, 600, 700])
        figure = profiles.profiles_figure(cells(fabric))
        made = [plotting.FORMATS[name](plotting.draw(figure)) for _ in range(2)]
        assert made[0] == made[1]
        assert not re.search(rb"CreationDate|dc:date|Matplotlib v\d", made[0])

    @pytest.mark.parametrize(
        ("wrong", "printed"),
        [
            ({"columns": 3}, "--columns 3: type 1 or 2"),
            ({"formats": ("gif",)}, "Unknown format 'gif'; choose "),
            ({"formats": ()}, "need a format"),
        ],
    )
    def test_invalid_columns_or_formats_are_refused(self, wrong, printed):
        from jbench.errors import RequestError

        with pytest.raises(RequestError, match=printed):
            Request(**wrong)


def test_figure_is_drawn_with_and_without_surrounding_text(fabric, published):
    seeds(fabric, [500])
    figure = grid_figure(fabric.learned(), published, Request())
    whole, bare = (plotting.draw(figure, text=text) for text in (True, False))
    of_paper = plotting.draw(figure, layout.SHEETS[2])
    assert [text.get_text().split()[0] for text in whole.texts] == ["Training", "Shown:"]
    assert (bare.texts, bare.legends, of_paper.texts) == ([], [], [])
    assert bare.get_size_inches()[1] < whole.get_size_inches()[1]
    assert "Order: quantile-first" in figure.caption
    assert f"solved ({SOLVED})" in [text.get_text() for text in of_paper.legends[-1].get_texts()]


@pytest.mark.parametrize(("last", "log"), [(7000, False), (9000, True)])
def test_evaluations_of_very_different_lengths_have_logarithmic_axis(fabric, last, log):
    fabric.run([1.0], 0, algo="sac", evaluated={500: 10.0, 1000: 20.0})
    fabric.run([1.0] * 9, 0, algo="ppo", evaluated={1000: 10.0, last: 20.0})
    figure = grid_figure(fabric.learned(kind=EVALUATION), [], Request())
    (x,) = (panel.x for panel in figure.panels if panel.series)
    assert (x.log, x.limits) == (log, (500 if log else 0, last))
    drawn = plotting.draw(figure)
    drawn.canvas.draw()
    (axes,) = (one for one in drawn.axes if one.lines and one.get_xlabel())
    shown = [text.get_text() for text in axes.get_xticklabels() if text.get_text()]
    if log:
        assert [text for text in shown if 0.5 <= float(text) <= 9] == ["0.5", "1", "2", "5"]


@pytest.mark.parametrize("last", [0, 1000])
def test_evaluations_before_training_are_on_linear_axis(fabric, last):
    fabric.run([1.0], 0, algo="sac", evaluated={0: 10.0, last: 20.0})
    fabric.run([1.0] * 9, 0, algo="ppo", evaluated={0: 10.0, 9000: 20.0})
    figure = grid_figure(fabric.learned(kind=EVALUATION), [], Request())
    (x,) = (panel.x for panel in figure.panels if panel.series)
    assert (x.log, x.limits) == (False, (0, 9000))


def test_axis_of_single_evaluation_before_training_has_width(fabric):
    fabric.run([1.0], 0, evaluated={0: 10.0})
    figure = grid_figure(fabric.learned(kind=EVALUATION), [], Request())
    (x,) = (panel.x for panel in figure.panels if panel.series)
    assert (x.log, x.limits) == (False, (0, 1))


@pytest.mark.filterwarnings("error")  # matplotlib warns if it can't lay out a figure
@pytest.mark.parametrize("sheet", layout.SHEETS.values(), ids=map(str, layout.SHEETS))
def test_long_row_names_leave_room_for_heat_map(fabric, sheet):
    fabric.run([1.0], algo="W" * 80)
    drawn = plotting.draw(heat_map.matrix_figure(fabric.cells()[0]), sheet)
    drawn.draw_without_rendering()
    assert drawn.axes[0].get_position().width * sheet.width > 0.25


@pytest.mark.parametrize("sheet", layout.SHEETS.values(), ids=map(str, layout.SHEETS))
@pytest.mark.parametrize("count", [1, 2, 6])
def test_long_row_names_leave_room_for_panels(sheet, count):
    names = [f"ppo full, {'setting=0.123456, ' * 20}{row}" for row in range(3)]
    y = Axis("", (2.6, -0.6), ticks=range(3), names=names)
    figure = Figure("", [Panel("", Axis("return", (0.0, 1000.0)), y, [], [])] * count, [], [])
    laid = layout.lay_out(figure, sheet, text=True)
    assert min(place.box.width for place in laid.panels) >= 0.5
    right = max(place.box.left + place.box.width for place in laid.panels)
    assert right <= laid.width
    assert plotting.to_png(plotting.draw(figure, sheet))


def test_axis_of_one_whole_number_has_no_fractions():
    axis = Axis("latents", (11.5, 12.5), integer=True)
    drawn = plotting.draw(Figure("Errors", [Panel("", axis, Axis("error", (0, 1)), [])]))
    ticks = drawn.axes[0].get_xticks()
    assert [tick for tick in ticks if 11.5 <= tick <= 12.5] == [12]
