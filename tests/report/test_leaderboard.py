"""Tests of the leaderboard: ranks by overlapping intervals, kinds of entries, and the command."""

import json

import numpy as np
import pandas as pd
import pytest

from jbench.cli import main
from jbench.report.configurations import CONFIGURATIONS
from jbench.report.leaderboard import leaderboard
from tests.report.conftest import import_curves


def configurations(*rows):
    """Returns configurations with these medians, ends of intervals and seeds."""
    names = ("median", "median_low", "median_high", "seeds")
    common = {"task": "face_direction", "algo": "TD3", "representation": "full", "source": "own"}
    common["words"] = ""
    common["steps_min"] = 9
    common["steps"] = 9
    found = [common | dict(zip(names, row, strict=True)) for row in rows]
    return pd.DataFrame(found, columns=CONFIGURATIONS)


def test_entries_with_overlapping_intervals_share_rank():
    found = leaderboard(
        configurations(
            (960, 955, 970, 6),
            (900, 700, 950, 6),  # below the first
            (880, 870, 890, 6),  # overlaps with the second
            (870, 600, 960, 6),  # overlaps with the first, but the second's rank has begun
            (860, np.nan, np.nan, 2),  # no interval
            (850, 840, 990, 5),  # too few seeds
            (690, 680, 699, 6),
            (600, 500, 680, 6),
        ),
        {},
        curves(),
        None,
    )
    ranks = [None if rank is pd.NA else rank for rank in found["rank"]]
    assert ranks == [1, 2, 2, 2, None, None, 5, 5]


def curves(*ends):
    """Returns published curves with these figures, last medians and steps."""
    names = {"task": "face_direction", "algo": "ddpg", "representation": "full"}
    found = [
        {**names, "figure": figure, "median": value, "steps": at}
        for figure, median, steps in ends
        for value, at in ((0.0, 1000.0), (median, steps))
    ]
    columns = ["figure", "task", "algo", "representation", "steps", "median"]
    return pd.DataFrame(found, columns=columns)


def test_published_curves_and_hand_written_policies_are_separate_entries():
    by_hand = {"face_direction": np.append(np.arange(99.0), 1149.0)}
    published = curves(("Figure 7", 700.0, 3e6), ("Figure 9", 650, 5e6), ("Figure 8", 640, 5e6))
    none = configurations()
    best, other = leaderboard(none, by_hand, published, ()).to_dict("records")
    # The longest curve counts.
    assert (best["entry"], best["median"], best["steps"]) == ("published", 650.0, 5e6)
    assert pd.isna(best["rank"])
    # By hand: the mean of the episodes, whose median is 49.5: (98 * 99 / 2 + 1149) / 100.
    assert (other["entry"], other["median"], other["n"]) == ("hand-written", 60.0, 100)
    assert other["low"] < 60 < other["high"]
    assert other["rank"] == 1
    assert leaderboard(none, by_hand, published, ["td3"]).empty
    assert leaderboard(none, by_hand, published, ["heuristic"])["entry"].tolist() == [
        "hand-written"
    ]


@pytest.fixture
def directories(fabric, tmp_path):
    """Six seeds of TD3 that end at 960 to 965, and six of SAC at 500 to 505."""
    for seed in range(6):
        for algo, level in (("td3", 960), ("sac", 500)):
            fabric.run([level + seed] * 8, seed, algo=algo, evaluated={8000: level + seed})
    return fabric.results.path


@pytest.mark.slow
def test_command_ranks_runs_of_directories(directories, capsys):
    assert main(["leaderboard", str(directories), "reference", "--json"]) == 0
    entries = json.loads(capsys.readouterr().out)["entries"]
    ours = [one for one in entries if one["entry"] == str(directories)]
    assert [(one["algo"], one["median"], one["n"]) for one in ours] == [
        ("TD3", 962.5, 6),
        ("SAC", 502.5, 6),
    ]
    assert {one["entry"] for one in entries} == {str(directories), "reference", "published"}
    ranked = {(one["entry"], one["algo"]): one["rank"] for one in entries if one["rank"]}
    assert ranked[str(directories), "TD3"] == 1
    # Of the shipped configurations of six or more seeds above SAC, DDPG on raw begins a rank at
    # place 16. Its interval is so wide (212 to 850) that SAC shares this rank.
    assert ranked[str(directories), "SAC"] == 16


def test_directory_that_is_typed_twice_is_ranked_once(directories, tmp_path, capsys):
    (tmp_path / "link").symlink_to(directories)
    once = listed(capsys, directories)
    assert len([one for one in once if one["entry"] == "own"]) == 2
    assert listed(capsys, directories, tmp_path / "link", directories / ".") == once


def test_command_prints_markdown_and_csv(directories, capsys):
    assert main(["leaderboard", str(directories), "--markdown", "--returns", "training"]) == 0
    printed = capsys.readouterr().out
    assert "| face_direction | 1 | own | TD3 | full | 962 [" in printed
    assert main(["leaderboard", str(directories), "--csv", "--algo", "sac"]) == 0
    header, first, *_ = capsys.readouterr().out.splitlines()
    assert header.startswith("task,rank,entry,algo,representation,median,low,high,n")
    assert "SAC" in first


def listed(capsys, *arguments):
    capsys.readouterr()
    assert main(["leaderboard", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)["entries"]


def test_imported_entries_have_names_of_directories(tmp_path, capsys):
    places = [tmp_path / "a", tmp_path / "b"]
    for place, value in zip(places, (300, 200), strict=True):
        import_curves(place, "td3", {0: [value, value]}, "--returns", "evaluation")
    sources = [one["entry"] for one in listed(capsys, *places) if one["entry"] != "published"]
    assert sources == [f"{place}: imported" for place in places]
    sources = [one["entry"] for one in listed(capsys, "--results", places[0])]
    assert "imported" in sources


def test_algorithm_selects_hand_written_policies(fabric, directories, capsys):
    fabric.evaluation("heuristic", [700.0] * 3)
    typed = ("--results", directories, "--algo")
    assert {one["entry"] for one in listed(capsys, *typed, "td3")} == {"own", "published"}
    assert [one["entry"] for one in listed(capsys, *typed, "heuristic")] == ["hand-written"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nowhere"], "nowhere does not exist"),
        (["results", "--csv", "--markdown"], "exclude each other; type one of them"),
        (["results", "--task", "move_to_pose", "--algo", "td3"], "No run in results has eval"),
        (["results", "--algo", "heuristic"], "No hand-written policy in results has"),
    ],
)
def test_command_refuses_invalid_arguments(fabric, arguments, sentence, capsys, monkeypatch):
    fabric.flat([500], evaluated={40_000: 500.0})
    monkeypatch.chdir(fabric.results.path.parent)
    assert main(["leaderboard", *arguments]) == 2
    assert sentence in capsys.readouterr().err
