"""Tests of diverging runs: they fail, keep their rows, and do not affect other runs."""

import math
import re

import pytest
import safetensors.torch

import jbench.training.engines
from jbench.agents.divergence import DivergedError
from jbench.store import Results
from jbench.training.batched_run import run_batch
from tests.short_episodes import EPISODE
from tests.training.small_runs import resumed, rows
from tests.training.small_runs import train as train_one
from tests.training.test_checkpoints import only
from tests.training.test_resume import outcome, settings
from tests.training.test_sb3_engine import settings as sb3_settings

pytestmark = pytest.mark.usefixtures("short_episodes")

HUGE = {"learning_rate": 1e30}


def diverging(algo, **changes):
    """Settings of a long run that diverges at its first updates."""
    run = settings(algo, 0, steps=10**7, evaluate_every=100, **changes)
    later = {} if algo == "ppo" else {"learning_starts": 160}
    return run.model_copy(update={"hyperparameters": {**run.hyperparameters, **HUGE, **later}})


@pytest.fixture
def engines(monkeypatch):
    """The engines in the order of their creation."""
    made, make = [], jbench.training.engines.make_batched_engine

    def remembered(*arguments, **options):
        made.append(make(*arguments, **options))
        return made[-1]

    monkeypatch.setattr(jbench.training.engines, "make_batched_engine", remembered)
    return made


def train(path, runs, **more):
    """Trains runs; returns their failures and those that were resumed, see `resumed`."""
    events = []
    options = {"checkpoint_every": 0, "report": events.append, **more}
    failures = run_batch(runs, Results(path), **options)
    return failures, resumed(events, runs)


@pytest.mark.parametrize("algo", ["td3", "ppo"])
def test_diverged_run_fails_with_its_rows_and_ends_batch(algo, tmp_path):
    run = diverging(algo)
    failures, _ = train(tmp_path, [run])
    record = only(tmp_path, run)
    assert record.status == "failed"
    error = failures[run.id]
    assert isinstance(error, DivergedError)
    diverged = record.manifest.summary["diverged"]
    assert diverged == error.summary["diverged"]
    assert record.manifest.summary["error"] == str(error)
    assert str(error).startswith("The agent diverged: its ")
    assert f"after update {diverged['update']:,}, at control step" in str(error)
    reached = record.read("episodes")["control_steps"].to_pylist()
    assert max(reached, default=0) <= diverged["control_steps"]
    assert algo == "ppo" or reached[:3] == [50, 100, 150]
    for role in record.roles():
        if role.startswith("checkpoint-"):
            tensors = safetensors.torch.load(record.read_file(role))
            assert all(bool(tensor.isfinite().all()) for tensor in tensors.values())


def test_retried_run_resumes_at_last_finite_checkpoint_and_diverges(tmp_path):
    run = diverging("td3")
    train(tmp_path, [run])
    record = only(tmp_path, run)
    failures, restarted = train(tmp_path, [run])
    assert restarted == [(run.seed, 150, "")]
    again = only(tmp_path, run)
    assert list(failures) == [run.id]
    assert again.manifest.summary == record.manifest.summary
    assert rows(again) == rows(record)


def test_other_runs_of_batch_are_unaffected(tmp_path, engines):
    runs = [settings("td3", seed, steps=250) for seed in (0, 3)]
    assert train(tmp_path / "alone", runs[1:], final_episodes=1) == ({}, [])

    def poison(event):
        if (event.run, event.control_steps) == (runs[0].id, 200):
            engines[-1].tensors.saved["critic1"][0, 0] = math.nan

    failures, _ = train(tmp_path / "both", runs, report=poison, final_episodes=1)
    assert list(failures) == [runs[0].id]
    assert outcome(tmp_path / "both", runs[1]) == outcome(tmp_path / "alone", runs[1])
    failed = only(tmp_path / "both", runs[0])
    # Weights are checked before the checkpoint at 200 control steps, together with the last row.
    assert failed.manifest.summary["diverged"]["what"] == "weights"
    assert failed.manifest.summary["diverged"]["control_steps"] == 200
    episodes = failed.read("episodes")
    assert episodes["control_steps"].to_pylist() == [50, 100, 150, 200]
    positions = [int(role.split("-")[1]) for role in failed.roles() if "checkpoint" in role]
    assert positions == [100, 150]


def test_final_weights_are_checked_before_policy_is_saved(tmp_path, engines):
    run = settings("ddpg", 0, steps=100, evaluate_every=1000)

    def poison(event):
        if event.control_steps == 100:
            engines[-1].tensors.saved["critic_target"][0, 0] = math.inf

    failures, _ = train(tmp_path, [run], report=poison)
    assert list(failures) == [run.id]
    record = only(tmp_path, run)
    assert record.rows("evaluations") == 0
    assert not [entry for entry in record.manifest.files if entry.name.startswith("policy")]


@pytest.mark.parametrize("algo", ["td3", "ppo"])
def test_diverging_stable_baselines3_agent_fails(algo, tmp_path):
    first = {
        "td3": {"learning_starts": EPISODE},
        "ppo": {"n_envs": 2, "n_steps": 55, "batch_size": 10, "n_epochs": 2},
    }
    run = sb3_settings(algo, {**first[algo], **HUGE}, steps=450, evaluate_episodes=0)
    results = Results(tmp_path)
    with pytest.raises(DivergedError, match="after update"):
        train_one(run, results)
    record = results.find("run", run.id)
    assert record.status == "failed"
    diverged = record.manifest.summary["diverged"]
    assert {*diverged} == {"update", "control_steps", "what"}
    assert EPISODE < diverged["control_steps"] < 450
    episodes = record.read("episodes")
    assert episodes.num_rows > 0
    assert episodes["control_steps"][-1].as_py() <= diverged["control_steps"]


def test_later_error_does_not_hide_divergence(tmp_path, engines):
    runs = [settings("ddpg", seed, steps=200, evaluate_episodes=0) for seed in (0, 3)]

    def disturb(event):
        if (event.run, event.control_steps) == (runs[0].id, 50):
            engines[-1].tensors.saved["critic"][0, 0] = math.nan
        if event.control_steps == 150:
            raise ValueError("something else")

    failures, _ = train(tmp_path, runs, report=disturb)
    assert [type(failures[run.id]) for run in runs] == [DivergedError, ValueError]
    summaries = [only(tmp_path, run).manifest.summary for run in runs]
    assert "diverged" in summaries[0]
    (error,) = summaries[1].values()
    assert re.fullmatch(r"ValueError: something else, line \d+ of test_divergence\.py", error)
