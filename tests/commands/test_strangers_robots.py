"""Every command on robots that others wrote: of Gymnasium, of dm_control, and a description."""

import importlib.util
import json

import pytest
from typer.main import get_command

from jbench.cli import app
from jbench.store import Results
from jbench.tasks.find import find_task
from tests.command_line import TRAINING, jbench
from tests.sweep_matrices import TINY_TD3

ROBOTS = {
    "gym:Hopper-v5,max_episode_steps=60": 120,
    "tests.strangers_robots:arm": 120,
    "dmc:cheetah-run": 2000,
}
"""Control steps of a training by task: of models of Gymnasium, Kinova and dm_control."""

WITHOUT_ROBOT = {"algorithms", "doctor", "schema", "demo", "view"}
"""Commands that know no robot, or show the Jitterbug or a window; other tests run these."""

MATRIX = """
tasks = ["{task}"]
algos = ["td3"]
representations = ["full", "pca3"]
seeds = "0"
steps = {steps}
[evaluation]
every = {steps}
episodes = 1
[dataset]
steps = {steps}
"""


class Typed:
    """Types commands in a directory, and notes which."""

    def __init__(self, directory):
        self.directory = directory
        self.verbs = set()

    def __call__(self, verb, *arguments):
        self.verbs.add(verb)
        done = jbench(verb, *map(str, arguments), cwd=self.directory)
        assert done.returncode == 0, (verb, arguments, done.stderr)
        return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("task", ROBOTS)
def test_every_command_takes_the_robot(task, tmp_path):
    steps, typed = ROBOTS[task], Typed(tmp_path)
    about = ("--task", task, "--steps", steps)
    results = Results(tmp_path / "results")

    assert task in typed("tasks", task)
    assert "the same seed gives the same episode" in typed("check", task)
    typed("collect", *about)
    assert task in typed("datasets")
    typed("train-dae", "--task", task, "--latent", 3, "--epochs", 1, "--batch", 64)
    typed("train-encoder", "--task", task, "--kind", "pca", "--latent", 4)
    evaluated = ("--evaluate-episodes", 1, "--evaluate-every", steps)
    for algo, encoder in (("td3", "none"), ("sac", "dae3"), ("ppo", "pca4")):
        chosen = ("--algo", algo, "--encoder", encoder, "--seeds", "0", *TRAINING[algo])
        typed("train", *about, *chosen, *evaluated)
    (tmp_path / "robot.toml").write_text(MATRIX.format(task=task, steps=steps) + TINY_TD3)
    typed("sweep", "robot.toml", "--only", f"{task},td3")

    runs = {record.id.split("/", 1)[1].split("/s")[0]: record for record in results.scan("run")[0]}
    assert {"td3/full", "td3/pca3", "ppo/pca4"} < runs.keys()
    assert len(runs) == 4
    episodes = [record.read("episodes").to_pandas() for record in runs.values()]
    assert all(frame["length"].max() <= find_task(task).episode_steps for frame in episodes)
    run = runs["td3/pca3"].id

    assert run in typed("runs")
    assert run in typed("tail", "--once")
    assert task in typed("query", "SELECT DISTINCT task FROM runs")
    typed("evaluate", "random", "--task", task, "--episodes", 2)
    typed("evaluate", run, "--episodes", 2)
    assert "training: equal" in typed("reproduce", run, "--episodes", 1)
    assert "intact" in typed("verify", "--reevaluate")
    typed("render", run, "--out", "strip.png", "--steps", 12)
    assert (tmp_path / "strip.png").stat().st_size > 1000
    typed("export", run, "--out", "policy.onnx")
    if importlib.util.find_spec("minari"):
        assert "Exported" in typed("export", "--task", task)
    (tmp_path / "curves.csv").write_text("control_steps,episode_return,seed\n9,5.0,0\n19,7.0,0\n")
    csv = ("--from", "csv", "--seed-column", "seed", "--algo", "mine")
    typed("import", *csv, "--task", task, "curves.csv")
    typed("merge", "results", "--results", "merged")
    typed("repair", "--dry-run")
    typed("leaderboard", "merged")
    rows = json.loads(typed("report", "--json", "--format", "png"))["configurations"]
    assert {(row["task"], row["seeds"]) for row in rows if row["seeds"]} == {(task, 1)}
    typed("archive", "--blind", "--out", "robot.zip")

    every = {name for name, verb in get_command(app).commands.items() if not verb.hidden}
    assert typed.verbs == every - WITHOUT_ROBOT
