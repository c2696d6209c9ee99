"""Tests of agents and policies of an installed third-party package."""

import hashlib
import json
import re
import shutil

import pytest

from jbench.cli import main
from jbench.policies.saved import WEIGHTS, has_policy
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.store.query import load
from jbench.training.batched_run import run_batch
from jbench.training.repeat import retrain
from tests.command_line import SHORT, Process, jbench, succeed
from tests.commands.distributions import (
    assert_fails,
    assert_listed_reported_and_verified,
    install,
    make_importable,
    train_and_sweep,
)
from tests.training.small_runs import resumed, rows, shorten_episodes

PACKAGE = "random-search-agent"
NAME = "random_search:RandomSearch"
"""The same agent without its entry point."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return install("third_party_agent", "your-own-agent.md", "random_search.py", tmp_path_factory)


@pytest.fixture
def installed(site, monkeypatch):
    make_importable(site, monkeypatch)


def settings(algo="random-search", seed=0, **changes):
    about = {"task": "face_direction", "algo": algo, "seed": seed, "steps": 400}
    about |= {"engine": "plugin", "package": PACKAGE, "hyperparameters": {"noise": 0.5}}
    return RunSettings(**{**about, "evaluate_every": 150, "evaluate_episodes": 1, **changes})


MATRIX = f"""
tasks = ["face_direction"]
algos = ["random-search"]
seeds = "0-1"
steps = {SHORT}
[hyperparameters.random-search]
noise = 0.2
[evaluation]
episodes = 0
"""


@pytest.fixture(scope="module")
def swept(site, tmp_path_factory):
    """Results of a sweep with two seeds, the first of them trained by `jbench train`."""
    train = ("--algo", "random-search", "--set", "noise=0.2", "--evaluate-episodes", "0")
    return train_and_sweep(site, tmp_path_factory.mktemp("swept"), train, MATRIX)


def test_train_and_sweep_make_same_runs(swept):
    runs, problems = swept.scan("run")
    assert not problems
    assert sorted(run.settings["seed"] for run in runs) == [0, 1]
    for run in runs:
        assert run.status == "finished"
        assert run.rows("episodes") == 1
        assert has_policy(run)
        assert run.settings["hyperparameters"] == {"noise": 0.2}
        assert (run.settings["engine"], run.settings["package"]) == ("plugin", PACKAGE)
        assert run.manifest.provenance["package"] == "random-search-agent 1.0"


def test_runs_of_uninstalled_agent_are_listed_reported_and_verified(swept, capsys):
    assert_listed_reported_and_verified(swept, "random-search", capsys)
    assert load(swept)[0]["runs"]["engine"].to_pylist() == ["plugin"] * 2


def test_training_uninstalled_agent_is_refused(swept, refused):
    before = sorted(swept.path.rglob("*"))
    error = refused("train", "--algo", "random-search", results=swept.path)
    assert "Unknown algorithm 'random-search'" in error
    assert "install the package of another agent, or type MODULE:CLASS." in error
    assert sorted(swept.path.rglob("*")) == before


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        (("random-search", "--set", "noise=-1"), "noise of random-search can't be -1: .*greater"),
        (
            ("random-search", "--set", "nose=1"),
            r"random-search has no setting nose; did you mean noise\?",
        ),
        (("random-search", "--settings", "sb3"), "settings sb3 are for ddpg.*own defaults"),
        (("random-search", "--engine", "batched"), "has the engine plugin, not batched"),
        (("random-search", "--encoder", "ofe12"), "of the batched engine, not for random-search"),
        (("td3", "--engine", "plugin"), "td3 is not an agent of another package"),
        (("random-serch",), "did you mean random-search"),
        (("sb3_contrib:TQC", "--engine", "plugin"), "has the engine sb3, not plugin"),
        (("nowhere:TQC",), "there is no module nowhere"),
        (("math:cos",), r"no subclass of jbench\.Agent, jbench\.Rule or stable-b"),
    ],
)
def test_invalid_request_is_refused(installed, typed, sentence, tmp_path, refused):
    assert re.search(sentence, refused("train", "--algo", *typed, results=tmp_path / "results"))
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("algo", "sentence"),
    [
        ("broken", "The agent broken can't be loaded from other_agents:Missing"),
        ("no-agent", "The agent no-agent is no subclass of jbench.Agent"),
        ("jbench:Agent", "is no subclass of jbench.Agent with explore, act and learn; fix it, or"),
        ("no-settings", "Settings of the agent no-settings is no subclass of jbench.AgentSettings"),
    ],
)
def test_entry_point_that_is_not_an_agent_is_refused(installed, algo, sentence, tmp_path, refused):
    assert sentence in refused("train", "--algo", algo, results=tmp_path / "results", code=1)


@pytest.mark.parametrize(
    ("algo", "sentence", "episodes"),
    [
        ("wrong-shape", "explore of the agent wrong-shape returned the shape (1,)", 0),
        ("unknown-loss", "learn of the agent unknown-loss returned the loss q_loss", 0),
        ("unsaved-policy", "This policy can't be kept: softsign", 0),
        ("not-finite", "its actions are not finite at control step 120", 2),
        ("not-finite-weights", "its weights are not finite at control step 50", 1),
    ],
)
def test_faulty_agent_fails_its_run(installed, algo, sentence, episodes, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    assert_fails(settings(algo), tmp_path, sentence, episodes)


def test_error_of_agent_is_a_sentence_before_the_traceback(installed, tmp_path):
    typed = ("train", "--algo", "raises", "--seeds", "0-1", "--steps", SHORT)
    done = jbench(*typed, results=tmp_path, short=True)
    assert done.returncode == 1
    lines = [line for line in done.stderr.splitlines() if not line.startswith(" ")]
    error = "AttributeError: 'Raises' object has no attribute 'missing'"
    sentence = f"failed: learn of the agent raises failed ({error})."
    assert [line.endswith(sentence) for line in lines[:2]] == [True, False]
    # The same traceback of the second run is not shown again.
    assert done.stderr.count("Traceback (most recent call last):\n") == 1
    assert lines.index("Traceback (most recent call last):") < lines.index(error)
    assert "Next:" not in done.stdout


@pytest.mark.parametrize(("name", "kills"), [("random-search", 5), (NAME, 2)])
def test_run_killed_at_random_moments_resumes_bit_for_bit(installed, name, kills, tmp_path):
    run = settings(name, package=None if name == NAME else PACKAGE)
    request = {"path": str(tmp_path), "runs": [run.model_dump(mode="json")]}
    request |= {"at": "random", "kills": kills}
    done = Process("tests.training.kills:main", request, short=True).finished()
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["kills"], answer["problems"]) == (kills, [])
    # Some kills were in the middle of the run.
    assert {steps for folder in answer["steps"] for (steps,) in folder} & set(range(50, 400, 50))
    whole = Results(tmp_path / "whole").find("run", run.id)
    for folder in range(answer["folders"]):
        record = Results(tmp_path / str(folder)).find("run", run.id)
        assert rows(record) == rows(whole)
        assert record.read_file(WEIGHTS) == whole.read_file(WEIGHTS)


def test_interrupted_run_without_agent_state_restarts_with_notice(installed, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    run, results = settings("without-state"), Results(tmp_path)

    def stop(event):
        if event.steps == 200:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch([run], results, checkpoint_every=0, report=stop)
    assert results.find("run", run.id).rows("episodes") == 3
    events = []
    run_batch([run], results, report=events.append)
    reason = "The agent without-state has no state and restore, so its runs can't be resumed."
    assert resumed(events, [run]) == [(run.seed, 0, reason)]
    record = results.find("run", run.id)
    assert record.read("episodes")["episode"].to_pylist() == list(range(8))


def test_run_of_agent_with_state_is_continued(installed, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    whole = settings()
    short = whole.model_copy(update={"steps": 225})
    assert run_batch([whole], Results(tmp_path / "once")) == {}
    assert run_batch([short], Results(tmp_path), keep_state=True) == {}
    events = []
    run_batch([whole], Results(tmp_path), report=events.append)
    assert resumed(events, [whole]) == [(whole.seed, 225, "", short.id)]
    once, twice = (Results(path).find("run", whole.id) for path in (tmp_path / "once", tmp_path))
    assert rows(twice) == rows(once)
    assert twice.read_file(WEIGHTS) == once.read_file(WEIGHTS)


def test_state_of_agent_without_it_is_refused(installed, tmp_path, refused):
    error = refused("train", "--algo", "without-state", "--keep-state", "--results", str(tmp_path))
    assert "the agent without-state has no state and restore; leave --keep-state out" in error


def test_run_of_agent_without_state_is_reproduced(installed, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    run, results = settings("without-state"), Results(tmp_path)
    assert run_batch([run], results) == {}
    again = retrain(results, results.find("run", run.id), 2)
    reason = "The agent was not updated in them; repeat more episodes."
    assert (again.verdict, again.reason, again.control_steps) == ("equal", reason, 100)


def test_classes_are_named_without_entry_points(site, tmp_path):
    for module in ("random_search.py", "other_agents.py"):
        shutil.copy(site / module, tmp_path)
    matrix = MATRIX.replace('"random-search"', f'"{NAME}", "other_agents:WithoutState"')
    matrix = matrix.replace("ers.random-search]", f'ers."{NAME}"]')
    (tmp_path / "two.toml").write_text(matrix)
    results = tmp_path / "results"
    done = jbench("sweep", "two.toml", results=results, cwd=tmp_path, short=True)
    assert done.returncode == 0, done.stderr
    typed = ("train", "--algo", NAME, "--set", "noise=0.2", "--evaluate-episodes", "0")
    typed += ("--seeds", "0-1", "--steps", SHORT)
    again = jbench(*typed, results=results, cwd=tmp_path, short=True)
    assert "2 of 2 runs are already finished" in again.stdout
    runs, _ = Results(results).scan("run")
    assert {(run.settings["algo"], run.settings["hyperparameters"]["noise"]) for run in runs} == {
        *((NAME, 0.2), ("other_agents:WithoutState", 0.5))
    }
    checksum = hashlib.sha256((tmp_path / "random_search.py").read_bytes()).hexdigest()
    (run, _) = (run for run in runs if run.settings["algo"] == NAME)
    assert run.id.startswith("face_direction/random_search.RandomSearch/full/s0")
    assert run.manifest.provenance["source_sha256"] == checksum
    assert (run.settings["engine"], run.settings.get("package")) == ("plugin", None)
    report = ("report", "--json", "--format", "png")
    rows = json.loads(succeed(*report, results=results, short=True).stdout)["configurations"]
    assert {(row["algo"], row["seeds"]) for row in rows} == {
        *((NAME, 2), ("other_agents:WithoutState", 2))
    }


def test_algorithms_are_listed_with_settings_and_packages(installed, capsys):
    # Three entry points of the package can't be loaded.
    assert main(["algorithms", "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    found = {each["name"]: each for each in printed["algorithms"]}
    assert {"ddpg", "ppo", "sac", "td3", "random-search"} <= set(found)
    assert found["random-search"] == {
        "name": "random-search",
        "engine": "plugin",
        "package": "random-search-agent 1.0",
        "settings": [
            {"name": "noise", "default": 0.5, "description": "standard deviation of a change"}
        ],
    }
    td3 = {each["name"]: each["default"] for each in found["td3"]["settings"]}
    assert (td3["tau"], td3["hidden_layers"]) == (0.005, [350, 250])
    assert [each["name"] for each in printed["broken"]] == ["broken", "no-agent", "no-settings"]
    assert main(["algorithms", "sb3_contrib:TQC"]) == 0
    assert "top_quantiles_to_drop_per_net" in capsys.readouterr().out


def test_installed_policy_is_evaluated(installed, tmp_path):
    typed = ("evaluate", "bang-bang", "--task", "face_direction", "--episodes", "1")
    printed = json.loads(succeed(*typed, "--json", results=tmp_path, short=True).stdout)
    assert printed["settings"]["code"] == "random-search-agent 1.0"
