"""Tests of work on robots whose episodes can't go on: what ended is kept, other seeds go on."""

import itertools
import re
import sys

import numpy as np
import pytest

import jbench
from jbench.datasets import Dataset, collect, find_dataset
from jbench.errors import RequestError, WorkError
from jbench.policies.evaluate import evaluate
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.records import DatasetSettings, EvaluationSettings, dataset_robot
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.tasks.find import find_task
from jbench.tasks.task import episode_generator
from jbench.tasks.worlds import EpisodeError
from jbench.training.batched_run import run_batch
from jbench.training.group import TrainingGroup
from jbench.training.status import run_status, will_fail_again
from tests import odd_tasks
from tests.odd_tasks import EPISODE
from tests.training.small_runs import rows

FRAGILE = "tests.odd_tasks:Fragile"
SMALL = {"hidden_layers": [8], "batch_size": 8, "learning_starts": 10, "train_freq": 10}
SENTENCE = (
    rf"jbench can't use the task {FRAGILE}: at control step 7 of the episode with seed (\d+), it "
    r"fails \(OSError: a leg broke, line \d+ of odd_tasks\.py\)"
)


def is_broken(seed):
    """Returns whether the episode with this seed breaks."""
    state = np.random.RandomState(seed)
    state.uniform(-1, 1, (2, 2))
    return state.uniform() < 0.2


def check_failed(record):
    """Asserts that a run failed in a broken episode, and keeps those before it."""
    assert record.status == "failed"
    found = re.match(SENTENCE, record.error)
    assert is_broken(int(found[1]))
    made = record.rows("episodes") * EPISODE  # control steps
    ending = rf"; the run had made ({made + 7}|{4 * EPISODE}) control steps\."
    assert re.fullmatch(ending, record.error[found.end() :])


def run_of(seed, algo="td3", task=FRAGILE, **changes):
    chosen = algorithm_settings("td3", "suite", {**SMALL, "gradient_steps": 1})
    about = {
        "task": task,
        "specs": find_task(task).specs,
        "algo": algo,
        "seed": seed,
        "hyperparameters": chosen.model_dump(mode="json"),
        "steps": 4 * EPISODE,
        "evaluate_every": 4 * EPISODE,
        "evaluate_episodes": 1,
    }
    return RunSettings(**{**about, **changes})


def test_seed_whose_episode_breaks_fails_and_the_others_go_on(tmp_path):
    runs = [run_of(seed) for seed in range(3)]
    together = Results(tmp_path / "together")
    failures = run_batch(runs, together, final_episodes=1)
    assert 0 < len(failures) < len(runs)
    for run in runs:
        alone = Results(tmp_path / f"alone-{run.seed}")
        assert run_batch([run], alone, final_episodes=1).keys() == failures.keys() & {run.id}
        record = together.find("run", run.id)
        assert rows(record) == rows(alone.find("run", run.id))
        if run.id not in failures:
            assert record.rows("episodes") == 4
            continue
        check_failed(record)
        assert record.manifest.summary["episode_failed"]["step"] == 7


def test_finished_episodes_of_an_evaluation_are_kept(tmp_path):
    settings = EvaluationSettings(
        task=FRAGILE, specs=find_task(FRAGILE).specs, policy="constant:0.5", episodes=12
    )
    results = Results(tmp_path)
    with pytest.raises(EpisodeError, match=SENTENCE) as raised:
        evaluate(settings, results, threads=1)
    seeds = [int(episode_generator(0, episode).integers(2**32)) for episode in range(12)]
    whole = [episode for episode, seed in enumerate(seeds) if not is_broken(seed)]
    assert 0 < len(whole) < 12
    record = results.find("evaluation", settings.id)
    assert record.read("policy_episodes")["episode"].to_pylist() == whole
    assert record.status == "failed"
    assert str(raised.value) == (
        f"{record.error[:-1]}; {len(whole)} of 12 episodes are kept, and the same command makes "
        "all of them again."
    )


def test_episodes_of_a_dataset_before_the_broken_one_are_kept(tmp_path, monkeypatch):
    task = find_task(FRAGILE)
    settings = DatasetSettings(**dataset_robot(task.name, task.specs), steps=40 * EPISODE)
    results = Results(tmp_path)
    seeds = [int(episode_generator(0, episode).integers(2**32)) for episode in range(40)]
    before = len([*itertools.takewhile(lambda seed: not is_broken(seed), seeds)])
    assert 0 < before < 40
    for _ in range(2):  # the second time, it begins with the broken one
        with pytest.raises(EpisodeError, match=SENTENCE) as raised:
            collect(settings, results, threads=1)
        record = results.find("dataset", settings.id)
        (block,) = Dataset(record).blocks(FRAGILE, parts=[0])
        assert len(block.observations) == before
        assert record.status == "failed"
        assert str(raised.value) == (
            f"{record.error[:-1]}; {before * EPISODE} of 800 control steps are kept, and the "
            "jbench collect command that started it continues there."
        )

    # The leg is repaired.
    monkeypatch.setattr(odd_tasks.Fragile, "step", odd_tasks.Short.step)
    record = collect(settings, results, threads=1)
    assert (record.status, record.error) == ("finished", None)
    assert record.rows("seeds") == 40


def test_work_that_another_seed_may_finish_says_what_to_type(tmp_path):
    name = "tests.odd_tasks:Faulty"
    robot = dataset_robot(name, find_task(name).specs)
    settings = DatasetSettings(**robot, steps=40 * EPISODE, seed=4)
    results = Results(tmp_path)
    seeds = [int(episode_generator(4, episode).integers(2**32)) for episode in range(40)]
    before = len([*itertools.takewhile(lambda seed: not is_broken(seed), seeds)])
    with pytest.raises(EpisodeError) as raised:
        collect(settings, results, threads=1)
    kept = (
        f"{before * EPISODE} of 800 control steps are kept, and jbench collect --task {name} "
        f"--results {tmp_path} --steps 800 --seed 5 makes other episodes."
    )
    assert "(ArithmeticError: a leg broke, line " in str(raised.value)
    assert str(raised.value).endswith(f" of odd_tasks.py); {kept}")
    for id in (settings.id, None):
        with pytest.raises(RequestError) as refused:
            find_dataset(results, id, name)
        assert str(refused.value).startswith(f"The dataset {settings.id} has failed (jbench can't ")
        assert str(refused.value).endswith(f"odd_tasks.py)); {kept}")

    about = {"task": name, "specs": find_task(name).specs, "policy": "constant:0.5"}
    whole = sum(not is_broken(seed) for seed in seeds)
    with pytest.raises(EpisodeError, match=f"; {whole} of 40 episodes are kept, and --seed 5 mak"):
        evaluate(EvaluationSettings(**about, episodes=40, seed=4), results, threads=1)


def test_finished_episodes_of_stable_baselines3_are_kept(tmp_path):
    results = Results(tmp_path)
    failed = 0
    for run in (run_of(seed, engine="sb3") for seed in range(3)):
        failures = run_batch([run], results, final_episodes=1)
        record = results.find("run", run.id)
        if not failures:
            assert (record.status, record.rows("episodes")) == ("finished", 4)
            continue
        failed += 1
        assert record.status == "failed"
        found = re.match(SENTENCE, record.error)
        assert is_broken(int(found[1]))
        made = record.rows("episodes") * EPISODE
        # The step that broke was not counted.
        ending = rf"; the run had made ({made + 6}|{4 * EPISODE}) control steps\."
        assert re.fullmatch(ending, record.error[found.end() :])
    assert 0 < failed < 3


@pytest.mark.parametrize(
    ("name", "fails_again"), [("Faulty", True), ("Fragile", False), ("Hungry", False)]
)
def test_run_whose_robot_lacks_a_file_or_memory_need_not_fail_again(name, fails_again, tmp_path):
    task = f"tests.odd_tasks:{name}"
    results = Results(tmp_path)
    runs = [run_of(seed, task=task, specs=find_task(task).specs) for seed in range(2)]
    failures = run_batch(runs, results, final_episodes=1)
    assert failures
    for id in failures:
        record = results.find("run", id)
        assert will_fail_again(record) == fails_again


@pytest.mark.parametrize(
    ("made_on", "fails_again"),
    [
        ({"device": "cpu"}, True),
        ({"episodes_repeat": False}, False),
        ({"device": "cuda", "gpu": "NVIDIA H200"}, False),
        ({"device": "cuda", "continued": [{"changed": {"device": ["cuda", "cpu"]}}]}, True),
        ({"processor": "another", "packages": {"mujoco": "1.0"}, "continued": [{}]}, False),
    ],
)
def test_run_that_failed_with_other_numbers_than_here_need_not_fail_again(
    made_on, fails_again, tmp_path
):
    run = run_of(0)
    record = Results(tmp_path).create("run", run.id, run.values, made_on)
    diverged = {"update": None, "control_steps": 7, "what": "weights"}
    record.fail("The agent diverged.", {"diverged": diverged})
    assert will_fail_again(record, "cpu") == fails_again
    assert run_status(run, Results(tmp_path), "cpu").fails_again == fails_again


class Still(jbench.Agent):
    """It never moves the robot, and learns nothing."""

    def __init__(self, settings, environment, seed, device):
        self.weights = np.zeros((environment.action_size, environment.observation_size))

    def explore(self, observations):
        return self.act(observations)

    def act(self, observations):
        return observations @ self.weights.T

    def learn(self, transition):
        return {}


def test_finished_episodes_of_an_agent_of_another_package_are_kept(tmp_path):
    about = {"engine": "plugin", "algo": f"{__name__}:Still", "hyperparameters": {}}
    runs = [run_of(seed, **about) for seed in range(3)]
    results = Results(tmp_path)
    failures = {}
    for run in runs:
        failures |= run_batch([run], results, final_episodes=1)
    assert 0 < len(failures) < 3
    for run in runs:
        record = results.find("run", run.id)
        if run.id not in failures:
            assert (record.status, record.rows("episodes")) == ("finished", 4)
            continue
        check_failed(record)


class Quitting(Still):
    """It ends the process when it learns."""

    def learn(self, transition):
        sys.exit()


def test_run_whose_code_ends_the_process_fails_in_a_sentence(tmp_path, monkeypatch):
    run = run_of(0, engine="plugin", algo=f"{__name__}:Quitting", hyperparameters={})
    (error,) = run_batch([run], Results(tmp_path), final_episodes=1).values()
    assert str(error).startswith(f"learn of the agent {__name__}:Quitting failed (SystemExit, line")

    # A part of the training where no other sentence stands for it.
    monkeypatch.setattr(TrainingGroup, "train", lambda group, until: sys.exit(3))
    (error,) = run_batch([run_of(1)], Results(tmp_path), final_episodes=1).values()
    assert isinstance(error, WorkError)
    assert str(error).startswith("Code that jbench called ended the process (SystemExit: 3, line")


def test_agent_of_stable_baselines3_that_diverges_is_called_so(tmp_path):
    changes = {"engine": "sb3", "task": "tests.odd_tasks:NeedsFinite"}
    changes |= {"specs": find_task(changes["task"]).specs}
    run = run_of(0, **changes)
    hyperparameters = {**run.hyperparameters, "learning_rate": 1e20}
    run = run.model_copy(update={"hyperparameters": hyperparameters})
    (error,) = run_batch([run], Results(tmp_path)).values()
    assert isinstance(error, WorkError)
    assert str(error).startswith("The agent diverged: its ")
