"""The command line as its users type it: in processes of its own, on real physics."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from jbench.cli import main
from jbench.store import Results, schema
from jbench.store.query import load

SMALL = ("--set", "hidden_layers=[8]", "--set", "batch_size=8")
OFF_POLICY = (
    "--set",
    "learning_starts=1000",
    "--set",
    "train_freq=500",
    "--set",
    "gradient_steps=2",
)
TRAINING = {
    "ddpg": (*SMALL, *OFF_POLICY),
    "td3": (*SMALL, *OFF_POLICY),
    "sac": (*SMALL, *OFF_POLICY),
    "ppo": (*SMALL, "--set", "n_envs=2", "--set", "n_steps=256"),
}
COLLECT = ("collect", "--steps", "4000", "--seed", "3")
TRAIN_DAE = ("train-dae", "--latent", "5", "--epochs", "2", "--batch", "64")


# One process runs the pipeline, and every test on what it left.
PIPELINE = pytest.mark.xdist_group("pipeline")


def jbench(*arguments, results=None, cwd=None):
    """Runs the command line; returns the finished process."""
    where = () if results is None else ("--results", str(results))
    return subprocess.run(
        [sys.executable, "-m", "jbench.cli", *arguments, *where],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=300,
    )


def succeed(*arguments, results):
    done = jbench(*arguments, results=results)
    assert done.returncode == 0, done.stderr
    return done


def train(algo, encoder, *more):
    return (
        *("train", "--algo", algo, "--encoder", encoder, "--seeds", "0-1", "--steps", "2000"),
        *("--evaluate-episodes", "1", *TRAINING[algo], *more),
    )


def files(results):
    """Content of every file but locks, whose times say nothing."""
    return {p: p.read_bytes() for p in results.rglob("*") if p.is_file() and p.name != "lock"}


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    """The whole pipeline, once: every algorithm, two seeds, full and encoded."""
    results = tmp_path_factory.mktemp("pipeline") / "results"
    succeed(*COLLECT, results=results)
    succeed(*TRAIN_DAE, results=results)
    for algo in TRAINING:
        for encoder in ("none", "5"):
            succeed(*train(algo, encoder), results=results)
    return results


@PIPELINE
def test_the_pipeline_leaves_every_run_finished(pipeline):
    tables, problems = load(Results(pipeline))
    runs = tables["runs"].to_pandas()
    assert problems == []
    assert len(runs) == 4 * 2 * 2
    assert set(runs["status"]) == {"finished"}
    assert set(runs["representation"]) == {"full", "dae5"}
    assert set(runs["episodes"]) == {2}
    assert (
        runs.groupby(["algo", "representation"])["seed"]
        .apply(list)
        .map(sorted)
        .eq([[0, 1]] * 8)
        .all()
    )


@PIPELINE
def test_the_report_shows_every_cell(pipeline, tmp_path):
    done = succeed("report", "--json", "--out", str(tmp_path / "report"), results=pipeline)
    said = json.loads(done.stdout)
    cells = {(row["algo"], row["representation"], row["seeds"]) for row in said["table"]}
    assert cells == {(algo, rep, 2) for algo in TRAINING for rep in ("full", "dae5")}
    names = {Path(path).name for path in said["files"]}
    assert {"figure9.png", "figure9.svg", "aggregate.parquet", "aggregate.csv"} <= names
    assert {f"comparison-face_direction-{algo}.png" for algo in TRAINING} <= names
    assert all(Path(path).stat().st_size > 0 for path in said["files"])


@PIPELINE
def test_queries_join_what_the_verbs_wrote(pipeline):
    sql = (
        "SELECT representation, count(*) AS episodes FROM episodes JOIN runs USING (run) "
        "GROUP BY representation ORDER BY representation"
    )
    answer = json.loads(succeed("query", sql, "--json", results=pipeline).stdout)
    assert answer == [
        {"representation": "dae5", "episodes": 16},
        {"representation": "full", "episodes": 16},
    ]
    text = succeed("query", sql, "--csv", results=pipeline).stdout
    assert text == "representation,episodes\ndae5,16\nfull,16\n"
    assert "dae5" in succeed("query", sql, results=pipeline).stdout


@PIPELINE
def test_the_same_commands_again_change_nothing_and_say_so(pipeline):
    before = files(pipeline)
    collected = succeed(*COLLECT, results=pipeline)
    trained_dae = succeed(*TRAIN_DAE, results=pipeline)
    trained = succeed(*train("td3", "5"), results=pipeline)
    assert "finished already; nothing to do" in collected.stdout
    assert "finished already; nothing to do" in trained_dae.stdout
    assert "2 of 2 runs are finished already and not repeated; nothing to do" in trained.stdout
    assert files(pipeline) == before


@PIPELINE
def test_only_missing_seeds_are_trained(pipeline):
    done = succeed(*train("ppo", "none"), "--seeds", "0-2", results=pipeline)
    assert "2 of 3 runs are finished already and not repeated." in done.stdout
    assert "1 runs of 2,000 control steps at about" in done.stdout
    runs = load(Results(pipeline)).tables["runs"].to_pandas()
    chosen = runs[(runs["algo"] == "ppo") & (runs["representation"] == "full")]
    assert sorted(chosen["seed"]) == [0, 1, 2]
    (added,) = chosen.loc[chosen["seed"] == 2, "run"]
    # Other tests count two seeds.
    subprocess.run(["rm", "-r", str(pipeline / "runs" / added)], check=True)


@PIPELINE
def test_train_agent_is_train(pipeline):
    done = succeed("train-agent", *train("sac", "none")[1:], results=pipeline)
    assert "nothing to do" in done.stdout


@PIPELINE
def test_json_is_the_only_thing_on_standard_output(pipeline):
    collected = succeed(*COLLECT, "--json", results=pipeline)
    assert json.loads(collected.stdout)["settings"]["steps"] == 4000
    trained = json.loads(succeed(*train("td3", "none"), "--json", results=pipeline).stdout)
    assert trained["failures"] == {}
    assert [run.rsplit("/", 1)[1][:3] for run in trained["runs"]] == ["s00", "s01"]
    encoders = json.loads(succeed(*TRAIN_DAE, "--json", results=pipeline).stdout)["encoders"]
    assert encoders[0]["summary"]["test_mse"] > 0


@PIPELINE
def test_a_damaged_run_is_named_and_all_others_are_reported(pipeline, tmp_path):
    copy = tmp_path / "copy"
    subprocess.run(["cp", "-r", str(pipeline), str(copy)], check=True)
    part = next(copy.glob("runs/face_direction/td3/full/s01-*/episodes-*.parquet"))
    part.write_bytes(part.read_bytes()[:-20])
    done = jbench("report", "--json", results=copy)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    (problem,) = json.loads(done.stdout)["problems"]
    assert part.name in problem
    assert part.parent.relative_to(copy / "runs").as_posix() in problem
    table = json.loads(done.stdout)["table"]
    seeds = {(row["algo"], row["representation"]): row["seeds"] for row in table}
    assert seeds.pop(("td3", "full")) == 1
    assert set(seeds.values()) == {2}
    queried = jbench("query", "SELECT count(*) AS n FROM runs", "--csv", results=copy)
    assert (queried.returncode, queried.stdout) == (1, "n\n15\n")
    assert part.name in queried.stderr


def kill_when(arguments, results, ready):
    """Starts a verb, and kills it and nothing else (SIGKILL) once something is there."""
    process = subprocess.Popen(
        [sys.executable, "-m", "jbench.cli", *arguments, "--results", str(results)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 120
    while not ready():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()


def test_killed_while_collecting_it_reads_and_continues(tmp_path):
    steps = ("collect", "--steps", "27000")
    kill_when(steps, tmp_path, lambda: any(tmp_path.rglob("steps-*.parquet")))
    (row,) = load(Results(tmp_path)).tables["datasets"].to_pylist()
    assert row["status"] == "unfinished"
    assert row["steps_done"] in (0, 25_000)  # a file holds 25 whole episodes
    refused = jbench("train-dae", results=tmp_path)
    assert refused.returncode == 2
    assert "No finished dataset" in refused.stderr
    succeed(*steps, results=tmp_path)
    (row,) = load(Results(tmp_path)).tables["datasets"].to_pylist()
    assert (row["status"], row["steps_done"]) == ("finished", 27_000)
    # A file that the kill left unlisted is gone: every file there is in the manifest.
    listed = {
        entry.name for entry in Results(tmp_path).find("dataset", row["dataset"]).parts("steps")
    }
    assert {path.name for path in tmp_path.rglob("steps-*.parquet")} == listed


def test_killed_while_training_the_database_reads_and_the_run_starts_over(tmp_path):
    arguments = train("td3", "none", "--steps", "6000", "--seeds", "0")
    kill_when(arguments, tmp_path, lambda: any(tmp_path.rglob("manifest.json")))
    (manifest,) = tmp_path.rglob("manifest.json")
    results = Results(tmp_path)
    record = results.find("run", manifest.parent.relative_to(tmp_path / "runs").as_posix())
    assert record.status == "unfinished"
    rows = record.read("episodes", schema.EPISODES)
    assert set(rows["length"].to_pylist()) <= {1000}
    # The worker ends with its parent: the lock is free and nobody writes any more.
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        try:
            with record.lock():
                break
        except Exception:
            time.sleep(0.1)
    done = succeed(*arguments, results=tmp_path)
    assert "was interrupted or failed; it starts over" in done.stdout
    assert results.find("run", record.id).status == "finished"
    assert results.find("run", record.id).rows("episodes") == 6


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("train", "--task", "fly"), "No task 'fly'; there are move_from_origin,"),
        (("train", "--task", "face_direktion"), "did you mean face_direction?"),
        (("train", "--algo", "dqn"), "No algorithm 'dqn'.*ddpg"),
        (("train", "--encoder", "12"), "jbench train-dae --task face_direction --latent 12"),
        (("train", "--encoder", "17"), "1 to 16 latents"),
        (("train", "--encoder", "face_direction/dae12/s00-00000000"), "No encoder face_dir"),
        (("train", "--encoder", "../../etc/passwd"), "is not an id"),
        (("train", "--steps", "-5"), "type a positive whole number"),
        (("train", "--steps", "many"), "type a positive whole number"),
        (("train", "--steps", "999"), "type --steps 1000 or more"),
        (("train", "--algo", "ppo", "--steps", "5000"), "type --steps 8000 or more"),
        (("train", "--seeds", "3-1"), "type seeds like 0-9"),
        (("train", "--seeds", "a"), "type seeds like 0-9"),
        (("train", "--set", "speed=2"), "ddpg has no setting speed; it has"),
        (("train", "--set", "tau=2"), "tau of ddpg can't be 2"),
        (("train", "--settings", "mine"), "No value of --settings 'mine'"),
        (("train", "--time-limit", "never"), "No value of --time-limit 'never'"),
        (("train", "--evaluate-episodes", "-1"), "evaluate_episodes of the run can't be -1"),
        (("train", "--jobs", "-1"), "type 0 for one on each core"),
        (("collect", "--steps", "1500"), "type --steps 2000"),
        (("collect", "--steps", "0"), "type a positive whole number"),
        (("collect", "--seed", "-1"), "type a whole number from 0 up"),
        (("train-dae",), "No finished dataset in .*; run jbench collect first"),
        (("train-dae", "--task", "fly"), "No task 'fly'"),
        (("train-dae", "--dataset", "random/s00-00000000"), "run jbench collect first"),
        (("report",), "jbench train"),
        (("report", "--order", "none"), "No value of --order 'none'"),
        (("query", "DROP TABLE runs"), "read-only"),
        (("query", "FROM read_text('/etc/passwd')"), "file system operations are disabled"),
        (("query", "SELECT 1", "--csv", "--json"), "exclude each other"),
        (("fly",), "No such command 'fly'"),
        (("collect", "--stepz", "1"), "No such option: --stepz"),
        (("collect", "--seed", "x"), "Invalid value for '--seed'"),
    ],
)
def test_a_wrong_request_gets_one_sentence_and_exit_code_2(arguments, says, tmp_path, capsys):
    # In this process: what the console script does is to exit with what main returns.
    assert main([*arguments, "--results", str(tmp_path / "results")]) == 2
    printed = capsys.readouterr()
    assert re.search(says, printed.err), printed.err
    assert printed.err.startswith("Error: ")
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert not list(tmp_path.rglob("manifest.json"))


@PIPELINE
@pytest.mark.parametrize(("latent", "says"), [("17", "type --latent 1 to 16"), ("0", "can't be 0")])
def test_latents_outside_the_observation_are_refused(pipeline, latent, says, capsys):
    assert main(["train-dae", "--latent", latent, "--results", str(pipeline)]) == 2
    assert says in capsys.readouterr().err


@PIPELINE
def test_an_encoder_of_another_task_is_refused(pipeline, capsys):
    (row,) = load(Results(pipeline)).tables["encoders"].to_pylist()
    wanted = ("train", "--task", "move_to_pose", "--encoder", row["encoder"])
    assert main([*wanted, "--results", str(pipeline)]) == 2
    assert "is for face_direction, not for move_to_pose" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["collect", "train-dae", "train", "report", "query"])
def test_a_results_directory_that_is_a_file_is_refused(verb, tmp_path, capsys):
    place = tmp_path / "results"
    place.write_text("mine")
    more = ("SELECT 1",) if verb == "query" else ()
    assert main([verb, *more, "--results", str(place)]) == 2
    assert "is a file" in capsys.readouterr().err
    assert place.read_text() == "mine"


def test_a_results_directory_that_can_not_be_written_is_refused(tmp_path):
    # /proc refuses directories even to root, whom permissions do not stop.
    done = jbench("collect", "--steps", "1000", results="/proc/jbench")
    assert done.returncode == 2
    assert "can't be made" in done.stderr


def test_help_and_completion_import_nothing_heavy():
    script = (
        "import sys\n"
        "from jbench.cli import main\n"
        "code = main(sys.argv[1:])\n"
        "heavy = {'torch', 'mujoco', 'pandas', 'numpy', 'pyarrow', 'duckdb', 'matplotlib'}\n"
        "print(sorted(heavy & set(sys.modules)), code)\n"
    )
    for arguments in (["--help"], ["train", "--help"], ["--version"]):
        done = subprocess.run(
            [sys.executable, "-c", script, *arguments], capture_output=True, text=True
        )
        assert done.stdout.splitlines()[-1] == "[] 0"
    typed = {"COMP_WORDS": "jbench train --task move_to", "COMP_CWORD": "3"}
    completed = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "jbench.cli"],
        env={**os.environ, **typed, "_JBENCH_COMPLETE": "complete_bash"},
        capture_output=True,
        text=True,
    )
    assert completed.stdout.split() == ["move_to_position", "move_to_pose"]
    imported = {line.rsplit("|", 1)[-1].strip() for line in completed.stderr.splitlines()}
    assert not imported & {"torch", "mujoco", "pandas", "numpy", "pyarrow"}


def test_the_defaults_say_within_seconds_how_long_they_take(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "jbench.cli", "train", "--results", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    line = process.stdout.readline()
    process.kill()
    process.wait()
    assert re.match(
        r"10 runs of 5,000,000 control steps at about \d+ steps/s each, .* at a time: about \d+ d "
        r"\d+ h\. For less: fewer --steps .*--seeds",
        line,
    )
    # What it had begun is the paper's experiment on one task.
    manifest = json.loads(next(tmp_path.rglob("manifest.json")).read_text())
    assert manifest["id"].startswith("face_direction/ddpg/full/s0")
    assert manifest["settings"]["hyperparameters"]["hidden_layers"] == [350, 250]
