"""Tests of runs whose episodes end early: seeds, kills, environments that do not repeat."""

import itertools

import numpy as np
import pytest

from jbench.store import Results
from jbench.tasks.find import find_task
from jbench.training.batched_run import run_batch
from jbench.training.events import Note
from jbench.training.repeat import reevaluate, retrain
from tests.gym_tasks import EPISODE
from tests.training.small_runs import resumed, rows
from tests.training.test_gym_runs import run_of
from tests.training.test_resume import kill

LEAVES = "tests.gym_tasks:leaves"
DRIFTS = "tests.gym_tasks:drifts"
WAKES = "tests.gym_tasks:wakes"


def falling(algo, seed=0, task=LEAVES, **changes):
    return run_of(algo, seed, task=task, specs=find_task(task).specs, **changes)


@pytest.mark.parametrize(
    "algo", ["sac", *(pytest.param(each, marks=pytest.mark.slow) for each in ("ppo", "td3"))]
)
def test_seeds_that_end_at_different_steps_are_independent(algo, tmp_path):
    runs = [falling(algo, seed) for seed in (0, 1)]
    together, alone = Results(tmp_path / "together"), Results(tmp_path / "alone")
    assert run_batch(runs, together) == {}
    for run in runs:
        assert run_batch([run], alone) == {}
        record = together.find("run", run.id)
        assert rows(record) == rows(alone.find("run", run.id))
        assert reevaluate(together, record).verdict == "equal"
        assert retrain(together, record, 4).verdict == "equal"
    ends = [together.find("run", run.id).read("episodes")["control_steps"] for run in runs]
    assert ends[0] != ends[1]


def test_run_whose_episodes_do_not_repeat_is_not_called_altered(tmp_path, run_command):
    run = falling("ppo", task=DRIFTS)
    assert run_batch([run], Results(tmp_path)) == {}
    code, _, err = run_command("reproduce", run.id, results=tmp_path)
    reason = "its task makes other episodes of the same seed and actions"
    assert (code, err.splitlines()[-1]) == (1, f"Error: {run.id} was not reproduced: {reason}.")


def test_lengths_and_returns_are_those_of_the_environment(tmp_path):
    results = Results(tmp_path)
    run = falling("td3")
    assert run_batch([run], results) == {}
    record = results.find("run", run.id)
    found = record.read("episodes").to_pylist()
    lengths = [row["length"] for row in found]
    assert min(lengths) < EPISODE
    assert [row["control_steps"] for row in found] == list(itertools.accumulate(lengths))
    evaluated = record.read("evaluations").to_pylist()
    assert {row["control_steps"] for row in evaluated} == {2 * EPISODE, 4 * EPISODE}
    assert all(1 <= row["length"] <= EPISODE for row in evaluated)
    # A reward is -10 |position|, and the cart is on the rail until it leaves it.
    assert all(-10 * row["length"] - 20 < row["episode_return"] < 0 for row in evaluated)


@pytest.mark.slow
def test_runs_killed_in_the_middle_of_episodes_resume_bit_for_bit(tmp_path):
    runs = [falling("td3", seed) for seed in (0, 1)]
    answer = kill(tmp_path, runs, at="writes", every=25)
    reached = {steps for folder in answer["steps"] for both in folder for steps in both}
    ends = {run.seed: outcome_ends(tmp_path / "whole", run) for run in runs}
    # A commit at the end of one seed's episode is within an episode of the other seed.
    assert (reached & ends[0]) - ends[1] or (reached & ends[1]) - ends[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algo", "every", "kills"), [("td3", 1, 40), ("ddpg", 9, 5), ("sac", 9, 5), ("ppo", 9, 5)]
)
def test_robot_that_falls_resumes_bit_for_bit_after_kills_at_writes(algo, every, kills, tmp_path):
    """TD3 is killed at one write point after the other, in all commits, the others at some."""
    hopper = "gym:Hopper-v5,max_episode_steps=25"
    run = falling(algo, 1, task=hopper, steps=50, evaluate_every=25, evaluate_episodes=1)
    answer = kill(tmp_path, [run], at="writes", every=every)
    assert answer["kills"] > kills
    # Commits are at the ends of episodes, each of another length.
    (steps,) = answer["steps"]
    reached = {at for (at,) in steps}
    ends = outcome_ends(tmp_path / "whole", run)
    assert len(reached) > 1
    assert reached <= {0, *ends, run.steps}
    assert len(set(np.diff([0, *sorted(ends)]))) > 1


def outcome_ends(path, run):
    return set(Results(path).find("run", run.id).read("episodes")["control_steps"].to_pylist())


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["td3", "sac", "ppo"])
def test_runs_killed_at_random_times_resume_bit_for_bit(algo, tmp_path):
    runs = [falling(algo, seed, steps=30 * EPISODE) for seed in (0, 1, 2)]
    assert kill(tmp_path, runs, at="random", kills=15)["kills"] == 15


@pytest.mark.parametrize("algo", ["td3", "ppo"])
def test_episode_that_does_not_repeat_is_truncated_and_the_record_says_so(algo, tmp_path):
    run, results, events = falling(algo, task=DRIFTS), Results(tmp_path), []
    environments = run.environments
    assert run_batch([run], results, until=15 * environments) == {}
    record = results.find("run", run.id)
    before = record.read("episodes").num_rows
    assert run_batch([run], results, report=events.append) == {}
    record = results.find("run", run.id)
    assert record.manifest.provenance["episodes_repeat"] is False
    (note,) = record.manifest.provenance["continued"]
    assert note["truncated"]["control_steps"] == 15 * environments
    count = note["truncated"]["episodes"]
    assert 1 <= count <= environments
    assert len(resumed(events, [run])) == 1
    (sentence,) = (event.text for event in events if isinstance(event, Note))
    assert sentence.startswith(f"The run {run.id}: {count} episode")
    assert f"truncation at control step {15 * environments:,}" in sentence
    found = record.read("episodes").to_pylist()[before : before + count]
    assert [row["control_steps"] for row in found] == [15 * environments] * count
    assert sum(row["length"] for row in record.read("episodes").to_pylist()) <= run.steps
    assert np.isfinite([row["episode_return"] for row in found]).all()


@pytest.mark.parametrize("algo", ["td3", "ppo"])
def test_episode_without_a_step_is_begun_again_and_not_truncated(algo, tmp_path):
    """A run saved at the end of an episode has a next one, which may begin elsewhere."""
    run, results = falling(algo, task=WAKES), Results(tmp_path)
    assert run_batch([run], results, until=EPISODE * run.environments) == {}
    assert run_batch([run], results) == {}
    record = results.find("run", run.id)
    (note,) = record.manifest.provenance["continued"]
    assert "truncated" not in note
    found = record.read("episodes")["length"].to_pylist()
    assert found == [EPISODE] * (run.steps // EPISODE)
