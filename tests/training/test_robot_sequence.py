"""Tests of runs on one augmented robot and on a sequence of them."""

import numpy as np
import pytest

from jbench.agents.sb3_policies import copy_model
from jbench.report.frames import Frames
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.tasks.jitterbug.robots import load_model
from jbench.training import evaluation, group
from jbench.training.evaluation import make_env
from jbench.training.sb3_engine import RobotSequence
from tests.short_episodes import EPISODE
from tests.store.store_rows import episodes
from tests.training.small_runs import small_run, train

pytestmark = pytest.mark.usefixtures("short_episodes")

# Rollouts of 35 steps, each followed by an update, do not end together with a robot's share.
TD3 = {"batch_size": 8, "learning_starts": 25, "train_freq": 35, "gradient_steps": 5}


def settings(algo="td3", overrides=TD3, **changes):
    lengths = {"steps": 4 * EPISODE, "evaluate_every": 2 * EPISODE, "evaluate_episodes": 1}
    about = {"task": "move_in_direction", "engine": "sb3", **lengths, **changes}
    return small_run(algo, overrides, **about)


def shape(robot):
    """Positions of the geoms and masses of the bodies of a robot."""
    return np.concatenate([robot.geom_pos.ravel(), robot.body_mass])


class Watched:
    """Trains a run; keeps the robots' shapes, the policy and the replay size of each step."""

    def __init__(self, path, *arguments, **changes):
        self.shapes, self.weights, self.stored, self.evaluated = {}, {}, {}, {}
        after_step, evaluate = group.TrainingGroup._after_step, evaluation._evaluations

        def watched_step(trained, returns):
            agent = trained._engine._agent
            step = agent.num_timesteps
            if step % EPISODE:  # otherwise the next episode has already started
                self.shapes[step] = [shape(env.unwrapped.model) for env in agent.get_env().envs]
            layers = copy_model(agent).linear_layers()
            self.weights[step] = np.concatenate([one.weight.ravel() for one in layers])
            if hasattr(agent, "replay_buffer"):
                self.stored[step] = agent.replay_buffer.size()
            return after_step(trained, returns)

        def watched_evaluation(task, worlds, *arguments):
            self.evaluated[max(self.weights)] = shape(worlds._robots._model)
            return evaluate(task, worlds, *arguments)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(group.TrainingGroup, "_after_step", watched_step)
            patch.setattr(evaluation, "_evaluations", watched_evaluation)
            self.results = Results(path)
            self.record = train(settings(*arguments, **changes), self.results)


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    return Watched(tmp_path_factory.mktemp("watched"), robots=2, augment=5)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    return Watched(tmp_path_factory.mktemp("watched"), augment=5, steps=2 * EPISODE)


def test_robots_are_part_of_id():
    changes = ({"augment": 0}, {"augment": 1}, {"robots": 4}, {"robots": 2, "augment": 1})
    different = [settings(), settings(robots=2), *(settings(**change) for change in changes)]
    assert len({run.id for run in different}) == 6
    # The first of several robots has seed 0 by default.
    assert settings(robots=2).id == settings(robots=2, augment=0).id
    for run in different:
        assert RunSettings.model_validate_json(run.model_dump_json()) == run


def test_run_on_augmented_robot_trains_and_evaluates_on_it(alone):
    expected = shape(load_model(5))
    assert not np.array_equal(expected, shape(load_model()))
    assert all(np.array_equal(robot, expected) for (robot,) in alone.shapes.values())
    assert list(alone.evaluated) == [100, 105]
    assert all(np.array_equal(robot, expected) for robot in alone.evaluated.values())
    assert alone.record.settings["augment"] == 5
    assert "robots" not in alone.record.settings


def test_episodes_and_evaluations_are_numbered_across_robots(two):
    rows = two.record.read("episodes").to_pylist()
    assert [(row["episode"], row["control_steps"]) for row in rows] == [
        *((0, 50), (1, 100), (2, 150), (3, 200))
    ]
    rows = two.record.read("evaluations").to_pylist()
    # The run ends with the last rollout of 35 steps, at 210. Only the evaluation there has half as
    # many episodes as the training, which has 4.
    assert [row["control_steps"] for row in rows] == [100, 200, 210, 210]
    assert two.record.settings["robots"] == 2


def test_robot_is_switched_after_its_share_of_episodes(two):
    first, second = shape(load_model(5)), shape(load_model(6))
    assert not np.array_equal(first, second)
    assert len(two.shapes) == 210 - 4
    assert list(two.evaluated) == [100, 200, 210]
    seen = [*((step, robot) for step, (robot,) in two.shapes.items()), *two.evaluated.items()]
    for step, robot in seen:
        assert np.array_equal(robot, first if step <= 100 else second), step


def test_second_robot_starts_with_policy_of_first(two, alone):
    # Updates are after steps 35, 70 and 105.
    assert not np.array_equal(alone.weights[1], alone.weights[100])
    for step in (1, 50, 100):
        assert np.array_equal(two.weights[step], alone.weights[step]), step
    assert np.array_equal(two.weights[101], alone.weights[100])
    ours, theirs = (
        watched.record.read("episodes")["episode_return"].to_pylist() for watched in (two, alone)
    )
    assert ours[:2] == theirs


def test_second_robot_keeps_replay_buffer_of_first(two):
    # A transition is stored directly after the recorder's callback.
    assert [two.stored[step] for step in (100, 101, 210)] == [99, 100, 209]


def test_next_robot_continues_random_stream():
    sequence, plain = RobotSequence(settings(robots=4), None), make_env(settings(), None)
    seen = {sequence: [], plain: []}
    for env, beginnings in seen.items():
        env.reset(seed=4)
        for _ in range(3):
            beginnings.append((*env.unwrapped.data.qpos[3:7], *env.unwrapped.world.target.yaw))
            if env is sequence:
                for _ in range(EPISODE):
                    *_, info = env.step(np.zeros(1, np.float32))
                assert info["episode"]["l"] == EPISODE
            env.reset()
    # Pose and target are drawn in the same way for every robot.
    assert seen[sequence] == seen[plain]
    assert len(set(seen[plain])) == 3
    assert np.array_equal(shape(sequence.unwrapped.model), shape(load_model(3)))


def test_all_environments_of_ppo_switch_robots_together(tmp_path):
    ppo = {"hidden_layers": [8], "n_envs": 2, "n_steps": 15, "batch_size": 30, "n_epochs": 1}
    watched = Watched(tmp_path, "ppo", ppo, robots=2, evaluate_episodes=0)
    rows = watched.record.read("episodes").to_pylist()
    assert [row["control_steps"] for row in rows] == [100, 100, 200, 200]
    assert len({row["episode_return"] for row in rows}) == 4
    assert all(row["value_loss"] is not None for row in rows)
    robots = [shape(load_model(seed)) for seed in (0, 1)]
    assert max(watched.shapes) == 210
    for step, seen in watched.shapes.items():
        expected = robots[0 if step <= 100 else 1]
        assert all(np.array_equal(robot, expected) for robot in seen), step


def summary_rows(path, *changes):
    """The rows of a report for runs with these settings and constant returns of 500, by words."""
    results = Results(path)
    for changed in changes:
        wanted = settings("sac", {}, steps=10_000_000, **changed)
        record = results.create("run", wanted.id, wanted.model_dump(mode="json"))
        record.append({"episodes": episodes(wanted.id, [500.0] * 10_000)})
        record.finish({"wall_time": 1.0})
    return Frames(results).configurations.set_index("words").to_dict("index")


def test_published_sequence_is_compared_only_with_same_sequence(tmp_path):
    found = summary_rows(tmp_path, {"robots": 10}, {}, {"augment": 0})
    row = found.pop("augment=0, robots=10, stable-baselines3")
    # The published medians are 807.00 at 9,931,000 and 808.17 at 9,971,000; 9,950,500 is between.
    assert row["published"] == pytest.approx(807.57, abs=0.01)
    assert row["published_figure"] == "augmented SAC"
    # Figure 9 ends at 5e6 steps: there is no published value for the plain robot.
    assert {*found} == {"augment=0, stable-baselines3", "stable-baselines3"}
    assert np.isnan([other["published"] for other in found.values()]).all()
