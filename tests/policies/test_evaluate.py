"""Tests of policy evaluations, against episodes of the Gymnasium environment."""

import itertools
import math

import numpy as np
import pytest

from jbench.cli import main
from jbench.policies.evaluate import evaluate
from jbench.settings.records import EvaluationSettings
from jbench.store import Results
from jbench.store.query import run_sql
from jbench.store.tables import read_tables
from jbench.tasks.gym import RobotEnv
from jbench.tasks.jitterbug.heuristics import LAWS
from tests.short_episodes import short_episodes

EPISODE = 100  # control steps


@pytest.fixture(scope="module", autouse=True)
def _short_episodes():
    with short_episodes(EPISODE):
        yield


def returns_of(record):
    return record.read("policy_episodes")["episode_return"].to_pylist()


def test_returns_of_heuristic_equal_environment(tmp_path):
    task = "move_to_pose"
    settings = EvaluationSettings(task=task, policy="heuristic", episodes=2, seed=5)
    record = evaluate(settings, Results(tmp_path), threads=2)
    policy, env = LAWS[task](), RobotEnv(task)
    returns = []
    for episode in range(2):
        env.np_random = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(episode,)))
        observation, _ = env.reset()
        policy.reset(1)
        total = 0.0
        for _ in range(EPISODE):
            observation, reward, *_ = env.step(policy.act(observation[None])[0])
            total += reward
        returns.append(total)
    assert returns_of(record) == pytest.approx(returns, abs=1e-6)


def test_rewards_of_recorded_states_sum_to_returns(tmp_path):
    settings = EvaluationSettings(
        task="move_in_direction", policy="random", episodes=2, states=True, target_yaw=math.pi / 4
    )
    record = evaluate(settings, Results(tmp_path), threads=2)
    states = record.read("policy_states").to_pandas()
    sums = states.groupby("episode")["reward"].sum()
    assert sums.to_list() == pytest.approx(returns_of(record), rel=1e-5)
    found = sorted(zip(states["episode"], states["step"], strict=True))
    assert found == [*itertools.product(range(2), range(1, EPISODE + 1))]
    episodes = record.read("policy_episodes").to_pandas()
    assert set(episodes["target_yaw"]) == {math.pi / 4}
    assert states["action"].between(-1, 1).all()
    assert states["action"].std() == pytest.approx(1 / math.sqrt(3), rel=0.05)  # uniform


def test_evaluation_is_skipped_if_finished_and_thread_independent(tmp_path):
    settings = EvaluationSettings(task="face_direction", policy="constant:0.5", episodes=3)
    first = evaluate(settings, Results(tmp_path / "a"), threads=1)
    second = evaluate(settings, Results(tmp_path / "b"), threads=3)
    assert returns_of(first) == returns_of(second)
    assert len(set(returns_of(first))) == 3
    before = (first.path / "manifest.json").read_bytes()
    evaluate(settings, Results(tmp_path / "a"), threads=1)
    assert (first.path / "manifest.json").read_bytes() == before


def test_command_records_evaluation_in_database(tmp_path, capsys):
    more = ["--episodes", "3", "--results", str(tmp_path)]
    assert main(["evaluate", "random", *more]) == 0
    (row,) = run_sql(
        "SELECT policy, episodes, mean, median, "
        "(SELECT avg(episode_return) FROM policy_episodes) AS average, "
        "(SELECT quantile_cont(episode_return, 0.5) FROM policy_episodes) AS middle "
        "FROM policy_evaluations",
        read_tables(Results(tmp_path)).tables,
    ).to_dict("records")
    assert (row["policy"], row["episodes"]) == ("random", 3)
    assert (row["mean"], row["median"]) == pytest.approx((row["average"], row["middle"]))
    words = f"mean return {row['mean']:.0f}, median {row['median']:.0f}, "
    assert words in capsys.readouterr().out
    assert main(["evaluate", "random", *more]) == 0
    assert "already finished; nothing to do" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["fly"], "Unknown policy 'fly'; choose heuristic, random, constant:U"),
        (["hueristic"], "Unknown policy 'hueristic'; did you mean heuristic? Choose"),
        ([""], "Unknown policy ''; choose heuristic, random, constant:U"),
        (["constant"], "constant is a command in [-1, 1]; type constant:0.5"),
        (["constant:2"], "lies in [-1, 1]"),
        (["constant:+0.5"], "lies in [-1, 1]; type constant:0.5"),
        (["constant:0_1"], "lies in [-1, 1]; type constant:0.5"),
        (["constant:nan"], "lies in [-1, 1]"),
        (["face_direction/td3/full/s00-00000000"], "There is no run face_direction/td3"),
        (["../x"], "is not an id"),
        (["--task", "fly"], "Unknown task 'fly'"),
        (["--episodes", "0"], "episodes of the evaluation can't be 0"),
        (["--augment", "-1"], "'--augment': '-1': type a whole number, such as 0"),
        (["--episodes", str(10**15 + 1)], "it should be less than or equal to 1000000000000000"),
        (["--augment", str(2**63)], "it should be less than or equal to 9223372036854775807"),
        (["--target-yaw", "nan"], "type degrees"),
    ],
)
def test_invalid_request_is_refused(arguments, message, tmp_path, refused):
    assert message in refused("evaluate", *arguments, results=tmp_path)
