"""Tests of the names of two compared sides, and of how a report says what differs."""

import pytest

from jbench.report.figures import charts
from jbench.report.frames import Frames
from jbench.report.page import render
from jbench.report.request import Request
from jbench.report.sides import Sides, named_sides
from jbench.report.tables import tables


@pytest.mark.parametrize(
    ("compare", "named"),
    [
        (("engine=sb3", "engine=batched"), Sides("engine=sb3", "engine=batched")),
        (
            ("algo=td3,representation=full", "representation=planar, algo=td3"),
            Sides("representation=full", "representation=planar", "algo=td3"),
        ),
        # As options and tables call the same setting.
        (
            ("algorithm=td3,encoder=none", "algo=td3,representation=dae12"),
            Sides("encoder=none", "representation=dae12", "algorithm=td3"),
        ),
        # One side has nothing that the other lacks.
        (("algo=td3", "algo=td3,engine=sb3"), Sides("algo=td3", "algo=td3,engine=sb3")),
        (
            ("a=1,b=[1,2],c=3,d=4", "a=1,b=[1,2],c=5,d=6"),
            Sides("c=3, d=4", "c=5, d=6", "a=1, b=[1,2]"),
        ),
    ],
)
def test_settings_of_both_sides_are_named_once(compare, named):
    assert named_sides(compare) == named


def test_folders_of_both_directories_are_left_out(tmp_path, monkeypatch):
    for name in ("one/results", "two/results", "two/old", "file"):
        (tmp_path / name).mkdir(parents=True)

    monkeypatch.chdir(tmp_path)
    for typed, named in (
        (("one/results", "two/results"), ("one/results", "two/results")),
        (("two/results", "two/old"), ("results", "old")),
        ((f"{tmp_path}/one/results", f"{tmp_path}/two/old"), ("one/results", "two/old")),
        ((f"{tmp_path}/file", f"{tmp_path}/two"), ("./file", "two")),  # not a file of curves
        (("two", "two/old"), ("two", "two/old")),
        (("two/old", "reference"), ("two/old", "reference")),
        (("two/old", "algo=td3"), ("two/old", "algo=td3")),
    ):
        assert named_sides(typed) == Sides(*named)


def comparison(fabric, *sides):
    """Returns the frames of a report that compares two sides, and its figures by name."""
    frames = Frames(fabric.results, Request(compare=sides))
    return frames, {chart.name: chart for chart in charts(frames)}


def test_a_row_names_both_configurations_and_the_sides_are_named_once(fabric):
    fabric.flat(range(500, 506), engine="batched")
    fabric.flat(range(600, 606), engine="batched", algo="sac", hyperparameters={"tau": 0.005})
    fabric.flat(range(700, 706), engine="batched", algo="sac", hyperparameters={"tau": 0.5})
    found, made = comparison(fabric, "engine=batched,algo=td3", "algo=sac, engine=batched")
    assert found.headline == (
        "With engine=batched, the final return with algo=td3, compared with algo=sac, is lower in "
        "2 of 2 configurations."
    )
    (table,) = [table for table in tables(found) if table.name == "comparisons"]
    title = "algo=td3 against algo=sac (both: engine=batched)"
    assert table.title == f"Comparison: {title}"
    texts = table.texts()
    assert {*texts["algorithm"]} == {"TD3"}
    names = ["SAC full, tau=0.005", "SAC full, tau=0.5"]
    assert texts["against"].tolist() == names
    assert all(text.startswith("lower by ") for text in texts["verdict"])

    assert sorted(found.configurations["label"]) == [*names, "TD3 full"]
    assert made["comparisons"].note == (
        "final return with algo=td3 minus that with algo=sac (both: engine=batched); 95% interval"
    )
    page = render(found, [])
    assert f"<h1>{title}</h1>" in page


def test_sides_have_a_panel_in_common_if_names_tell_their_curves_apart(fabric):
    fabric.flat(range(500, 506))
    fabric.flat(range(600, 606), representation="planar12")
    found, made = comparison(fabric, "representation=full", "representation=planar")
    assert sorted(found.configurations["label"]) == ["TD3 full", "TD3 planar"]
    curves = made["representations"]
    assert [panel.title for panel in curves.panels] == ["face_direction, TD3"]
    assert list(curves.legend)[:2] == ["full", "planar"]


def test_a_setting_of_both_sides_frees_no_other_setting(fabric):
    """The algorithm implies hyperparameters, which may differ only if the algorithm does."""
    fabric.flat([500] * 3)
    for tau in (0.005, 0.5):
        fabric.flat([600] * 3, representation="planar12", hyperparameters={"tau": tau})
    fabric.flat([700] * 3, hyperparameters={"tau": 0.5})
    sides = ("algo=td3,representation=full", "algo=td3,representation=planar")
    found, _ = comparison(fabric, *sides)
    (row,) = found.comparisons.to_dict("records")
    assert row["difference"] == 100


def test_runs_of_both_sides_are_named_by_their_side(fabric):
    fabric.flat([500] * 3, engine="sb3")
    fabric.flat([600] * 3, engine="batched")
    found, _ = comparison(fabric, "algo=td3", "engine=batched")
    assert {*found.configurations["source"]} == {"algo=td3", "engine=batched"}
    for row in found.configurations.to_dict("records"):
        assert row["label"].startswith(f"{row['source']}: ")
