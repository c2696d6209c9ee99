"""Tests of `jbench.record`, which records training loops of other libraries as runs."""

import hashlib
import json
import re
import shutil
import signal
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import nn

import jbench
from jbench.errors import RequestError
from jbench.policies.copied_modules import copy_module
from jbench.policies.saved import load_agent
from jbench.settings.recorded import read_run
from jbench.settings.records import ExternalSettings
from jbench.store import Results
from jbench.store.rows import has_policy
from jbench.store.weights import encoder_weights
from jbench.training.repeat import reevaluate
from tests.command_line import SHORT, Process
from tests.documentation import ROOT, code_of
from tests.short_episodes import EPISODE, short_episodes
from tests.training.small_runs import paths

SEED = 7  # with this seed, `loop` gets rewards in the first episode
STEPS = 2 * EPISODE
RUN = {"algo": "mine", "seed": SEED, "steps": STEPS}
RUN["evaluate_every"] = EPISODE
RUN["evaluate_episodes"] = 2

IN_A_FILE = (
    "type MODULE:NAME of a function that returns the environment, in a file of its own, such as "
    "'arm:make'."
)


@pytest.fixture(scope="module", autouse=True)
def _short_episodes():
    with short_episodes():
        yield


def recorded(results, task="face_direction", **changes):
    hyperparameters = {"rate": np.float32(0.5), "layers": (8, None), "file": Path("x/y")}
    hyperparameters["seed"] = SEED
    hyperparameters["total_timesteps"] = STEPS
    arguments = {**RUN, "hyperparameters": hyperparameters, "results": results, **changes}
    return jbench.record(task, **arguments)


class Actor(nn.Module):
    """An actor in the style of CleanRL, with functional activations and a buffer for the scale."""

    def __init__(self, inputs=16):
        super().__init__()
        self.fc1, self.norm, self.fc_mu = nn.Linear(inputs, 8), nn.LayerNorm(8), nn.Linear(8, 1)
        self.log_std = nn.Linear(8, 1)  # not used by forward's result
        self.register_buffer("action_scale", torch.tensor([0.5]))

    def forward(self, x):
        x = nn.functional.relu(self.norm(self.fc1(x)))
        self.log_std(x)
        return torch.tanh(self.fc_mu(x)) * self.action_scale


def loop(recording, actor, episodes=2):
    """Acts by a sine for some episodes; returns the episode returns."""
    env, returns = recording.env(), []
    for _ in range(episodes):
        env.reset()
        total, ended, step = 0.0, False, 0
        while not ended:
            action = np.array([np.sin(step / 5)], np.float32)
            _, reward, terminated, ended, _ = env.step(action)
            assert not terminated
            total, step = total + reward, step + 1
            recording.losses(critic_loss=torch.tensor(float(step)), actor_loss=-1.0)
            if step % 20 == 0:
                recording.log(gradient_norm=torch.tensor(step / 2), success=step == 40)
            recording.evaluate(actor)
        returns.append(total)
    return returns


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished run, its actor and the returns of its loop."""
    results = tmp_path_factory.mktemp("recorded") / "results"
    torch.manual_seed(0)
    actor = Actor()
    with recorded(results, log="tensorboard") as recording:
        returns = loop(recording, actor)
        recording.keep_policy(actor)
    assert recording.finished
    return results, recording.id, actor, returns


@pytest.fixture
def copy(finished, tmp_path):
    """A copy of the results of the finished run."""
    shutil.copytree(finished[0], tmp_path / "results")
    return tmp_path / "results"


def record_of(results, id):
    return Results(results).find("run", id)


def test_rows_equal_returns_of_environment(finished):
    results, id, _, returns = finished
    rows = record_of(results, id).read("episodes").to_pylist()
    assert [row["episode_return"] for row in rows] == pytest.approx(returns, rel=1e-6)
    assert returns[0] > 1
    assert [(row["control_steps"], row["length"]) for row in rows] == [(50, 50), (100, 50)]
    # The losses of the last step but one: those of the last step follow the end of the episode.
    assert [(row["critic_loss"], row["actor_loss"]) for row in rows] == [(49, -1), (49, -1)]
    assert rows[0]["policy_loss"] is None


def test_logged_metrics_are_rows_of_their_own_table(finished, copy, run_command):
    found = jbench.open(copy).query("SELECT control_steps, name, value FROM metrics")
    # Two episodes of 50 control steps, each logged after 20 and 40.
    norms = [(20, 10), (40, 20), (70, 10), (90, 20)]
    wanted = {"gradient_norm": norms, "success": [(20, 0), (40, 1), (70, 0), (90, 1)]}
    for name, rows in found.groupby("name"):
        assert list(zip(rows["control_steps"], rows["value"], strict=True)) == wanted.pop(name)
    assert not wanted
    _, out, _ = run_command("tail", "--once", results=copy)
    assert f"{finished[1]}: 90 control steps, gradient_norm 20, success 1" in out
    # The tracker has the same.
    events = EventAccumulator(str(copy / "tensorboard" / finished[1]))
    events.Reload()
    logged = [(event.step, event.value) for event in events.Scalars("metrics/gradient_norm")]
    assert logged == norms


def test_block_that_ends_early_fails_and_seed_determines_its_first_episode(finished, tmp_path):
    results, id, actor, returns = finished
    with (
        pytest.raises(jbench.WorkError, match="50 of 100 control steps"),
        recorded(tmp_path / "again") as recording,
    ):
        assert loop(recording, actor, episodes=1) == returns[:1]
    assert recording.id == id
    assert record_of(tmp_path / "again", id).status == "failed"
    first, second = (
        record_of(where, id).read("evaluations")["episode_return"].to_pylist()
        for where in (results, tmp_path / "again")
    )
    assert first[:2] == second


def test_evaluations_are_made_at_interval_and_of_the_saved_policy_at_the_end(finished):
    record = record_of(*finished[:2])
    rows = record.read("evaluations").to_pylist()
    assert [(row["evaluation"], row["control_steps"], row["episode"]) for row in rows] == [
        (0, 50, 0),
        (0, 50, 1),
        (1, 100, 0),
        (1, 100, 1),
        (2, 100, 0),
        (2, 100, 1),
    ]
    assert paths(record) == {(0, 50): 3, (2, 100): 3}


def test_id_and_settings_equal_arguments(finished):
    results, id, _, _ = finished
    record = record_of(results, id)
    wanted = {
        "task": "face_direction",
        "algo": "mine",
        "representation": "full",
        "encoder": None,
        "seed": SEED,
        "steps": STEPS,
        "engine": "external",
        "time_limit": "bootstrap",
        "evaluate_every": EPISODE,
        "evaluate_episodes": 2,
        # Seed and steps are not hyperparameters.
        "hyperparameters": {"rate": 0.5, "layers": [8, None], "file": "x/y"},
    }
    assert record.settings == wanted
    text = json.dumps(wanted, sort_keys=True, separators=(",", ":"))
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    assert id == f"face_direction/mine/full/s07-{digest}"
    assert isinstance(read_run(record.settings), ExternalSettings)
    assert record.manifest.summary["steps_done"] == STEPS
    assert {"jbench", "processor", "command", "script_sha256"} <= set(record.manifest.provenance)


def test_saved_policy_equals_actor(finished):
    results, id, actor, _ = finished
    observations = np.random.default_rng(0).normal(size=(50, 16)).astype(np.float32)
    with torch.no_grad():
        wanted = actor(torch.from_numpy(observations)).numpy()
    kept = load_agent(Results(results), id)
    np.testing.assert_allclose(kept.act(observations), wanted, atol=1e-6)


def test_finished_run_is_skipped_and_script_continues(finished, copy, capfd):
    _, id, _, _ = finished
    manifest = (copy / "runs" / id / "manifest.json").read_bytes()
    after = []
    with recorded(copy) as recording:
        assert recording.finished
        after.append("before the first use")
        gymnasium.vector.SyncVectorEnv([recording.env])
        after.append("never")
    after.append("after the block")
    assert after == ["before the first use", "after the block"]
    assert capfd.readouterr().err == f"The run {id} is already finished; it is skipped.\n"
    assert (copy / "runs" / id / "manifest.json").read_bytes() == manifest
    with pytest.raises(KeyError), recorded(copy):
        raise KeyError("other")


def test_block_that_raises_fails_run_which_can_restart(tmp_path, capfd):
    with pytest.raises(ZeroDivisionError), recorded(tmp_path, evaluate_episodes=0) as recording:
        loop(recording, None, episodes=1)
        1 / 0  # noqa: B018
    record = record_of(tmp_path, recording.id)
    assert (record.status, record.rows("episodes")) == ("failed", 1)
    (error,) = record.manifest.summary.values()
    assert re.fullmatch(r"ZeroDivisionError: .* by zero, line \d+ of test_recorder\.py", error)
    with recorded(tmp_path, evaluate_episodes=0) as recording:
        loop(recording, None)
    record = record_of(tmp_path, recording.id)
    assert (record.status, record.rows("episodes")) == ("finished", 2)
    assert (
        f"Recording the run {record.id} in {tmp_path}, which is failed and starts over."
        in capfd.readouterr().err
    )
    assert record.id in repr(recording)
    with pytest.raises(RequestError, match=r"Its loop must call recording\.keep_policy"):
        load_agent(tmp_path, record.id)


def test_nonfinite_action_is_divergence(tmp_path):
    with pytest.raises(jbench.WorkError, match="actions are not finite"), recorded(tmp_path) as it:
        env = it.env()
        env.reset()
        env.step(np.zeros(1))
        env.step(np.array([np.nan]))
    diverged = record_of(tmp_path, it.id).manifest.summary["diverged"]
    assert diverged == {"update": None, "control_steps": 1, "what": "actions"}


@pytest.mark.slow
def test_killed_run_is_unfinished_and_restarts(tmp_path):
    def program(what):
        target = "tests.recording.programs:record_two_episodes"
        return Process(target, str(tmp_path), what, short=True).finished()

    assert program("kill").returncode == -signal.SIGKILL
    (record,) = Results(tmp_path).scan("run")[0]
    assert (record.status, record.rows("episodes")) == ("unfinished", 1)
    again = program("end")
    assert again.returncode == 0, again.stderr
    assert again.stderr == (
        f"Recording the run {record.id} in {tmp_path}, which is unfinished and starts over.\n"
        f"Recorded the run {record.id} in {tmp_path}.\n"
    )
    (record,) = Results(tmp_path).scan("run")[0]
    rows = record.read("episodes").to_pylist()
    assert (record.status, [row["episode"] for row in rows]) == ("finished", [0, 1])


def test_callback_records_model_of_stable_baselines3(tmp_path):
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    with recorded(tmp_path, algo="sb3-ppo", evaluate_episodes=1, evaluate_every=100) as recording:
        env = VecNormalize(DummyVecEnv([recording.env] * 2))
        policy = {"net_arch": [8], "activation_fn": nn.Tanh}
        ppo = PPO("MlpPolicy", env, n_steps=25, n_epochs=1, policy_kwargs=policy, seed=0)
        ppo.learn(STEPS, recording.sb3_callback())
    record = record_of(tmp_path, recording.id)
    rows = record.read("episodes").to_pylist()
    # Two environments alternate: the first episode ends one control step before the second.
    assert [row["control_steps"] for row in rows] == [99, 100]
    assert all(0 < row["episode_return"] < EPISODE for row in rows)  # not the normalized rewards
    # The second rollout ends after the first update.
    assert all(np.isfinite(row["value_loss"]) for row in rows)
    evaluations = record.read("evaluations").to_pylist()
    assert [row["control_steps"] for row in evaluations] == [100, 100]
    observations = np.random.default_rng(0).normal(size=(20, 16)).astype(np.float32)
    wanted, _ = ppo.predict(env.normalize_obs(observations), deterministic=True)
    acted = load_agent(Results(tmp_path), recording.id).act(observations)
    np.testing.assert_allclose(acted, wanted, atol=1e-5)


def test_loop_on_another_robot_is_recorded(tmp_path):
    task, returns = "tests.short_tasks:cheetah_run", []
    torch.manual_seed(0)
    actor = nn.Sequential(nn.Linear(17, 8), nn.Tanh(), nn.Linear(8, 6), nn.Tanh())
    with jbench.record(task, results=tmp_path, **RUN) as recording:
        env = recording.env()
        for _ in range(2):
            observation, _ = env.reset()
            returns.append(0.0)
            for _ in range(EPISODE):
                action = actor(torch.from_numpy(observation)).detach().numpy()
                observation, reward, *_ = env.step(action)
                returns[-1] += reward
                recording.evaluate(actor)
        recording.keep_policy(actor)
    assert recording.id.startswith("tests.short_tasks.cheetah_run/mine/full/s07-")
    record = record_of(tmp_path, recording.id)
    assert record.settings["specs"]["sizes"] == [8, 9]
    rows = record.read("episodes")["episode_return"].to_pylist()
    assert rows == pytest.approx(returns, rel=1e-6)
    assert min(returns) > 0
    assert reevaluate(Results(tmp_path), record).verdict == "equal"


def test_environment_is_encoded(demo_results, tmp_path):
    shutil.copytree(demo_results.path, tmp_path / "results")
    with pytest.raises(KeyboardInterrupt), recorded(tmp_path / "results", encoder=14) as it:
        env = it.env()
        assert env.observation_space.shape == env.reset()[0].shape == (14,)
        raise KeyboardInterrupt
    record = record_of(tmp_path / "results", it.id)
    assert record.status == "unfinished"
    assert record.settings["representation"] == "dae14"
    assert record.settings["encoder"].startswith("face_direction/dae14/")
    weights = encoder_weights(Results(tmp_path / "results"), record.settings["encoder"])
    assert weights.items() <= record.manifest.provenance.items()


class Residual(nn.Module):
    def __init__(self, results=1):
        super().__init__()
        self.first, self.second, self.results = nn.Linear(16, 16), nn.Linear(16, 1), results

    def forward(self, x):
        if self.results == 2:
            return self.second(self.first(x)), self.first(x)
        return self.second(x + self.first(x))


@pytest.mark.parametrize(
    ("policy", "reason"),
    [
        (Residual(), "add takes 2 results, not one"),
        (Residual(results=2), "it returns something else than one tensor, the action"),
        (nn.Sequential(nn.Linear(16, 4), nn.GELU(), nn.Linear(4, 1)), "gelu is not"),
        (nn.Linear(14, 1), "it has 14 inputs and 1 output, not 16 and 1"),
        (lambda observations: observations, "a function is not a torch module"),
    ],
)
def test_policy_that_is_not_sequence_of_layers_is_refused(policy, reason, tmp_path):
    with pytest.raises(jbench.UnsupportedPolicyError) as refused, recorded(tmp_path) as recording:
        recording.keep_policy(policy)
    message = str(refused.value)
    assert message.startswith(f"This policy can't be kept: {reason}")
    assert message.count(". ") == 0
    assert message.endswith(".")


@pytest.mark.parametrize(
    ("policy", "reason"),
    [
        (Residual(), "add takes 2 results"),
        (nn.Sequential(nn.Linear(16, 1), nn.Flatten(0)), r"it can't act .*the shape \(16,\)"),
    ],
)
def test_complete_run_finishes_when_policy_is_refused(policy, reason, tmp_path):
    with (
        pytest.raises(jbench.UnsupportedPolicyError, match=reason),
        recorded(tmp_path, evaluate_episodes=0) as it,
    ):
        loop(it, None)
        it.keep_policy(policy)
    record = record_of(tmp_path, it.id)
    assert (record.status, record.rows("episodes")) == ("finished", 2)


def test_second_block_of_recording_starts_over(tmp_path):
    recording, firsts = recorded(tmp_path, evaluate_episodes=0), []
    with pytest.raises(KeyError), recording:
        firsts.append(recording.env().reset()[0])
        recording.keep_policy(Actor())
        raise KeyError
    with recording:
        firsts.append(recording.env().reset()[0])
        loop(recording, None)
    np.testing.assert_array_equal(*firsts)
    assert not has_policy(record_of(tmp_path, recording.id))


def test_saved_layers_equal_torch():
    torch.manual_seed(1)
    layers = [nn.Linear(16, 8), nn.ELU(), nn.LayerNorm(8), nn.Linear(8, 8), nn.SiLU(), nn.Dropout()]
    layers += [nn.Linear(8, 4), nn.LeakyReLU(0.2), nn.Linear(4, 1), nn.Hardtanh(-0.3, 0.4)]
    module = nn.Sequential(*layers).eval()
    observations = 3 * np.random.default_rng(1).normal(size=(40, 16)).astype(np.float32)
    with torch.no_grad():
        wanted = module(torch.from_numpy(observations)).numpy()
    np.testing.assert_allclose(copy_module(module, 16, 1).act(observations), wanted, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"task": "dmc:cheetah-ran"}, "did you mean dmc:cheetah-run?"),
        (
            {"task": "tests.short_tasks:cheetah_run", "augment": 3},
            "run has no augmented robots",
        ),
        ({"task": "tests.third_party_task.own_tasks:EndsEarly"}, "terminates at control step 5"),
        ({"task": "../x"}, "task of the run can't be '../x'"),
        (
            {"task": gymnasium.make("Pendulum-v1")},
            f"recording is of type TimeLimit, not the name of one: {IN_A_FILE}",
        ),
        (
            {"task": "__main__:make"},
            f"recording can't be '__main__:make', a function of the running script: {IN_A_FILE}",
        ),
        ({"algo": "a/b"}, "algo of the run can't be 'a/b'"),
        ({"evaluate_episodes": 10**15 + 1}, "it should be less than or equal to 1000000000000000"),
        ({"steps": 40}, "No episode would end in 40 control steps"),
        (
            {"steps": "1k"},
            "steps of the run can't be '1k': it should be a whole number such as 10000.",
        ),
        ({"encoder": "ofe12"}, "learned together with jbench's own agents"),
        ({"hyperparameters": [1]}, "hyperparameters is [1]: type a dictionary"),
        ({"hyperparameters": {1: 2}}, "is {1: 2}: type a dictionary of values by name"),
        ({"hyperparameters": {"seed": 4}}, "hyperparameters['seed'] is 4, but seed=7"),
        ({"hyperparameters": {"f": print}}, "hyperparameters['f'] is <built-in function print>"),
        ({"package": "no-such-package"}, "package='no-such-package' is not an installed"),
        ({"package": ""}, "package='' is not an installed distribution."),
    ],
)
def test_invalid_arguments_are_refused(changes, message, tmp_path):
    with pytest.raises(jbench.RequestError, match=re.escape(message)):
        recorded(tmp_path / "results", **changes)
    assert not (tmp_path / "results").exists()


def test_script_that_records_its_own_function_is_refused_before_it_is_imported_again(tmp_path):
    recorded = 'jbench.record("loop:make", algo="a", seed=0, steps=100)'
    (tmp_path / "loop.py").write_text(f'print("begins")\nimport jbench\n{recorded}\n')
    done = Process("tests.recording.programs:run_script", "loop.py", cwd=tmp_path).finished()

    assert done.stdout == "begins\n"
    refusal = f"can't be 'loop:make', a function of the running script: {IN_A_FILE}"
    assert refusal in done.stderr
    assert not (tmp_path / "results").exists()


def test_script_with_a_main_part_may_record_its_own_function(tmp_path):
    (tmp_path / "loop.py").write_text(
        "import gymnasium\n"
        "import jbench\n"
        "def make():\n"
        '    return gymnasium.make("Pendulum-v1")\n'
        'if __name__ == "__main__":\n'
        '    jbench.record("loop:make", algo="a", seed=0, steps=400)\n'
        '    print("recorded")\n'
    )
    done = Process("tests.recording.programs:run_script", "loop.py", cwd=tmp_path).finished()
    assert (done.returncode, done.stdout) == (0, "recorded\n"), done.stderr


@pytest.mark.slow
def test_environment_of_the_page_is_recorded_with_a_model_of_stable_baselines3(tmp_path):
    (tmp_path / "arm.py").write_text(code_of("recording.md", "python", "def make"))
    script = code_of("recording.md", "python", '"arm:make"')
    (tmp_path / "train.py").write_text(script.replace("4096", "2048"))
    done = Process("tests.recording.programs:run_script", "train.py", cwd=tmp_path).finished()

    assert done.returncode == 0, done.stderr
    (record,) = Results(tmp_path / "results").scan("run")[0]
    assert record.id.startswith("arm.make/sb3-ppo/full/s00-")
    assert (record.status, has_policy(record)) == ("finished", True)


@pytest.mark.parametrize(
    ("changes", "plain"),
    [
        ({"encoder": "full"}, {"encoder": "none"}),
        ({"hyperparameters": None}, {"hyperparameters": {}}),
        ({"seed": np.int64(SEED), "steps": np.int32(STEPS)}, {}),
        ({"evaluate_every": np.int64(25)}, {"evaluate_every": 25}),
    ],
)
def test_arguments_of_same_meaning_give_same_run(changes, plain, tmp_path):
    assert recorded(tmp_path, **changes).id == recorded(tmp_path, **plain).id
    assert "/full/" in recorded(tmp_path).id


def test_misuse_of_recording_is_refused(tmp_path):
    recording = recorded(tmp_path)
    with pytest.raises(jbench.RequestError, match="within its block"):
        recording.env()
    with pytest.raises(jbench.RequestError, match="no loss qf1_loss; there are act"), recording:
        recording.losses(qf1_loss=1.0)
    with pytest.raises(jbench.RequestError, match="success must be numbers"), recording:
        recording.log(success="yes")
    for loss in ("low", None, torch.ones(3)):
        with pytest.raises(jbench.RequestError, match="critic_loss must be numbers or"), recording:
            recording.losses(critic_loss=loss)
            env = recording.env()
            env.reset()
            for _ in range(EPISODE):
                env.step([0.0])
    for action in ("left", None):
        with pytest.raises(jbench.RequestError, match="must be finite numbers of shape"), recording:
            env = recording.env()
            env.reset()
            env.step(action)
    with pytest.raises(jbench.RequestError, match="leave its block before the next"):  # noqa: SIM117
        with recording:
            with recording:
                pass
    with pytest.raises(jbench.RequestError, match="success must be numbers"), recording:
        recording.log(success=10**400)
    recording = recorded(tmp_path, steps=EPISODE, evaluate_every=1, hyperparameters={})
    with pytest.raises(jbench.RequestError, match=r"returned the shape \(2,\)"), recording:
        env = recording.env()
        env.reset()
        env.step(np.zeros(1))
        recording.evaluate(lambda observations: np.zeros(len(observations)))


@pytest.mark.parametrize("name", ["reference", "reference/", Path("reference")])
def test_shipped_results_are_not_recorded_to(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(jbench.RequestError, match="which are read-only"), recorded(name):
        pass
    assert list(tmp_path.iterdir()) == []


def test_environments_in_other_processes_are_refused(tmp_path):
    with pytest.raises(Exception, match="use SyncVectorEnv"), recorded(tmp_path) as recording:
        env = gymnasium.vector.AsyncVectorEnv([recording.env] * 2, context="spawn")
        env.close()


def test_commands_list_and_report_external_runs(finished, copy, undrawn, document):
    _, id, _, returns = finished
    (run,) = document("runs", results=copy)["runs"]
    assert (run["run"], run["algo"], run["status"]) == (id, "mine", "finished")
    assert document("verify", results=copy)["findings"] == []
    document("report", "--format", "svg", results=copy)
    assert "mine" in (copy / "report" / "index.html").read_text()
    opened = jbench.open(copy)
    rows = opened.query("SELECT algo, engine, settings->>'engine' AS said FROM runs")
    assert rows.to_dict("records") == [{"algo": "mine", "engine": "external", "said": "external"}]
    curves = opened.curves(task="face_direction", returns="training")
    assert set(curves["algo"]) == {"mine"}
    assert curves["q50"].iloc[0] == pytest.approx(returns[0])


EXAMPLES = {
    "cleanrl_td3": ("--learning-starts", "190", "--hidden", "8", "--batch-size", "8"),
    "sb3_contrib_tqc": ("--learning-starts", "190", "--hidden", "8"),
}


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES)
def test_examples_train_with_at_most_five_jbench_lines(example, tmp_path):
    if "contrib" in example:
        pytest.importorskip("sb3_contrib")
    script = ROOT / "examples" / f"{example}.py"
    assert script.read_text().count("  # jbench\n") <= 5
    arguments = (str(script), "--total-timesteps", str(2 * SHORT), *EXAMPLES[example])
    target = "tests.recording.programs:run_script"
    done = Process(target, *arguments, cwd=tmp_path, short=True).finished()
    assert done.returncode == 0, done.stderr
    (record,) = Results(tmp_path / "results").scan("run")[0]
    assert (record.status, record.rows("episodes")) == ("finished", 2)
    # An evaluation after each of the two episodes, and one of the saved policy at the end.
    assert record.rows("evaluations") == 3 * 10
    assert load_agent(Results(tmp_path / "results"), record.id).policy.sizes[1] == 1


def test_step_after_the_end_of_an_episode_is_refused(tmp_path):
    with jbench.record("face_direction", results=tmp_path, **RUN) as recording:
        env = recording.env()
        for _ in range(2):
            env.reset()
            for _ in range(EPISODE):
                env.step(np.zeros(1))
            with pytest.raises(RequestError, match="The episode has ended: call reset before"):
                env.step(np.zeros(1))
    assert record_of(tmp_path, recording.id).rows("episodes") == 2


def test_place_and_unplanned_length_of_a_recording_are_noted(tmp_path, capfd):
    with jbench.record(
        "face_direction", results=tmp_path, **{**RUN, "steps": EPISODE}
    ) as recording:
        loop(recording, Actor(), episodes=3)
    assert capfd.readouterr().err.splitlines() == [
        f"Recording the run {recording.id} in {tmp_path}.",
        "The block made 150 control steps, but steps=50: pass the number that it makes, by which "
        "runs are compared.",
        f"Recorded the run {recording.id} in {tmp_path}.",
    ]


def test_loop_of_a_vector_environment_is_complete_however_early_episodes_end(tmp_path):
    settings = {"algo": "mine", "seed": 0, "evaluate_episodes": 0}
    random = np.random.default_rng(0)
    with jbench.record("gym:Hopper-v5", steps=1000, results=tmp_path, **settings) as recording:
        environments = gymnasium.vector.SyncVectorEnv([recording.env] * 2)
        environments.reset()
        for _ in range(500):
            environments.step(random.uniform(-1, 1, (2, 3)).astype(np.float32))

    run = Results(tmp_path).find("run", recording.id)
    made = run.manifest.summary["steps_done"]
    assert (run.status, made < 990) == ("finished", True)
    # Each step of the loop was a control step or a reset, but for resets after the last step.
    assert 1000 <= made + run.rows("episodes") <= 1002


def test_run_shorter_than_the_longest_episode_is_recorded_if_episodes_end_early(tmp_path):
    settings = {"algo": "mine", "seed": 0, "evaluate_episodes": 1}
    random = np.random.default_rng(0)
    with jbench.record("gym:Hopper-v5", steps=200, results=tmp_path, **settings) as recording:
        env = recording.env()
        env.reset()
        for step in range(1, 201):
            _, _, terminated, truncated, _ = env.step(random.uniform(-1, 1, 3).astype(np.float32))
            if terminated or truncated:
                env.reset()
            returns = recording.evaluate(lambda observations: np.zeros((len(observations), 3)))
            assert (returns is not None) == (step == 200)  # once, at the end

    run = Results(tmp_path).find("run", recording.id)
    assert run.status == "finished"
    assert run.rows("episodes") > 1


def test_environment_with_a_namespace_is_recorded(tmp_path):
    task = "gym:tests.drawn_gym_tasks:lab/Drawn-v0"
    with recorded(tmp_path, task, evaluate_episodes=0) as recording:
        env = recording.env()
        while recording.control_steps < STEPS:
            env.reset()
            is_over = False
            while not is_over:
                _, _, terminated, truncated, _ = env.step(env.action_space.sample())
                is_over = terminated or truncated

    assert re.fullmatch(
        r"gym\.tests\.drawn_gym_tasks\.lab/Drawn-v0/mine/full/s07-.{8}", recording.id
    )
    assert record_of(tmp_path, recording.id).status == "finished"
