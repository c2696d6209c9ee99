"""Tests of update rules of an installed third-party package."""

import json
import re
import signal
from functools import partial

import pytest

from jbench.agents.algorithms import algorithm_fields
from jbench.policies.saved import WEIGHTS, has_policy
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training.batched_run import run_batch
from tests.agents.killed_run import stack_seeds
from tests.command_line import SHORT, Process, succeed
from tests.commands.distributions import (
    assert_fails,
    assert_listed_reported_and_verified,
    install,
    make_importable,
    train_and_sweep,
)
from tests.training.small_runs import rows, shorten_episodes

PACKAGE = "tqc-rule"
SMALL = {
    **{"hidden_layers": [8], "batch_size": 8, "learning_starts": 60},
    **{"train_freq": 10, "gradient_steps": 2},
}
TYPED = tuple(
    word
    for name, value in {**SMALL, "quantiles": 5}.items()
    for word in ("--set", f"{name}={json.dumps(value)}")
)
MATRIX = f"""
tasks = ["face_direction"]
algos = ["tqc"]
seeds = "0-1"
steps = {SHORT}
[hyperparameters.tqc]
hidden_layers = [8]
batch_size = 8
learning_starts = 60
train_freq = 10
gradient_steps = 2
quantiles = 5
[evaluation]
episodes = 1
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return install("third_party_rule", "your-own-rule.md", "tqc.py", tmp_path_factory)


@pytest.fixture
def installed(site, monkeypatch):
    make_importable(site, monkeypatch)


def run_of(algo="tqc", **changes):
    """A run whose episodes have 50 control steps."""
    about = {"task": "face_direction", "seed": 0, "steps": 400, "evaluate_every": 150}
    fields = algorithm_fields(algo, overrides=SMALL)
    return RunSettings(**{**about, **fields, "evaluate_episodes": 1, **changes})


@pytest.fixture(scope="module")
def swept(site, tmp_path_factory):
    """Results of a sweep with two seeds, the first of them trained by `jbench train`."""
    train = ("--algo", "tqc", *TYPED, "--evaluate-episodes", "1")
    return train_and_sweep(site, tmp_path_factory.mktemp("swept"), train, MATRIX)


def test_train_and_sweep_make_same_runs(swept):
    runs, problems = swept.scan("run")
    assert not problems
    assert sorted(run.settings["seed"] for run in runs) == [0, 1]
    for run in runs:
        assert run.status == "finished"
        assert (run.rows("episodes"), run.rows("evaluations")) == (1, 1)
        assert has_policy(run)
        chosen = run.settings["hyperparameters"]
        assert (chosen["quantiles"], chosen["dropped"], chosen["tau"]) == (5, 2, 0.005)
        assert (run.settings["engine"], run.settings["package"]) == ("batched", PACKAGE)
        assert run.manifest.provenance["package"] == "tqc-rule 2.1"
        (episode,) = run.read("episodes").to_pylist()
        assert episode["critic_loss"] > 0
        assert episode["entropy_coefficient"] is None


def test_trained_policy_is_evaluated_and_reevaluated(swept, installed):
    run = swept.scan("run")[0][0]
    typed = partial(succeed, results=swept.path, short=True)
    evaluated = typed("evaluate", run.id, "--episodes", "1", "--json")
    assert json.loads(evaluated.stdout)["settings"]["task"] == "face_direction"
    assert "equal" in typed("verify", "--reevaluate").stdout
    typed("reproduce", run.id, "--episodes", "1")


def test_runs_of_uninstalled_rule_are_listed_reported_and_verified(swept, capsys, refused):
    assert_listed_reported_and_verified(swept, "tqc", capsys)
    assert "Unknown algorithm 'tqc'" in refused("train", "--algo", "tqc", results=swept.path)


def test_class_is_named_without_entry_point(installed, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    run, results = run_of("tqc:TQC"), Results(tmp_path)
    assert (run.engine, run.package) == ("batched", None)
    assert run_batch([run], results) == {}
    record = results.find("run", run.id)
    assert record.manifest.provenance["package"] == "tqc-rule 2.1"
    same = Results(tmp_path / "installed")
    assert run_batch([run_of()], same) == {}
    other = same.find("run", run_of().id)
    assert record.read_file(WEIGHTS) == other.read_file(WEIGHTS)


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        (("tqc", "--set", "quantiles=0"), "quantiles of tqc can't be 0: .*greater"),
        (("tqc", "--set", "quantile=9"), "tqc has no setting quantile; did you mean quantiles"),
        (("tqc", "--settings", "sb3"), "settings sb3 are for ddpg.*own defaults"),
        (("tqc", "--engine", "sb3"), "tqc has the engine batched, not sb3"),
        (
            ("tqc", "--encoder", "ofe12"),
            "ofe12 is for DDPG, TD3 and SAC of the batched engine, not for tqc",
        ),
        (("tqc", "--precision", "bfloat16"), "tqc does not learn in bfloat16"),
    ],
)
def test_invalid_request_is_refused(installed, typed, sentence, tmp_path, refused):
    assert re.search(sentence, refused("train", "--algo", *typed, results=tmp_path / "results"))
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("algo", "sentence", "episodes"),
    [
        ("no-actor", "The rule NoActor can't be trained: its actor is no nn.Sequential", 0),
        ("not-finite", "its critic_loss is not finite after update 2, at control step 70", 1),
    ],
)
def test_faulty_rule_fails_its_run(installed, algo, sentence, episodes, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    assert_fails(run_of(algo), tmp_path, sentence, episodes)


@pytest.mark.parametrize("stacked", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_killed_run_resumes_bit_for_bit(installed, stacked, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    if stacked:
        stack_seeds(monkeypatch.setattr)
    run = run_of()
    request = (str(tmp_path / "killed"), run.model_dump(mode="json"), "cpu", 200, stacked)
    done = Process("tests.agents.killed_run:main", *request, short=True).finished()
    assert done.returncode == -signal.SIGKILL
    events, records = [], []
    for name in ("whole", "killed"):
        results = Results(tmp_path / name)
        assert run_batch([run], results, report=events.append) == {}
        records.append(results.find("run", run.id))
    assert [event.steps for event in events if event.kind == "resumed"] == [200]
    assert rows(records[0]) == rows(records[1])
    assert len(rows(records[0])) == 8 + 3
    assert records[0].read_file(WEIGHTS) == records[1].read_file(WEIGHTS)
