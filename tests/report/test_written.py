"""Tests of the files of a report, and of those of an earlier report in the same directory."""

import json
from collections import Counter

import numpy as np
import pandas as pd
import pytest

from jbench.errors import RequestError, WorkError
from jbench.names import LISTING
from jbench.report import page, tables
from jbench.report.frames import Frames
from jbench.report.report import _write, write_report
from jbench.report.request import Request
from jbench.report.table import Table

FLAT = np.full(40, 500.0)
SVG = Request(formats=("svg",))


@pytest.fixture
def filled(fabric):
    fabric.flat([500, 501, 502], algo="ddpg")
    fabric.flat([550, 551, 552], algo="ddpg", representation="dae12")
    return fabric.results


def test_report_is_page_list_and_two_folders(filled, out, monkeypatch):
    made = Counter()

    def make_table(name, *about, **more):
        made[name] += 1
        return Table(name, *about, **more)

    monkeypatch.setattr(tables, "Table", make_table)
    found, files, _ = write_report(filled, out, SVG)
    assert tables.tables(found)[0].name == "final_returns"  # as the terminal shows them
    assert made == dict.fromkeys(("final_returns", "leaderboard", "encoders", "runs"), 1)
    assert {path.name for path in out.iterdir()} == {"index.html", LISTING, "figures", "tables"}
    assert sorted(files) == sorted(path for path in out.rglob("*") if path.is_file())
    figures = {path.name for path in (out / "figures").iterdir()}
    assert {"representations.svg", "returns.svg"} <= figures
    written = {path.name for path in (out / "tables").iterdir()}
    for name in ("final_returns", "leaderboard"):
        assert {f"{name}.{ending}" for ending in ("csv", "md", "tex")} <= written
    assert {"runs.csv", "seeds.csv", "baselines.csv"} <= written
    assert found.problems == []
    frame = pd.read_parquet(out / "tables" / "curves.parquet")
    pd.testing.assert_frame_equal(frame, found.curves, check_dtype=False)
    text = pd.read_csv(out / "tables" / "curves.csv", keep_default_na=False, na_values=[""])
    np.testing.assert_allclose(text["median"], frame["median"], rtol=1e-12)


@pytest.mark.slow
def test_same_results_give_identical_files(filled, tmp_path):
    first = write_report(filled, tmp_path / "a", SVG).files
    second = write_report(filled, tmp_path / "b", SVG).files
    assert first
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_watched_report_writes_only_page(filled, undrawn, out):
    write_report(filled, out, Request(watched=True))
    assert sorted(path.name for path in out.iterdir()) == ["index.html", "report.json"]


def test_characters_that_the_font_lacks_are_noted_once(fabric, out, recwarn):
    fabric.run(FLAT[:8], task="robot 🤖")
    written = write_report(fabric.results, out, SVG)
    assert "The font of the figures' files lacks 🤖, which are boxes there." in written.notes
    assert not [warning for warning in recwarn if "Glyph" in str(warning.message)]
    assert "🤖" in (out / "index.html").read_text("utf-8")


def test_names_with_path_separators_write_no_file_outside(fabric, out):
    for name in ("face_direction", "x/../../../etc/passwd"):
        for representation in ("full", "x/../../y"):
            fabric.run(FLAT[:4], task=name, algo=name, representation=representation)
    files = write_report(fabric.results, out, SVG).files
    assert sorted(files) == sorted(path for path in out.rglob("*") if path.is_file())
    assert sorted(out.parent.iterdir()) == [out, fabric.results.path]


def test_damaged_run_is_reported_and_others_are_used(fabric):
    damaged = fabric.run(FLAT, seed=0)
    fabric.run(FLAT, seed=1)
    (file,) = damaged.path.glob("*.parquet")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 255
    file.write_bytes(content)
    found = Frames(fabric.results)
    (problem,) = found.problems
    assert file.name in problem
    assert damaged.id in problem
    assert found.configurations["seeds"].tolist() == [1]


def test_only_damaged_runs_are_refused(fabric, out):
    damaged = fabric.run(FLAT)
    (damaged.path / "manifest.json").write_text("{")
    with pytest.raises(WorkError, match=r"can be reported.*manifest\.json.*`jbench repair"):
        write_report(fabric.results, out)
    assert not out.exists()


def test_runs_without_episodes_are_refused(fabric, out):
    fabric.run([], status="unfinished", steps=1000)
    with pytest.raises(RequestError, match=r"No run has an episode yet.*r0001"):
        write_report(fabric.results, out)


@pytest.mark.parametrize(
    ("filters", "asked"),
    [
        ({"task": "dance"}, "task 'dance'"),
        ({"task": "face_direction", "algo": ("ddpg",)}, "task 'face_direction' and algo 'ddpg'"),
    ],
)
def test_filter_without_match_lists_existing_runs(fabric, filters, asked):
    fabric.run(FLAT, algo="td3")
    fabric.run(FLAT, task="move_to_pose", algo="ddpg")
    with pytest.raises(RequestError) as error:
        Frames(fabric.results, Request(**filters))
    assert asked in str(error.value)
    assert "face_direction with td3; move_to_pose with ddpg" in str(error.value)


def test_order_and_window_are_those_of_curves(fabric):
    turns = np.tile([0.0, 10.0], 4)
    for seed, returns in enumerate((turns, 10 - turns, np.full(8, 4.0))):
        fabric.run(returns, seed=seed)
    for order, median in (("quantile-first", 4), ("smooth-first", 5)):
        curves = Frames(fabric.results, Request(order=order, window=2)).curves
        assert curves["median"].tolist()[1:-1] == [median] * 7


def test_files_missing_from_new_report_are_removed_but_foreign_and_changed_ones_are_kept(out):
    out.mkdir()
    _write(out, {"a.png": b"1", "b.png": b"2", "c.png": b"3", "gone.png": b"4"})
    (out / "notes.txt").write_text("mine")
    (out / "a.png").write_bytes(b"mine")
    (out / "gone.png").unlink()
    paths, (note,) = _write(out, {"c.png": b"5"})
    assert {path.name for path in out.iterdir()} == {"a.png", "c.png", "notes.txt", LISTING}
    assert (out / "c.png").read_bytes() == b"5"
    assert sorted(path.name for path in paths) == ["c.png", LISTING]
    assert note.startswith("a.png in ")
    # The file is kept and not reported again.
    assert _write(out, {"c.png": b"5"})[1] == []


def test_file_in_place_of_directory_is_refused_before_drawing(fabric, out, monkeypatch):
    fabric.run([500.0] * 4)
    out.write_text("mine")
    monkeypatch.setattr(page, "render", None)  # calling it would be a TypeError
    with pytest.raises(RequestError, match="is a file, or lies in one; name a directory"):
        write_report(fabric.results, out)
    assert out.read_text() == "mine"


@pytest.mark.parametrize(
    "listing",
    [
        "{",
        "[]",
        '{"files": []}',
        '{"files": {"../outside": 1}}',
        '{"files": {"../outside": "DIGEST", "..": "x", "link": "DIGEST"}}',
        '{"files": {"a\\u0000b": "x", "a\\ud800b": "x", "": "x"}}',
    ],
)
def test_invalid_or_hostile_listing_is_harmless(out, listing):
    digest = "6b86b273ff34fce19d6b804eff5a3f5747ada4eaa22f1d49c01e52ddb7875b4b"  # of "1"
    out.mkdir()
    outside = out.parent / "outside"
    outside.write_bytes(b"1")
    (out / "link").symlink_to(outside)
    (out / LISTING).write_text(listing.replace("DIGEST", digest))
    _write(out, {"c.png": b"4"})
    assert outside.read_bytes() == b"1"
    assert (out / "link").is_symlink()
    assert list(json.loads((out / LISTING).read_text())["files"]) == ["c.png"]
