"""Figures: what is drawn of a frame, how series look, and the files."""

import itertools
import re
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from jbench.report import style
from jbench.report.data.untrained import shipped_untrained
from jbench.report.encoders import PREDICTED
from jbench.report.figures import charts, marks, shares
from jbench.report.figures.chart import Panel
from jbench.report.figures.curves import drawn_points
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.report.svg import panel_svgs
from jbench.report.texts import map_texts
from jbench.representation_names import ENCODER_KINDS, kind_in
from jbench.task_specs import SOLVED_RETURN
from tests.matrices import diagonal

NAMES = [
    "full",
    "scaled",
    "planar",
    "raw",
    "forward12",
    "random12",
    "pca12",
    "heading16",
    "ofe12",
    "dae12",
    "dae16",
    "dae12-observation",
    "dae12-observation-whitened",
    "dae12-whitened",
    "dae-yaw13",
    "planar-no-yaw11",
    "planar-mirror12",
    "theirs8",
    "another",
    "third3",
    *(f"{kind}12" for kind in ENCODER_KINDS if kind not in ("scaled", "planar")),
    *(f"dae12-variant{i}" for i in range(20)),
]
STEPS = [10_000, 20_000, 30_000, 40_000, 50_000]


def add_runs(fabric, *names, seeds=3, points=5, **changes):
    """Adds runs whose evaluation return is 100 for each evaluation, and 10 more for each seed."""
    for name, seed in itertools.product(names or ("full",), range(seeds)):
        evaluated = {steps: 100.0 * (i + 1) + 10 * seed for i, steps in enumerate(STEPS[:points])}
        fabric.run([50.0 + seed] * 50, seed, evaluated=evaluated, representation=name, **changes)


def chart_of(fabric, name, request=Request()):  # noqa: B008
    return {chart.name: chart for chart in charts(Frames(fabric.results, request))}.get(name)


def drawn(panel, version=None):
    draw = panel.versions[version] if version else next(iter(panel.versions.values()))
    axes = Figure().subplots()
    draw(axes)
    return axes


def representation_looks(names):
    rows = pd.DataFrame({"name": names, "kind": [kind_in(name) for name in names]})
    return style.looks(rows, "name", "kind")


def test_no_two_representations_look_alike():
    looks = representation_looks(NAMES)
    assert set(looks) == set(NAMES)
    assert len({(look.color, look.dash) for look in looks.values()}) == len(looks)
    assert style.PUBLISHED_DASH not in {look.dash for look in looks.values()}
    assert looks["planar"].color == looks["planar-mirror12"].color
    assert looks["dae12"].dash == looks["planar"].dash == ()
    assert looks["dae12"].color == looks["dae12-whitened"].color != looks["full"].color


def test_no_two_algorithms_look_alike_and_none_has_the_color_of_a_representation():
    names = [("TD3", "TD3"), *((f"TD3, tau={i}", "TD3") for i in range(20)), ("mine", "mine")]
    names += [("DDPG", "DDPG"), ("SAC", "SAC"), ("PPO", "PPO"), ("other", "other")]
    looks = style.looks(pd.DataFrame(names, columns=["name", "algo"]), "name", "algo")
    assert len({(look.color, look.dash) for look in looks.values()}) == len(names)
    others = representation_looks(NAMES)
    colors = {look.color for look in others.values()}
    assert not colors & {look.color for look in looks.values()}


@pytest.mark.parametrize(("other", "lines"), [("move_in_direction", 3), ("cartpole.swingup", 1)])
def test_profiles_have_the_return_of_a_solved_task_where_all_tasks_have_one(fabric, other, lines):
    for task in ("face_direction", other):
        add_runs(fabric, "full", "dae12", task=task, seeds=6)
    panels = chart_of(fabric, "profiles").panels
    together = "all tasks" if lines == 3 else "all tasks, normalized"
    assert [panel.title for panel in panels] == ["face_direction", other, together]
    levels = [line.get_xdata() for panel in panels for line in drawn(panel).lines]
    assert sum(list(x) == [900, 900] for x in levels) == lines


def test_profiles_over_tasks_need_enough_seeds_of_each(fabric):
    # Ten seeds on both tasks together, five on each.
    for task in ("face_direction", "cartpole.swingup"):
        add_runs(fabric, "full", "dae12", task=task, seeds=5)
    frames = Frames(fabric.results)
    assert "all tasks, normalized" in {*frames.profiles["task"]}
    assert shares.profiles(frames).panels == []


def test_levels_far_from_the_curves_extend_the_axis_and_have_their_name_beside_them():
    steps = np.array([1000.0, 2000.0])
    rows = pd.DataFrame({"task": "gym:P", "source": "own", "steps": steps})
    policies = pd.DataFrame({"task": "gym:P", "policy": ["random"], "mean": [-1200.0]})
    axes = Figure().subplots()
    axes.plot(steps, [-300, -150])
    marks.set_axes(axes, rows, "linear", policies["mean"])
    marks.add_levels(axes, rows, policies)
    (name,) = axes.texts
    low, high = axes.get_ylim()
    assert low < -1200
    assert low + name.get_position()[1] * (high - low) == pytest.approx(-1200)


def test_ticks_below_1_are_no_thousandths():
    axes = Figure().subplots()
    marks.set_axes(axes, pd.DataFrame({"task": ["a"], "source": "own", "steps": [2.0]}), "linear")
    shown = [axes.xaxis.get_major_formatter()(value) for value in (0, 0.25, 0.5, 1, 1.5, 22_500)]
    assert shown == ["0", "0.25", "0.5", "1", "1.5", "22.5k"]


def test_curves_by_representation_are_the_medians_of_evaluations(fabric):
    add_runs(fabric, "full", "dae12")
    add_runs(fabric, algo="ppo")
    chart = chart_of(fabric, "representations")
    assert [panel.title for panel in chart.panels] == ["face_direction, TD3"]
    assert list(chart.legend)[:2] == ["full", "dae12"]
    axes = drawn(chart.panels[0], "evaluation linear")
    line = next(line for line in axes.lines if line.get_gid() == "series-0")
    assert list(line.get_xdata()) == STEPS
    assert list(line.get_ydata()) == [110, 210, 310, 410, 510]
    assert axes.get_ylabel() == "evaluation return"
    words = {text.get_text() for text in axes.texts}
    assert words == {"random", "hand-written", "solved"}
    levels = {line.get_ydata()[0] for line in axes.lines if list(line.get_xdata()) == [0, 1]}
    policies = shipped_untrained().query("task == 'face_direction'")
    assert levels == {SOLVED_RETURN, *policies["mean"]}


def test_long_curves_are_drawn_with_80_points_of_each():
    names = pd.DataFrame({"configuration": ["b", "a"], "returns": "training"})
    rows = drawn_points(names.merge(pd.DataFrame({"steps": range(5000)}), how="cross"))
    assert rows["configuration"].unique().tolist() == ["b", "a"]
    for _, curve in rows.groupby("configuration"):
        assert curve["steps"].is_monotonic_increasing
        assert 60 < len(curve) <= 80
        assert (curve["steps"].min(), curve["steps"].max()) == (0, 4999)


def test_few_evaluations_lead_as_in_tables_and_two_seeds_are_lines_and_no_band(fabric):
    add_runs(fabric, "full", "dae12", seeds=2, points=4)
    chart = chart_of(fabric, "representations")
    assert chart.switches[0] == ["evaluation", "training"]
    assert next(iter(chart.panels[0].versions)).startswith("evaluation")
    axes = drawn(chart.panels[0], "evaluation linear")
    mine = [line.get_ydata()[-1] for line in axes.lines if line.get_gid() == "series-0"]
    assert sorted(mine)[:3] == [400, 405, 410]


def test_a_single_configuration_has_its_curve_and_nothing_else_and_none_is_drawn_twice(fabric):
    add_runs(fabric, "dae12")
    (only,) = charts(Frames(fabric.results))
    assert (only.name, only.title) == ("algorithms", "Learning curves")
    add_runs(fabric, "full")
    assert chart_of(fabric, "algorithms") is None


def test_the_forest_has_each_seed_and_the_policies(fabric):
    add_runs(fabric, "full", "dae12")
    chart = chart_of(fabric, "returns")
    assert chart.note.endswith("; vertical line: the return of a solved task (900)")
    axes = drawn(chart.panels[0])
    assert [line.get_xdata() for line in axes.lines if [*line.get_xdata()] == [900, 900]]
    # A mark at the end of the axis, as of a policy that gets 0, is whole.
    points = [each for each in axes.collections if isinstance(each, PathCollection)]
    assert not any(mark.get_clip_on() for mark in points if len(mark.get_offsets()) == 1)
    rows = [label.get_text() for label in axes.get_yticklabels()]
    assert rows == ["TD3 full", "TD3 dae12", "random actions", "hand-written policy"]
    marked = {tuple(place) for points in axes.collections for place in points.get_offsets()}
    policies = shipped_untrained().query("task == 'face_direction'")
    assert {*zip(policies["mean"], (2, 3), strict=True)} <= marked
    dots = [c for c in axes.collections if c.get_gid() == "series-0" and len(c.get_offsets()) == 3]
    assert sorted(dots[0].get_offsets()[:, 0]) == [500, 510, 520]


def test_three_configurations_of_six_seeds_have_a_panel_of_variability_and_come_first(fabric):
    add_runs(fabric, "full", "dae12", "pca12", task="move_from_origin")
    add_runs(fabric, "full", "dae12", "pca12", seeds=6)
    chart = chart_of(fabric, "returns")
    assert chart.note.endswith(
        "its interval begins at 0; a line to the right edge extends beyond it"
    )
    titles = [panel.title for panel in chart.panels]
    assert titles == [
        "face_direction: final return",
        "face_direction: variability",
        "move_from_origin: final return",
    ]


@pytest.mark.slow
def test_behavior_and_sequences_are_drawn_of_their_frames(fabric):
    add_runs(fabric)
    found = Frames(fabric.results)
    assert not {"motor", "positions", "sequences"} & {chart.name for chart in charts(found)}
    names = {"task": "face_direction", "policy": "p", "label": "p (median 5)", "median": 5.0}
    velocity = np.linspace(-1, 1, 50)
    found.motor = pd.DataFrame({**names, "velocity": velocity, "density": 1 - abs(velocity)})
    places = {"x": [-0.1, 0.1], "y": [0.1, -0.1], "share": [0.01, 0.0], "target_yaw": 0.5}
    found.positions = pd.DataFrame({**names, **places, "reach": 0.2})
    encoders = [
        {"task": "face_direction", "kind": "pca", "representation": f"pca{size}", "settings": ""}
        | {"latents": size, "test": 0.1 / size, "heuristic": 0.2}
        | dict.fromkeys(PREDICTED, np.nan)
        for size in (2, 4)
    ]
    found.encoders = pd.DataFrame(encoders)
    trained = found.curves[found.curves["returns"] == "training"]
    found.sequences = pd.concat([trained, trained.assign(source="published", seeds=1)])
    made = {chart.name: chart for chart in charts(found)}
    density = drawn(made["motor"].panels[0]).lines[0].get_ydata()
    assert list(density[1:-1]) == pytest.approx(list(1 - abs(velocity))[1:-1])
    mesh = drawn(made["positions"].panels[0]).collections[0].get_array()
    assert sorted(mesh.compressed()) == [0.01]
    lines = drawn(made["sequences"].panels[0]).lines
    assert [line.get_gid() for line in lines].count("series-0") == 1
    for name in ("motor", "encoders"):
        axes = drawn(made[name].panels[0])
        axes.figure.canvas.draw()
        ticks = [tick.get_text() for tick in (*axes.get_xticklabels(), *axes.get_yticklabels())]
        assert ticks
        assert not any("$" in text for text in ticks)
    for chart in made.values():
        assert style.image(chart.figure(2), "png").startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "width"), [(1, 3.5), (2, 7.15)])
def test_files_have_the_width_of_a_column_and_the_same_bytes(fabric, columns, width):
    add_runs(fabric, "full", "dae12")
    draw = chart_of(fabric, "representations").figure
    assert draw(columns).get_size_inches()[0] == pytest.approx(width)
    for ending in ("svg", "pdf", "png"):
        content = style.image(draw(columns), ending)
        assert content == style.image(draw(columns), ending)
        assert b"n = 3" not in content  # no tips
        if ending == "pdf":
            assert b"/Type3" not in content
            assert b"/CIDFontType2" in content or b"/TrueType" in content


def test_long_titles_and_large_returns_are_written_whole(fabric):
    for algo in ("td3", "sac"):
        fabric.run(np.linspace(0, 2e9, 8), task="a task with a name, of many words", algo=algo)
    (chart,) = [c for c in charts(Frames(fabric.results)) if c.name == "algorithms"]
    (panel,) = chart.panels
    title = f"{panel.title}, with settings=1, that=2, have=3"
    figure = replace(chart, panels=[replace(panel, title=title)]).figure(columns=1)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert axes.get_title("left").replace("\n", " ") == title
    assert axes.get_tightbbox().x1 <= figure.bbox.x1
    # matplotlib would write 1e9 over the title.
    assert axes.yaxis.get_offset_text().get_text() == ""
    assert "2000000000" in [label.get_text() for label in axes.get_yticklabels()]


@pytest.mark.parametrize(("columns", "largest"), diagonal([None, 1], [3e9, -4e12]))
def test_large_returns_in_rows_have_room_beside_each_other(fabric, columns, largest):
    for task in ("huge", "other"):
        for place, algo in enumerate(("td3", "sac")):
            fabric.run(np.full(8, largest * (1 + place)), task=task, algo=algo)
    figure = chart_of(fabric, "returns").figure(columns)
    figure.draw_without_rendering()
    for axes in figure.axes:
        low, high = axes.get_xlim()
        labels = axes.get_xticklabels()
        shown = [label for label in labels if low <= label.get_position()[0] <= high]
        boxes = [label.get_window_extent() for label in shown]
        assert len(boxes) > 1
        assert all(left.x1 < right.x0 for left, right in itertools.pairwise(boxes))


@pytest.mark.parametrize("columns", [None, 2, 1])
def test_percentages_of_sixteen_configurations_stay_in_their_cells(columns):
    names = [f"TD3 dae12-observation-whitened{i:02d}" for i in range(16)]
    rows = pd.DataFrame(itertools.permutations(names, 2), columns=["a_label", "b_label"])
    rows = rows.assign(a=rows["a_label"], p=1.0, decided=True, task="face_direction", steps=1000)
    figure = shares.pairs(SimpleNamespace(pairs=rows)).figure(columns)
    (axes,) = figure.axes
    width = axes.bbox.width / 16
    assert max(text.get_window_extent().width for text in axes.texts) < width
    assert max(text.get_window_extent().width for text in axes.get_xticklabels()) < width


def test_svg_of_a_page_has_no_style_no_double_id_and_a_title_for_each_mark(fabric):
    add_runs(fabric, "full", "dae12")
    panels = chart_of(fabric, "representations").panels
    root = ElementTree.fromstring(f"<x>{panel_svgs(panels[0], 'label', 'name')}</x>")
    elements = list(root.iter())
    ids = [element.get("id") for element in elements if element.get("id")]
    assert len(ids) == len(set(ids))
    assert not [element for element in elements if element.get("style")]
    titles = [e.text for e in elements if e.tag.endswith("title")]
    assert "full at 50,000: 510 [502, 518], n = 3" in titles
    series = {element.get("data-series") for element in elements} - {None}
    assert series >= {"0", "1"}
    used = re.findall(r'href="#([^"]+)"', ElementTree.tostring(root, encoding="unicode"))
    assert set(used) <= set(ids)


def test_lines_of_a_page_have_the_corners_that_matplotlib_writes():
    def draw(axes):
        axes.plot(
            [0, 1, 2, 3, 4, 5, 6], [10, np.nan, -30, np.nan, 40.5, 41, np.nan], gid="series-7"
        )
        axes.set_axis_off()

    text = panel_svgs(Panel("title", {"": draw}, (4, 3)), "label", "name")
    paths = ElementTree.fromstring(text).iter("path")
    (path,) = (found.get("d", "") for found in paths if found.get("stroke") == "#1f77b4")
    steps = [re.findall(r"-?(?:\d+\.?\d*|\.\d+)", line) for line in path.split("M")[1:]]
    lines = [np.cumsum(np.array(line, float).reshape(-1, 2), axis=0) for line in steps]
    assert [len(line) for line in lines] == [1, 1, 2]
    for drawn, value in zip(
        np.concatenate(lines).T, ([0, 2, 4, 5], [10, -30, 40.5, 41]), strict=True
    ):
        assert abs(np.corrcoef(drawn, value)[0, 1]) > 0.99999
    assert [line.count("l") for line in path.split("M")[1:]] == [0, 0, 1]


@pytest.mark.parametrize("colors", [["#aa0000"] * 3, ["#aa0000", "#00bb00", "#aa0000"]])
@pytest.mark.parametrize("marker", ["^", "o"])  # drawn as paths, and as copies of a definition
def test_marks_of_a_page_have_their_colors_whatever_they_share(colors, marker):
    def draw(axes):
        names = ["first", "second", "third"]
        axes.scatter([0, 1, 2], [0, 1, 2], c=colors, marker=marker, urls=names, gid="series-0")

    root = ElementTree.fromstring(panel_svgs(Panel("title", {"": draw}, (4, 3)), "label", "name"))
    parents = {part: element for element in root.iter() for part in element}

    def inherited(element, name):
        while element.get(name) is None:
            element = parents[element]
        return element.get(name)

    marks = {title.text: parents[title][-1] for title in root.iter("title")}
    assert [inherited(marks[name], "fill") for name in ("first", "second", "third")] == colors
    assert all(inherited(mark, "clip-path").startswith("url(#") for mark in marks.values())


def test_names_are_drawn_as_they_are_but_for_control_characters(fabric):
    add_runs(fabric, "full", "dae12")
    found = Frames(fabric.results)
    names = found.curves["representation"].replace("dae12", '"$x^2$<\a')
    found.curves = map_texts(found.curves.assign(representation=names))
    chart = next(c for c in charts(found) if c.name == "representations")
    text = panel_svgs(chart.panels[0], chart.title, chart.name)
    titles = [e.text for e in ElementTree.fromstring(f"<x>{text}</x>").iter() if e.text]
    assert any(title.startswith('"$x^2$<\ufffd at') for title in titles)


def test_long_names_beside_rows_have_several_lines():
    name = "DDPG dae12-without-speed_in_target_frame-script, settings=figure8"
    lines = "DDPG dae12-without-\nspeed_in_target_frame-script,\nsettings=figure8"
    assert marks.named_rows(["TD3 full", name]) == ["TD3 full", lines]
    assert marks.row_height(["TD3 full"]) == marks.ROW == 0.24  # inches
    assert marks.row_height(["TD3 full", name]) == pytest.approx(0.48)
    (endless,) = marks.named_rows(["x" * 300])
    assert max(map(len, endless.split("\n"))) <= 37
    assert "…" in endless


def test_representations_are_in_the_order_of_their_words(fabric):
    names = ["planar-mirror12", "pca12", "planar12", "full", "pca4", "planar-no-yaw11"]
    add_runs(fabric, *names, seeds=2)
    rows = Frames(fabric.results, Request()).configurations
    ordered = ["full", "pca4", "pca12", "planar", "planar-mirror", "planar-no-yaw"]
    assert list(dict.fromkeys(rows["representation"])) == ordered
