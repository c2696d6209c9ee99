"""Tests of the figure of robot sequences: curves are averaged within each robot's episodes."""

import numpy as np
import pytest

from jbench.report import contents
from jbench.report.data.published import read_sequences
from jbench.report.figures.sequences import sequence_figures
from jbench.report.report import gather, write_report
from jbench.report.request import Request
from jbench.report.views import curve_of
from jbench.store import query
from tests.report.conftest import drawn_files, labels

SAC = {"algo": "sac", "task": "move_in_direction", "augment": 0, "robots": 2}
# Two robots of 80 episodes: 80 returns of 100, then 80 of 300.
RETURNS = np.repeat([100.0, 300.0], 80)


@pytest.fixture(scope="module")
def sequences():
    return read_sequences(query.published())


def test_windows_never_span_change_of_robots(fabric):
    for seed in range(3):
        fabric.run(RETURNS + seed, seed, **SAC)
    ((cell, _),) = fabric.learned()
    assert (cell.robots, cell.robot_episodes) == (2, 80)
    curve = curve_of(cell, Request())
    # Each robot's 80 episodes have 61 full windows of 20, and 10 truncated ones at each end; the
    # median of seeds 0, 1 and 2 adds 1.
    assert curve.window == 20
    assert curve.quantile(50).tolist() == [101.0] * 81 + [301.0] * 81
    # From the first to the last episode of each robot.
    assert curve.control_steps[[0, 80, 81, 161]].tolist() == [1000, 80_000, 81_000, 160_000]
    assert curve.widths[[0, 9, 10, 80, 81]].tolist() == [10, 19, 20, 10, 10]


def test_run_on_first_robot_uses_planned_changes(fabric):
    fabric.run(RETURNS[:40], 0, status="unfinished", steps=160_000, **SAC)
    ((cell, _),) = fabric.learned()
    assert cell.robot_episodes == 80
    assert curve_of(cell, Request(order="smooth-first")).quantile(50).tolist() == [100.0] * 41


def test_download_has_drawn_points(fabric):
    fabric.run(RETURNS, 0, **SAC)
    fabric.run(RETURNS, 0, **{**SAC, "augment": None, "robots": 1})
    document = contents.document(gather(fabric.results, Request()))
    (item,) = [one for one in document.items if one.name.startswith("robots-")]
    (panel,) = item.figure.panels
    # Runs on one robot are in other figures.
    assert [label.split(", ")[1] for label in labels(panel)] == ["2 robots", "10 robots"]
    (curve,) = [one for one in panel.series if one.label.startswith("full, 2")]
    assert item.data["control_steps"].tolist() == curve.x.tolist()
    assert item.data["q50"].tolist() == curve.y.tolist()
    assert set(item.data["window"]) == {*range(10, 21)}


def test_switches_of_all_cells_are_drawn(fabric):
    fabric.run(RETURNS, 0, **SAC)
    fabric.run(RETURNS, 0, **{**SAC, "robots": 4})
    (figure,) = sequence_figures(fabric.learned(), [], Request()).values()
    at = [line.at for line in figure.panels[0].references if line.vertical]
    assert at == [40_000, 80_000, 120_000]


def test_figure_shows_own_and_published_curves_and_robot_changes(fabric, sequences):
    fabric.run(RETURNS, 0, **SAC)
    ((key, figure),) = sequence_figures(fabric.learned(), sequences, Request()).items()
    assert key == ("move_in_direction", "sac")
    (panel,) = figure.panels
    assert len(labels(panel)) == 2
    assert labels(panel)[0].startswith("full, 2 robots")
    assert labels(panel)[1] == "full, 10 robots"
    (published,) = [one for one in panel.series if one.label == "full, 10 robots"]
    assert published.detail == "augmented SAC, 10 seeds"
    theirs = sequences[0].quantiles[50]
    assert any(np.array_equal(series.y, theirs) for series in panel.series)
    # The one change of robots, after 80,000 control steps.
    assert [line.at for line in panel.references if line.vertical] == [80_000]


@pytest.mark.usefixtures("undrawn")
def test_grid_excludes_robot_sequences(fabric, out):
    fabric.run(RETURNS, 0, **SAC)
    names = {*drawn_files(write_report(fabric.results, out))}
    drawn = ("forest", "matrix", "robots-move_in_direction-sac")
    assert names == {f"{name}.{kind}" for name in drawn for kind in ("png", "svg")}
    fabric.run(RETURNS, 0, **{**SAC, "augment": None, "robots": 1})
    names = {*drawn_files(write_report(fabric.results, out))}
    assert {"figure9.svg", "robots-move_in_direction-sac.svg"} <= names
