"""Tests that results of an earlier version (`fixtures/make_results.py`) are read and resumed."""

import json
import shutil
from pathlib import Path

import pytest

from jbench.cli import main
from jbench.encoders.settings import EncoderSettings
from jbench.settings.records import DatasetSettings, EvaluationSettings
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.store.schema import TIMES
from jbench.store.shipped import shipped
from tests.fixtures import make_results
from tests.fixtures.make_results import FINISHED, INTERRUPTED, TRAINING, content, train
from tests.short_episodes import shorten_episodes

FIXTURES = Path(__file__).parent / "fixtures"
SETTINGS = {
    "dataset": DatasetSettings,
    "encoder": EncoderSettings,
    "evaluation": EvaluationSettings,
    "run": RunSettings,
}


@pytest.fixture
def results(tmp_path):
    """A copy, since every reader creates lock files."""
    shutil.copytree(FIXTURES / "results", tmp_path / "results")
    return Results(tmp_path / "results")


def runs(results, status):
    """The runs of the batched engine with a status, by algorithm."""
    return {
        record.settings["algo"]: record
        for record in results.scan("run")[0]
        if record.status == status and record.settings["engine"] == "batched"
    }


@pytest.mark.parametrize("kind", SETTINGS)
def test_ids_of_settings_equal_directory_names(kind, results):
    for database in (results, Results(shipped())):
        for record in database.scan(kind)[0]:
            settings = SETTINGS[kind](**record.settings)
            assert settings.id == record.id
            assert settings.model_dump(mode="json") == record.settings


@pytest.mark.slow
def test_reading_commands_accept_old_results(results, tmp_path, monkeypatch, capsys):
    finished = runs(results, "finished")["sac"].id
    with monkeypatch.context() as patched:
        shorten_episodes(patched.setattr)
        assert main(["evaluate", finished, "--episodes", "1", "--results", str(results.path)]) == 0

    for command in (
        ("runs",),
        ("datasets",),
        ("query", "SELECT run, status FROM runs"),
        ("verify",),
        ("export",),
        ("report", "--format", "svg", "--out", str(tmp_path / "report")),
    ):
        code = main([*command, "--results", str(results.path)])
        assert code == 0, (command, capsys.readouterr().err)
    assert (tmp_path / "report" / "index.html").exists()


@pytest.mark.parametrize("algo", TRAINING)
def test_finished_run_is_skipped(algo, results, capsys):
    record = runs(results, "finished")[algo]
    manifest = (record.path / "manifest.json").read_bytes()
    assert main([*train(algo, FINISHED), "--results", str(results.path)]) == 0
    assert f"{record.id} is already finished; nothing to do." in capsys.readouterr().out
    assert (record.path / "manifest.json").read_bytes() == manifest


@pytest.mark.usefixtures("forked_workers")
@pytest.mark.parametrize(
    "algo",
    ["td3", *(pytest.param(algo, marks=pytest.mark.slow) for algo in ("ddpg", "sac", "ppo"))],
)
def test_interrupted_run_resumes_to_recorded_results(algo, results, monkeypatch, capsys):
    monkeypatch.setattr("jbench.sweeps.scheduler.forecasts", lambda *_: [])
    interrupted = runs(results, "unfinished")[algo]
    before = interrupted.read("episodes").drop(TIMES).to_pylist()
    assert [row["control_steps"] for row in before] == [1000]
    assert main([*train(algo, INTERRUPTED), "--results", str(results.path)]) == 0
    resumed = f"{interrupted.id} was interrupted or failed; it resumes at control step 1,000."
    assert resumed in capsys.readouterr().out
    now = results.find("run", interrupted.id)
    assert now.status == "finished"
    rows = now.read("episodes").drop(TIMES).to_pylist()
    assert [row["control_steps"] for row in rows] == [1000, 2000]
    assert rows[:1] == before
    # Other processors and libraries round differently.
    expected = json.loads((FIXTURES / "expected.json").read_text())
    if expected["processor"] == make_results.this_processor():
        wanted, found = expected["runs"][interrupted.id], content(results, interrupted.id)
        for row, old in zip(found["episodes"], wanted["episodes"], strict=True):
            # Columns that are newer than the fixture are empty.
            newer = {name for name in row if name not in old}
            assert {name: row.pop(name) for name in newer} == dict.fromkeys(newer)
        if algo == "ddpg":
            # The saved policy is now that of the last evaluation, which precedes the last updates.
            assert now.manifest.summary["policy_evaluation"] == 0
            assert found.pop("policy") != wanted.pop("policy")
        assert found == wanted
