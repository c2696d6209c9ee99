"""Tests of reproducing recorded runs: equality bit for bit, and detection of altered runs."""

import shutil

import numpy as np
import pyarrow as pa
import pytest
import safetensors.numpy

import jbench
from jbench.errors import RequestError
from jbench.policies.saved import DESCRIPTION, WEIGHTS
from jbench.store import Results
from jbench.training import reproduce as reproducing
from jbench.training import sb3_run
from jbench.training.batched_run import run_batch
from jbench.training.environment import load_encoder_of
from jbench.training.log import POLICY_EVALUATION
from jbench.training.reevaluate import reevaluate
from jbench.training.reproduce import default_episodes, find_run, reproduce
from tests.demo_results import ENCODER
from tests.training.small_runs import EPISODE, shorten_episodes, small_run

OFF_POLICY = {"batch_size": 8, "train_freq": 10, "gradient_steps": 2, "learning_starts": 10}
ON_POLICY = {"batch_size": 10, "n_envs": 2, "n_steps": 25}


@pytest.fixture(scope="module", autouse=True)
def _short_episodes():
    with pytest.MonkeyPatch.context() as patch:
        shorten_episodes(patch.setattr)
        yield


def settings(algo="ddpg", seed=0, **changes):
    lengths = {"steps": 2 * EPISODE, "evaluate_every": EPISODE, "evaluate_episodes": 2}
    overrides = ON_POLICY if algo == "ppo" else OFF_POLICY
    return small_run(algo, overrides, **{"engine": "batched", "seed": seed, **lengths, **changes})


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Two seeds trained in one batch."""
    results = Results(tmp_path_factory.mktemp("trained"))
    assert run_batch([settings(seed=0), settings(seed=1)], results, None) == {}
    return results


def altered_copy(results, into, run, tables=None, files=None, summary=None):
    """Writes a copy of a run with other rows, files or summary, with valid checksums."""
    before = results.find("run", run.id)
    rows = {name: before.read(name) for name in ("episodes", "evaluations")}
    kept = {name: before.read_file(name) for name in (WEIGHTS, DESCRIPTION)}
    record = Results(into).create("run", run.id, before.settings, {"device": "cpu"})
    record.append({**rows, **(tables or {})})
    record.finish(
        before.manifest.summary if summary is None else summary, {**kept, **(files or {})}
    )
    return Results(into), record


def with_value(table, row, column, value):
    values = table[column].to_pylist()
    values[row] = value
    field = table.schema.field(column)
    return table.set_column(
        table.schema.get_field_index(column), field, pa.array(values, field.type)
    )


def test_run_is_reproduced_bit_for_bit(trained):
    run, shown = settings(seed=1), []
    record = trained.find("run", run.id)
    assert record.manifest.summary[POLICY_EVALUATION] == 1
    done = reproduce(trained, record, 1, shown.append)
    assert done.evaluation.verdict == "equal"
    assert done.evaluation.control_steps == 100
    recorded = record.read("evaluations")["episode_return"].to_pylist()[2:]
    assert list(done.evaluation.computed) == recorded
    assert done.retraining == (1, 2, 50, True, None)
    assert (shown, done.changed, done.equal) == ([50], {}, True)


def test_stable_baselines3_run_is_reproduced_bit_for_bit(tmp_path):
    task = "move_from_origin"  # its returns are not 0
    run = settings(engine="sb3", task=task, evaluate_every=75, evaluate_episodes=1)
    results = Results(tmp_path)
    record = sb3_run.run(run, results, None)
    assert record.manifest.summary[POLICY_EVALUATION] == 1
    done = reproduce(results, record, 1)
    assert done.evaluation.verdict == "equal"
    assert done.retraining == (1, 0, 50, True, None)


def test_run_with_parallel_environments_is_reproduced(tmp_path):
    run, results = settings("ppo", evaluate_every=200, steps=200), Results(tmp_path)
    run_batch([run], results, None)
    record = results.find("run", run.id)
    done = reproduce(results, record, 3)  # with two environments: the whole run
    assert done.retraining == (4, 2, 200, True, None)
    assert done.evaluation.verdict == "equal"


def test_return_altered_by_one_bit_is_reported(trained, tmp_path):
    run = settings()
    rows = trained.find("run", run.id).read("episodes")
    before = rows["episode_return"][1].as_py()
    after = float(np.nextafter(before, np.inf))
    altered = with_value(rows, 1, "episode_return", after)
    results, record = altered_copy(trained, tmp_path, run, {"episodes": altered})
    assert reproduce(results, record, 1).equal
    done = reproduce(results, record, 2)
    assert not done.equal
    assert done.retraining.difference == ("episodes", 1, 100, "episode_return", after, before)
    assert str(done.retraining.difference) == (
        f"episode_return of episode 1, at control step 100: recorded {after!r}, here {before!r}"
    )


def test_missing_row_is_reported(trained, tmp_path):
    run = settings()
    rows = trained.find("run", run.id).read("evaluations")
    results, record = altered_copy(trained, tmp_path, run, {"evaluations": rows.slice(1)})
    found = reproduce(results, record, 1).retraining.difference
    assert found[:3] == ("evaluations", 0, 50)
    assert found.recorded is None
    assert found.computed is not None


def test_weight_altered_by_one_bit_is_detected(trained, tmp_path):
    run = settings()
    weights = safetensors.numpy.load(trained.find("run", run.id).read_file(WEIGHTS))
    weights["1.bias"].view(np.uint32)[0] ^= 1  # the lowest bit of the output bias
    files = {WEIGHTS: safetensors.numpy.save(weights)}
    results, record = altered_copy(trained, tmp_path, run, files=files)
    done = reevaluate(results, record)
    assert done.verdict == "different"
    assert done.recorded != done.computed
    assert f"recorded {done.recorded[0]!r}, here {done.computed[0]!r}" in done.reason


def test_policy_with_wrong_layers_is_not_evaluated(trained, tmp_path):
    files = {
        name: trained.find("run", settings().id).read_file(name) for name in (WEIGHTS, DESCRIPTION)
    }
    run = settings("ppo")
    run_batch([run], Results(tmp_path / "other"), None)
    results, record = altered_copy(
        Results(tmp_path / "other"), tmp_path / "altered", run, files=files
    )
    done = reevaluate(results, record)
    assert done.verdict == "not comparable"
    assert done.reason == "Its policy can't be run: its layers are not those of its settings."


def test_policies_of_older_versions_are_not_compared(trained, tmp_path):
    """Older versions saved the policy after the last updates but evaluated it before them."""
    run, summary = settings(), {"wall_time": 1.0}
    results, record = altered_copy(trained, tmp_path / "due", run, summary=summary)
    done = reproduce(results, record, 1)
    assert (done.evaluation.verdict, done.equal) == ("not comparable", True)
    assert "before the last updates" in done.evaluation.reason
    # If no evaluation was due at the last step, the final policy was evaluated.
    late = settings("ddpg", evaluate_every=75)
    run_batch([late], Results(tmp_path / "late"), None)
    results, record = altered_copy(
        Results(tmp_path / "late"), tmp_path / "old", late, summary=summary
    )
    assert reevaluate(results, record).verdict == "equal"


def test_run_with_encoder_needs_it(demo_results, tmp_path):
    shutil.copytree(demo_results.path / "encoders", tmp_path / "encoders")
    results = Results(tmp_path)
    run = settings(encoder=ENCODER, representation="dae14", steps=50)
    assert run_batch([run], results, load_encoder_of(run, results)) == {}
    done = reproduce(results, results.find("run", run.id), 1)
    assert (done.evaluation.verdict, done.retraining.difference) == ("equal", None)
    shutil.rmtree(results.path / "encoders")
    with pytest.raises(RequestError, match=ENCODER):
        reproduce(results, results.find("run", run.id), 1)


def test_only_evaluation_of_recorded_loop_is_reproduced(tmp_path):
    import torch
    from torch import nn

    torch.manual_seed(0)
    actor = nn.Sequential(nn.Linear(16, 8), nn.ReLU(), nn.Linear(8, 1), nn.Tanh())
    arguments = {"algo": "mine", "seed": 3, "steps": EPISODE, "hyperparameters": {}}
    arguments |= {"evaluate_every": 25, "evaluate_episodes": 2, "results": tmp_path}
    with jbench.record("face_direction", **arguments) as recording:
        env = recording.env()
        env.reset()
        for _ in range(EPISODE):
            env.step(np.array([0.5], np.float32))
            recording.evaluate(actor)
        recording.keep_policy(actor)
    results = Results(tmp_path)
    record = results.find("run", recording.id)
    assert reproduce(results, record, 0).evaluation.verdict == "equal"
    with pytest.raises(RequestError, match="only its evaluation can be repeated; type --episodes"):
        reproduce(results, record, 1)


def test_runs_are_found_by_id_prefix(trained):
    run = settings()
    assert find_run(trained, run.id)[1].id == run.id
    assert find_run(trained, "face_direction/ddpg/full/s01")[1].id == settings(seed=1).id
    with pytest.raises(RequestError, match="Several runs begin with face_direction/ddpg: face_dir"):
        find_run(trained, "face_direction/ddpg")
    with pytest.raises(RequestError, match="There is no run face_direction/td3 in"):
        find_run(trained, "face_direction/td3")
    shipped, record = find_run(trained, "reference/face_direction/sac/full/s05")
    assert (shipped.path.name, record.settings["seed"]) == ("reference", 5)
    with pytest.raises(RequestError, match="in reference; jbench runs --results reference lists"):
        find_run(trained, "reference/face_direction/none")


def test_run_without_reproducible_data_is_refused(trained, tmp_path):
    run = settings()
    results = Results(tmp_path)
    record = results.create("run", run.id, run.values)
    with pytest.raises(RequestError, match="is unfinished and has no episode to compare with"):
        reproduce(results, record, 1)
    rows = trained.find("run", run.id).read("episodes")
    record.append({"episodes": rows})
    with pytest.raises(RequestError, match="has not finished: type --episodes 1 or more"):
        reproduce(results, record, 0)
    record.finish({})
    with pytest.raises(RequestError, match="was saved without its policy: type --episodes 1"):
        reproduce(results, record, 0)
    unknown = results.create("run", "t/a/full/s00-00000000", {"task": "t"})
    with pytest.raises(RequestError, match="Another program or version wrote"):
        reproduce(results, unknown, 1)


def test_default_episodes_include_first_updates(trained):
    record = trained.find("run", settings().id)
    assert default_episodes(record) == 1
    td3 = find_run(trained, "reference/face_direction/td3/full/s05-1fe5f7e8")[1]
    assert default_episodes(td3) == 12  # its first update is after 11,000 control steps


def test_differences_are_in_order_of_training():
    recorded = {(1000, "episodes", 0, 0): {"episode_return": 1.0, "actor_loss": float("nan")}}
    computed = {(1000, "episodes", 0, 0): {"episode_return": 1.0, "actor_loss": float("nan")}}
    assert list(reproducing._differences(recorded, computed)) == []
    computed[500, "evaluations", 0, 0] = {"episode_return": 3.0}
    computed[1000, "episodes", 0, 0] = {"episode_return": 2.0, "actor_loss": None}
    found = [one[:4] for one in reproducing._differences(recorded, computed)]
    assert found == [
        ("evaluations", 0, 500, "episode_return"),
        ("episodes", 0, 1000, "episode_return"),
        ("episodes", 0, 1000, "actor_loss"),
    ]
