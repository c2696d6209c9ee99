"""Tests of runs of the batched engine: rows, paths, batches and settings."""

import shutil

import numpy as np
import pytest
import torch

from jbench.errors import RequestError
from jbench.policies.network import WEIGHTS
from jbench.policies.saved import load_agent
from jbench.settings.evaluations import evaluation_schedule
from jbench.store import Results
from jbench.store.locks import HeldError
from jbench.training import batched_run, evaluation
from jbench.training.batched_run import run_batch
from jbench.training.evaluation import derive_seeds, evaluate_policies
from jbench.training.events import EpisodeEnded
from jbench.training.repeat import reevaluate
from jbench.training.request import training_device
from jbench.training.status import run_statuses
from tests.short_episodes import EPISODE
from tests.training.small_runs import TanhEncoder, paths, rows, small_run

pytestmark = pytest.mark.usefixtures("short_episodes")

SMALL = {
    "ddpg": {"train_freq": 10, "gradient_steps": 5},
    "td3": {"learning_starts": 50, "train_freq": 10, "gradient_steps": 5},
    "ppo": {"n_envs": 2, "n_steps": 25},
}


def settings(algo="td3", seed=0, **changes):
    lengths = {"steps": 2 * EPISODE, "evaluate_every": EPISODE, "evaluate_episodes": 2}
    about = {"engine": "batched", "seed": seed, **lengths, **changes}
    return small_run(algo, {"batch_size": 16, **SMALL[algo]}, **about)


ENCODED = {"representation": "dae5", "encoder": "face_direction/dae5-00000000"}
OTHER = "face_direction/dae5-11111111"


class OtherEncoder(TanhEncoder):
    """A nonlinear encoder with as many latents."""

    def encode(self, observations):
        return -0.5 * super().encode(observations)


# `test_batched_engine.py` tests the engine itself with all algorithms.
@pytest.mark.parametrize(
    ("algo", "changes"), [("td3", ENCODED), pytest.param("ddpg", {}, marks=pytest.mark.slow)]
)
def test_run_in_batch_equals_run_alone(algo, changes, tmp_path, monkeypatch):
    if changes:
        encoders = {changes["encoder"]: TanhEncoder(), OTHER: OtherEncoder()}
        monkeypatch.setattr(batched_run, "load_run_encoder", lambda id, *_: encoders[id])
    together, alone = Results(tmp_path / "together"), Results(tmp_path / "alone")
    about = {0: changes, 3: {**changes, "encoder": OTHER} if changes else {}}
    runs = [settings(algo, seed, **about[seed]) for seed in about]
    assert run_batch(runs, together) == {}
    assert run_batch(runs[1:], alone) == {}
    found = [results.find("run", runs[1].id) for results in (together, alone)]
    assert found[0].status == "finished"
    assert rows(found[0]) == rows(found[1])
    assert found[0].read_file(WEIGHTS) == found[1].read_file(WEIGHTS)
    other = together.find("run", runs[0].id)
    returns = [[row["episode_return"] for row in rows(record)] for record in (other, found[0])]
    assert returns[0] != returns[1]


def test_rows_are_written_at_scheduled_steps(tmp_path):
    results, reported = Results(tmp_path), []
    run = settings(steps=150, evaluate_every=100)
    run_batch([run], results, report=reported.append)
    record = results.find("run", run.id)
    episodes = record.read("episodes").to_pylist()
    assert [(row["episode"], row["control_steps"]) for row in episodes] == [
        (0, 50),
        (1, 100),
        (2, 150),
    ]
    assert reported == [
        EpisodeEnded(run.id, row["control_steps"], row["episode_return"]) for row in episodes
    ]
    # Learning starts at the end of the first episode.
    assert [row["critic_loss"] is None for row in episodes] == [True, False, False]
    assert all(row["critic_loss"] > 0 for row in episodes[1:])
    evaluations = record.read("evaluations").to_pylist()
    assert [(row["evaluation"], row["control_steps"]) for row in evaluations] == [
        (0, 100),
        (0, 100),
        (1, 150),
        (1, 150),
        (1, 150),
    ]
    assert len({row["episode_return"] for row in evaluations}) == 5
    # Points at control steps 0, 20 and 40 of episodes of 50 steps.
    assert paths(record) == {(0, 100): 3, (1, 150): 3}
    assert load_agent(results, run.id).task == "face_direction"
    assert run_statuses([run], results)[run.id].state == "finished"
    # The finished run is not repeated.
    before = record.manifest
    run_batch([run], results)
    assert results.find("run", run.id).manifest == before


def test_runs_stop_at_given_step_or_stay_after_it(tmp_path):
    results = Results(tmp_path)
    about = {"steps": 4 * EPISODE, "evaluate_episodes": 0}
    ahead, behind = (settings("ddpg", seed, **about) for seed in range(2))

    def train_until(episodes, *runs):
        assert run_batch(runs, results, until=episodes * EPISODE) == {}
        return [results.find("run", run.id).rows("episodes") for run in runs]

    assert train_until(3, ahead) == [3]
    assert train_until(2, ahead) == [3]
    assert train_until(1, ahead, behind) == [3, 1]
    assert train_until(2, ahead, behind) == [3, 2]
    assert train_until(3, ahead, behind) == [3, 3]


def test_run_locked_by_another_process_is_skipped(tmp_path):
    results = Results(tmp_path)
    runs = [settings(seed=seed, steps=EPISODE, evaluate_episodes=0) for seed in range(2)]
    record = results.create("run", runs[0].id, runs[0].model_dump(mode="json"))
    with record.folder.lock():
        failures = run_batch(runs, results)
    assert list(failures) == [runs[0].id]
    assert "Another process is writing" in str(failures[runs[0].id])
    assert results.find("run", runs[1].id).status == "finished"


def test_error_of_a_group_fails_no_run_ahead_of_it(tmp_path):
    results, longer = Results(tmp_path), 3 * EPISODE
    runs = [settings(seed=seed, steps=longer, evaluate_episodes=0) for seed in range(3)]
    assert run_batch(runs[:1], results, until=2 * EPISODE) == {}

    def disturb(event):
        if isinstance(event, EpisodeEnded) and event.run == runs[1].id:
            raise ValueError("something else")

    with results.create("run", runs[2].id, runs[2].values).folder.lock():
        failures = run_batch(runs, results, report=disturb)
    assert {id: type(error) for id, error in failures.items()} == {
        runs[1].id: ValueError,
        runs[2].id: HeldError,
    }
    statuses = [results.find("run", run.id).status for run in runs]
    assert statuses == ["finished", "failed", "unfinished"]


def test_run_whose_record_is_removed_fails_alone(tmp_path):
    results = Results(tmp_path)
    runs = [settings(seed=seed, steps=3 * EPISODE, evaluate_episodes=0) for seed in range(3)]

    def remove(event):
        if event == EpisodeEnded(runs[1].id, 2 * EPISODE, event.episode_return):
            shutil.rmtree(results.folder("run", runs[1].id).path)

    failures = run_batch(runs, results, checkpoint_every=0, report=remove)
    assert list(failures) == [runs[1].id]
    assert "can't be written (No such file" in str(failures[runs[1].id])
    for run in (runs[0], runs[2]):
        record = results.find("run", run.id)
        assert (record.status, record.rows("episodes")) == ("finished", 3)


def test_missing_encoder_fails_only_its_runs(tmp_path):
    runs = [settings("ddpg", 0, steps=EPISODE), settings("ddpg", 3, steps=EPISODE, **ENCODED)]
    assert list(run_batch(runs, Results(tmp_path))) == [runs[1].id]
    assert Results(tmp_path).find("run", runs[0].id).status == "finished"


def test_parallel_environments_share_steps_and_updates(tmp_path):
    results = Results(tmp_path)
    changes = {"task": "move_from_origin", "parallel": 4, "evaluate_episodes": 0}
    run = settings("ddpg", steps=4 * EPISODE, **changes)
    run_batch([run], results)
    episodes = results.find("run", run.id).read("episodes").to_pylist()
    assert [row["control_steps"] for row in episodes] == [200] * 4
    assert len({row["episode_return"] for row in episodes}) == 4
    assert paths(results.find("run", run.id)) == {}


def test_paths_are_of_own_episodes_of_each_seed(tmp_path):
    results, runs = Results(tmp_path), [settings(seed=seed) for seed in (0, 3)]
    run_batch(runs, results)
    for run in runs:
        record, agent = results.find("run", run.id), load_agent(results, run.id)
        found = record.read("paths").to_pandas()
        assert paths(record) == {(0, 50): 3, (1, 100): 3}
        (made,) = evaluate_policies(run, [derive_seeds(run.seed).evaluations], 1, agent.act)
        last = found[found["evaluation"] == 1]
        # The engine rounds differently from the single policy.
        np.testing.assert_allclose(last[["x", "y", "heading"]], made.path.points, atol=1e-4)
        assert np.abs(last[["x", "y"]].to_numpy()).max() > 1e-4
        assert last["target_yaw"].tolist() == pytest.approx([made.path.target["yaw"]] * 3)
        assert last["target_x"].isna().all()


def test_evaluation_of_more_episodes_has_the_path_of_the_first_and_shows_how_many_ended():
    def act(observations):
        return np.full((*observations.shape[:-1], 1), 0.5)

    run = settings(evaluate_episodes=2)
    shown = []
    (few,) = evaluate_policies(run, [7], 0, act)
    (many,) = evaluate_policies(run, [7], 0, act, episodes=5, show_done=shown.append)
    assert shown == [2, 4, 5]
    assert many.returns[:2].tolist() == few.returns.tolist()
    assert many.returns.shape == (5,)
    np.testing.assert_array_equal(many.path.points, few.path.points)
    assert many.path.target == few.path.target


def test_incompatible_settings_and_devices_are_refused():
    with pytest.raises(ValueError, match="choose that engine, or leave it out"):
        settings(engine="sb3", parallel=2)
    with pytest.raises(ValueError, match="choose that engine, or type n_envs, a setting of ppo"):
        settings("ppo", engine="sb3", parallel=2)
    with pytest.raises(ValueError, match="setting of the batched engine"):
        settings(engine="sb3", precision="bfloat16")
    with pytest.raises(ValueError, match="ppo does not learn in bfloat16: precision must be float"):
        settings("ppo", precision="bfloat16")
    with pytest.raises(RequestError, match="the CPU: leave --device cuda out, or choose"):
        training_device("sb3", "cuda")
    assert training_device("sb3", "auto") == "cpu"
    if not torch.cuda.is_available():
        with pytest.raises(RequestError, match="There is no CUDA device here"):
            training_device("batched", "cuda")
        with pytest.raises(RequestError, match="Only a GPU has the precision tf32"):
            training_device("batched", "auto", "tf32")


@pytest.mark.slow
def test_last_evaluation_of_more_episodes_begins_with_those_of_fewer(tmp_path):
    run = settings("ppo", steps=3 * EPISODE)
    few, many = (Results(tmp_path / name) for name in ("few", "many"))
    run_batch([run], few, final_episodes=2)
    run_batch([run], many, final_episodes=5)
    records = [results.find("run", run.id) for results in (few, many)]
    made = [record.read("evaluations").to_pandas() for record in records]
    count = made[1].groupby("evaluation").size().tolist()
    assert count == [2] * (len(count) - 1) + [5]
    shared = made[1][made[1]["episode"] < 2].reset_index(drop=True)
    columns = ["evaluation", "episode", "control_steps", "episode_return"]
    assert shared[columns].equals(made[0][columns])
    assert made[1]["episode_return"].tail(3).nunique() > 1
    assert reevaluate(many, records[1]).verdict == "equal"
    assert records[0].read_file(WEIGHTS) == records[1].read_file(WEIGHTS)


@pytest.mark.parametrize(
    ("steps", "each", "requested", "expected"),
    [
        (5_000_000, 10, None, 100),
        (25 * EPISODE, 10, None, 25),
        (2 * EPISODE, 10, None, 10),
        (100_000, 10, 7, 7),
        (100_000, 0, None, 0),
    ],
)
def test_default_of_last_evaluation_is_at_most_its_training_episodes(
    steps, each, requested, expected
):
    run = settings(steps=steps, evaluate_episodes=each)
    assert evaluation.final_evaluation_episodes(run, requested) == expected


def test_evaluations_that_nobody_typed_take_no_longer_than_the_training():
    for trained in range(1, 400):
        every, each = evaluation_schedule(trained * EPISODE, EPISODE)
        run = settings(steps=trained * EPISODE, evaluate_every=every, evaluate_episodes=each)
        last = evaluation.final_evaluation_episodes(run, None)
        earlier = max(run.steps // every, 1) - 1
        assert last >= each >= 1
        assert earlier * each + last <= trained
    # Long runs and typed numbers stay as they were.
    assert evaluation_schedule(200_000, 1000) == (20_000, 10)
    assert evaluation_schedule(5_000_000, 1000) == (50_000, 10)
    assert evaluation_schedule(5000, 1000, episodes=10) == (1000, 10)
    assert evaluation_schedule(5000, 1000, every=1000) == (1000, 10)
    # A run of 5,000 control steps has one evaluation of one episode, and a last one of two.
    assert evaluation_schedule(5000, 1000) == (2000, 1)
