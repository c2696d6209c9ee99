"""Tests that a watched report reads and draws only changed data again."""

import numpy as np
import pytest

from jbench.remembered import remembering
from jbench.report.figure import Axis, Figure, Panel, Series, Style
from jbench.report.page import vector
from jbench.report.report import write_report
from jbench.report.request import Request
from jbench.store.record import Record
from tests.report.conftest import episodes

TASKS = ("move_from_origin", "face_direction", "move_to_pose")
WATCHED = Request(window=4, watched=True)


@pytest.fixture
def growing(fabric):
    """Adds two finished runs of each task, and returns the record of an unfinished third."""
    levels = {task: 300.0 + 200 * i for i, task in enumerate(TASKS)}
    for task, level in levels.items():
        for seed in range(2):
            fabric.run(np.full(40, level + seed), seed, task=task)
    return fabric.run(np.full(20, 510.0), 2, status="unfinished", task=TASKS[1], steps=40_000)


def counted(monkeypatch, place, name, which):
    """Wraps a function; returns a list to which each call appends `which(*arguments)`."""
    calls, function = [], getattr(place, name)

    def call(*args, **kwargs):
        calls.append(which(*args))
        return function(*args, **kwargs)

    monkeypatch.setattr(place, name, call)
    return calls


def test_only_changed_data_is_read_and_drawn_again(fabric, growing, out, monkeypatch):
    read = counted(monkeypatch, Record, "read", lambda record, table, _: (record.id, table))
    drawn = counted(monkeypatch, vector, "draw_alone", lambda panel, *_: panel.title)
    with remembering() as memory:
        write_report(fabric.results, out, WATCHED)
        assert (growing.id, "episodes") in read
        assert {*TASKS, "move_in_direction", "all tasks"} < set(drawn)
        read.clear(), drawn.clear()
        memory.next_round()
        write_report(fabric.results, out, WATCHED)
        assert (read, drawn) == ([], [])
        growing.append({"episodes": episodes(growing.id, np.full(22, 510.0)).slice(20)})
        memory.next_round()
        write_report(fabric.results, out, WATCHED)
    assert read == [(growing.id, "episodes")]
    # One panel of the learning curves, and one of the forest plot.
    assert drawn == [TASKS[1], TASKS[1]]
    # The page equals that of a report without a cache.
    page = (out / "index.html").read_bytes()
    write_report(fabric.results, out, WATCHED)
    assert (out / "index.html").read_bytes() == page


def test_watched_report_writes_only_page(fabric, growing, out):
    write_report(fabric.results, out, WATCHED)
    assert sorted(path.name for path in out.iterdir()) == ["index.html", "report.json"]


def test_renamed_line_draws_only_its_panel_again(monkeypatch):
    def figure(label):
        axes = Axis("x", (0, 1)), Axis("y", (0, 1))
        one, other = (
            Series(np.arange(2.0), np.arange(2.0), Style("black"), s) for s in (label, "other")
        )
        return Figure("two", [Panel("one", *axes, [one]), Panel("two", *axes, [other])])

    drawn = counted(monkeypatch, vector, "draw_alone", lambda panel, *_: panel.title)
    with remembering():
        vector.element(figure("10k control steps"), "f", "title")
        vector.element(figure("20k control steps"), "f", "title")
    assert drawn == ["one", "two", "one"]
