"""Tests of runs on one augmented robot and on a sequence of them."""

import numpy as np
import pyarrow as pa
import pytest

from jbench.agents import sb3
from jbench.report.frames import Frames
from jbench.settings.run import RunSettings
from jbench.store import Results, schema
from jbench.tasks.robots import load_model
from jbench.training import evaluation, group
from jbench.training.environment import RobotSequence, make_env
from tests.command_line import succeed
from tests.training.small_runs import EPISODE, shorten_episodes, small_run, train

SHORT = pytest.mark.usefixtures("short_episodes")

# Rollouts of 35 steps, each followed by an update, do not end together with a robot's share.
TD3 = {
    "batch_size": 8,
    "learning_starts": 25,
    "train_freq": 35,
    "gradient_steps": 5,
}


def settings(algo="td3", overrides=TD3, **changes):
    lengths = {"steps": 4 * EPISODE, "evaluate_every": 2 * EPISODE, "evaluate_episodes": 1}
    about = {"task": "move_in_direction", "engine": "sb3", **lengths, **changes}
    return small_run(algo, overrides, **about)


def shape(env_or_model):
    """Positions of the geoms and masses of the bodies of a robot."""
    env = getattr(env_or_model, "unwrapped", None)
    robot = env_or_model if env is None else env.model
    return np.concatenate([robot.geom_pos.ravel(), robot.body_mass])


def flat_weights(policy):
    return np.concatenate([layer.arrays["weight"].ravel() for layer in policy.linear_layers()])


class Watched:
    """Trains a run; keeps the robots' shapes, the policy and the replay size of each step."""

    def __init__(self, path, *arguments, **changes):
        self.shapes, self.weights, self.stored, self.evaluated = {}, {}, {}, {}
        after_step, evaluate = group.TrainingGroup._after_step, evaluation._evaluations

        def watched_step(trained, returns):
            agent = trained._engine._agent
            step = agent.num_timesteps
            if step % EPISODE:  # otherwise the next episode has already started
                self.shapes[step] = [shape(env) for env in agent.get_env().envs]
            self.weights[step] = flat_weights(sb3.copy_model(agent))
            if hasattr(agent, "replay_buffer"):
                self.stored[step] = agent.replay_buffer.size()
            return after_step(trained, returns)

        def watched_evaluation(worlds, *arguments):
            self.evaluated[max(self.weights)] = shape(worlds._robots._model)
            return evaluate(worlds, *arguments)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(group.TrainingGroup, "_after_step", watched_step)
            patch.setattr(evaluation, "_evaluations", watched_evaluation)
            shorten_episodes(patch.setattr)
            self.results = Results(path)
            self.record = train(settings(*arguments, **changes), self.results)


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    return watched(tmp_path_factory, robots=2, augment=5)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    return watched(tmp_path_factory, augment=5, steps=2 * EPISODE)


def watched(tmp_path_factory, **changes):
    return Watched(tmp_path_factory.mktemp("watched"), **changes)


@SHORT
def test_robots_are_part_of_id():
    different = [
        settings(),
        settings(augment=0),
        settings(augment=1),
        settings(robots=2),
        settings(robots=4),
        settings(robots=2, augment=1),
    ]
    assert len({run.id for run in different}) == 6
    # The first of several robots has seed 0 by default.
    assert settings(robots=2).id == settings(robots=2, augment=0).id
    for run in different:
        assert RunSettings.model_validate_json(run.model_dump_json()) == run


@SHORT
@pytest.mark.parametrize(
    ("steps", "robot"), [(0, 0), (1, 0), (100, 0), (101, 1), (200, 1), (205, 1)]
)
def test_robot_at_step(steps, robot):
    assert settings(robots=2).robot_at(steps) == robot


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
    assert [(r["episode"], r["control_steps"], r["length"]) for r in rows] == [
        (0, 50, 50),
        (1, 100, 50),
        (2, 150, 50),
        (3, 200, 50),
    ]
    rows = two.record.read("evaluations").to_pylist()
    # The run ends with the last rollout of 35 steps, at 210.
    assert [row["control_steps"] for row in rows] == [100, 200, 210]
    assert two.record.settings["robots"] == 2


def test_robot_is_switched_after_its_share_of_episodes(two):
    first, second = shape(load_model(5)), shape(load_model(6))
    assert not np.array_equal(first, second)
    assert len(two.shapes) == 210 - 4
    for step, (seen,) in two.shapes.items():
        assert np.array_equal(seen, first if step <= 100 else second), step


def test_evaluations_use_current_robot(two):
    robots = [shape(load_model(seed)) for seed in (5, 6)]
    chosen = {
        steps: [np.array_equal(seen, robot) for robot in robots].index(True)
        for steps, seen in two.evaluated.items()
    }
    assert chosen == {100: 0, 200: 1, 210: 1}


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


@SHORT
def test_next_robot_continues_random_stream():
    sequence, plain = RobotSequence(settings(robots=4), None), make_env(settings(), None)
    seen = {sequence: [], plain: []}
    for env, beginnings in seen.items():
        env.reset(seed=4)
        for _ in range(3):
            beginnings.append((*env.unwrapped.data.qpos[3:7], env.unwrapped._target.yaw))
            if env is sequence:
                for _ in range(EPISODE):
                    *_, info = env.step(np.zeros(1, np.float32))
                assert info["episode"]["l"] == EPISODE
            env.reset()
    # Pose and target are drawn in the same way for every robot.
    assert seen[sequence] == seen[plain]
    assert len(set(seen[plain])) == 3
    assert np.array_equal(shape(sequence), shape(load_model(3)))


def test_all_environments_of_ppo_switch_robots_together(tmp_path):
    ppo = {"hidden_layers": [8], "n_envs": 2, "n_steps": 15, "batch_size": 30, "n_epochs": 1}
    watched = Watched(tmp_path, "ppo", ppo, robots=2, evaluate_episodes=0)
    rows = watched.record.read("episodes").to_pylist()
    assert [row["control_steps"] for row in rows] == [100, 100, 200, 200]
    robots = [shape(load_model(seed)) for seed in (0, 1)]
    assert max(watched.shapes) == 210
    for step, seen in watched.shapes.items():
        expected = robots[0 if step <= 100 else 1]
        assert all(np.array_equal(robot, expected) for robot in seen), step


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ["--robots", "2", "--steps", "10000", "--algo", "ppo"],
            "2 robots can't share 10000 steps equally, in episodes of 1000 control steps in each "
            "of 8 environments: steps must be 16000, or another multiple of 16000.",
        ),
        (["--robots", "0"], "robots of the run can't be 0: "),
        (["--augment", "-1"], "augment of the run can't be -1: "),
    ],
)
def test_invalid_robot_options_are_refused(arguments, says, tmp_path, refused):
    assert refused("train", *arguments, results=tmp_path).startswith(f"Error: {says}")


@pytest.mark.slow
def test_train_command_trains_on_the_robots_of_its_options(tmp_path):
    for robots in (("--augment", "7"), ("--robots", "2")):
        steps = ("--algo", "td3", "--seeds", "0", "--steps", "200")
        succeed("train", *steps, *robots, results=tmp_path, short=True)
    trained = [run.settings for run in Results(tmp_path).scan("run")[0]]
    robots = {(run["augment"], run.get("robots", 1)) for run in trained}
    assert robots == {(7, 1), (0, 2)}


def summary_row(path, **changes):
    """The row of a report for a run with these settings and constant returns of 500."""
    results = Results(path)
    wanted = settings("sac", {}, steps=10_000_000, **changes)
    steps = range(1000, 10_000_001, 1000)
    rows = [
        {"run": wanted.id, "episode": i, "control_steps": n, "episode_return": 500.0}
        for i, n in enumerate(steps)
    ]
    record = results.create("run", wanted.id, wanted.model_dump(mode="json"))
    record.append({"episodes": pa.Table.from_pylist(rows, schema.EPISODES)})
    record.finish({"wall_time": 1.0})
    (row,) = Frames(results).configurations.to_dict("records")
    return row


def test_published_sequence_is_compared_only_with_same_sequence(tmp_path):
    row = summary_row(tmp_path / "ten", robots=10)
    # The published medians are 807.00 at 9,931,000 and 808.17 at 9,971,000; 9,950,500 is between.
    assert row["published"] == pytest.approx(807.57, abs=0.01)
    assert row["published_figure"] == "augmented SAC"
    # Figure 9 ends at 5e6 steps: there is no published value for the plain robot.
    assert np.isnan(summary_row(tmp_path / "plain")["published"])
    assert np.isnan(summary_row(tmp_path / "one", augment=0)["published"])
