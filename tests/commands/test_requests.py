"""Tests of invalid requests, help, and the imports and speed of the command line."""

import json
import os
import re
import shlex
import subprocess
import sys

import pytest
from typer import BadParameter
from typer.main import get_command

from jbench import __version__
from jbench.cli import app, main
from jbench.commands import parsing
from jbench.recording.request import record
from jbench.store import Results
from jbench.sweeps.cell import matrix_cells
from jbench.sweeps.matrix import read_matrix
from jbench.training import speed
from tests.command_line import succeed, wait_until
from tests.documentation import ROOT


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("train", "--task", "fly"), "Unknown task 'fly'; choose move_from_origin,"),
        (("train", "--algo", "dqn"), "Unknown algorithm 'dqn'; it needs discrete actions"),
        (("train", "--algo", "A2C"), "algorithm 'A2C'; use --algo stable_baselines3:A2C"),
        (("train", "--encoder", "vae12x"), "or jbench train-encoder for another kind"),
        (("train", "--set", "ofe.layers=2"), "is for --encoder ofeN, such as ofe12"),
        (("train", "--encoder", "ofe12", "--algo", "ppo"), "of the batched engine, not for ppo"),
        (("train", "--steps", "many"), "type a positive whole number"),
        (("train", "--steps", "999"), "it takes 1000; type 1000 or more"),
        (("train", "--algo", "ppo", "--steps", "5000"), "in each of 8 environments; type 8000"),
        (("train", "--seeds", "3-1"), "type seeds like 0-9"),
        (("train", "--seeds", "9" * 5000), "type seeds like 0-9"),
        (("train", "--algo", "sac", "--settings", "script"), "network; choose published"),
        (
            ("train", "--set", "mirror=true", "--engine", "sb3"),
            "stable-baselines3 has no mirror: choose the batched engine",
        ),
        (("train", "--algo", "sac", "--set", "ent_coef=-1"), "of sac can't be -1: .*or equal to 0"),
        (("train", "--environments", "0"), "Error: environments of the run can't be 0: "),
        (("train", "--robots", "3", "--steps", "10000"), "steps must be 12000"),
        (("train", "--jobs", "-1"), "Invalid value for '--jobs'"),
        (("collect", "--seed", "-1"), "seed of the dataset can't be -1: it should be greater"),
        (("train-dae",), "No finished dataset in .*; run jbench collect --results .* first"),
        (("report",), "jbench train"),
        (("report", "--order", "none"), "'--order': 'none' is not one of 'quantile-first'"),
        (("query", "DROP TABLE runs"), "read-only"),
        (("query", "FROM read_text('/etc/passwd')"), "file system operations are disabled"),
        (("fly",), "No such command 'fly'"),
        (("train", "--gamma", "1"), "No such option: --gamma; type --set gamma=VALUE instead"),
        (("train", "--n-envs", "2"), "No such option: --n-envs; type --environments instead"),
        (("report", "--gamma", "1"), "No such option: --gamma; jbench report --help"),
        (("train", "--task", "all"), "trains one task; type jbench sweep FILE for several"),
        (("collect", "--seed", "x"), "Invalid value for '--seed'"),
        (("train-vae",), "; type jbench train-encoder --kind vae instead; jbench --help lists"),
        (("import", "a.csv", "--algo", "x"), "Missing options --task and --from; jbench import"),
        (
            ("import", "a.csv", "--algo", "x", "--task", "fly"),
            "Missing option '--from'. Choose from",
        ),
        (
            ("report", "a.csv"),
            r"\(a.csv\): type --curves FILE, or --results DIR; jbench",
        ),
        (("encoders",), "; type jbench query 'FROM encoders' instead"),
        (("query",), "Missing argument 'SQL'; jbench query --help lists the options and shows an"),
        (("merge",), "Missing argument 'DIR'"),
        (("runs", "--seed", "x"), "--seed x: type seeds like 0-9"),
        (
            ("evaluate", "--target-yaw", "45", "--task", "move_to_position"),
            "--target-yaw is for tasks with a target direction, not for move_to_position",
        ),
        (("evaluate", "--augment", "-1"), "augment of the evaluation can't be -1"),
        (("export", "--inputs", "observation"), "--inputs is not for minari"),
        (("view", "best"), "Unknown policy 'best'"),
        (("sweep", "smoke", "--address", "here:1"), "are for --executor ray"),
        (("sweep", "smoke", "--gpus-per-task", "1"), "are for --executor ray"),
        (("sweep", "smoke", "--executor", "ray", "--device", "cpu"), "type --gpus-per-task"),
        (("sweep", "smoke", "--device", "tpu"), "Unknown device 'tpu'"),
        (("sweep", "fig7", "dae12"), "COMPARISON and --max-seeds are for --until-decided."),
        (("sweep", "fig7", "--max-seeds", "10"), "--max-seeds are for --until-decided."),
        (("sweep", "fig7", "--until-decided", "--seeds", "0-3"), "type --max-seeds, not --seeds"),
        (("sweep", "fig7", "--until-decided", "--max-seeds", "7"), "7: type a multiple of 5."),
        (("sweep", "fig7", "--until-decided", "--max-seeds", "0"), "0: type a multiple of 5."),
        (("sweep", "fig7", "--until-decided", "dae3"), "'dae3'; did you mean dae12?"),
        (("trian",), r"Did you mean 'train'\? jbench --help lists the commands\."),
        (
            ("train", "--set", "hidden_layers=16"),
            "hidden_layers of ddpg can't be 16: it should be a list in brackets.",
        ),
        (("train", "--set", "tau=abc"), "tau of ddpg can't be 'abc': it should be a valid number."),
    ],
)
def test_invalid_request_prints_one_error_and_exits_with_2(arguments, message, tmp_path, refused):
    # In this process: the console script exits with the code that main returns.
    (tmp_path / "results").mkdir()
    assert re.search(message, refused(*arguments, results=tmp_path / "results"))
    assert not list(tmp_path.rglob("manifest.json"))


def test_train_sweep_and_record_evaluate_at_the_same_steps(tmp_path, capsys):
    steps, results = 40_000, Results(tmp_path)
    file = tmp_path / "one.toml"
    file.write_text(f'tasks = ["face_direction"]\nalgos = ["td3"]\nseeds = "3"\nsteps = {steps}')
    ((planned,),) = (cell.runs for cell in matrix_cells(read_matrix(str(file)), results))
    command = ("train", "--algo", "td3", "--seeds", "3", "--steps", str(steps), "--dry-run")
    assert main([*command, "--results", str(tmp_path), "--json"]) == 0
    typed = json.loads(capsys.readouterr().out)
    assert planned.id in json.dumps(typed)
    recording = record("face_direction", algo="mine", seed=3, steps=steps, results=tmp_path)
    assert recording._settings.evaluate_every == planned.evaluate_every == 4000


@pytest.mark.parametrize(
    ("arguments", "typed"),
    [
        (("runs", "--results", ""), "--results"),
        (("collect", "--steps", "1000", "--results="), "--results"),
        (("report", "--results", "reference", "--out", ""), "--out"),
        (("export", "face_direction/td3", "--out="), "--out"),
        (("leaderboard", ""), "DIR"),
        (("merge", "--results", "results", ""), "DIR"),
        (("import", "--from=csv", "--task=face_direction", "--algo=a", ""), "FILE"),
    ],
)
def test_empty_path_is_refused(arguments, typed, tmp_path, monkeypatch, refused):
    """An unset variable of the shell must not be the working directory."""
    monkeypatch.chdir(tmp_path)
    expected = f"Error: Invalid value for '{typed}': it is empty; type . for the working directory;"
    assert refused(*arguments).startswith(expected)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ("query", "SELECT 1"),
        *(("runs",), ("datasets",), ("verify",), ("report",)),
        ("report", "--reference"),
        ("report", "--watch"),
        ("report", "--compare", "engine=sb3", "engine=batched"),
    ],
)
def test_missing_results_directory_is_refused(arguments, tmp_path, refused):
    missing = tmp_path / "missing"
    error = refused(*arguments, results=missing)
    assert error.startswith(f"Error: {missing} does not exist; name another directory, such")
    assert not missing.exists()


def test_query_of_published_curves_needs_no_results_directory(tmp_path, capsys):
    missing = tmp_path / "missing"
    sql = "SELECT count(DISTINCT task) AS tasks FROM published"
    assert main(["query", sql, "--json", "--results", str(missing)]) == 0
    assert json.loads(capsys.readouterr().out) == [{"tasks": 5}]
    assert not missing.exists()


@pytest.mark.parametrize("verb", ["collect", "train-dae", "train", "report", "query"])
def test_results_directory_that_is_file_is_refused(verb, tmp_path, refused):
    path = tmp_path / "results"
    path.write_text("mine")
    more = ("SELECT 1",) if verb == "query" else ()
    assert "is a file" in refused(verb, *more, results=path)
    assert path.read_text() == "mine"


def test_jbench_without_arguments_prints_help(capsys):
    assert main([]) == 0
    printed = capsys.readouterr()
    assert printed.out.split()[:3] == ["Usage:", "jbench", "[OPTIONS]"]
    assert printed.err == ""


def test_help_has_full_sentence_and_valid_example_per_command(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["--help"]) == 0
    listed = capsys.readouterr().out
    assert "…" not in listed
    assert listed.index("│ train ") < listed.index("Policies") < listed.index("│ render ")
    commands = get_command(app).commands
    for name in commands.keys() - {"train-agent"}:
        assert main([name, "--help"]) == 0
        example = commands[name].epilog.removeprefix("Example: ")
        assert example[:60] in capsys.readouterr().out
        program, verb, *arguments = shlex.split(example)
        assert (program, verb) == ("jbench", name)
        # Raises an error for an unknown option.
        commands[name].make_context(name, arguments)


def test_help_of_train_begins_with_five_options_and_names_their_values(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["train", "--help"]) == 0
    main_options, _, advanced = capsys.readouterr().out.partition("Advanced")
    shown = re.findall(r"^│ (--\S+) +([A-Z]+)  ", main_options, re.M)
    assert [" ".join(option) for option in shown] == [
        *("--task TASK", "--algo ALGO", "--encoder ENCODER"),
        *("--seeds,--seed SEEDS", "--steps STEPS"),
    ]
    assert re.search("--results +DIR", advanced)


@pytest.mark.parametrize(
    ("text", "steps"),
    [
        ("100k", 100_000),
        ("5M", 5_000_000),
        ("1.5m", 1_500_000),
        ("5e6", 5_000_000),
        ("1_000", 1000),
    ],
)
def test_counts_with_suffix_are_parsed(text, steps):
    assert parsing.count(text) == steps


@pytest.mark.parametrize(
    "text", [*("k", "1.5", "0.0001k", "1kk", "-5M", "nan", "inf"), *("1e300M", "1e999999M", "")]
)
def test_invalid_counts_are_refused(text):
    with pytest.raises(BadParameter, match="type a positive whole number"):
        parsing.count(text)


@pytest.mark.slow
def test_algorithm_is_case_insensitive_and_full_means_no_encoder(tmp_path):
    arguments = ("train", "--algo", "TD3", "--encoder", "full", "--steps", "0.1k", "--seeds", "0")
    shortest = ("--set", "hidden_layers=[4]", "--evaluate-episodes", "0", "--jobs", "1")
    done = succeed(*arguments, *shortest, "--json", results=tmp_path, short=True)
    (run,) = json.loads(done.stdout)["runs"]
    assert run.startswith("face_direction/td3/full/s00-")
    assert main(["runs", "--algo", "TD3", "--results", str(tmp_path)]) == 0


@pytest.mark.parametrize(
    ("arguments", "exit_code", "message"),
    [
        (("runs", "--task", "fly"), 2, "Unknown task 'fly'"),
        (("runs", "--fly"), 2, "No such option: --fly"),
        (("query", "SELECT nothing"), 2, "nothing"),
        (("query", "SELECT 1", "--csv"), 2, "exclude each other"),
    ],
)
def test_json_of_failed_command_is_its_error(arguments, exit_code, message, tmp_path, capsys):
    assert main([*arguments, "--json", "--results", str(tmp_path)]) == exit_code
    printed = capsys.readouterr()
    document = json.loads(printed.out)
    assert list(document) == ["error"]
    assert message in document["error"]
    assert printed.err == f"Error: {document['error']}\n"


def test_json_of_failed_verify_is_printed_once(tmp_path, capsys):
    (tmp_path / "runs" / "leftover").mkdir(parents=True)
    (tmp_path / "runs" / "leftover" / "x.parquet").write_bytes(b"x")
    assert main(["verify", "--json", "--results", str(tmp_path)]) == 1
    assert json.loads(capsys.readouterr().out)["findings"]


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="unpacked from an archive")
def test_version_of_a_checkout_has_its_revision(capsys):
    assert main(["--version"]) == 0
    version, revision = re.fullmatch(
        r"jbench (\S+) \((\S+?)(?:-dirty)?\)\n", capsys.readouterr().out
    ).groups()
    commits = [f"{name}^{{commit}}" for name in (revision, "HEAD")]
    parsed = subprocess.check_output(["git", "-C", ROOT, "rev-parse", *commits], text=True)
    assert (version, len({*parsed.split()})) == (__version__, 1)


def test_help_and_completion_import_no_heavy_library():
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
        [sys.executable, "-X", "importtime", "-m", "jbench"],
        env={**os.environ, **typed, "_JBENCH_COMPLETE": "complete_bash"},
        capture_output=True,
        text=True,
    )
    assert completed.stdout.split() == ["move_to_position", "move_to_pose"]
    imported = {line.rsplit("|", 1)[-1].strip() for line in completed.stderr.splitlines()}
    assert not imported & {"torch", "mujoco", "pandas", "numpy", "pyarrow"}


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("evaluate --results {0} face_direction/td3/full/s01", ["face_direction/td3/full/s01-"]),
        ("evaluate reference/face_direction/ddpg/f", ["reference/face_direction/ddpg/full/s0"]),
        ("export --results {0} face_direction/td3/full/s00", ["face_direction/td3/full/s00-"]),
        ("reproduce --results {0} face_direction/td3/dae14/s00", ["face_direction/td3/dae14/s00-"]),
        ("train --results {0} --encoder d", ["dae14"]),
        ("train --results {0} --encoder face_direction/", ["face_direction/dae14/s00-99f840bb"]),
        ("train-dae --results {0} --dataset r", ["random/s00-"]),
        ("train --set l", ["last_layer_bound=", "learning_rate=", "learning_starts="]),
        ("train --algo ppo --set n_ep", ["n_epochs="]),
        ("report --results ref", ["reference"]),
        ("report --results {0}", ["{0}"]),
    ],
)
def test_ids_and_settings_are_completed(words, offered, demo_results, monkeypatch, capsys):
    typed = f"jbench {words.format(demo_results.path)}"
    for name, value in (("WORDS", typed), ("CWORD", str(typed.count(" ")))):
        monkeypatch.setenv(f"COMP_{name}", value)
    monkeypatch.setenv("_JBENCH_COMPLETE", "complete_bash")
    with pytest.raises(SystemExit):
        main([])
    completed = sorted(capsys.readouterr().out.split())
    assert len(completed) == len(offered)
    begins = (begin.format(demo_results.path) for begin in offered)
    assert all(word.startswith(begin) for word, begin in zip(completed, begins, strict=True))


def test_dry_run_of_train_shows_time_left_and_trains_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(speed, "stepping", lambda run: 0.001)
    arguments = ["--algo", "td3", "--seed", "3", "--steps", "1000", "--results", str(tmp_path)]
    assert main(["train", "--dry-run", "--json", *arguments]) == 0
    printed = capsys.readouterr()
    document = json.loads(printed.out)
    (cell,) = document["configurations"]
    assert (cell["missing"], cell["steps_left"], cell["algo"]) == (1, 1000, "td3")
    # Ten episodes of evaluation, and one of random actions before the first update.
    assert cell["evaluating"] == pytest.approx(10 / 11)
    # One run keeps one process busy.
    assert document["seconds_left"] == pytest.approx(cell["seconds_left"])
    assert document["seconds_left"] > 0
    assert "a quick measurement" in printed.err
    assert not list(tmp_path.iterdir())


def test_dry_run_of_class_says_when_its_time_is_known(tmp_path, capsys):
    arguments = ["--algo", "stable_baselines3:A2C", "--seed", "0", "--steps", "1000"]
    assert main(["train", "--dry-run", *arguments, "--results", str(tmp_path)]) == 0
    assert ": unknown until each configuration has a finished run." in capsys.readouterr().out


def test_training_in_directory_without_permission_is_refused(tmp_path, monkeypatch, refused):
    # Root may write everywhere but in a file system that is mounted read-only.
    monkeypatch.setattr("jbench.store.files.os.access", lambda path, mode: not mode & os.W_OK)
    short = ("--steps", "1000", "--seeds", "0-1", "--set", "hidden_layers=[4]")
    error = refused("train", *short, results=tmp_path)
    assert "s00-" in error
    assert "is not writable; name a directory that you may write to." in error
    assert not list(tmp_path.rglob("manifest.json"))


@pytest.mark.slow
def test_train_with_defaults_prints_forecast_first(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "jbench", "train", "--results", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    line = process.stdout.readline()
    # The forecast is printed before a worker writes the first manifest.
    manifests = wait_until(lambda: list(tmp_path.rglob("manifest.json")), process)
    process.kill()
    process.wait()
    assert re.match(
        r"10 runs with 50,000,000 control steps left at about \d+ steps/s, evaluations included, "
        r"\d+ processes at a time: about (\d+ d \d+ h|\d+ h \d+ min)\. "
        r"For less: fewer --steps .*--seeds",
        line,
    )
    # By default, it trains the paper's experiment on one task.
    manifest = json.loads(manifests[0].read_text())
    assert manifest["id"].startswith("face_direction/ddpg/full/s0")
    assert manifest["settings"]["hyperparameters"]["hidden_layers"] == [350, 250]


def test_query_prints_first_rows_and_cuts_long_text(capsys):
    assert main(["query", "FROM published LIMIT 101", "--results", "reference"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("101 rows, the first 100 shown; --csv prints all")
    assert printed.count("vector-exact") == 100
    assert main(["query", "SELECT repeat('x', 81) AS long", "--results", "reference"]) == 0
    assert f"{'x' * 79}…" in capsys.readouterr().out


def test_sweep_of_runs_too_short_to_learn_prints_one_warning(tmp_path, capsys):
    matrix = tmp_path / "short.toml"
    matrix.write_text('tasks = ["face_direction", "move_to_pose"]\nalgos = ["td3"]\nsteps = 5000')
    assert main(["sweep", str(matrix), "--dry-run", "--results", str(tmp_path)]) == 0
    (warning,) = [line for line in capsys.readouterr().err.splitlines() if "Warning" in line]
    assert "after 11,000 control steps, so a run of 5,000 learns nothing" in warning
    assert "[hyperparameters.td3]" in warning


def test_settings_are_listed_with_description_and_source(capsys):
    assert main(["algorithms", "td3"]) == 0
    assert "control steps before the first update; Table 1" in capsys.readouterr().out
