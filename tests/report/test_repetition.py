"""Tests of what the page says of runs that dropped out, and of how its runs are repeated."""

import math
import re

import pytest

from jbench.report import page
from jbench.report.encoders import descriptions
from jbench.report.frames import Frames
from jbench.report.repetition import drops, repetition
from jbench.store.tables import read_tables
from jbench.studies.rebuilt_matrix import matrix_text
from tests.store.store_rows import alter_manifest
from tests.training.small_runs import small_run

RETURNS = [100.0] * 8


def page_text(frames):
    return page.render(frames, [])


def test_page_says_that_no_run_dropped_out(fabric):
    fabric.run(RETURNS)
    assert '<p class="drops">No run failed, is unfinished or is left out.</p>' in page_text(
        Frames(fabric.results)
    )


def test_page_counts_runs_that_failed_or_are_left_out(fabric):
    fabric.run(RETURNS)
    fabric.run(RETURNS, 1, status="failed")
    fabric.run(RETURNS, 2, status="unfinished")
    fabric.run(RETURNS[:4], 0)  # a shorter one of a seed that has a run
    fabric.run([math.nan] * 8, 4)
    broken = fabric.run(RETURNS, 3)
    (broken.path / "manifest.json").write_text("{")
    found = Frames(fabric.results)
    counted = drops(found.runs, found.source.problems)
    assert counted == (
        "Of 5 runs: 1 failed, 1 unfinished, 1 left out, 1 without a final return, 1 unreadable."
    )


def recorded(fabric, command, **changes):
    run = small_run("td3", {}, representation="full", encoder=None, **changes)
    values = {**run.values}
    record = fabric.run(RETURNS, values.pop("seed"), steps=values.pop("steps"), **values)
    made = {**record.manifest.provenance, "command": command}
    if command is None:
        del made["command"]
    alter_manifest(record, provenance=made)
    return record.settings


def test_page_has_the_matrix_and_the_commands(fabric):
    typed = ["/usr/bin/jbench", "train", "--algo", "td3", "--seeds", "0<1"]
    usual = {"steps": 8000, "evaluate_every": 1000, "evaluate_episodes": 1}
    settings = [recorded(fabric, typed, **usual), recorded(fabric, None, **usual, seed=5)]
    found = Frames(fabric.results)
    repeat = repetition(found.source, fabric.results)
    assert repeat.matrix + "\n" == matrix_text(settings, {}, {})
    assert repeat.typed == ["jbench train --algo td3 --seeds '0<1'"]
    (rebuilt,) = repeat.rebuilt
    assert "--seeds 5 --steps 8000" in rebuilt
    shown = re.findall(r"<pre[^>]*>(.*?)</pre>", page_text(found), re.S)
    assert shown[0] == "jbench train --algo td3 --seeds &#39;0&lt;1&#39;"
    assert len(shown) == 3
    assert "tasks = [&#34;face_direction&#34;]" in shown[2]


@pytest.mark.parametrize("named", ["A lab's six numbers.", None])
def test_representations_of_users_are_described_by_their_docstring(fabric, named):
    id = "face_direction/six-rows6/s00-1"
    provenance = {} if named is None else {"description": named}
    settings = {"task": "face_direction", "kind": "mine:SixRows", "latents": 6, "seed": 0}
    fabric.results.create("encoder", id, settings, provenance).finish({})
    for name in ("full", "six-rows6"):
        fabric.run(RETURNS, representation=name)
    found = Frames(fabric.results)
    tables = read_tables(fabric.results, ["encoders"]).tables
    frames = {name: table.to_pandas() for name, table in tables.items()}
    assert descriptions(frames) == ({} if named is None else {"six-rows": named})
    assert ("<b>six-rows</b>: A lab&#39;s six numbers" in page_text(found)) == (named is not None)
