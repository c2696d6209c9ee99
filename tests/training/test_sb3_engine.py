"""Tests of runs with stable-baselines3: recorded rows, reproducibility, policies and failures."""

import re
from collections import Counter

import numpy as np
import pytest

from jbench.agents import sb3
from jbench.errors import RequestError, WorkError
from jbench.policies.saved import load_agent
from jbench.settings.algorithms import Foreign
from jbench.store import Results
from jbench.tasks.jitterbug import geometry
from jbench.training.evaluation import make_env
from jbench.training.repeat import reevaluate, retrain
from jbench.training.sb3_engine import SB3Engine
from jbench.training.status import run_statuses
from tests.short_episodes import EPISODE
from tests.training.small_runs import paths, small_run, train

pytestmark = pytest.mark.usefixtures("short_episodes")

TD3 = {"learning_starts": 75, "train_freq": 25, "gradient_steps": 5}


def settings(algo="td3", overrides=None, **changes):
    lengths = {"steps": 3 * EPISODE, "evaluate_every": 2 * EPISODE, "evaluate_episodes": 2}
    chosen = {"batch_size": 8, **(TD3 if algo == "td3" else {}), **(overrides or {})}
    return small_run(algo, chosen, **{"engine": "sb3", **lengths, **changes})


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    results = Results(tmp_path_factory.mktemp("results"))
    return results, train(settings(task="move_to_pose"), results)


def pose(env):
    """Returns x, y and heading of the robot."""
    return [*env.unwrapped.data.qpos[:2], geometry.heading(env.unwrapped.world.robot_state)[0]]


def test_episodes_and_evaluations_are_rows(finished):
    _, record = finished
    episodes = record.read("episodes").to_pylist()
    assert [(row["episode"], row["control_steps"]) for row in episodes] == [
        (0, 50), (1, 100), (2, 150),
    ]  # fmt: skip
    # Learning starts after 75 steps: at the end of the second episode, 100.
    assert [row["critic_loss"] is None for row in episodes] == [True, True, False]
    evaluations = record.read("evaluations").to_pylist()
    assert [(r["evaluation"], r["episode"], r["control_steps"]) for r in evaluations] == [
        (0, 0, 100), (0, 1, 100), (1, 0, 150), (1, 1, 150), (1, 2, 150),
    ]  # fmt: skip
    for row in (*episodes, *evaluations):
        assert (row["length"], row["run"]) == (EPISODE, record.id)
        assert 0 <= row["episode_return"] <= EPISODE
    times = [row["processor_time"] for row in episodes]
    assert np.all(np.diff([*times, record.manifest.summary["processor_time"]]) > 0)


def test_saved_agent_reproduces_evaluation(finished):
    results, record = finished
    agent = load_agent(results, record.id)
    assert agent.task == "move_to_pose"
    # The generator of the evaluation environment is seeded once per run.
    evaluation_seed = int(np.random.SeedSequence(0).generate_state(2)[1])
    env = make_env(settings(task="move_to_pose"), None)
    env.reset(seed=evaluation_seed)
    returns, poses, targets = [], [], []
    for _ in range(2 + 3):
        observation, _ = env.reset()
        total, ended = 0.0, False
        poses.append([pose(env)])
        targets.append(env.unwrapped.world.target)
        while not ended:
            observation, reward, _, ended, _ = env.step(agent.act(observation))
            total += reward
            poses[-1].append(pose(env))
        returns.append(total)
    rows = record.read("evaluations").to_pylist()
    # The last three episodes are of the final policy, the first two of an earlier one.
    assert returns[2:] == [row["episode_return"] for row in rows[2:]]
    # Points at control steps 0, 20 and 40.
    assert paths(record) == {(0, 100): 3, (1, 150): 3}
    found = record.read("paths").slice(3).to_pandas()
    expected = np.array(poses[2][::20], np.float32)
    np.testing.assert_array_equal(found[["x", "y"]], expected[:, :2])
    turn = np.exp(1j * found["heading"]) / np.exp(1j * expected[:, 2])
    np.testing.assert_allclose(turn, 1, atol=1e-5)
    target = [*targets[2].position[0, :2], *targets[2].yaw]
    np.testing.assert_allclose(found[["target_x", "target_y", "target_yaw"]], [target] * 3)


@pytest.mark.parametrize("algo", ["td3", pytest.param("ppo", marks=pytest.mark.slow)])
def test_standardized_inputs_are_those_of_vec_normalize(algo, tmp_path):
    small = {"normalize": "running", "normalize_clip": 2.0}
    small |= {"n_envs": 2, "n_steps": 25} if algo == "ppo" else {}
    results = Results(tmp_path)
    record = train(settings(algo, small), results)
    shift, scale, clip = load_agent(results, record.id).policy.layers[:3]
    assert (shift.kind, scale.kind, clip.kind) == ("shift", "scale", "clip")
    assert (clip.low, clip.high) == (-2, 2)
    assert not np.allclose(shift.offset, 0)
    assert not np.allclose(scale.factor, 1)
    assert reevaluate(results, record).verdict == "equal"


SCHEDULES = {
    "ppo": {"n_envs": 1, "n_steps": 80, "n_epochs": 1},
    "td3": {**TD3, "train_freq": 80},
}


@pytest.mark.parametrize("algo", ["ppo", pytest.param("td3", marks=pytest.mark.slow)])
def test_evaluation_within_the_last_rollout_is_not_the_final_one(algo, tmp_path):
    """The rollouts end at the control steps 80 and 160: the latter is the run's last."""
    often = settings(algo, SCHEDULES[algo], steps=100, evaluate_every=50, evaluate_episodes=1)
    results = Results(tmp_path)
    record = train(often, results, final_episodes=3)
    evaluations = record.read("evaluations").to_pylist()
    assert Counter(row["control_steps"] for row in evaluations) == {50: 1, 100: 1, 150: 1, 160: 3}
    assert reevaluate(results, record).verdict == retrain(results, record, 2).verdict == "equal"


@pytest.mark.slow
def test_longer_evaluations_of_older_versions_are_repeated(tmp_path, monkeypatch):
    """They made each evaluation from `steps` on as long as the final one."""
    run = settings("ppo", SCHEDULES["ppo"], steps=100, evaluate_every=50, evaluate_episodes=1)
    results = Results(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(SB3Engine, "has_made", lambda engine, steps: engine.control_steps >= steps)
        record = train(run, results, final_episodes=3)
    evaluations = record.read("evaluations").to_pylist()
    assert Counter(row["control_steps"] for row in evaluations) == {50: 1, 100: 3, 150: 3, 160: 3}
    assert reevaluate(results, record).verdict == "equal"
    assert [retrain(results, record, count).verdict for count in (1, 2, 3)] == ["equal"] * 3


@pytest.mark.parametrize(
    ("name", "overrides", "steps"),
    [
        ("stable_baselines3:A2C", {"n_steps": 80}, 160),
        ("stable_baselines3:TD3", {"train_freq": 25}, 50),
        ("stable_baselines3:TD3", {"train_freq": [1, "episode"]}, 1),
    ],
)
def test_steps_between_learning_phases_are_those_of_two_environments(name, overrides, steps):
    count = 1 if isinstance(overrides.get("train_freq"), list) else 2
    env = sb3.DummyVecEnv([lambda: sb3.Spaces(16, 1)] * count)
    agent = sb3.build(name, Foreign(hyperparameters=overrides), env, 0)
    assert sb3.rollout(agent) == steps


def test_standardization_that_vec_normalize_does_not_have_is_refused():
    with pytest.raises(ValueError, match="stable-baselines3 has no normalize_min_sd: choose the"):
        settings(overrides={"normalize": "running", "normalize_min_sd": 0.1})


def test_replay_buffer_that_exceeds_the_memory_names_option():
    size = 10**13  # hundreds of terabytes
    with pytest.raises(WorkError, match=f"type less than --set buffer_size={size} "):
        SB3Engine(settings(overrides={"buffer_size": size}), None, 0)


@pytest.mark.parametrize("batch_size", [1, 2])
@pytest.mark.parametrize(("n_steps", "n_envs"), [(1, 1), (1, 2), (2, 1)])
@pytest.mark.parametrize("normalize_advantage", [True, False])
@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
def test_settings_that_stable_baselines3_refuses_are_refused_before_the_training(
    batch_size, n_steps, n_envs, normalize_advantage
):
    chosen = {"batch_size": batch_size, "n_steps": n_steps, "n_envs": n_envs}
    chosen["normalize_advantage"] = normalize_advantage
    algorithm = settings("ppo", chosen).algorithm
    env = sb3.DummyVecEnv([lambda: sb3.Spaces(16, 1)] * n_envs)
    try:
        sb3.build("ppo", algorithm, env, 0)
    except AssertionError:
        with pytest.raises(RequestError, match="advantages of at least two transitions"):
            algorithm.check_stable_baselines3()
    else:
        assert algorithm.check_stable_baselines3() is algorithm


@pytest.mark.parametrize(
    ("time_limit", "ends"), [("bootstrap", (False, True)), ("terminal", (True, False))]
)
def test_time_limit_ends_episode_as_configured(time_limit, ends):
    env = make_env(settings(time_limit=time_limit), None)
    env.reset(seed=0)
    for _ in range(EPISODE):
        *_, terminated, truncated, info = env.step(np.zeros(1, np.float32))
    assert (terminated, truncated) == ends
    assert info["episode"]["l"] == EPISODE


def test_failure_is_recorded_and_can_be_retried(tmp_path, monkeypatch):
    results = Results(tmp_path)
    wanted = settings(steps=EPISODE, evaluate_episodes=0)

    def burn(*_, **__):
        raise FloatingPointError("on fire")

    with monkeypatch.context() as patch:
        patch.setattr("jbench.training.sb3_engine.sb3.build", burn)
        with pytest.raises(FloatingPointError):
            train(wanted, results)
    failed = results.find("run", wanted.id)
    assert failed.status == "failed"
    (error,) = failed.manifest.summary.values()
    assert re.fullmatch(r"FloatingPointError: on fire, line \d+ of test_sb3_engine\.py", error)
    assert run_statuses([wanted], results)[wanted.id].state == "failed"
    assert train(wanted, results).status == "finished"
