"""Tests of the command `jbench report`, including `--watch`."""

import json
import re
import signal
import sys
import threading
import webbrowser

import numpy as np
import pytest

from jbench.cli import main
from jbench.commands.verdict_tables import print_verdicts
from jbench.commands.watching import changes, open_page
from jbench.report.frames import Frames
from jbench.report.verdict_matrices import verdict_matrices
from tests.forking import COMMAND, Piped

RELOADS = b'<meta http-equiv="refresh"'
FLAT = np.full(40, 500.0)


@pytest.fixture
def filled(fabric):
    fabric.flat([500, 501, 502])
    fabric.flat([550, 551, 552], representation="dae12")
    return fabric.results.path


def run_report(results, *arguments):
    return main(["report", *arguments, "--results", str(results)])


def test_claims_are_in_json_files_and_page(filled, undrawn, capsys):
    assert run_report(filled, "--claims", "--json", "--format", "svg", "--window", "4") == 0
    output = json.loads(capsys.readouterr().out)
    ours = {c["claim"]: c for c in output["claims"] if c["source"] == "own"}
    assert set(ours) == set("abcg")
    assert ours["c"]["effect"] == pytest.approx(50)
    assert ours["c"]["verdict"] == "undecided"  # of three seeds
    assert ours["c"]["seeds_needed"] >= 6
    assert {one["verdict"] for one in output["verdicts"]} == {"undecided"}
    assert output["headline"].startswith("Too early to say: 3 seeds")
    out = filled / "report"
    page = (out / "index.html").read_text().replace("\n", " ")
    assert "With the reduced order learning is slightly faster." in page
    assert (out / "tables" / "claims.tex").exists()
    assert str(out / "report.json") in output["files"]


@pytest.mark.parametrize(
    ("width", "titles"),
    [
        (80, ["Does reduction help? Against full", "Does reduction help? Against scaled"]),
        (150, ["Does reduction help?"]),
    ],
)
def test_a_narrow_terminal_shows_the_verdicts_against_each_baseline(width, titles, fabric, capsys):
    for place, name in enumerate(("full", "scaled16", "dae12")):
        fabric.flat([500 + place] * 6, representation=name, task="move_in_direction")

    frames = Frames(fabric.results)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", str(width))
        for matrix in verdict_matrices(frames):
            print_verdicts("Does reduction help?", matrix)

    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert [line for line in lines if line.startswith("Does")] == titles
    rows = [line for line in lines if line not in titles and any(mark in line for mark in "✓✗=?")]
    # A line has a representation with its three verdicts; scaled is compared with full alone.
    names = [name for row in rows for name in ("scaled", "dae12") if name in row]
    assert sorted(names) == ["dae12"] * len(titles) + ["scaled"]
    assert sum(row.count(mark) for row in rows for mark in "✓✗=?") == 9


def test_returns_option_selects_leading_returns(fabric, undrawn, capsys):
    fabric.flat([500] * 3, evaluated={20_000: 300.0, 40_000: 950.0})
    results, medians = fabric.results.path, {}
    for returns in ("evaluation", "training"):
        assert run_report(results, "--returns", returns, "--format", "svg") == 0
        printed = capsys.readouterr().out
        assert f"Final {returns} returns" in printed
        medians[returns] = "950 [950, 950]" in printed
    assert medians == {"evaluation": True, "training": False}
    assert not (results / "report" / "tables" / "claims.csv").exists()  # without --claims


def test_terminal_has_a_row_of_verdicts_for_each_representation(fabric, undrawn, capsys):
    for name, value in (("full", 500), ("random12", 100), ("vae12", 900)):
        fabric.flat(range(value, value + 6), representation=name)
    run_report(fabric.results.path, "--format", "svg")
    rows = re.findall(
        r"(\w+) +([?✓✗] \w+) +([?✓✗] \w+) +([?✓✗] \w+) *$", capsys.readouterr().out, re.M
    )
    assert rows == [
        ("random12", "✗ lower", "? undecided", "✗ slower"),
        ("vae12", "✓ higher", "? undecided", "✓ faster"),
    ]


def test_comparison_is_written_beside_report(filled, undrawn, capsys):
    sides = ("--compare", "representation=dae12", "representation=full")
    assert run_report(filled, *sides, "--format", "svg") == 0
    output = capsys.readouterr().out
    assert "1.00 [1.00, 1.00]" in output
    assert (filled / "comparison" / "index.html").exists()
    assert not (filled / "report").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--since", "now"), "--since now: type a date"),
        (("--format", "gif"), "Unknown format 'gif'"),
        (("--columns", "3"), "--columns 3: type 1 or 2"),
        (("--window", "0"), "A window of 0 episodes"),
        (("--returns", "all"), "'--returns': 'all' is not one of 'evaluation', 'training'"),
        (("--watch", "--json"), "--watch and --json exclude each other"),
        (("--compare", "a=1", "a=2", "--reference"), "--compare results reference"),
        (("--compare", "engine=sb3", "--json"), "--compare engine=sb3: type two results"),
    ],
)
def test_invalid_arguments_print_one_line(filled, capsys, arguments, says):
    assert run_report(filled, *arguments) == 2
    printed = capsys.readouterr()
    assert says in printed.err
    assert printed.err.count("\n") == 1
    if "--json" in arguments:
        assert json.loads(printed.out)["error"] in printed.err
    else:
        assert printed.out == ""


@pytest.mark.skipif(sys.platform == "win32", reason="the browser is a shell script")
def test_page_is_opened_if_it_and_display_exist(tmp_path, monkeypatch):
    page, browser, opened = (tmp_path / name for name in ("index.html", "browser", "opened"))
    browser.write_text(f'#!/bin/sh\necho "$1" > {opened}\n')
    browser.chmod(0o755)
    monkeypatch.setattr(webbrowser, "_tryorder", None)  # it reads the environment again
    monkeypatch.setenv("BROWSER", str(browser))
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("DISPLAY", ":0")
    assert not open_page(page)
    page.touch()
    assert open_page(page)
    assert opened.read_text().strip() == page.as_uri()
    if sys.platform == "linux":
        monkeypatch.delenv("DISPLAY")
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        assert not open_page(page)


class TestWatch:
    def test_watch_rewrites_report_only_after_commit(self, fabric, filled):
        turns = changes([filled], poll_seconds=0.01)
        next(turns)
        threading.Timer(0.2, fabric.run, [FLAT, 9]).start()
        next(turns)
        assert len(fabric.results.scan("run")[0]) == 7

    @pytest.mark.slow
    def test_watch_rewrites_report_and_ends_on_interrupt(self, fabric):
        fabric.results.path.mkdir()
        command = ["report", "--watch", "--format", "svg", "--results", str(fabric.results.path)]
        with Piped(COMMAND, [command], session=True) as process:
            wait_for(process, "Nothing to report yet: There are no runs")
            fabric.run(FLAT, 0)
            wait_for(process, "Wrote ")
            fabric.run(FLAT, 1)
            # The run may be read before its episodes; then one more report is written in between.
            wait_for(process, r"TD3 +full +2 ")
            wait_for(process, "Wrote ")
            page = fabric.results.path / "report" / "index.html"
            assert page.read_bytes().count(RELOADS) == 1
            assert not list(page.parent.rglob("*.svg"))
            process.send_signal(signal.SIGINT)
            output = process.stdout.read()
        assert process.returncode == 0
        assert "No longer watching" in output
        assert RELOADS not in page.read_bytes()
        assert list(page.parent.rglob("*.svg"))

    def test_watch_ends_after_interrupt_caught_elsewhere(self, fabric, filled):
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            turns = changes([filled])
            next(turns)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            assert list(turns) == []
            assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        finally:
            signal.signal(signal.SIGINT, before)


def wait_for(process, text):
    """Reads the output of the process up to the first line that matches."""
    assert any(re.search(text, line) for line in process.stdout), f"{text!r} was never said"


@pytest.mark.parametrize("typed", [("--algo", "td3,sac"), ("--algo", "td3", "--algo", "sac")])
def test_several_algorithms_are_typed_with_commas_or_one_by_one(fabric, undrawn, capsys, typed):
    for algo in ("td3", "sac", "ddpg"):
        fabric.flat([500] * 3, algo=algo)

    assert run_report(fabric.results.path, *typed, "--format", "svg", "--json") == 0
    entries = json.loads(capsys.readouterr().out)["configurations"]
    assert {entry["algo"] for entry in entries} == {"TD3", "SAC"}


def test_many_tests_of_claims_are_counted_and_all_are_in_the_document(fabric, undrawn, capsys):
    for place in range(41):
        fabric.flat([950] * 6, hyperparameters={"tau": 0.01 * (1 + place)})

    options = ("--claims", "--published", "no", "--algo", "td3", "--format", "svg", "--json")
    assert run_report(fabric.results.path, *options) == 0
    printed = capsys.readouterr()
    tests = json.loads(printed.out)["claims"]
    own = [entry for entry in tests if entry["source"] == "own"]
    assert [entry["claim"] for entry in own] == ["g"] * 41
    (line,) = re.findall(r"own +training +(\d+) +(\d+) +(\d+)", printed.err)
    assert line == ("41", "0", "0")
    assert "tables/claims.csv" in printed.err
