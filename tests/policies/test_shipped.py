"""Tests of `benchmarks/ship_reference.py`, and of the shipped policies that POLICY finds."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from benchmarks import ship_reference
from jbench.cli import main
from jbench.policies import find, located
from jbench.settings.base import settings_hash
from jbench.settings.records import EvaluationSettings
from jbench.store import Results
from jbench.store.rows import has_policy
from jbench.store.shipped import shipped
from jbench.store.verify import verify
from jbench.tasks.jitterbug.features import observation_size
from tests.short_episodes import shorten_episodes


@pytest.fixture
def source(demo_results, tmp_path):
    """Two seeds on the full observation, and two on 12 latents."""
    shutil.copytree(demo_results.path, tmp_path / "source")
    return Results(tmp_path / "source")


@pytest.fixture
def target(tmp_path):
    return Results(tmp_path / "target")


@pytest.fixture
def database(demo_results, target, monkeypatch):
    """The shipped results, which replace those of the package."""
    assert ship_reference.ship(demo_results, target) == []
    monkeypatch.setattr(located, "shipped_results", lambda: target)
    return target


def test_evaluations_of_shipped_policies_are_shipped(source, target):
    run = source.scan("run")[0][0]
    for policy in (run.id, "heuristic"):
        settings = EvaluationSettings(task="face_direction", policy=policy)
        record = source.create("evaluation", settings.id, settings.model_dump())
        record.finish({"median": 1.0})
    assert ship_reference.ship(source, target) == []
    assert [record.settings["policy"] for record in target.scan("evaluation")[0]] == [run.id]
    found = verify(target, 1)
    assert found.findings == []
    # Four runs with their policies, and their encoder, without its dataset.
    assert found.records == 6
    assert all(has_policy(run) for run in target.scan("run")[0])


def test_what_lacks_is_added_and_shipped_runs_stay_as_they_are(demo_results, database):
    (encoder,), (run, *others) = (database.scan(kind)[0] for kind in ("encoder", "run"))
    shutil.rmtree(encoder.path)
    shutil.rmtree(run.path)
    manifests = [other.path / "manifest.json" for other in others]
    before = [(file.read_bytes(), file.stat().st_mtime_ns) for file in manifests]
    assert verify(database, 1).findings != []
    assert ship_reference.ship(demo_results, database) == []
    assert verify(database, 1).findings == []
    assert len(database.scan("run")[0]) == 4
    assert [(file.read_bytes(), file.stat().st_mtime_ns) for file in manifests] == before


def test_command_and_checkpoint_are_not_shipped(source, target):
    settings = {**source.scan("run")[0][0].settings, "seed": 7}
    id = f"face_direction/td3/full/s07-{settings_hash(settings)}"
    run = source.create("run", id, settings)
    run.append({}, {"checkpoint.safetensors": b"weights"})
    assert ship_reference.ship(source, target) == [f"{id} is left out: it is unfinished."]
    assert target.find("run", id) is None
    run.finish({"wall_time": 1.0}, {})
    ship_reference.ship(source, target)
    kept = target.find("run", id)
    assert "command" in run.manifest.provenance
    assert "command" not in kept.manifest.provenance
    assert kept.roles() == []


@pytest.mark.parametrize(
    "directory", [None, "/home/ann/out", "see ~/out", "--results=/data/x", r"C:\out"]
)
def test_run_that_is_damaged_or_names_a_directory_is_left_out(source, target, directory):
    run = source.scan("run")[0][0]
    if directory is None:
        (run.path / "policy.safetensors").write_bytes(b"")
    else:
        text = json.loads((run.path / "manifest.json").read_text())
        text["provenance"]["continued"] = [{"at": "now", "changed": {"x": [None, directory]}}]
        (run.path / "manifest.json").write_text(json.dumps(text))
    (note,) = ship_reference.ship(source, target)
    assert run.id in note
    assert ("is damaged" if directory is None else "names a directory") in note
    assert target.find("run", run.id) is None


def test_policies_of_chosen_seeds_are_shipped(demo_results, target):
    assert ship_reference.ship(demo_results, target, policies=[1]) == []
    runs = target.scan("run")[0]
    assert {run.settings["seed"] for run in runs} == {0, 1}
    assert {run.settings["seed"] for run in runs if has_policy(run)} == {1}
    assert verify(target, 1).findings == []


def test_policy_on_different_encoder_is_not_shipped(demo_results, target):
    """An encoder trained on another processor may differ in its last digits."""
    (encoder,) = demo_results.scan("encoder")[0]
    target.create("encoder", encoder.id, encoder.settings).finish({}, {"encoder.json": b"{}"})
    notes = ship_reference.ship(demo_results, target)
    assert len(notes) == 2
    assert all("the shipped encoder is another one" in note for note in notes)
    kept = [run for run in target.scan("run")[0] if has_policy(run)]
    assert {run.settings["representation"] for run in kept} == {"full"}


@pytest.mark.parametrize("representation", ["full", "dae14"])
def test_shipped_policy_equals_policy_of_run(
    database, representation, demo_results, tmp_path, monkeypatch, capsys
):
    shorten_episodes(monkeypatch.setattr)
    cell = f"reference/face_direction/td3/{representation}/s00"
    (name,) = [policy for policy in located.shipped_policies() if policy.startswith(cell)]
    assert find.full_name(Results(shipped()), cell).name == name
    assert find.full_name(Results(shipped()), name[:-4]).name == name
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
def test_ambiguous_name_is_refused_with_choices(database, name, message, refused):
    there = ", ".join(located.shipped_policies())
    assert message.format(name, there) in refused("evaluate", name)


def test_many_choices_are_counted(monkeypatch, refused):
    names = [f"reference/face_direction/td3/full/s{seed:02d}-0" for seed in range(98)]
    monkeypatch.setattr(located, "shipped_policies", lambda: names)
    choices = f"type one of {', '.join(names[:8])} or 90 others"
    assert f"is not unique; {choices} (jbench runs" in refused("evaluate", names[0][:-6])
    assert f"No policy is shipped as reference/x/y; {choices}." in refused(
        "evaluate", "reference/x/y"
    )


def test_run_without_policy_is_refused(database, refused):
    run = database.scan("run")[0][0]
    for name in ("policy.json", "policy.safetensors"):
        (run.path / name).unlink()
    text = json.loads((run.path / "manifest.json").read_text())
    text["files"] = [entry for entry in text["files"] if "policy" not in entry["name"]]
    (run.path / "manifest.json").write_text(json.dumps(text))
    error = refused("evaluate", run.id, results=database.path)
    assert f"The run {run.id} in {database.path} was saved without its policy." in error


def test_missing_shipped_policies_are_reported(tmp_path, monkeypatch, refused):
    monkeypatch.setattr(located, "shipped_results", lambda: Results(tmp_path / "none"))
    error = refused("evaluate", "reference/face_direction/td3/full")
    assert "this version of jbench ships none" in error


@pytest.mark.slow
def test_policies_of_the_package_load():
    results = Results(shipped())
    policies = filter(has_policy, results.scan("run")[0])
    for run in {run.id.rpartition("/")[0]: run for run in policies}.values():  # not of every seed
        found = find.find_policy(results, f"reference/{run.id}", run.settings["task"])
        size = observation_size(run.settings["task"])
        assert np.abs(found.act(np.zeros((3, size), np.float32))).max() <= 1


def test_package_size_is_limited():
    package = Path(ship_reference.__file__).parents[1] / "jbench"
    assert ship_reference.size(package) < ship_reference.LARGEST_PACKAGE
