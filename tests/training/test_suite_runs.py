"""Tests of runs on robots of dm_control's suite, with one and several motors."""

import numpy as np
import pytest

from jbench.errors import RequestError
from jbench.policies.saved import load_agent
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.tasks.find import find_task
from jbench.training.batched_run import run_batch
from jbench.training.continuation import check_state_can_be_kept
from jbench.training.log import POLICY_EVALUATION
from jbench.training.repeat import reevaluate, retrain
from tests.short_episodes import EPISODE
from tests.training.small_runs import rows, train
from tests.training.test_resume import kill

SMALL = {"hidden_layers": [8], "batch_size": 16, "learning_starts": 50, "train_freq": 30}


def settings(algo, task, seed=0, **changes):
    overrides = {**SMALL, "gradient_steps": 2}
    algorithm = algorithm_settings(algo, "suite", overrides).model_dump(mode="json")
    about = {
        **{"task": task, "specs": find_task(task).specs, "algo": algo, "seed": seed},
        **{"hyperparameters": algorithm, "engine": "batched", "steps": 8 * EPISODE},
        **{"evaluate_every": 3 * EPISODE, "evaluate_episodes": 1},
    }
    return RunSettings(**{**about, **changes})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algo", "task"),
    [
        ("td3", "tests.short_tasks:cheetah_run"),
        ("sac", "tests.short_tasks:cartpole_swingup"),
    ],
)
def test_batch_killed_at_random_times_resumes_bit_for_bit(algo, task, tmp_path):
    runs = [settings(algo, task, seed) for seed in (0, 3)]
    answer = kill(tmp_path, runs, at="random", kills=4)
    assert answer["kills"] == 4
    # Not all of them were before the first checkpoint.
    assert {steps for folder in answer["steps"] for both in folder for steps in both} != {0}


def test_run_is_reproduced_and_its_policy_moves_all_motors(tmp_path):
    run = settings("sac", "tests.short_tasks:cheetah_run", steps=4 * EPISODE)
    results = Results(tmp_path)
    assert run_batch([run], results, final_episodes=1) == {}
    record = results.find("run", run.id)
    assert reevaluate(results, record).verdict == retrain(results, record, 2).verdict == "equal"
    observations = np.random.default_rng(0).normal(size=(5, 17)).astype(np.float32)
    actions = load_agent(results, run.id).act(observations)
    assert actions.shape == (5, 6)
    assert np.ptp(actions, axis=1).min() > 0
    assert all(0 <= row["episode_return"] <= EPISODE for row in rows(record))


def test_run_of_stable_baselines3_moves_all_motors(tmp_path):
    run = settings("td3", "tests.short_tasks:cheetah_run", engine="sb3", steps=4 * EPISODE)
    results = Results(tmp_path)
    record = train(run, results, final_episodes=1)
    assert record.rows("episodes") == 4
    assert record.rows("paths") == 0
    assert record.manifest.summary[POLICY_EVALUATION] == 1
    changed = run.specs.model_copy(update={"model": "0" * 64})
    with pytest.raises(RequestError, match="has changed since it was recorded"):
        train(run.model_copy(update={"specs": changed}), results)
    assert load_agent(results, run.id).policy.sizes[1] == 6
    assert reevaluate(results, record).verdict == retrain(results, record, 1).verdict == "equal"


@pytest.mark.parametrize(
    ("algo", "steps", "parallel", "hyperparameters", "enough"),
    [
        ("td3", 1990, None, {"train_freq": 5}, 2000),
        ("td3", 4000, 3, {"train_freq": 3, "gradient_steps": 3}, 6000),
        # A rollout ends at every 48th control step, and 2000 is none of them; 6000 is.
        ("ppo", 3000, None, {"n_envs": 2, "n_steps": 24}, 6000),
    ],
)
def test_state_within_an_episode_is_refused_before_the_training(
    algo, steps, parallel, hyperparameters, enough
):
    chosen = algorithm_settings(algo, "suite", hyperparameters).model_dump(mode="json")
    changes = {"algo": algo, "steps": steps, "parallel": parallel, "hyperparameters": chosen}
    run = settings("td3", "dmc:cartpole-swingup").model_copy(update=changes)
    with pytest.raises(RequestError, match=rf"two episodes only.*; type --steps {enough}, or leav"):
        check_state_can_be_kept([run])
    check_state_can_be_kept([run.model_copy(update={"steps": enough})])
    plain = {"task": "face_direction", "specs": None}
    check_state_can_be_kept([run.model_copy(update=plain)])
