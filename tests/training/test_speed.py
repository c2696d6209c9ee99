"""Tests of the measured speed of runs, against numbers worked out by hand."""

import numpy as np
import pytest

from jbench.agents.batched.features import Features
from jbench.settings.records import OFESettings
from jbench.store import Results
from jbench.training import speed
from jbench.training.batched_run import run_batch
from jbench.training.engines import make_engine
from jbench.training.speed import evaluation_steps, learning_share, seconds_per_step, stepping
from tests.short_episodes import EPISODE
from tests.training.small_runs import rows, small_run

pytestmark = pytest.mark.usefixtures("short_episodes")


def settings(**changes):
    overrides = {"batch_size": 16, "learning_starts": 50, "train_freq": 10, "gradient_steps": 5}
    lengths = {"steps": 2 * EPISODE, "evaluate_every": EPISODE, "evaluate_episodes": 2}
    return small_run("td3", overrides, **{"engine": "batched", **lengths, **changes})


def test_speed_is_measured_with_any_number_of_environments(brief_measurements):
    about = {"engine": "batched", "parallel": 7, "steps": 7000, "evaluate_every": 10**4}
    assert seconds_per_step([small_run("ddpg", {}, evaluate_episodes=0, **about)]) > 0


@pytest.mark.parametrize(
    ("algo", "steps", "share"),
    [
        # TD3 as published learns after 11,000 control steps, then every 1000; the last 10,000 of
        # 20,000 are followed by updates.
        ("td3", 20_000, 0.5),
        ("td3", 11_000, 1 / 11),
        ("td3", 10_000, 0.0),
        ("ppo", 20_480, 1.0),
    ],
)
def test_estimated_speed_counts_steps_without_updates(algo, steps, share):
    about = {"engine": "batched", "evaluate_every": 10**6, "evaluate_episodes": 0}
    run = small_run(algo, {}, steps=steps, **about)
    assert learning_share(run) == pytest.approx(share)


@pytest.mark.parametrize(
    ("algo", "overrides", "parallel", "updates"),
    [
        ("ddpg", {}, None, 0.5),  # 50 every 100 control steps
        pytest.param("ddpg", {}, 7, 0.5, marks=pytest.mark.slow),
        # 1000 every 1000
        pytest.param("td3", {"learning_starts": 0}, None, 1.0, marks=pytest.mark.slow),
        pytest.param(
            "ddpg",
            {"train_freq": 3, "gradient_steps": 2},
            None,
            2 / 3,
            marks=pytest.mark.slow,
        ),
        ("ppo", {"n_envs": 2, "n_steps": 25, "batch_size": 10}, None, 4 / 50),  # 4 epochs
    ],
)
def test_speed_is_measured_with_the_updates_of_a_run(
    algo, overrides, parallel, updates, monkeypatch
):
    about = {"steps": 10**7, "evaluate_every": 10**7, "evaluate_episodes": 0}
    run = small_run(algo, overrides, engine="batched", parallel=parallel, **about)
    made = []

    def make_and_keep(*arguments):
        made.append(make_engine(*arguments))
        return made[-1]

    monkeypatch.setattr(speed, "make_engine", make_and_keep)
    monkeypatch.setattr(speed, "_STEPS", 10)  # of the robots without an agent
    # A clock that counts updates.
    counted = seconds_per_step([run], clock=lambda: made[0].updates if made else 0)
    assert counted == pytest.approx(updates, rel=1e-3)


@pytest.mark.parametrize(
    ("pretraining", "updates"),
    [
        (0, 0.5),  # of the agent: 50 every 100 control steps
        (2, 0.5 + 2 * 100 / 1000),  # before its first one, 2 for each of 100 control steps
        pytest.param(0.5, 0.5 + 0.5 * 100 / 1000, marks=pytest.mark.slow),
    ],
)
def test_speed_is_measured_with_the_pretraining_of_features(pretraining, updates, monkeypatch):
    made = []

    def learn_and_count(*arguments):
        made.append(1)
        return learn(*arguments)

    learn = Features.learn
    monkeypatch.setattr(Features, "learn", learn_and_count)
    monkeypatch.setattr(speed, "_STEPS", 10)
    ofe = {"ofe": OFESettings(units=6, layers=2, pretraining=pretraining), "representation": "ofe6"}
    about = {"steps": 1000, "evaluate_every": 1000, "evaluate_episodes": 0, **ofe}
    overrides = {"learning_starts": 99, "train_freq": 100, "gradient_steps": 50}
    run = small_run("td3", overrides, engine="batched", **about)
    # A clock that counts updates of features, of which each update of the agent makes one.
    assert seconds_per_step([run], clock=lambda: len(made)) == pytest.approx(updates, rel=1e-3)


@pytest.mark.parametrize(("seeds", "robots"), [(3, 6), (4, 4), (7, 7)])
def test_robots_that_are_measured_on_a_gpu_are_divided_among_the_seeds(seeds, robots, monkeypatch):
    monkeypatch.setattr(speed, "cores", lambda: 4)
    monkeypatch.setattr(speed, "_STEPS", 10)
    seen = []

    def act(observations):
        seen.append(len(observations))
        return np.zeros((len(observations), 1), np.float32)

    stepping(settings(), seeds, act, device="cuda")  # where the robots are on the processor
    assert set(seen) == {robots}


def test_evaluations_are_counted_in_control_steps_of_training():
    run = settings(steps=10 * EPISODE, evaluate_every=5 * EPISODE, evaluate_episodes=2)
    # Two episodes in the middle; at the end as many as the training has, or as were typed.
    assert evaluation_steps(run) == pytest.approx((2 + 10) / 10)
    assert evaluation_steps(run, 3) == pytest.approx((2 + 3) / 10)


def test_measuring_speed_does_not_change_results(tmp_path, brief_measurements):
    run = settings(evaluate_episodes=0)
    once, again = Results(tmp_path / "once"), Results(tmp_path / "again")
    run_batch([run], once)
    assert seconds_per_step([run]) > 0
    run_batch([run], again)
    assert rows(once.find("run", run.id)) == rows(again.find("run", run.id))
