"""Tests of the figure and the table of encoder errors against latents, with made-up encoders."""

import json
import math

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from jbench.errors import RequestError
from jbench.names import OFE
from jbench.report.figures import encoders, figure_items, plotting
from jbench.report.page import legends
from jbench.report.report import write_report
from jbench.report.request import Request
from jbench.store import Results, encoder_schema, query
from tests.report.conftest import drawn_files, labels

pytestmark = pytest.mark.usefixtures("no_png")

EXPLAINED = {
    "pca": 0.9,
    "random": 0.5,
    "heuristic": 0.4,
    "pca_heuristic": 0.3,
    "random_heuristic": 0.2,
}


def add(results, kind, latents, explained, *, task="face_direction", seed=0, **more):
    """A finished encoder that explains this fraction of the variance."""
    options = more.pop("options", {})
    settings = {"kind": kind, "task": task, "latents": latents, "seed": seed, "dataset": "d"}
    name = f"s{seed:02d}-{abs(hash(json.dumps(options, sort_keys=True))) % 10**8:08d}"
    record = results.create(
        "encoder", f"{task}/{kind}{latents}/{name}", {**settings, "options": options}
    )
    row = {
        "encoder": record.id,
        "test_mse": 1 - explained,
        "test_explained": explained,
        **{f"{name}_explained": value for name, value in EXPLAINED.items()},
        **more,
    }
    record.append({"encoder_errors": pa.Table.from_pylist([row], encoder_schema.ENCODER_ERRORS)})
    record.finish({"test_mse": 1 - explained})
    return record


def table_of(results, task=None):
    return encoders.encoder_table(query.load(results).tables, task)


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results")


def test_row_holds_medians_across_seeds_of_kind_and_size(results):
    for seed, explained in enumerate((0.5, 0.6, 0.9)):
        add(results, "dae", 4, explained, seed=seed)
    add(results, "pca", 4, 0.9)
    table = table_of(results)
    assert table["kind"].tolist() == ["dae", "pca"]
    first = table.iloc[0]
    assert (first["latents"], first["seeds"], first["settings"]) == (4, 3, "")
    assert first["test_mse"] == pytest.approx(0.4)
    fractions = first[["test", "pca", "random", "heuristic", "pca_heuristic"]].tolist()
    assert fractions == pytest.approx([0.4, 0.1, 0.5, 0.6, 0.7])


def test_axis_shows_every_known_error(results):
    for latents, explained in ((2, math.nan), (4, -math.inf), (8, -4.0), (16, 0.8)):
        add(results, "dae", latents, explained)
    figure = encoders.error_figure(table_of(results))
    # From 0.2, which is the smallest error, to 5, with margins.
    assert figure.panels[0].y.limits == pytest.approx((0.2 / 1.4, 5 * 1.3))
    assert plotting.to_svg(plotting.draw(figure))


def test_rows_are_ordered_by_task_kind_and_size(results):
    for task in ("move_to_pose", "face_direction"):
        for kind in ("random", "zeta", "pca", "dae", "alpha"):
            for latents in (10, 2):
                add(results, kind, latents, 0.5, task=task)
    table = table_of(results)
    found = list(table[["task", "kind", "latents"]].itertuples(index=False, name=None))
    assert found == [
        (task, kind, latents)
        for task in ("face_direction", "move_to_pose")
        for kind in ("dae", "pca", "random", "alpha", "zeta")
        for latents in (2, 10)
    ]
    assert set(table_of(results, "move_to_pose")["task"]) == {"move_to_pose"}


def test_series_of_encoders_belong_to_their_legend_entry(results):
    for kind in ("pca", "dae"):
        add(results, kind, 4, 0.5)
    figure = encoders.error_figure(table_of(results))
    entries = legends.legend(figure, set())
    assert [entries.count(f'data-entry="{i}"') for i in range(2)] == [1, 1]
    named = [one for panel in figure.panels for one in panel.series if one.label]
    assert [one.belongs_to for one in named] == [("dae",), ("pca",)]


def test_encoders_with_other_options_are_separate_lines(results):
    for horizon in (1, 5):
        for latents in (2, 4):
            add(results, "ddae", latents, 0.5, options={"horizon": horizon, "noise": 0.1})
    table = table_of(results)
    assert table["settings"].tolist() == ["horizon=1"] * 2 + ["horizon=5"] * 2
    figure = encoders.error_figure(table)
    assert labels(figure.panels[0]) == ["ddae horizon=1", "ddae horizon=5"]


def test_unfinished_encoders_are_skipped(results):
    add(results, "dae", 4, 0.5)
    results.create("encoder", "face_direction/dae5/a", {"kind": "dae", "task": "face_direction"})
    assert table_of(results)["latents"].tolist() == [4]


def test_figure_has_panel_per_task_and_line_per_kind(results):
    for latents, explained in ((2, 0.5), (8, 0.9), (16, 1.0)):
        add(results, "pca", latents, explained)
        add(results, "their-own", latents, explained / 2)
    add(results, "pca", 2, 0.3, task="move_to_pose")
    figure = encoders.error_figure(table_of(results))
    panel, other = figure.panels
    assert (panel.title, other.title) == ("face_direction", "move_to_pose")
    test, heuristic, their_own = panel.series[:3]
    np.testing.assert_array_equal(test.x, [2, 8, 16])
    # An error of 0 is drawn at the lower limit, because a logarithmic scale has no 0.
    np.testing.assert_allclose(test.y, [0.5, 0.1, 1e-3])
    np.testing.assert_allclose(heuristic.y, [0.6] * 3)
    assert panel.y.log
    styles = test.style, heuristic.style, other.series[0].style
    assert {style.color for style in styles} == {"#000000"}
    assert test.style.dash != heuristic.style.dash
    assert their_own.style.color != test.style.color
    assert labels(panel) == ["pca", "their-own"]
    assert len(figure.key) == 2


def test_every_encoder_kind_has_unique_color_and_marker():
    looks = list(encoders._LOOKS.values())
    assert set(encoders._LOOKS) == {*encoders.ENCODER_KINDS, OFE}
    for part in zip(*[*looks, encoders._OTHER], strict=True):
        assert len(set(part)) == len(looks) + 1


def test_report_without_runs_has_encoder_figure_and_table(results, tmp_path):
    for latents, explained in ((2, 0.5), (4, 0.75)):
        add(results, "vae", latents, explained)
    report = write_report(results, tmp_path / "report")
    assert drawn_files(report) == ["encoders.png", "encoders.svg"]
    written = pd.read_csv(tmp_path / "report" / "encoders.csv")
    assert written["test"].tolist() == pytest.approx([0.5, 0.25])
    page = (tmp_path / "report" / "index.html").read_text()
    assert ">Encoders</h2>" in page
    assert "0.2500" in page


def test_encoders_of_another_task_give_no_report(results, tmp_path):
    add(results, "vae", 2, 0.5)
    with pytest.raises(RequestError, match="There are no runs"):
        write_report(results, tmp_path / "report", Request(task="move_to_pose"))


def test_no_encoders_give_empty_table(results):
    assert table_of(results).empty


def add_predictions(record, yaw_rate, rank):
    """Adds the R² with which an encoder's latents predict the next control step."""
    r2 = {"yaw_rate": yaw_rate, "tilt_rate": 0.5, "forward_speed": -0.2, "reward": None}
    rows = [
        {"encoder": record.id, "target": target, "r2": value, "effective_rank": rank}
        for target, value in r2.items()
    ]
    record.append(
        {"encoder_predictions": pa.Table.from_pylist(rows, encoder_schema.ENCODER_PREDICTIONS)}
    )
    record.finish({"effective_rank": rank})


def test_measured_predictions_are_drawn_beside_errors(results, tmp_path):
    for seed, yaw_rate in enumerate((0.2, 0.4, 0.9)):
        add_predictions(add(results, "dae", 4, 0.5, seed=seed), yaw_rate, 3.5)
    add(results, "pca", 4, 0.9)
    table = table_of(results)
    assert table["kind"].tolist() == ["dae", "pca"]
    np.testing.assert_allclose(table["yaw_rate"], [0.4, np.nan])
    np.testing.assert_allclose(table["effective_rank"], [3.5, np.nan])
    assert table["reward"].isna().all()
    error, predicted = figure_items.of_encoders(table)
    assert (error.name, predicted.name) == ("encoders", "encoder_predictions")
    panels = predicted.figure.panels
    assert [panel.title.partition(": ")[2] for panel in panels] == [
        *("yaw rate", "forward speed", "tilt rate", "reward")
    ]
    assert {panel.y.label for panel in panels} == {"R²"}  # only the first of a row shows it
    heights = [series.y[0] for panel in panels for series in panel.series]
    assert {*(series.label for panel in panels for series in panel.series)} == {"dae"}
    # A negative R² is drawn at 0; a target without variance is not drawn.
    np.testing.assert_allclose(heights, [0.4, 0, 0.5, np.nan])
    write_report(results, tmp_path / "report")
    page = (tmp_path / "report" / "index.html").read_text()
    assert "Prediction of the next control step from latents" in page
    assert "R² of yaw rate" in page
    assert ">nan<" not in page
