"""Tests of work on Gymnasium environments, from random data to a report."""

import numpy as np
import pytest

from jbench.datasets import collect
from jbench.policies.evaluate import evaluate
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.base import task_and_representation
from jbench.settings.records import DatasetSettings, EvaluationSettings, dataset_robot
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.tasks.find import find_task
from jbench.training.batched_run import run_batch
from jbench.training.repeat import reevaluate, retrain
from tests.command_line import train
from tests.gym_tasks import EPISODE
from tests.training.small_runs import rows

CART = "tests.gym_tasks:cart"
OFF_POLICY = {"hidden_layers": [8], "batch_size": 8, "learning_starts": 20, "train_freq": 10}
SMALL = {
    "ddpg": {**OFF_POLICY, "gradient_steps": 2},
    "td3": {**OFF_POLICY, "gradient_steps": 2},
    "sac": {**OFF_POLICY, "gradient_steps": 2},
    "ppo": {"hidden_layers": [8], "batch_size": 20, "n_envs": 2, "n_steps": EPISODE},
}


def run_of(algo, seed=0, **changes):
    chosen = algorithm_settings(algo, "suite", SMALL[algo]).model_dump(mode="json")
    about = {
        "task": CART,
        "specs": find_task(CART).specs,
        "algo": algo,
        "seed": seed,
        "hyperparameters": chosen,
        "steps": 4 * EPISODE,
        "evaluate_every": 2 * EPISODE,
        "evaluate_episodes": 2,
    }
    return RunSettings(**{**about, **changes})


@pytest.mark.parametrize("algo", ["td3", pytest.param("sac", marks=pytest.mark.slow), "ppo"])
def test_seeds_learn_alike_alone_and_together_and_are_reproduced(algo, tmp_path):
    runs = [run_of(algo, seed) for seed in (0, 1)]
    together, alone = Results(tmp_path / "together"), Results(tmp_path / "alone")
    assert run_batch(runs, together) == run_batch(runs[1:], alone) == {}
    record = together.find("run", runs[1].id)
    assert rows(record) == rows(alone.find("run", runs[1].id))
    found = record.read("episodes").to_pylist()
    assert [row["length"] for row in found] == [EPISODE] * 4
    assert all(row["episode_return"] < 0 for row in found)
    assert reevaluate(together, record).verdict == retrain(together, record, 2).verdict == "equal"


def test_run_of_stable_baselines3_has_the_same_episodes(tmp_path):
    run, results = run_of("td3", engine="sb3"), Results(tmp_path)
    assert run_batch([run], results) == {}
    assert results.find("run", run.id).rows("episodes") == 4


def test_returns_of_a_policy_and_a_dataset_are_those_of_the_environment(tmp_path):
    results, task = Results(tmp_path), find_task(CART)
    settings = EvaluationSettings(task=CART, specs=task.specs, policy="constant:0.5", episodes=3)
    returns = evaluate(settings, results, threads=1).read("policy_episodes")["episode_return"]
    env = task.environment(0).env
    for episode, recorded in enumerate(returns.to_pylist()):
        random = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(episode,)))
        env.reset(seed=int(random.integers(2**32)))
        made = [env.step(np.array([[2.5]], np.float32))[1] for _ in range(EPISODE)]
        assert recorded == pytest.approx(sum(made), rel=1e-6)
    robot = dataset_robot(task.name, task.specs)
    record = collect(DatasetSettings(**robot, steps=3 * EPISODE), results, threads=1)
    assert record.rows("observations") == 3 * (EPISODE + 1)


@pytest.mark.parametrize(
    ("encoder", "task", "representation"),
    [
        ("face_direction/dae12/s00-1f9a2c4e", "face_direction", "dae12"),
        ("gym.lab/Cart-v0/pca2-whitened/s10-1f9a2c4e", "gym.lab/Cart-v0", "pca2-whitened"),
    ],
)
def test_id_of_an_encoder_begins_with_its_task(encoder, task, representation):
    assert task_and_representation(encoder) == (task, representation)


@pytest.mark.slow
def test_environment_of_a_namespace_is_trained_on_latents_and_reported(tmp_path, run_command):
    task = "gym:tests.gym_tasks:lab/Cart-v0"
    for typed in (
        ("collect", "--task", task, "--steps", 400),
        ("train-encoder", "--task", task, "--kind", "pca", "--latent", 2),
        (*train("td3", "pca2"), "--task", task, "--steps", 100),
        ("report", "--format", "svg"),
    ):
        code, _, err = run_command(*typed, results=tmp_path)
        assert code == 0, err
    runs, _ = Results(tmp_path).scan("run")
    assert [run.settings["representation"] for run in runs] == ["pca2", "pca2"]
    assert "pca2" in (tmp_path / "report" / "index.html").read_text()


def test_report_and_command_line_take_returns_of_any_size(tmp_path, run_command):
    results = Results(tmp_path)
    assert run_batch([run_of("td3", seed) for seed in range(2)], results) == {}
    code, out, err = run_command("report", "--format", "svg", results=tmp_path)
    assert code == 0, err
    page = (tmp_path / "report" / "index.html").read_text()
    assert CART in page
    assert "solved" not in page
    code, out, _ = run_command("runs", results=tmp_path)
    assert code == 0
    assert "finished" in out
