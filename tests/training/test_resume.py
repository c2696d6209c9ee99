"""Tests that killed runs of the batched engine resume to the results of uninterrupted runs."""

import itertools
import json

import pytest

from jbench.policies.network import WEIGHTS
from jbench.settings.records import OFESettings
from jbench.store import Results
from jbench.training.repeat import reevaluate, retrain
from tests.command_line import Process
from tests.training.small_runs import rows, small_run

SMALL = {
    "ddpg": {"train_freq": 10, "gradient_steps": 2, "buffer_size": 125},
    "td3": {"learning_starts": 50, "train_freq": 30, "gradient_steps": 2},
    "sac": {"learning_starts": 50, "train_freq": 10, "gradient_steps": 2},
    "ppo": {"n_envs": 2, "n_steps": 24},
}


def settings(algo, seed, normalize="none", **changes):
    lengths = {"steps": 400, "evaluate_every": 150, "evaluate_episodes": 1}
    about = {"engine": "batched", "seed": seed, **lengths, **changes}
    return small_run(algo, {"batch_size": 16, "normalize": normalize, **SMALL[algo]}, **about)


def outcome(path, run):
    """Returns all rows of a finished run without times, its paths, and its weights."""
    record = Results(path).find("run", run.id)
    assert record.status == "finished"
    assert record.roles() == []
    paths = record.read("paths").to_pylist()
    return rows(record), paths, record.read_file(WEIGHTS)


def kill(path, runs, **request):
    """Trains runs in processes that are killed; returns the answer of `kills.py`."""
    asked = {"path": str(path), "runs": [run.model_dump(mode="json") for run in runs], **request}
    done = Process("tests.training.kills:main", asked).finished()
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["problems"] == []
    for folder, steps in enumerate(answer["steps"]):
        # Committed steps are never lost.
        assert all(
            before <= after
            for pair in itertools.pairwise(steps)
            for before, after in zip(*pair, strict=True)
        )
        for run in runs:
            assert outcome(path / str(folder), run) == outcome(path / "whole", run)
    return answer


FEATURES = {"ofe": OFESettings(units=6, layers=2), "representation": "ofe6"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algo", "encoder", "changes"),
    [
        *((algo, encoder, {}) for algo in SMALL for encoder in (None, 3)),
        ("td3", None, FEATURES),
    ],
)
def test_batch_killed_at_random_times_resumes_bit_for_bit(algo, encoder, changes, tmp_path):
    runs = [settings(algo, seed, **changes) for seed in (0, 3)]
    answer = kill(tmp_path, runs, encoder=encoder, at="random", kills=20)
    assert answer["kills"] == 20
    reached = {steps for folder in answer["steps"] for both in folder for steps in both}
    # Some kills must have been in the middle of the runs.
    assert reached & set(range(50, runs[0].steps, 50))


@pytest.mark.slow
@pytest.mark.parametrize("algo", SMALL)
def test_killed_run_with_standardized_inputs_is_reproduced(algo, tmp_path, short_episodes):
    run = settings(algo, 1, normalize="running")
    answer = kill(tmp_path, [run], at="random", kills=10)
    assert answer["kills"] == 10
    results = Results(tmp_path / "0")
    record = results.find("run", run.id)
    assert reevaluate(results, record).verdict == retrain(results, record, 8).verdict == "equal"


@pytest.mark.slow
def test_run_killed_while_it_continues_a_shorter_one_loses_nothing(tmp_path):
    run = settings("ddpg", 1, steps=150)
    answer = kill(tmp_path, [run], at="writes", shorter=100, every=5)
    # Some kills were before the copy of the shorter run was committed.
    (steps,) = answer["steps"]
    assert [0] in steps
    assert all(at in ([0], [100], [150]) for at in steps)


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["ddpg", "ppo"])
def test_run_killed_at_each_write_resumes_bit_for_bit(algo, tmp_path):
    run = settings(algo, 1, steps=200, evaluate_every=50)
    answer = kill(tmp_path, [run], at="writes")
    # A single checkpoint has dozens of write points.
    assert answer["kills"] > 40
