"""Tests of `jbench schema`: what commands print, and what files contain, fits its schema."""

import json
import shutil
import tomllib
from pathlib import Path

import jsonschema
import pytest

from jbench import names, paper
from jbench.commands.forms import DOCUMENTS, FILES
from jbench.commands.output import DOCUMENT_VERSION
from jbench.store import Results
from jbench.store.shipped import shipped_results
from tests.json_documents import schema_error
from tests.store.store_whole import add_whole_run


def fits(document, name):
    assert schema_error(document, name) is None
    if name in DOCUMENTS:
        assert document["version"] == DOCUMENT_VERSION


@pytest.fixture
def results(demo_results, tmp_path):
    shutil.copytree(demo_results.path, tmp_path / "results")
    return Results(tmp_path / "results")


@pytest.mark.parametrize("name", [*DOCUMENTS, *FILES])
def test_schema_is_valid_and_refuses_unknown_fields(name, run_command):
    code, printed, _ = run_command("schema", name)
    assert code == 0
    jsonschema.Draft202012Validator.check_schema(json.loads(printed))
    # A document with a field that the schema lacks does not fit.
    assert schema_error({"nonsense": 1}, name) is not None


def test_schemas_are_listed(run_command, document):
    assert all(name in run_command("schema")[1] for name in (*DOCUMENTS, *FILES))
    assert document("schema")["schemas"].keys() == {*DOCUMENTS, *FILES}


def test_unknown_schema_is_refused(refused):
    assert "Unknown schema 'trian'; did you mean train?" in refused("schema", "trian")


def test_shipped_manifests_and_matrices_fit():
    results = shipped_results()
    for kind in ("run", "encoder", "evaluation"):
        fits(json.loads(results.scan(kind)[0][0].manifest.to_bytes()), "manifest")
    run = results.scan("run")[0][-1]
    fits(run.settings, "settings-run")
    fits(run.settings["hyperparameters"], f"hyperparameters-{run.settings['algo']}")
    for name in names.SWEEPS:
        file = Path(paper.__file__).parent / "matrices" / f"{name}.toml"
        fits(tomllib.loads(file.read_text()), "matrix")


RUN = "face_direction/td3/full/s00"
QUICK = [
    ("algorithms", ["algorithms", "td3"]),
    ("tasks", ["tasks", "face_direction"]),
    ("datasets", ["datasets"]),
    ("runs", ["runs", "--returns"]),
    ("leaderboard", ["leaderboard"]),
    ("verify", ["verify"]),
    ("repair", ["repair", "--dry-run"]),
    ("merge", ["merge", "OTHER"]),
    ("export-curves", ["export", "--curves", "curves.json"]),
    ("train-dry-run", ["train", "--algo", "td3", "--seeds", "0", "--steps", "1000", "--dry-run"]),
    ("sweep", ["sweep", "smoke", "--dry-run"]),
    ("evaluate", ["evaluate", "random", "--episodes", "1"]),
    ("reproduce", ["reproduce", RUN, "--episodes", "0"]),
    ("report", ["report", "--format", "svg"]),
    ("import", ["import", "--from", "csv", "--seed-column", "seed", "--algo", "mine", "CURVES"]),
]
SLOW = ("train-dry-run", "sweep", "evaluate", "reproduce", "report")


@pytest.mark.parametrize(
    ("name", "typed"),
    [pytest.param(*case, marks=[pytest.mark.slow] * (case[0] in SLOW)) for case in QUICK],
)
def test_document_of_a_command_fits(results, name, typed, run_command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    add_whole_run(Results(tmp_path / "other"), seed=7)
    (tmp_path / "curves.csv").write_text("control_steps,episode_return,seed\n100,5.0,0\n")
    places = {"OTHER": [str(tmp_path / "other")]}
    places["CURVES"] = ["--task", "face_direction", str(tmp_path / "curves.csv")]
    arguments = [part for word in typed for part in places.get(word, [word])]
    where = None if name in ("algorithms", "tasks", "leaderboard") else results.path
    if name == "leaderboard":
        arguments.append(str(results.path))
    _, printed, _ = run_command(*arguments, "--json", results=where)
    fits(json.loads(printed), name)


def test_document_of_a_refusal_fits(run_command):
    code, printed, _ = run_command("runs", "--algo", "dpg", "--json", results="reference")
    assert code == 2
    fits(json.loads(printed), "error")
