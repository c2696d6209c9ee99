"""Tests of the live table of training processes."""

import io
from contextlib import contextmanager

import pytest
from rich.console import Console

from jbench.commands.live_batch import published_median, sparkline
from jbench.commands.live_view import TrainingView
from jbench.commands.output import Output
from jbench.training.events import Event
from tests.sweep_matrices import runs_of_matrix, write_matrix


@pytest.fixture
def runs(tmp_path):
    return runs_of_matrix(write_matrix(tmp_path, algos='"td3", "ppo"', steps=10_000), tmp_path)


def shown(view):
    """The printed lines of the table, with single spaces between columns."""
    console = Console(file=io.StringIO(), width=200)
    console.print(view)
    return [" ".join(line.split()) for line in console.file.getvalue().splitlines()]


def episode(run, steps, episode_return):
    return Event("episode", run.id, steps=steps, episode_return=episode_return)


@contextmanager
def trained(runs):
    """A view during training; standard error is not a terminal."""
    with TrainingView(Output()) as view:
        view.show(Event("training", runs=runs))
        yield view


def test_each_process_has_line_with_steps_and_last_returns(runs):
    with trained(runs) as view:
        view.show(Event("started", runs=runs[:2]))
        view.show(Event("started", runs=runs[2:3]))
        assert any(line == "face_direction td3 full seed 0,1 0/20,000" for line in shown(view))
        for run, steps, episode_return in ((0, 1000, 12.4), (1, 1000, 7.0), (0, 2000, 99.6)):
            view.show(episode(runs[run], steps, episode_return))
        lines = shown(view)
        (td3,) = (line for line in lines if "td3" in line)
        assert td3.startswith("face_direction td3 full seed 0,1 3,000/20,000 ")
        assert " 100 7 " in td3
        # The fifth rollout of 2,048 steps ends after 10,240.
        assert any(line == "face_direction ppo full seed 0 0/10,240" for line in lines)
        assert any(line.startswith("0 of 4 runs ended, ") for line in lines)


def test_narrow_terminal_keeps_steps_and_returns_and_breaks_no_word(runs):
    with trained(runs) as view:
        view.show(Event("started", runs=runs[:2]))
        view.show(episode(runs[0], 1000, 12.4))
        view.show(episode(runs[0], 2000, 12.4))
        headers = {}
        for width in (60, 80, 120):
            console = Console(file=io.StringIO(), width=width)
            console.print(view)
            text = console.file.getvalue()
            assert "face_direction" in text
            assert "2,000/20,000" in text
            headers[width] = next(line for line in text.splitlines() if "running" in line).split()
    assert headers[60] == ["running", "steps", "training", "return"]
    assert headers[80] == ["running", "steps", "training", "return", "left"]
    assert headers[120] == [
        "running",
        "steps",
        "steps/s",
        "learning",
        "curve",
        "training",
        "return",
        "left",
    ]


def test_published_median_at_same_step_follows_last_returns(tmp_path):
    runs = runs_of_matrix(write_matrix(tmp_path, steps=2_000_000), tmp_path)
    with trained(runs) as view:
        view.show(Event("started", runs=runs))
        view.show(episode(runs[0], 1_500_000, 12.4))
        view.show(episode(runs[1], 500_000, 999.6))
        # The mean of both is a million steps.
        assert any("▁█ 12 1000 (published 953)" in line for line in shown(view))


def test_published_median_of_td3_at_million_steps(runs):
    # Figure 9 of the paper, digitized in published_curves.csv.
    assert published_median(runs[0], 1e6) == 953.47
    encoded = runs[0].model_copy(update={"representation": "planar12"})
    assert published_median(encoded, 1e6) is None


def test_sparkline_shows_means_of_returns_between_0_and_1000():
    assert sparkline([]) == ""
    assert sparkline([-50.0, 0.0, 500.0, 1000.0]) == "▁▁▅█"
    # 16 means of two returns each: 0, 0, 1000, 1000, ...
    assert sparkline([0.0, 0.0, 1000.0, 1000.0] * 8) == "▁█" * 8


def test_ended_process_is_removed_and_its_runs_counted(runs, capsys):
    with trained(runs) as view:
        view.show(Event("started", runs=runs[:2]))
        view.show(episode(runs[0], 10_000, 50.0))
        view.show(Event("finished", runs[0].id))
        view.show(Event("failed", runs[1].id, "no luck"))
        view.show(Event("ended", runs=runs[:2]))
        assert not any("td3" in line for line in shown(view))
        printed = capsys.readouterr()
        assert printed.out == ""
        assert (
            "td3 full seed 0,1: 10,000/20,000 control steps, training return 50; 2 of 4"
            in printed.err
        )


def test_speed_of_resumed_run_counts_from_its_checkpoint(runs):
    with trained(runs) as view:
        view.show(Event("started", runs=runs[:1]))
        view.show(Event("resumed", runs[0].id, steps=6000))
        # There is no speed before the first step.
        assert "face_direction td3 full seed 0 6,000/10,000" in shown(view)


def test_many_seeds_are_shown_by_mean_and_extremes(tmp_path):
    runs = runs_of_matrix(write_matrix(tmp_path, seeds="0-7"), tmp_path)
    with trained(runs) as view:
        view.show(Event("started", runs=runs))
        for run in runs:
            view.show(episode(run, 1000, 10.0 * run.seed))
        assert any("mean 35 [0, 70]" in line for line in shown(view))


def test_process_of_several_cells_shows_their_number(tmp_path):
    runs = runs_of_matrix(write_matrix(tmp_path, steps=2_000_000), tmp_path)
    other = [run.model_copy(update={"task": "move_to_pose"}) for run in runs]
    with trained([*runs, *other]) as view:
        view.show(Event("started", runs=[*runs, *other]))
        view.show(episode(runs[0], 2_000_000, 12.4))
        (line,) = (line for line in shown(view) if "td3" in line)
    assert line.startswith("td3 4 runs of 2 configurations 2,000,000/8,000,000 ")
    assert " 12" in line
    assert "published" not in line
