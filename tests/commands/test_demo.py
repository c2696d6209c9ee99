"""Tests of `jbench demo`, which runs the commands of the quick start."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

from jbench.cli import main
from jbench.commands import demo
from jbench.store import Results
from tests.demo_results import RETURNS
from tests.documentation import ROOT
from tests.forking import COMMAND, Piped


def test_commands_are_those_of_quick_start():
    page = " ".join((ROOT / "docs" / "quick-start.md").read_text().replace("\\\n", " ").split())
    assert [command for command in demo.COMMANDS if f"jbench {command}" not in page] == []


class ForkedCommand(Piped):
    """A command of the demo; `test_failing_command_ends_demo` starts Python instead."""

    def __init__(self, command, **_options):
        assert command[:3] == [sys.executable, "-m", "jbench"]
        super().__init__(COMMAND, [command[3:]])

    def communicate(self):
        return self.stdout.read(), None


def test_each_command_is_printed_run_and_recorded(tmp_path, monkeypatch, capsys):
    # Of this module only: the server that forks the commands is started by the real one.
    replaced = SimpleNamespace(Popen=ForkedCommand, PIPE=subprocess.PIPE)
    monkeypatch.setattr(demo, "subprocess", replaced)
    monkeypatch.setattr(demo, "COMMANDS", ("collect --steps 1000", "datasets"))
    place = tmp_path / "mine"
    assert main(["demo", "--results", str(place)]) == 0
    printed = capsys.readouterr().out
    assert f"\n$ jbench collect --steps 1000 --results {place}\n$ jbench datasets" in printed
    assert "1 dataset in" not in printed  # only a failing command is quoted
    assert f"Open {place / 'report' / 'index.html'} in a browser." in printed
    assert "Two seeds decide nothing" in printed
    (record,) = Results(place).scan("dataset")[0]
    typed = ["jbench", "collect", "--steps", "1000", "--results", str(place)]
    assert record.manifest.provenance["command"] == typed


def test_curves_of_each_representation_are_shown_in_few_lines(demo_results, monkeypatch, capsys):
    monkeypatch.setattr(demo, "COMMANDS", ())
    assert main(["demo", "--results", str(demo_results.path)]) == 0
    printed = capsys.readouterr()
    assert len((printed.out + printed.err).splitlines()) <= 30
    # The means of the last evaluations of two seeds, and their median.
    for representation in ("full", "dae14"):
        low, high = sorted(RETURNS[representation, seed][1] for seed in (0, 1))
        lines = [line.split() for line in printed.out.splitlines()]
        (_, curve, *row) = next(line for line in lines if line[:1] == [representation])
        assert row == [f"{(low + high) / 2:.0f}", "2", f"{low}", "and", f"{high}"]
        assert len(curve) == 10
        assert sorted(curve) == list(curve)  # the returns of these results rise
        assert curve[0] < curve[-1]


@pytest.mark.slow
def test_failing_command_ends_demo(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(demo, "COMMANDS", ("train --encoder none --steps 1", "runs"))
    assert main(["demo", "--results", str(tmp_path / "results")]) == 2
    printed = capfd.readouterr()
    assert printed.err.startswith("Error: ")
    assert "$ jbench runs" not in printed.out
