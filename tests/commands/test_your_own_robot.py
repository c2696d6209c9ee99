"""The robot of `docs/your-own-robot.md`: as a file, from random data to a report; as a package."""

import json
import shlex
import subprocess
import sys

import pandas as pd
import pytest

import jbench as api
from jbench import task_specs
from jbench.store import Results
from tests.command_line import TRAINING, jbench, succeed, train
from tests.commands.distributions import install, make_importable
from tests.documentation import ROOT, blocks_of, code_of

TASK = "two_poles:balance"


@pytest.mark.slow
def test_robot_of_page_is_collected_encoded_trained_and_reported(tmp_path):
    (tmp_path / "two_poles.py").write_text(code_of("your-own-robot.md", "python"))
    for arguments in (
        ("collect", "--task", TASK, "--steps", "10000"),
        ("train-dae", "--task", TASK, "--latent", "4", "--epochs", "2"),
        train("td3", "full", "--task", TASK),
        train("td3", "dae4", "--task", TASK),
        ("report", "--format", "svg"),
    ):
        done = jbench(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    results = api.open(tmp_path / "results")
    runs = results.runs()
    assert set(zip(runs["task"], runs["representation"], runs["seed"], strict=True)) == {
        (TASK, representation, seed)
        for representation in ("full", "dae4-epochs-2")
        for seed in (0, 1)
    }
    assert runs["evaluation_return"].between(0, 1000).all()
    page = (tmp_path / "results" / "report" / "index.html").read_text()
    assert TASK in page
    assert "solved" not in page  # what counts as solved is known of the Jitterbug's tasks only


def commands_of(part):
    """Returns the commands of the page's block that contains a text, without their comments."""
    text = (ROOT / "docs" / "your-own-robot.md").read_text()
    (block,) = (
        block
        for block in blocks_of("your-own-robot.md", text)
        if block.kind == "sh" and part in block.text
    )
    return [shlex.split(line, comments=True)[1:] for line in block.commands.splitlines()]


@pytest.mark.slow
def test_commands_for_the_stick_of_the_page_run_in_their_order(tmp_path):
    """They train in fewer control steps here; the exported policy then runs without jbench."""
    (tmp_path / "sticks.py").write_text(code_of("your-own-robot.md", "python", "class Stick"))
    shorter = {"100k": "4000", "50k": "1000"}
    for arguments in commands_of("sticks:stick"):
        typed = [shorter.get(each, each) for each in arguments]
        if typed[0] == "train":
            typed += ["--seeds", "0", *TRAINING["sac"]]
        if typed[0] == "report":
            typed += ["--format", "svg"]
        done = jbench(*typed, cwd=tmp_path)
        assert done.returncode == 0, done.stderr

    results = api.open(tmp_path / "results")
    runs = results.runs()
    assert set(runs["representation"]) == {"full", "dae3"}
    files = (tmp_path / "results" / "datasets").rglob("*.parquet")
    steps = pd.concat([pd.read_parquet(file) for file in files])
    falls = int(steps["terminated"].sum())
    assert falls > 50  # the stick falls after some 20 control steps of random actions
    assert falls + int(steps["truncated"].sum()) == steps["episode"].nunique()

    run = next(id for id in runs["run"] if "/dae3/" in id)
    done = jbench("export", run, "--out", "stick.onnx", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    program = code_of("your-own-robot.md", "python", "InferenceSession")
    ran = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    # A control step is worth at most 1, and an episode has 500.
    assert 0 < float(ran.stdout) <= 500


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return install("third_party_task", "your-own-robot.md", "two_poles.py", tmp_path_factory)


@pytest.fixture
def installed(site, monkeypatch):
    make_importable(site, monkeypatch)


@pytest.mark.slow
def test_task_of_a_package_is_trained_and_its_runs_are_reported_without_it(site, tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        make_importable(site, patch)
        succeed(*train("td3", "full", "--task", "two-poles"), results=tmp_path)
        run = min(Results(tmp_path).scan("run")[0], key=lambda record: record.id)
        succeed("evaluate", run.id, "--episodes", "2", results=tmp_path)
    assert (run.status, run.settings["task"]) == ("finished", "two-poles")
    assert run.id.startswith("two-poles/td3/full/s00-")
    assert run.settings["specs"]["parts"] == ["cart", "poles", "velocities"]
    assert run.settings["specs"]["sizes"] == [1, 4, 3]
    assert run.manifest.provenance["task_package"] == "two-poles-robot 1.2"
    (evaluation,) = Results(tmp_path).scan("evaluation")[0]
    returns = evaluation.read("policy_episodes")["episode_return"].to_pylist()
    assert [0 < value < 1000 for value in returns] == [True, True]
    # The package is installed no longer.
    assert run.id in succeed("runs", results=tmp_path).stdout
    succeed("verify", results=tmp_path)
    report = ("report", "--json", "--format", "png")
    rows = json.loads(succeed(*report, results=tmp_path).stdout)["configurations"]
    assert {(row["task"], row["seeds"]) for row in rows} == {("two-poles", 2)}


def test_tasks_of_packages_are_listed(installed, monkeypatch, document):
    monkeypatch.setattr(task_specs, "SUITE_TASKS", ("dmc:cheetah-run",))  # each of 49 is compiled
    # Six of the package's are no tasks: their specifications, their modules or a trial show it.
    printed = document("tasks", code=1)
    tasks = {entry["name"]: entry for entry in printed["tasks"]}
    assert (tasks["two-poles"]["observation_size"], tasks["two-poles"]["action_size"]) == (8, 1)
    assert {"not-finite", "dmc:cheetah-run", "face_direction"} <= set(tasks)
    broken = {entry["name"]: entry["error"] for entry in printed["broken"]}
    refused = {"one-value", "unnamed", "same-names", "missing", "ends-early", "broken"}
    assert set(broken) == refused
    assert "The task missing can't be loaded from own_tasks:Missing" in broken["missing"]
    (task,) = document("tasks", "two-poles")["tasks"]
    assert task["parts"] == {"cart": 1, "poles": 4, "velocities": 3}


@pytest.mark.parametrize(
    "typed",
    [
        ("train", *TRAINING["td3"], "--algo", "td3"),
        ("evaluate", "random"),
        ("collect", "--steps", "1000"),
    ],
    ids=lambda typed: typed[0],
)
def test_task_of_a_package_that_breaks_the_contract_is_refused(installed, typed, tmp_path, refused):
    error = refused(*typed, "--task", "ends-early", results=tmp_path / "results")
    sentence = "its episode terminates at control step 5, and its time limit is not known"
    assert error.startswith(f"Error: jbench can't use the task ends-early: {sentence}")
    assert not (tmp_path / "results").exists()
