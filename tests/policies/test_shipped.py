"""Tests of `benchmarks/ship_reference.py`, and of the shipped policies that POLICY finds."""

import importlib.util
import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from jbench.cli import main
from jbench.policies import find
from jbench.policies.network import SavedNetwork, linear_layer
from jbench.policies.saved import has_policy, policy_files
from jbench.settings.base import settings_hash
from jbench.settings.records import EvaluationSettings
from jbench.store import Results, schema
from jbench.store.shipped import shipped
from jbench.store.verify import verify
from jbench.tasks.features import observation_size
from tests.training.small_runs import shorten_episodes

ROOT = Path(__file__).parents[2]
POLICY = SavedNetwork([linear_layer(np.ones((1, 16), np.float32), np.zeros(1, np.float32))])


@pytest.fixture(scope="module")
def script():
    """The module of the script that adds runs to the package."""
    path = ROOT / "benchmarks" / "ship_reference.py"
    spec = importlib.util.spec_from_file_location("ship_reference", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def add_run(results, seed, evaluations, algo="ddpg", finish=True):
    """Adds a run with a policy; `evaluations` are mean returns of two episodes each."""
    settings = {"task": "face_direction", "algo": algo, "representation": "full"}
    settings |= {"encoder": None, "seed": seed, "steps": 1000, "engine": "batched"}
    id = f"face_direction/{algo}/full/s{seed:02d}-{settings_hash(settings)}"
    record = results.create("run", id, settings)
    rows = [
        {"run": id, "evaluation": number, "control_steps": 1000, "episode": episode}
        | {"episode_return": mean + change, "length": 1000, "wall_time": 1.0}
        for number, mean in enumerate(evaluations)
        for episode, change in enumerate((-50.0, 50.0))
    ]
    record.append({"evaluations": pa.Table.from_pylist(rows, schema.EVALUATIONS)})
    if finish:
        record.finish({"wall_time": 1.0}, policy_files(POLICY))
    return record


def with_policies(results):
    return {run.settings["seed"] for run in results.scan("run")[0] if has_policy(run)}


@pytest.fixture
def source(tmp_path):
    return Results(tmp_path / "source")


@pytest.fixture
def target(tmp_path):
    return Results(tmp_path / "target")


def test_finished_runs_keep_policies_and_evaluations(script, source, target):
    runs = [add_run(source, seed, [500]) for seed in range(3)]
    evaluation, _ = (
        source.create("evaluation", settings.id, settings.model_dump())
        for policy in (runs[1].id, "heuristic")
        for settings in [EvaluationSettings(task="face_direction", policy=policy)]
    )
    for record in source.scan("evaluation")[0]:
        record.finish({"median": 1.0})
    assert script.ship(source, target) == []
    assert with_policies(target) == {0, 1, 2}
    assert [record.id for record in target.scan("evaluation")[0]] == [evaluation.id]
    assert verify(target, 1).findings == []


def test_shipped_runs_stay_as_they_are(script, source, target):
    first = add_run(source, 0, [500])
    script.ship(source, target)
    manifest = (target.find("run", first.id).path / "manifest.json").read_bytes()
    add_run(source, 1, [600])
    script.ship(source, target)
    assert with_policies(target) == {0, 1}
    assert (target.find("run", first.id).path / "manifest.json").read_bytes() == manifest


def test_command_and_checkpoint_are_not_shipped(script, source, target):
    run = add_run(source, 0, [500], finish=False)
    run.append({}, {"checkpoint.safetensors": b"weights"})
    assert script.ship(source, target) == [f"{run.id} is left out: it is unfinished."]
    assert target.scan("run") == ([], [])
    run.finish({"wall_time": 1.0}, policy_files(POLICY))
    script.ship(source, target)
    kept = target.find("run", run.id)
    assert "command" in run.manifest.provenance
    assert "command" not in kept.manifest.provenance
    assert kept.roles() == []


@pytest.mark.parametrize(
    "directory", ["/home/ann/out", "see ~/out", "--results=/data/x", r"C:\out"]
)
def test_run_that_names_directory_is_refused(script, source, target, directory):
    run = add_run(source, 0, [500])
    text = json.loads((run.path / "manifest.json").read_text())
    text["provenance"]["continued"] = [{"at": "now", "changed": {"libraries": [None, directory]}}]
    (run.path / "manifest.json").write_text(json.dumps(text))
    (note,) = script.ship(source, target)
    assert run.id in note
    assert "names a directory" in note
    assert target.scan("run") == ([], [])


def test_damaged_run_is_left_out(script, source, target):
    run = add_run(source, 0, [500])
    (run.path / "policy.safetensors").write_bytes(b"")
    (note,) = script.ship(source, target)
    assert "is damaged" in note
    assert target.scan("run") == ([], [])


class TestShippedTwoCells:
    """Two seeds on the full observation, and two on 12 latents, are shipped."""

    @pytest.fixture
    def database(self, script, demo_results, target, monkeypatch):
        """The shipped results, which replace those of the package."""
        assert script.ship(demo_results, target) == []
        monkeypatch.setattr(find, "shipped_results", lambda: target)
        return target

    def test_shipped_results_verify_without_findings(self, database):
        found = verify(database, 1)
        assert found.findings == []
        assert found.records == 5  # four runs and their encoder, without its dataset
        assert len(find.shipped_policies()) == 4

    @pytest.mark.parametrize("representation", ["full", "dae14"])
    def test_shipped_policy_equals_policy_of_run(
        self, database, representation, demo_results, tmp_path, monkeypatch, capsys
    ):
        shorten_episodes(monkeypatch.setattr)
        cell = f"reference/face_direction/td3/{representation}/s00"
        (name,) = [policy for policy in find.shipped_policies() if policy.startswith(cell)]
        assert find.full_name(Results(shipped()), cell) == name
        assert find.full_name(Results(shipped()), name[:-4]) == name
        shutil.copytree(demo_results.path, tmp_path / "own")
        evaluate = ("evaluate", "--episodes", "1", "--seed", "5", "--threads", "1", "--json")
        printed = []
        for policy, results in ((name.removeprefix("reference/"), "own"), (cell, "other")):
            capsys.readouterr()
            assert main([*evaluate, policy, "--results", str(tmp_path / results)]) == 0
            printed.append(json.loads(capsys.readouterr().out))
        assert printed[1]["summary"] == printed[0]["summary"]
        assert printed[1]["summary"]["median"] > 1
        assert printed[1]["settings"]["policy"] == name
        assert verify(Results(tmp_path / "other"), 1).findings == []

    @pytest.mark.parametrize(
        ("name", "message"),
        [
            ("reference/face_direction/sac", "No policy is shipped as {}; type one of "),
            ("reference/face_direction/td3", "Error: {} is not unique; type one of {}"),
        ],
    )
    def test_ambiguous_name_is_refused_with_choices(self, database, name, message, refused):
        there = ", ".join(find.shipped_policies())
        assert message.format(name, there) in refused("evaluate", name)

    def test_run_without_policy_is_refused(self, database, refused):
        run = database.scan("run")[0][0]
        for name in ("policy.json", "policy.safetensors"):
            (run.path / name).unlink()
        text = json.loads((run.path / "manifest.json").read_text())
        text["files"] = [entry for entry in text["files"] if "policy" not in entry["name"]]
        (run.path / "manifest.json").write_text(json.dumps(text))
        error = refused("evaluate", run.id, results=database.path)
        assert f"The run {run.id} in {database.path} was saved without its policy." in error

    def test_missing_shipped_policies_are_reported(self, tmp_path, monkeypatch, refused):
        monkeypatch.setattr(find, "shipped_results", lambda: Results(tmp_path / "none"))
        error = refused("evaluate", "reference/face_direction/td3/full")
        assert "this version of jbench ships none" in error

    def test_missing_encoder_of_shipped_runs_is_added(self, script, database, demo_results):
        (encoder,) = database.scan("encoder")[0]
        shutil.rmtree(encoder.path)
        assert len(verify(database, 1).findings) == 2
        assert script.ship(demo_results, database) == []
        assert verify(database, 1).findings == []

    def test_policy_on_different_encoder_is_not_shipped(
        self, script, database, demo_results, tmp_path
    ):
        """An encoder trained on another processor may differ in its last digits."""
        for record in database.scan("run")[0]:
            shutil.rmtree(record.path)
        (encoder,) = database.scan("encoder")[0]
        shutil.rmtree(encoder.path)
        database.create("encoder", encoder.id, encoder.settings).finish({}, {"encoder.json": b"{}"})
        notes = script.ship(demo_results, database)
        assert len(notes) == 2
        assert all("the shipped encoder is another one" in note for note in notes)
        kept = [run for run in database.scan("run")[0] if has_policy(run)]
        assert {run.settings["representation"] for run in kept} == {"full"}


class TestPackage:
    def test_shipped_policies_load(self):
        results = Results(shipped())
        runs = [run for run in results.scan("run")[0] if has_policy(run)]
        for run in runs:
            found = find.find_policy(results, f"reference/{run.id}", run.settings["task"])
            size = observation_size(run.settings["task"])
            assert np.abs(found.act(np.zeros((3, size), np.float32))).max() <= 1

    def test_every_noncode_file_is_package_data(self):
        package = ROOT / "jbench"
        text = tomllib.loads((ROOT / "pyproject.toml").read_text())
        patterns = text["tool"]["setuptools"]["package-data"]["jbench"]
        carried = {path for pattern in patterns for path in package.glob(pattern)}
        there = {
            path
            for path in package.rglob("*")
            if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts
        }
        assert there - carried == set()

    def test_package_size_is_limited(self, script):
        assert script.size(ROOT / "jbench") < script.LARGEST_PACKAGE
