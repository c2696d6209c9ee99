"""Tests of `jbench demo`, which runs the commands of the quick start."""

from jbench.cli import main
from jbench.commands import demo
from jbench.store import Results
from tests.documentation import ROOT


def test_commands_are_those_of_quick_start():
    page = " ".join((ROOT / "docs" / "quick-start.md").read_text().replace("\\\n", " ").split())
    assert [command for command in demo.COMMANDS if f"jbench {command}" not in page] == []


def test_each_command_is_printed_run_and_recorded(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(demo, "COMMANDS", ("collect --steps 1000", "datasets"))
    place = tmp_path / "mine"
    assert main(["demo", "--results", str(place)]) == 0
    printed = capsys.readouterr().out
    assert f"\n$ jbench collect --steps 1000 --results {place}\n" in printed
    assert f"1 dataset in {place}" in printed
    assert f"The report: {place / 'report' / 'index.html'}" in printed
    (record,) = Results(place).scan("dataset")[0]
    typed = ["jbench", "collect", "--steps", "1000", "--results", str(place)]
    assert record.manifest.provenance["command"] == typed


def test_failing_command_ends_demo(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(demo, "COMMANDS", ("train --encoder none --steps 1", "runs"))
    assert main(["demo", "--results", str(tmp_path / "results")]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("Error: ")
    assert "$ jbench runs" not in printed.out
