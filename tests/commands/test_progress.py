"""Tests of the live lines of training processes."""

import io
from contextlib import contextmanager

import pytest
from rich.console import Console

from jbench.commands.progress import sparkline
from jbench.commands.training_view import TrainingView, published_median
from jbench.training.events import (
    EpisodeEnded,
    Failed,
    Finished,
    ProcessEnded,
    ProcessStarted,
    Resumed,
    TrainingBegan,
)
from tests.sweep_matrices import runs_of_matrix, write_matrix


@pytest.fixture
def runs(tmp_path):
    return runs_of_matrix(write_matrix(tmp_path, algos='"td3", "ppo"', steps=10_000), tmp_path)


def shown(view, width=200):
    """The text of the lines, with single spaces between columns."""
    console = Console(file=io.StringIO(), width=width)
    console.print(view)
    return [" ".join(line.split()) for line in console.file.getvalue().splitlines()]


def episode(run, steps, episode_return):
    return EpisodeEnded(run.id, steps, episode_return)


@contextmanager
def trained(*processes):
    """A view during training; standard error is not a terminal."""
    with TrainingView() as view:
        view.show(TrainingBegan([run for runs in processes for run in runs]))
        for runs in processes:
            view.show(ProcessStarted(runs))
        yield view


def test_each_process_has_line_with_steps_and_last_returns(runs):
    with trained(runs[:2], runs[2:3]) as view:
        assert "face_direction td3 full seed 0,1 0 of 20,000 steps" in shown(view)
        for run, steps, episode_return in ((0, 1000, 12.4), (1, 1000, 7.0), (0, 2000, 99.6)):
            view.show(episode(runs[run], steps, episode_return))
        (td3,) = (line for line in shown(view) if "td3" in line)
        assert td3.startswith("face_direction td3 full seed 0,1 3,000 of 20,000 steps ")
        assert td3.endswith("▁▁▂ episode return 100 7")
        # The fifth rollout of 2,048 steps ends after 10,240.
        assert "face_direction ppo full seed 0 0 of 10,240 steps" in shown(view)
        assert any(line.startswith("0 of 3 runs ended 3,000 of ") for line in shown(view))
        assert any("2,000" in line or "3,000" in line for line in shown(view, width=60))


def test_published_median_at_same_step_follows_last_returns(tmp_path):
    runs = runs_of_matrix(write_matrix(tmp_path, steps=2_000_000), tmp_path)
    with trained(runs) as view:
        view.show(episode(runs[0], 1_500_000, 12.4))
        view.show(episode(runs[1], 500_000, 999.6))
        # The mean of both is a million steps: Figure 9, digitized in published_curves.csv.
        assert any("▁█ episode return 12 1,000 (published 953)" in line for line in shown(view))
    encoded = runs[0].model_copy(update={"representation": "planar12"})
    assert published_median(encoded, 1e6) is None


def test_sparkline_shows_means_of_returns_between_0_and_1000():
    assert sparkline([], 1000) == ""
    assert sparkline([-50.0, 0.0, 500.0, 1000.0], 1000) == "▁▁▅█"
    assert sparkline([-1500.0, -800.0, -100.0], -100, -1500) == "▁▅█"
    # 16 means of two returns each: 0, 0, 1000, 1000, ...
    assert sparkline([0.0, 0.0, 1000.0, 1000.0] * 8, 1000) == "▁█" * 8


def test_ended_process_is_removed_and_its_runs_counted(runs, capsys):
    with trained(runs[:2], runs[2:]) as view:
        view.show(episode(runs[0], 10_000, 50.0))
        view.show(Finished(runs[0].id))
        view.show(Failed(runs[1].id, "no luck"))
        view.show(ProcessEnded(runs[:2]))
        assert not any("td3" in line for line in shown(view))
        printed = capsys.readouterr()
        assert printed.out == ""
        assert "2 of 4 runs ended: " in printed.err
        assert "td3 full seed 0,1: 10,000 of 20,000 steps, ▁ episode return 50\n" in printed.err


def test_line_without_news_is_not_printed_twice(runs, capsys):
    with trained(runs[:1], runs[1:2]) as view:
        for run in runs[:2]:
            view.show(episode(run, 10_000, 5.0))
            view.show(Finished(run.id))
        for run in runs[:2]:
            view.show(ProcessEnded([run]))
    printed = capsys.readouterr().err.splitlines()
    assert len(printed) == 3  # all runs, and each of two processes
    assert len({*printed}) == 3


def test_resumed_run_begins_at_its_checkpoint_without_a_speed(runs):
    with trained(runs[:1]) as view:
        view.show(Resumed(runs[0].id, control_steps=6000))
        assert "face_direction td3 full seed 0 6,000 of 10,000 steps" in shown(view)


def test_time_left_is_measured_from_the_first_update_on(tmp_path):
    """By hand: 10,000 steps/s of random actions, then 10,000 steps in 10 s with updates."""
    (run,) = runs_of_matrix(write_matrix(tmp_path, seeds="0", steps=100_000), tmp_path)
    later = {**run.hyperparameters, "learning_starts": 11_000}
    run = run.model_copy(update={"hyperparameters": later})
    clock = [0]
    with TrainingView() as view:
        view.get_time = lambda: clock[-1]
        view.show(TrainingBegan([run]))
        view.show(ProcessStarted([run]))
        for seconds, steps in ((1, 10_000), (2, 20_000)):
            clock.append(seconds)
            view.show(episode(run, steps, 5.0))
            assert not any("left" in line or "/s" in line for line in shown(view))
        for seconds, steps in ((12, 30_000), (22, 40_000)):
            clock.append(seconds)
            view.show(episode(run, steps, 5.0))
        assert all("1,000/s" in line and "left" in line for line in shown(view))
        # It will not make the other 60,000 control steps.
        view.show(Failed(run.id, "no luck"))
        assert not any("left" in line or "/s" in line for line in shown(view))


def test_many_seeds_are_shown_by_mean_and_extremes_and_several_cells_by_their_number(tmp_path):
    *runs, eighth, ninth = runs_of_matrix(write_matrix(tmp_path, seeds="0-9"), tmp_path)
    other = [run.model_copy(update={"task": "move_to_pose"}) for run in (eighth, ninth)]
    with trained(runs, [eighth, ninth, *other]) as view:
        for run in runs:
            view.show(episode(run, 1000, 10.0 * run.seed))
        assert any("mean 35 [0, 70]" in line for line in shown(view))
        assert any(line.startswith("td3 4 runs of 2 configurations ") for line in shown(view))
