"""Tests of `jbench reproduce` and `jbench verify --reevaluate`: output, JSON and exit codes."""

import json
import os
import shutil
from unittest import mock

import numpy as np
import pytest
import safetensors.numpy

from jbench.policies.network import DESCRIPTION, WEIGHTS
from jbench.store import Results
from jbench.training.batched_run import run_batch
from tests.short_episodes import EPISODE, short_episodes
from tests.training.small_runs import small_run

OFF_POLICY = {"batch_size": 8, "train_freq": 10, "gradient_steps": 2, "learning_starts": 10}
LENGTHS = {"steps": 2 * EPISODE, "evaluate_every": EPISODE, "evaluate_episodes": 2}
RUNS = [small_run("ddpg", OFF_POLICY, engine="batched", seed=n, **LENGTHS) for n in range(3)]


@pytest.fixture(scope="module", autouse=True)
def _short_episodes():
    with short_episodes(), mock.patch.dict(os.environ):  # the commands change it
        yield


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    results = Results(tmp_path_factory.mktemp("trained") / "results")
    assert run_batch(RUNS, results) == {}
    return results


@pytest.fixture
def altered(trained, tmp_path):
    """A copy of the results: one run each with a changed weight, a changed return, no policy."""
    results = Results(tmp_path / "results")
    shutil.copytree(trained.path, results.path)
    for run, change in zip(RUNS, ("weight", "return", "policy"), strict=True):
        before = trained.find("run", run.id)
        rows = before.read("episodes")
        if change == "return":
            values = rows["episode_return"].to_numpy().copy()
            values[0] = np.nextafter(values[0], np.inf)
            at = rows.schema.get_field_index("episode_return")
            rows = rows.set_column(at, rows.schema.field(at), [values])
        weights = safetensors.numpy.load(before.read_file(WEIGHTS))
        if change == "weight":
            weights["2.bias"].view(np.uint32)[0] ^= 1
        files = {DESCRIPTION: before.read_file(DESCRIPTION)}
        files |= {WEIGHTS: safetensors.numpy.save(weights)}
        record = results.create("run", run.id, before.settings, {"device": "cpu"})
        evaluations = before.read("evaluations")
        record.append({"episodes": rows, "evaluations": evaluations})
        record.finish(before.manifest.summary, {} if change == "policy" else files)
    return results


def test_reproduce_reports_equal_run(trained, run_command):
    command = ("reproduce", RUNS[0].id[:-4])
    code, out, err = run_command(*command, results=trained.path)
    assert code == 0
    assert f"reproduce {RUNS[0].id}, evaluation: 2 of 2 episodes\n" in err
    assert f"run {RUNS[0].id}\n" in out
    assert "evaluation: equal. The returns of 2 episodes, up to control step 100, are" in out
    assert "training: equal. The returns of 1 episode, up to control step 50, are the rec" in out
    # The progress ends with the recorded episodes.
    code, _, err = run_command(*command, "--episodes", "999", results=trained.path)
    assert (code, f": {2 * EPISODE} of {2 * EPISODE} control steps\n" in err) == (0, True)


def test_reproduce_reports_first_difference(altered, run_command):
    code, out, err = run_command("reproduce", RUNS[1].id, "--json", results=altered.path)
    found = json.loads(out)
    assert (code, found["equal"], found["evaluation"]["verdict"]) == (1, False, "equal")
    (recorded,), (computed,) = (found["training"][name] for name in ("recorded", "computed"))
    assert recorded == np.nextafter(computed, np.inf)
    assert "The first difference is episode_return of episode 0, at control step 50" in err
    assert f"Error: {RUNS[1].id} was not reproduced: versions and processor are the same" in err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["face_direction/ddpg/full/s07"], "There is no run face_direction/ddpg/full/s07 in"),
        (["face_direction/ddpg"], "Several runs begin with face_direction/ddpg: face_dir"),
        (["reference/face_direction/none"], "in reference; jbench runs --results reference lists"),
        (["face_direction/ddpg/ful/s00"], "did you mean face_direction/ddpg/full/s0"),
        ([RUNS[0].id, "--episodes", "-1"], "'--episodes': '-1': type a whole number, such as 0"),
        ([RUNS[2].id, "--episodes", "0"], "was saved without its policy: type --episodes 1"),
    ],
)
def test_reproduce_refuses_invalid_request(altered, arguments, sentence, refused):
    assert sentence in refused("reproduce", *arguments, results=altered.path)


def test_run_without_evaluations_fails_comparison(trained, tmp_path, run_command):
    """The run has a saved policy, but no rows of evaluations."""
    before, place = trained.find("run", RUNS[0].id), tmp_path / "results"
    files = {name: before.read_file(name) for name in (WEIGHTS, DESCRIPTION)}
    record = Results(place).create("run", RUNS[0].id, before.settings)
    record.append({"episodes": before.read("episodes")})
    record.finish(before.manifest.summary, files)
    code, _, err = run_command("reproduce", RUNS[0].id, "--episodes", "0", results=place)
    assert (code, f"Error: Nothing of {RUNS[0].id} could be compared" in err) == (1, True)
    code, _, err = run_command("verify", "--reevaluate", results=place)
    assert code == 1
    assert "Error: No run could be compared with its last evaluation." in err


def test_verify_repeats_last_evaluations(trained, altered, run_command):
    code, out, _ = run_command("verify", "--reevaluate", results=trained.path)
    assert code == 0
    assert "Repeated the last evaluations of finished runs: 3 equal." in out
    code, out, err = run_command("verify", "--reevaluate", "--json", results=altered.path)
    assert code == 1
    verdicts = {part["run"]: part["verdict"] for part in json.loads(out)["reevaluations"]}
    assert [verdicts[run.id] for run in RUNS] == ["different", "equal", "no policy"]
    assert f"run {RUNS[0].id}\n  different: " in err
    # Runs without a policy are only counted.
    assert f"run {RUNS[2].id}" not in err
    assert "Left out 1 finished run without a saved policy; --json lists them." in err
    assert "Repeated the last evaluations of finished runs: 1 different, 1 equal." in err
    assert "Error: 1 of 2 repeated runs have other returns than recorded; see above." in err
    # Without --reevaluate, only checksums are checked.
    assert run_command("verify", results=altered.path)[0] == 0
