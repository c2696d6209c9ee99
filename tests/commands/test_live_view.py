"""What is shown of the runs of a sweep while they go on."""

import io

import pytest
from rich.console import Console

from jbench.commands.live_view import SweepView
from jbench.commands.output import Output
from tests.sweep_matrices import runs_of_matrix, write_matrix


@pytest.fixture
def runs(tmp_path):
    return runs_of_matrix(write_matrix(tmp_path, algos='"td3", "ppo"', steps=10_000), tmp_path)


def shown(view):
    """The table as a terminal shows it, its lines without the space between columns."""
    console = Console(file=io.StringIO(), width=200)
    console.print(view)
    return [" ".join(line.split()) for line in console.file.getvalue().splitlines()]


def episode(run, steps, episode_return):
    return {"run": run.id, "control_steps": steps, "episode_return": episode_return}


def test_a_line_for_each_process_with_its_steps_and_last_returns(runs):
    view = SweepView(runs, Output(), live=True)
    view.begins(runs[:2])
    view.begins(runs[2:3])
    view.says(runs[0], {"seconds_per_step": 0.01})
    assert any(line == "face_direction td3 full seed 0,1 0/20,000" for line in shown(view))
    for run, steps, episode_return in ((0, 1000, 12.4), (1, 1000, 7.0), (0, 2000, 99.6)):
        view.says(runs[run], episode(runs[run], steps, episode_return))
    lines = shown(view)
    (td3,) = (line for line in lines if "td3" in line)
    assert td3.startswith("face_direction td3 full seed 0,1 3,000/20,000 ")
    assert " 100 7 " in td3
    assert any(line == "face_direction ppo full seed 0 0/10,000" for line in lines)
    assert any(line.startswith("0 of 4 runs ended, ") for line in lines)


def test_a_process_that_ends_leaves_its_runs_counted(runs, capsys):
    view = SweepView(runs, Output(), live=False)
    view.begins(runs[:2])
    view.says(runs[0], episode(runs[0], 10_000, 50.0))
    view.says(runs[0], {"run": runs[0].id, "finished": True})
    view.says(runs[1], {"run": runs[1].id, "failed": "no luck"})
    view.ends(runs[:2])
    assert not any("td3" in line for line in shown(view))
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "td3 full seed 0,1: 10,000/20,000 control steps, last returns 50; 2 of 4" in printed.err


def test_a_run_of_another_process_has_not_ended(runs):
    view = SweepView(runs, Output(), live=True)
    view.begins(runs[:1])
    view.says(runs[0], {"run": runs[0].id, "failed": "Another process", "held": True})
    view.ends(runs[:1])
    assert any(line.startswith("0 of 4 runs ended") for line in shown(view))
    view.says(runs[0], {"run": runs[0].id, "finished": True})
    assert any(line.startswith("1 of 4 runs ended") for line in shown(view))


def test_where_a_run_goes_on_it_has_not_come_just_now(runs, capsys):
    view = SweepView(runs, Output(), live=True)
    view.begins(runs[:1])
    view.says(runs[0], {"run": runs[0].id, "goes_on_from": 6000, "because": "Torch is newer."})
    said = "was interrupted or failed; it resumes at control step 6,000. Torch is newer."
    assert f"{runs[0].id} {said}" in capsys.readouterr().out
    # Nothing is gained yet, and so there is no speed.
    assert any(line == "face_direction td3 full seed 0 6,000/10,000" for line in shown(view))


def test_of_many_seeds_the_mean_and_the_extremes_are_shown(tmp_path):
    runs = runs_of_matrix(write_matrix(tmp_path, seeds="0-7"), tmp_path)
    view = SweepView(runs, Output(), live=True)
    view.begins(runs)
    for run in runs:
        view.says(run, episode(run, 1000, 10.0 * run.seed))
    assert any("mean 35 [0, 70]" in line for line in shown(view))
