"""Tests of `jbench doctor`."""

import sys

import pytest

from jbench.checks import machine
from jbench.checks.checked import Checked
from jbench.store import Results
from tests.store.store_whole import add_whole_run, snapshot


@pytest.fixture(autouse=True)
def without_drawing(monkeypatch):
    """Leaves out the slow check, which `tests/test_opengl.py` tests."""
    monkeypatch.setattr(machine, "draws", lambda backend: backend == "osmesa")


def lines(path):
    return {line.name: line for line in machine.check_machine(Results(path))}


def test_this_machine_passes_and_nothing_is_left(tmp_path, document):
    run = add_whole_run(Results(tmp_path))
    before = snapshot(tmp_path)
    with run.folder.lock():
        told = {line["name"]: line for line in document("doctor", results=tmp_path)["checks"]}
    assert all(line["state"] in ("ok", "note") for line in told.values())
    assert told["locks"]["text"] == f"being written now: run {run.id}"
    assert told["OpenGL"]["text"].startswith("osmesa draws")
    before[f"runs/{run.id}/lock"] = b""
    assert snapshot(tmp_path) == before


def test_missing_results_directory_is_not_made(tmp_path):
    assert "does not exist yet" in lines(tmp_path / "new" / "results")["results"].text
    assert list(tmp_path.iterdir()) == []
    assert lines(machine.SHIPPED_RESULTS)["results"].text.endswith("read-only")


def test_what_fails_is_named_and_ends_with_code_1(run_command, monkeypatch, tmp_path):
    monkeypatch.setattr(machine.importlib.metadata, "requires", lambda name: ["numpy<1", "nope>3"])
    code, printed, error = run_command("doctor", results=tmp_path)
    assert code == 1
    assert "fails  dependencies: numpy is 2." in printed
    assert "not <1; nope is missing: type pip install jbench" in printed
    assert error == "Error: 1 check is not passed: dependencies; see above.\n"


@pytest.mark.skipif(sys.platform != "linux", reason="/proc is a directory of Linux")
def test_directory_that_cannot_be_written_fails():
    line = lines("/proc/results")["results"]
    assert line == Checked(
        "results",
        "fails",
        "/proc/results can't be written and locked (No such file or directory)",
    )


def test_directory_in_a_file_fails(tmp_path):
    (tmp_path / "file").touch()
    line = lines(tmp_path / "file" / "results")["results"]
    assert line.state == "fails"
    assert line.text.endswith("can't be written and locked (Not a directory)")


@pytest.mark.parametrize(("microseconds", "state"), [(22.0, "ok"), (55.0, "note")])
def test_physics_is_compared_with_the_documented_step(monkeypatch, microseconds, state):
    monkeypatch.setattr(machine, "physics_step", lambda: microseconds)
    line = machine._physics()
    assert line.state == state
    assert f"{microseconds / 11:.1f} times the documented 11 us" in line.text


def test_measured_step_is_that_of_a_processor():
    assert 0.1 < machine.physics_step() < 10_000
