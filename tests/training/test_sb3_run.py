"""Tests of runs with stable-baselines3: recorded rows, reproducibility, policies and failures."""

import numpy as np
import pytest

from jbench.errors import RequestError, WorkError
from jbench.policies.saved import load_agent
from jbench.store import Results
from jbench.store.merge import TIMES
from jbench.training.environment import make_env
from jbench.training.events import Event
from jbench.training.sb3_run import run
from jbench.training.speed import seconds_per_step
from jbench.training.status import plan
from tests.training.small_runs import EPISODE, paths, shorten_episodes, small_run

TD3 = {"learning_starts": 75, "train_freq": 25, "gradient_steps": 5}


def settings(algo="td3", overrides=None, **changes):
    lengths = {"steps": 3 * EPISODE, "evaluate_every": 2 * EPISODE, "evaluate_episodes": 2}
    chosen = {"batch_size": 8, **(TD3 if algo == "td3" else {}), **(overrides or {})}
    return small_run(algo, chosen, **{"engine": "sb3", **lengths, **changes})


@pytest.fixture(scope="module", autouse=True)
def _short_episodes():
    with pytest.MonkeyPatch.context() as patch:
        shorten_episodes(patch.setattr)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    results = Results(tmp_path_factory.mktemp("results"))
    reported = []
    record = run(settings(), results, None, reported.append)
    return results, record, reported


def test_every_training_episode_is_row(finished):
    _, record, _ = finished
    rows = record.read("episodes").to_pylist()
    assert [row["episode"] for row in rows] == [0, 1, 2]
    assert [row["control_steps"] for row in rows] == [50, 100, 150]
    assert {row["length"] for row in rows} == {EPISODE}
    assert {row["run"] for row in rows} == {record.id}
    assert all(0 <= row["episode_return"] <= EPISODE for row in rows)
    assert np.all(np.diff([row["wall_time"] for row in rows]) > 0)
    assert np.all(np.diff([row["processor_time"] for row in rows]) > 0)
    assert record.manifest.summary["processor_time"] > rows[-1]["processor_time"]


def test_losses_are_null_before_learning_starts(finished):
    _, record, _ = finished
    rows = record.read("episodes").to_pylist()
    # Learning starts after 75 steps: at the end of the second episode, 100.
    assert [row["critic_loss"] is None for row in rows] == [True, True, False]
    assert {row["value_loss"] for row in rows} == {None}  # only PPO has it


def test_evaluations_are_made_at_interval_and_end(finished):
    _, record, _ = finished
    rows = record.read("evaluations").to_pylist()
    assert [(r["evaluation"], r["episode"], r["control_steps"]) for r in rows] == [
        (0, 0, 100),
        (0, 1, 100),
        (1, 0, 150),
        (1, 1, 150),
    ]
    assert {row["length"] for row in rows} == {EPISODE}


def test_progress_is_reported_after_each_episode(finished):
    _, record, reported = finished
    returns = record.read("episodes")["episode_return"].to_pylist()
    assert reported == [
        Event("episode", record.id, steps=steps, episode_return=episode_return)
        for steps, episode_return in zip([50, 100, 150], returns, strict=True)
    ]


def test_finished_run_is_not_repeated(finished):
    results, record, _ = finished
    before = (record.path / "manifest.json").read_bytes()
    run(settings(), results, None, lambda *_: pytest.fail("it trained again"))
    assert (record.path / "manifest.json").read_bytes() == before
    planned = plan([settings(), settings(seed=1)], results)
    assert (planned.ids("finished"), planned.ids("missing")) == (
        [settings().id],
        [settings(seed=1).id],
    )
    assert planned.to_do(retry_failed=True) == [settings(seed=1)]


@pytest.mark.slow
def test_same_settings_give_same_rows(finished, tmp_path):
    _, record, _ = finished
    # Measuring the speed before the run, as the command line does, does not change the run.
    assert seconds_per_step([settings()]) > 0
    again = run(settings(), Results(tmp_path), None)
    for table in ("episodes", "evaluations"):
        first, second = (r.read(table).drop(TIMES) for r in (record, again))
        assert first.equals(second)
    assert record.read_file("policy.safetensors") == again.read_file("policy.safetensors")


def test_saved_agent_reproduces_evaluation(finished):
    results, record, _ = finished
    agent = load_agent(results, record.id)
    assert agent.task == "face_direction"
    # The generator of the evaluation environment is seeded once per run.
    evaluation_seed = int(np.random.SeedSequence(0).generate_state(2)[1])
    env = make_env(settings(), None)
    env.reset(seed=evaluation_seed)
    returns, positions = [], []
    for _ in range(4):
        observation, _ = env.reset()
        total, ended = 0.0, False
        positions.append([env.unwrapped.data.qpos[:2].copy()])
        while not ended:
            observation, reward, _, ended, _ = env.step(agent.act(observation))
            total += reward
            positions[-1].append(env.unwrapped.data.qpos[:2].copy())
        returns.append(total)
    rows = record.read("evaluations").to_pylist()
    # The last two episodes are of the final policy, the first two of an earlier one.
    assert returns[2:] == pytest.approx([row["episode_return"] for row in rows[2:]])
    # Points at control steps 0, 20 and 40.
    assert paths(record) == {(0, 100): 3, (1, 150): 3}
    found = record.read("paths").slice(3).select(["x", "y"]).to_pandas()
    np.testing.assert_array_equal(found, np.array(positions[2][::20], np.float32))


def test_agent_of_unknown_run_is_refused(finished):
    results, _, _ = finished
    with pytest.raises(RequestError, match=r"No run .*/s09-0{8} in .*; jbench runs --results"):
        load_agent(results, "face_direction/td3/full/s09-00000000")


def test_ppo_counts_steps_of_all_environments(tmp_path):
    ppo = settings(
        "ppo",
        task="move_from_origin",
        steps=4 * EPISODE,
        evaluate_episodes=0,
        overrides={"n_envs": 4, "n_steps": 10, "batch_size": 20, "n_epochs": 1},
    )
    rows = run(ppo, Results(tmp_path), None).read("episodes").to_pylist()
    # Four environments end their first episodes together, at step 50 of each.
    assert [row["control_steps"] for row in rows] == 4 * [200]
    assert len({row["episode_return"] for row in rows}) == 4
    assert all(row["value_loss"] is not None for row in rows)


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
        patch.setattr("jbench.training.sb3_run.sb3.build", burn)
        with pytest.raises(FloatingPointError):
            run(wanted, results, None)
    failed = results.find("run", wanted.id)
    assert failed.status == "failed"
    assert failed.manifest.summary == {"error": "FloatingPointError: on fire"}
    assert plan([wanted], results).to_do(retry_failed=False) == []
    assert plan([wanted], results).to_do(retry_failed=True) == [wanted]
    assert run(wanted, results, None).status == "finished"


def test_run_locked_by_another_process_is_refused(tmp_path):
    results = Results(tmp_path)
    record = results.create("run", settings().id, settings().model_dump(mode="json"))
    with record.lock(), pytest.raises(WorkError, match="Another process"):
        run(settings(), results, None)
