"""Tests of reproducing recorded runs: equality bit for bit, and detection of altered runs."""

import shutil

import numpy as np
import pytest
import torch

from jbench.errors import RequestError
from jbench.policies.network import DESCRIPTION, WEIGHTS
from jbench.store import Results
from jbench.store.shipped import shipped_results
from jbench.training.batched_run import run_batch
from jbench.training.changes import changes_since
from jbench.training.log import POLICY_EVALUATION, RunLog
from jbench.training.repeat import default_episodes, reevaluate, retrain, steps_to_repeat
from tests.demo_results import ENCODER
from tests.short_episodes import EPISODE
from tests.training.small_runs import small_run

pytestmark = pytest.mark.usefixtures("short_episodes")

OFF_POLICY = {"batch_size": 8, "train_freq": 10, "gradient_steps": 2, "learning_starts": 10}
ON_POLICY = {"batch_size": 10, "n_envs": 2, "n_steps": 25}


def settings(algo="ddpg", seed=0, overrides=None, **changes):
    lengths = {"steps": 2 * EPISODE, "evaluate_every": EPISODE, "evaluate_episodes": 2}
    overrides = (ON_POLICY if algo == "ppo" else OFF_POLICY) | (overrides or {})
    return small_run(algo, overrides, **{"engine": "batched", "seed": seed, **lengths, **changes})


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Two seeds trained in one batch."""
    results = Results(tmp_path_factory.mktemp("trained"))
    assert run_batch([settings(seed=0), settings(seed=1)], results) == {}
    return results


def altered_copy(results, into, run, tables=None, files=None, summary=None, **provenance):
    """Writes a copy of a run with other rows, files or summary, with valid checksums."""
    before = results.find("run", run.id)
    rows = {name: before.read(name) for name in ("episodes", "evaluations")}
    kept = {name: before.read_file(name) for name in (WEIGHTS, DESCRIPTION)}
    record = Results(into).create("run", run.id, before.settings, provenance)
    record.append({**rows, **(tables or {})})
    record.finish(
        before.manifest.summary if summary is None else summary, {**kept, **(files or {})}
    )
    return Results(into), record


def test_run_is_reproduced_bit_for_bit(trained):
    run, shown = settings(seed=1), []
    record = trained.find("run", run.id)
    assert record.manifest.summary[POLICY_EVALUATION] == 1
    again, recorded = reevaluate(trained, record), record.read("evaluations")["episode_return"]
    assert (again.verdict, again.control_steps) == ("equal", 100)
    assert list(again.computed) == recorded.to_pylist()[2:]
    trained_again = retrain(trained, record, 1, shown.append)
    assert trained_again[1:4] == ("equal", "", 50)
    assert (len(trained_again.computed), shown) == (1, [50])
    assert changes_since(record) == {}


def test_whole_run_is_reproduced_whatever_its_last_evaluation(tmp_path):
    run, results = settings(evaluate_episodes=1), Results(tmp_path)
    assert run_batch([run], results, final_episodes=2) == {}
    again = retrain(results, results.find("run", run.id), 2)
    assert again[1:4] == ("equal", "", 100)


def test_last_evaluation_shorter_than_the_others_is_repeated_with_as_many_episodes(tmp_path):
    """A matrix product of one row rounds differently from one of three."""
    wide = {"hidden_layers": [350, 250]}
    run, results = settings(overrides=wide, evaluate_episodes=3), Results(tmp_path)
    assert run_batch([run], results, final_episodes=1) == {}
    again = reevaluate(results, results.find("run", run.id))
    assert (again.verdict, len(again.computed)) == ("equal", 1)


def test_run_that_ends_before_its_first_update_is_reproduced(tmp_path):
    lengths = {"steps": EPISODE, "evaluate_every": EPISODE, "evaluate_episodes": 0}
    waiting = {**OFF_POLICY, "learning_starts": 1000}
    run = small_run("ddpg", waiting, engine="batched", seed=0, **lengths)
    assert run_batch([run], Results(tmp_path)) == {}
    again = retrain(Results(tmp_path), Results(tmp_path).find("run", run.id), 1)
    assert again.verdict == "equal"
    assert again.reason == "The agent was not updated in them; repeat more episodes."


@pytest.mark.slow
def test_run_with_parallel_environments_is_reproduced(tmp_path):
    run, results = settings("ppo", evaluate_every=200, steps=200), Results(tmp_path)
    run_batch([run], results)
    record = results.find("run", run.id)
    again = retrain(results, record, 3)  # with two environments: the whole run
    assert (again.verdict, len(again.computed), again.control_steps) == ("equal", 4, 200)
    assert reevaluate(results, record).verdict == "equal"


@pytest.mark.parametrize(
    "algo",
    ["ddpg", *(pytest.param(each, marks=pytest.mark.slow) for each in ("td3", "sac", "ppo"))],
)
def test_run_with_standardized_inputs_is_reproduced(algo, tmp_path):
    about = {"overrides": {"normalize": "running"}, "evaluate_episodes": 1}
    run, results = settings(algo, **about), Results(tmp_path)
    assert run_batch([run], results, final_episodes=1) == {}
    record = results.find("run", run.id)
    assert reevaluate(results, record).verdict == retrain(results, record, 2).verdict == "equal"


def test_return_altered_by_one_bit_is_reported(trained, tmp_path):
    rows = trained.find("run", settings().id).read("episodes")
    returns = rows["episode_return"].to_numpy().copy()
    before, after = returns[1], np.nextafter(returns[1], np.inf)
    returns[1] = after
    at = rows.schema.get_field_index("episode_return")
    altered = rows.set_column(at, rows.schema.field(at), [returns])
    results, record = altered_copy(trained, tmp_path, settings(), {"episodes": altered})
    assert retrain(results, record, 1).verdict == "equal"
    again = retrain(results, record, 2)
    assert (again.verdict, again.recorded[1], again.computed[1]) == ("different", after, before)
    assert again.reason == (
        "The first difference is episode_return of episode 1, at control step 100: recorded "
        f"{float(after)!r}, here {float(before)!r}."
    )


def test_missing_row_is_reported(trained, tmp_path):
    rows = trained.find("run", settings().id).read("evaluations")
    results, record = altered_copy(trained, tmp_path, settings(), {"evaluations": rows.slice(1)})
    reason = "A row of evaluation 0, at control step 50, is missing in the record."
    assert retrain(results, record, 1).reason == reason


def test_policy_with_wrong_layers_is_not_evaluated(trained, tmp_path):
    files = {
        name: trained.find("run", settings().id).read_file(name) for name in (WEIGHTS, DESCRIPTION)
    }
    run = settings("ppo")
    run_batch([run], Results(tmp_path / "other"))
    results, record = altered_copy(
        Results(tmp_path / "other"), tmp_path / "altered", run, files=files
    )
    done = reevaluate(results, record)
    assert done.verdict == "not comparable"
    assert done.reason == "Its policy can't be run: its layers are not those of its settings."


@pytest.mark.skipif(torch.cuda.is_available(), reason="has a GPU")
def test_evaluation_on_a_gpu_is_not_compared_without_one(trained, tmp_path):
    results, record = altered_copy(trained, tmp_path, settings(), device="cuda")
    done = reevaluate(results, record)
    assert done.verdict == "not comparable"
    assert done.reason == "A GPU evaluated it, and this machine has none."
    moved = {"changed": {"device": ["cuda", "cpu"]}}
    results, record = altered_copy(
        trained, tmp_path / "moved", settings(), device="cuda", continued=[{"changed": {}}, moved]
    )
    assert reevaluate(results, record).verdict == "equal"  # a CPU evaluated it


def test_policies_of_older_versions_are_not_compared(trained, tmp_path):
    """Older versions saved the policy after the last updates but evaluated it before them."""
    run, summary = settings(), {"wall_time": 1.0}
    results, record = altered_copy(trained, tmp_path / "due", run, summary=summary)
    done = reevaluate(results, record)
    assert done.verdict == "not comparable"
    assert "before the last updates" in done.reason
    # If no evaluation was due at the last step, the final policy was evaluated.
    late = settings("ddpg", evaluate_every=75)
    run_batch([late], Results(tmp_path / "late"))
    results, record = altered_copy(
        Results(tmp_path / "late"), tmp_path / "old", late, summary=summary
    )
    assert reevaluate(results, record).verdict == "equal"


def test_run_with_encoder_needs_it(demo_results, tmp_path):
    shutil.copytree(demo_results.path / "encoders", tmp_path / "encoders")
    results = Results(tmp_path)
    about = {"encoder": ENCODER, "representation": "dae14", "evaluate_episodes": 1}
    run = settings(steps=50, **about)
    assert run_batch([run], results) == {}
    record = results.find("run", run.id)
    assert reevaluate(results, record).verdict == retrain(results, record, 1).verdict == "equal"
    shutil.rmtree(results.path / "encoders")
    assert ENCODER in reevaluate(results, record).reason
    with pytest.raises(RequestError, match=ENCODER):
        retrain(results, record, 1)


def test_run_without_episodes_or_of_another_program_is_refused(tmp_path):
    results = Results(tmp_path)
    record = results.create("run", settings().id, settings().values)
    with pytest.raises(RequestError, match="is unfinished and has no episode to compare with"):
        retrain(results, record, 1)
    unknown = results.create("run", "t/a/full/s00-00000000", {"task": "t"})
    with pytest.raises(RequestError, match="Another program or version wrote"):
        retrain(results, unknown, 1)


@pytest.mark.parametrize(
    ("ends", "episodes", "steps"),
    [
        ([7, 9, 30], 2, 9),  # episodes that end early
        ([7, 9, 30], 10, 30),
        ([800, 800, 1600], 1, 800),  # of two environments
        ([], 1, 0),
    ],
)
def test_training_is_repeated_until_an_episode_has_ended(ends, episodes, steps, tmp_path):
    run = settings()
    record = Results(tmp_path).create("run", run.id, run.values)
    log = RunLog(record)
    for end in ends:
        log.episode(end, 0.0, {}, 1)
    log.commit()
    assert steps_to_repeat(record, episodes) == steps


def test_default_episodes_include_first_updates(trained):
    assert default_episodes(trained.find("run", settings().id)) == 1
    td3 = shipped_results().find("run", "face_direction/td3/full/s05-1fe5f7e8")
    assert default_episodes(td3) == 12  # its first update is after 11,000 control steps
