"""The demo: the commands of the quick start, each recorded as if it had been typed."""

from jbench.cli import main
from jbench.commands import demo
from jbench.store import Results
from tests.command_line import OFF_POLICY, SMALL
from tests.documentation import ROOT

TRAINING = ("train", "--algo", "td3", "--seeds", "0", "--steps", "1000", "--evaluate-episodes", "1")


def test_commands_are_those_of_the_quick_start():
    page = " ".join((ROOT / "docs" / "quick-start.md").read_text().replace("\\\n", " ").split())
    assert [command for command in demo.COMMANDS if f"jbench {command}" not in page] == []


def test_each_command_is_shown_run_and_recorded(tmp_path, monkeypatch, capsys):
    training = " ".join((*TRAINING, *SMALL, *OFF_POLICY))
    monkeypatch.setattr(demo, "COMMANDS", ("collect --steps 1000", training))
    place = tmp_path / "mine"
    assert main(["demo", "--results", str(place)]) == 0
    said = capsys.readouterr().out
    assert f"\n$ jbench collect --steps 1000 --results {place}\n" in said
    assert "--set 'hidden_layers=[8]'" in said
    assert f"The report: {place / 'report' / 'index.html'}" in said
    results = Results(place)
    for kind, command in (("dataset", "collect --steps 1000"), ("run", training)):
        (record,) = results.scan(kind)[0]
        assert record.status == "finished"
        typed = ["jbench", *command.split(), "--results", str(place)]
        assert record.manifest.provenance["command"] == typed


def test_a_command_that_fails_ends_the_demo(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(demo, "COMMANDS", ("train --encoder none --steps 1", "runs"))
    assert main(["demo", "--results", str(tmp_path / "results")]) == 2
    said = capsys.readouterr()
    assert said.err.startswith("Error: ")
    assert "$ jbench runs" not in said.out
