"""Tests of `jbench reproduce` and `jbench verify --reevaluate`: output, JSON and exit codes."""

import json
import os
import shutil

import numpy as np
import pytest
import safetensors.numpy

from jbench import names
from jbench.cli import main
from jbench.policies.saved import DESCRIPTION, WEIGHTS
from jbench.store import Results
from jbench.training.batched_run import run_batch
from tests.training.small_runs import EPISODE, shorten_episodes, small_run

OFF_POLICY = {"batch_size": 8, "train_freq": 10, "gradient_steps": 2, "learning_starts": 10}
RUNS = [
    small_run(
        "ddpg",
        OFF_POLICY,
        engine="batched",
        seed=seed,
        steps=2 * EPISODE,
        evaluate_every=EPISODE,
        evaluate_episodes=2,
    )
    for seed in range(3)
]


@pytest.fixture(scope="module", autouse=True)
def _short_episodes():
    with pytest.MonkeyPatch.context() as patch:
        shorten_episodes(patch.setattr)
        patch.setattr(os, "environ", os.environ.copy())  # the commands change it
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
        files = {
            WEIGHTS: safetensors.numpy.save(weights),
            DESCRIPTION: before.read_file(DESCRIPTION),
        }
        record = results.create("run", run.id, before.settings, {"device": "cpu"})
        evaluations = before.read("evaluations")
        record.append({"episodes": rows, "evaluations": evaluations})
        record.finish(before.manifest.summary, {} if change == "policy" else files)
    return results


def test_reproduce_reports_equal_run(trained, capsys, monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert main(["reproduce", RUNS[0].id[:-4], "--results", str(trained.path)]) == 0
    output = capsys.readouterr().out
    assert f"run {RUNS[0].id}\n" in output
    assert "evaluation: equal. The returns of 2 episodes, up to control step 100, are" in output
    assert "training: equal. The returns of 1 episode, up to control step 50, are the rec" in output
    assert os.environ["OMP_NUM_THREADS"] == names.ONE_THREAD["OMP_NUM_THREADS"]


def test_progress_of_reproduce_ends_with_the_recorded_episodes(trained, capsys, monkeypatch):
    monkeypatch.setattr(names, "EPISODE_STEPS", EPISODE)
    command = ["reproduce", RUNS[0].id, "--episodes", "999", "--results", str(trained.path)]
    assert main(command) == 0
    assert f": {2 * EPISODE} of {2 * EPISODE} control steps\n" in capsys.readouterr().err


def test_reproduce_reports_first_difference(altered, capsys):
    command = ["reproduce", RUNS[1].id, "--json", "--results", str(altered.path)]
    assert main(command) == 1
    printed = capsys.readouterr()
    document = json.loads(printed.out)
    assert (document["equal"], document["evaluation"]["verdict"]) == (False, "equal")
    (recorded,), (computed,) = (document["training"][name] for name in ("recorded", "computed"))
    assert recorded == np.nextafter(computed, np.inf)
    assert "The first difference is episode_return of episode 0, at control step 50" in printed.err
    assert f"Error: {RUNS[1].id} was not reproduced: versions and processor are the same" in (
        printed.err
    )


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["face_direction/ddpg/full/s07"], "There is no run face_direction/ddpg/full/s07 in"),
        (["face_direction/ddpg"], "Several runs begin with face_direction/ddpg: face_dir"),
        (["reference/face_direction/none"], "in reference; jbench runs --results reference lists"),
        (
            [RUNS[0].id, "--episodes", "-1"],
            "'--episodes': Input should be greater than or equal to 0",
        ),
        ([RUNS[2].id, "--episodes", "0"], "was saved without its policy: type --episodes 1"),
    ],
)
def test_reproduce_refuses_invalid_request(altered, arguments, sentence, refused):
    assert sentence in refused("reproduce", *arguments, results=altered.path)


def test_run_without_evaluations_fails_comparison(trained, tmp_path, capsys):
    """The run has a saved policy, but no rows of evaluations."""
    results = Results(tmp_path / "results")
    before = trained.find("run", RUNS[0].id)
    files = {name: before.read_file(name) for name in (WEIGHTS, DESCRIPTION)}
    record = results.create("run", RUNS[0].id, before.settings)
    record.append({"episodes": before.read("episodes")})
    record.finish(before.manifest.summary, files)
    at = ["--results", str(results.path)]
    assert main(["reproduce", RUNS[0].id, "--episodes", "0", *at]) == 1
    assert f"Error: Nothing of {RUNS[0].id} could be compared" in capsys.readouterr().err
    assert main(["verify", "--reevaluate", *at]) == 1
    assert "Error: No run could be compared with its last evaluation." in capsys.readouterr().err


def test_reproducing_shipped_run_needs_no_results_directory(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    run = "reference/face_direction/sac/full/s00"
    assert ": face_direction/sac/full/s00-" in refused("reproduce", run)
    missing = refused("reproduce", RUNS[0].id)
    assert "results does not exist; name another directory" in missing


def test_verify_repeats_last_evaluations(trained, altered, capsys):
    command = ["verify", "--reevaluate", "--results"]
    assert main([*command, str(trained.path)]) == 0
    assert "Repeated the last evaluations of finished runs: 3 equal." in capsys.readouterr().out
    assert main([*command, str(altered.path), "--json"]) == 1
    printed = capsys.readouterr()
    verdicts = {part["run"]: part["verdict"] for part in json.loads(printed.out)["reevaluations"]}
    expected = ("different", "equal", "no policy")
    assert verdicts == {run.id: verdict for run, verdict in zip(RUNS, expected, strict=True)}
    assert f"run {RUNS[0].id}\n  different: " in printed.err
    # Runs without a policy are only counted.
    assert f"run {RUNS[2].id}" not in printed.err
    assert "Left out 1 finished run without a saved policy; --json lists them." in printed.err
    assert "Repeated the last evaluations of finished runs: 1 different, 1 equal." in printed.err
    assert "Error: 1 of 2 repeated runs have other returns than recorded; see above." in printed.err
    # Without --reevaluate, only checksums are checked.
    assert main(["verify", "--results", str(altered.path)]) == 0
