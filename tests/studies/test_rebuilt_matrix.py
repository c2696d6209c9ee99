"""Tests that the written matrix and commands train the recorded runs again: the same ids."""

import shlex
import tomllib

import pytest
from typer.main import get_command

from jbench.agents.algorithms import choose_engine
from jbench.cli import app
from jbench.commands import parsing
from jbench.settings.recorded import read_run
from jbench.settings.run import TYPED
from jbench.store import Results
from jbench.store.shipped import shipped_results
from jbench.studies.commands import commands
from jbench.studies.file import read_file
from jbench.studies.matrix import read_matrix
from jbench.studies.rebuilt_matrix import matrix_text
from jbench.sweeps.cell import all_runs, matrix_cells
from jbench.training.request import request_runs
from jbench.typed_values import in_ranges, parse_numbers

VARIED = [
    {"algo": "td3", "seeds": range(3)},
    {"algo": "td3", "seeds": range(3), "task": "move_to_pose"},
    {"algo": "td3", "seeds": [7], "overrides": {"policy_delay": 3, "hidden_layers": [64, 64]}},
    {"algo": "td3", "seeds": [0, 1], "engine": "sb3"},
    {"algo": "sac", "seeds": [0, 4], "encoder": "ofe12", "overrides": {"ofe.layers": 3}},
    {"algo": "ddpg", "seeds": [2], "base": "figure8", "evaluate_every": 7000},
    {"algo": "ddpg", "seeds": [2], "task": "dmc:cartpole-balance", "evaluate_episodes": 3},
    {"algo": "ppo", "seeds": [1], "time_limit": "terminal", "augment": 5, "robots": 2},
    {"algo": "jbench.rules:SAC", "seeds": [1], "overrides": {"ent_coef": 0.2}},
    # That of stable-baselines3 is no bound of the change of a value: null, which TOML lacks.
    {"algo": "ppo", "seeds": [1], "base": "sb3"},
]


def made(directory):
    """Returns the settings of runs of many kinds."""
    runs = []
    for changes in VARIED:
        usual = {
            "task": "face_direction",
            "encoder": "none",
            "base": None,
            "overrides": {},
            "steps": 32_000,
            "evaluate_every": None,
            "evaluate_episodes": 10,
        }
        runs += request_runs(Results(directory), **{**usual, **changes})
    return runs


def runs_by_matrix(text, results, path):
    """Returns the ids of the runs of a matrix file."""
    path.write_text(text)
    return {run.id for run in all_runs(matrix_cells(read_matrix(str(path)), results))}


def runs_by_command(line, results):
    """Returns the ids of the runs of a `jbench train` command."""
    program, verb, *words = shlex.split(line)
    assert (program, verb) == ("jbench", "train")
    typed = get_command(app).commands["train"].make_context("train", words).params
    chosen = {name: typed[name] for name in TYPED}
    chosen["engine"] = choose_engine(typed["algo"], chosen["engine"])
    runs = request_runs(
        results,
        **{name: typed[name] for name in ("task", "algo", "encoder", "encoder_seeds")},
        seeds=parsing.seeds(typed["seeds"]),
        base=typed["settings"],
        overrides=parsing.parse_overrides(typed["set_"]),
        **chosen,
    )
    return {run.id for run in runs}


def test_matrix_and_commands_train_runs_of_every_kind(tmp_path):
    runs = made(tmp_path)
    settings = [run.values for run in runs]
    wanted = {run.id for run in runs}
    text = matrix_text(settings, {}, {})
    assert runs_by_matrix(text, Results(tmp_path), tmp_path / "m.toml") == wanted

    typed, rebuilt = commands((each, None) for each in settings)
    assert typed == []
    found = [runs_by_command(line, Results(tmp_path)) for line in rebuilt]
    assert len(found) == len(VARIED)
    assert set().union(*found) == wanted
    assert rebuilt[0] == (
        "jbench train --task face_direction --algo td3 --seeds 0-2 --steps 32000 "
        "--evaluate-every 3000 --evaluate-episodes 10"
    )


@pytest.mark.slow
def test_matrix_and_commands_train_the_shipped_runs(tmp_path):
    results = shipped_results()
    records, _ = results.scan("run")
    encoders = {record.id: record.settings for record in results.scan("encoder")[0]}
    settings = [record.settings for record in records]
    wanted = {record.id for record in records}
    assert (
        runs_by_matrix(matrix_text(settings, encoders, {}), results, tmp_path / "m.toml") == wanted
    )
    _, rebuilt = commands((each, None) for each in settings)
    assert set().union(*(runs_by_command(line, results) for line in rebuilt)) == wanted


def test_encoder_of_each_agent_is_trained_on_its_dataset(tmp_path):
    results = Results(tmp_path / "results")
    typed = (
        "tasks = ['face_direction']\nalgos = ['td3']\nrepresentations = ['pca3']\nseeds = '0-1'\n"
        "steps = 20000\nencoder.seed = 'each'\ndataset.steps = 20000\ndataset.seed = 3\n"
    )
    (tmp_path / "typed.toml").write_text(typed)
    (cell,) = matrix_cells(read_matrix(str(tmp_path / "typed.toml")), results)
    settings = [run.values for run in cell.runs]
    encoders = {encoder.id: encoder.values for encoder in cell.encoders}
    assert cell.dataset is not None
    known = {cell.dataset.id: cell.dataset.values}

    text = matrix_text(settings, encoders, known)
    assert runs_by_matrix(text, results, tmp_path / "m.toml") == {run.id for run in cell.runs}
    lost = f"# Encoders learned from {cell.dataset.id}, whose steps are not known: add them."
    assert lost not in text
    assert lost in matrix_text(settings, encoders, {}).splitlines()
    lost = f"# The options of {cell.runs[0].encoder} are not known: add them."
    assert lost in matrix_text(settings, {}, {}).splitlines()


def test_parts_name_shared_values_once_and_tasks_together(tmp_path):
    runs = [run.values for run in made(tmp_path)]
    chosen = [run for run in runs if run["algo"] == "td3" and run["engine"] == "batched"]
    text = matrix_text(chosen, {}, {})
    assert text.count("[[part]]") == 2
    assert text.count("learning_starts") == 1
    assert 'tasks = ["face_direction", "move_to_pose"]' in text


def test_values_that_toml_does_not_have_are_written_as_toml(tmp_path):
    rule = next(run for run in made(tmp_path) if run.algo == "jbench.rules:SAC").values
    unusual = {"bound": None, "bounds": [None, 2.5e-7], "": "null of \u2028"}
    text = matrix_text([{**rule, "hyperparameters": unusual}], {}, {})
    (part,) = tomllib.loads(text)["part"]
    written = {"bound": "null", "bounds": ["null", 2.5e-7], "": "null of \u2028"}
    assert part["hyperparameters"] == {"jbench.rules:SAC": written}

    (tmp_path / "m.toml").write_text(text)
    (part,) = read_file(str(tmp_path / "m.toml"))["part"]
    assert part["hyperparameters"] == {"jbench.rules:SAC": unusual}


def test_recorded_commands_stand_as_typed_and_other_programs_are_comments():
    td3 = read_run({"engine": "cpu", "task": "a\nb", "algo": "x", "representation": "full"})
    assert "# 1 run of a b x full was trained by another program" in matrix_text(
        [td3.values], {}, {}
    )
    words = ["/home/ada/bin/jbench", "train", "--set", "hidden_layers=[8, 8]"]
    loop = ["/home/ada/loop.py", "--fast"]
    made = commands([(td3.values, words), (td3.values, loop), (td3.values, words)])
    assert made.typed == ["jbench train --set 'hidden_layers=[8, 8]'", "python loop.py --fast"]
    assert made.rebuilt == []


@pytest.mark.parametrize("text", ["0", "0-2", "0-1,3,7-9"])
def test_ranges_are_as_they_are_typed(text):
    assert in_ranges(parse_numbers(text)) == text
