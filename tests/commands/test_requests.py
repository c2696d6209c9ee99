"""Tests of invalid requests, help, and the imports and speed of the command line."""

import errno
import inspect
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
from jbench.commands.verbs import PLACEHOLDERS
from jbench.errors import RequestError
from jbench.recording.request import record
from jbench.store import Results
from jbench.studies.matrix import read_matrix
from jbench.sweeps.cell import matrix_cells
from jbench.training import speed
from tests.documentation import ROOT
from tests.store.store_whole import add_whole_run


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("train", "--task", "fly"), "Unknown task 'fly'; choose move_from_origin,"),
        (("train", "--algo", "dqn"), "Unknown algorithm 'dqn'; it needs discrete actions"),
        (("train", "--algo", "lab/own.py:Agent"), "path of a file; type lab.own:Agent."),
        (("train-encoder", "--kind", "lab/own.py:Kind"), "path of a file; type lab.own:Kind."),
        (("evaluate", "lab/own.py:act"), "path of a file; type lab.own:act."),
        (("train", "--algo", "A2C"), "algorithm 'A2C'; use --algo stable_baselines3:A2C"),
        (("train", "--encoder", "vae12x"), "or jbench train-encoder for another kind"),
        (("train", "--set", "ofe.layers=2"), "is for --encoder ofeN, such as ofe12"),
        (("train", "--encoder", "ofe12", "--algo", "ppo"), "of the batched engine, not for ppo"),
        (("train", "--steps", "many"), "type a positive whole number"),
        (("train", "--steps", "999"), "it takes 1000; type 1000 or more"),
        (("train", "--algo", "ppo", "--steps", "5000"), "in each of 8 environments; type 8000"),
        (("train", "--seeds", "9" * 5000), "type seeds like 0-9"),
        (("train", "--algo", "sac", "--settings", "script"), "network; choose published"),
        (("train", "--set", "mirror=true", "--engine", "sb3"), "has no mirror: choose the batched"),
        (("train", "--robots", "3", "--steps", "10000"), "steps must be 12000"),
        (("train", "--encoder-seeds", "each"), "not for --encoder none: leave it out."),
        (("collect", "--task", "gym:Pendulum-v1", "--augment", "1"), "leave --augment out."),
        (("collect", "--seed", "-1"), "'-1': type a whole number, such as 0, 200 or 10k"),
        (("train-dae", "--seed", "x"), "--seed x: type seeds like 0-9"),
        (("train-dae", "--batch", "0"), "batch of dae can't be 0: it should be greater than or"),
        (("train", "--final-episodes", "0"), "'0': type a positive whole number, such as"),
        (("train", "--checkpoint-every", "1m"), "'1m': type a number of at least 0, such as"),
        (("train", "--checkpoint-every", "nan"), "'nan': type a number of at least 0, such as"),
        (("evaluate", "--target-yaw", "left"), "'left': type a number, such as 0.1, 60 or 5e-4"),
        (("train-dae",), "No finished dataset in .*; run jbench collect --results .* first"),
        (("report",), "jbench train"),
        (("report", "--order", "none"), "'--order': 'none' is not one of 'quantile-first'"),
        (("fly",), "No such command 'fly'"),
        (("--env", "x"), "No such option: --env; jbench --help"),
        (("--results", "x", "runs"), "after the command: type jbench runs --results …;"),
        (("train", "--gamma", "1"), "No such option: --gamma; type --set gamma=VALUE instead"),
        (("train", "--n-envs", "2"), "No such option: --n-envs; type --environments instead"),
        (("report", "--gamma", "1"), "No such option: --gamma; jbench report --help"),
        (("train", "--task", "all"), "trains one task; type jbench sweep FILE for several"),
        (("train-vae",), "; type jbench train-encoder --kind vae instead; jbench --help lists"),
        (("import", "a.csv", "--algo", "x"), "Missing options --task and --from; jbench import"),
        (("report", "a.csv"), r"\(a.csv\): type --curves FILE, or --results DIR; jbench"),
        (("encoders",), "; type jbench query 'FROM encoders' instead"),
        (("query",), "Missing argument 'SQL'; jbench query --help lists the options and shows an"),
        (("runs", "--seed", "x"), "--seed x: type seeds like 0-9"),
        (("evaluate", "--target-yaw", "45", "--task", "move_to_position"), "not for move_to_pos"),
        (
            ("evaluate", "random", "--task", "gym:Pendulum-v1", "--states"),
            "Jitterbug only, not of gym:Pendulum-v1: leave --states out.",
        ),
        (
            ("evaluate", "random", "--task", "gym:Pendulum-v1", "--target-yaw", "45"),
            "not for gym:Pendulum-v1: leave it out.",
        ),
        (("export", "--inputs", "observation"), "--inputs is not for minari"),
        (("export", "--accept-changed-code"), "--accept-changed-code is not for minari"),
        (("verify", "--accept-changed-code"), "is for --reevaluate; type both, or neither."),
        (("view", "best"), "Unknown policy 'best'"),
        (("evaluate", "--target-yaw", "nan"), "--target-yaw nan: type degrees from -360 to 360"),
        (("evaluate", "--target-yaw", "1e308"), r"1e\+308: type degrees from -360 to 360, such"),
        (("leaderboard", "reference"), "--results and DIR exclude each other"),
        (("sweep", "smoke", "--address", "here:1"), "are for --executor ray"),
        (("sweep", "smoke", "--executor", "ray", "--device", "cpu"), "type --gpus-per-task"),
        (("sweep", "fig7", "dae12"), "COMPARISON and --max-seeds are for --until-decided."),
        (("sweep", "fig7", "--until-decided", "--seeds", "0-3"), "type --max-seeds, not --seeds"),
        (("sweep", "fig7", "--until-decided", "--max-seeds", "7"), "7: type a multiple of 5."),
        (("sweep", "fig7", "--until-decided", "dae3-script"), "did you mean dae12-script?"),
        (("trian",), r"Did you mean 'train'\? jbench --help lists the commands\."),
        (("train", "--set", "hidden_layers=16"), "can't be 16: it should be a list in brackets."),
    ],
)
def test_invalid_request_prints_one_error_and_exits_with_2(arguments, message, tmp_path, refused):
    # In this process: the console script exits with the code that main returns.
    (tmp_path / "results").mkdir()
    assert re.search(message, refused(*arguments, results=tmp_path / "results"))
    assert not list(tmp_path.rglob("manifest.json"))


def test_train_sweep_and_record_evaluate_at_the_same_steps(tmp_path, document, brief_measurements):
    steps, results = 40_000, Results(tmp_path)
    file = tmp_path / "one.toml"
    file.write_text(f'tasks = ["face_direction"]\nalgos = ["td3"]\nseeds = "3"\nsteps = {steps}')
    ((planned,),) = (cell.runs for cell in matrix_cells(read_matrix(str(file)), results))
    # The name of an algorithm is typed in any case, and full is no encoder.
    command = ("train", "--algo", "TD3", "--encoder", "full", "--seeds", "3", "--steps", "40k")
    (cell,) = document(*command, "--dry-run", results=tmp_path)["configurations"]
    assert cell["runs"] == [planned.id]
    recording = record("face_direction", algo="mine", seed=3, steps=steps, results=tmp_path)
    assert recording._settings.evaluate_every == planned.evaluate_every == 4000


@pytest.mark.parametrize(
    ("arguments", "typed"),
    [
        (("runs", "--results", ""), "--results"),
        (("collect", "--steps", "1000", "--results="), "--results"),
        (("report", "--results", "reference", "--out", ""), "--out"),
        (("export", "face_direction/td3", "--out="), "--out"),
        (("render", "heuristic", "--out="), "--out"),
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


@pytest.mark.parametrize("option", ["--out=~/a.zip", "--results=~"])
def test_home_directory_that_the_shell_has_left_is_refused(option, tmp_path, monkeypatch, refused):
    """A directory of the name ~ is easily taken for the home directory, also by `rm -r ~`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/ada")
    typed = option.partition("=")[2]
    expected = f"{typed}: your shell has left the ~ as it is; type /home/ada{typed[1:]};"
    assert expected in refused("archive", option)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ("query", "SELECT 1"),
        ("runs",),
        ("datasets",),
        ("verify",),
        ("repair",),
        ("report",),
        ("reproduce", "face_direction/x"),
        ("report", "--reference"),
        ("report", "--watch"),
        ("report", "--compare", "engine=sb3", "engine=batched"),
        ("archive",),
    ],
)
def test_missing_results_directory_is_refused(arguments, tmp_path, refused):
    missing = tmp_path / "missing"
    error = refused(*arguments, results=missing)
    assert error.startswith(f"Error: {missing} does not exist; name another directory, such")
    assert not missing.exists()


@pytest.mark.parametrize(
    "arguments",
    [("runs",), ("report",), ("verify",), ("archive",), ("query", "FROM runs"), ("doctor",)],
)
def test_directory_of_runs_is_refused(arguments, tmp_path, refused):
    record = tmp_path / "runs" / "face_direction"
    record.mkdir(parents=True)
    (record / "manifest.json").touch()
    error = refused(*arguments, results=tmp_path / "runs")
    assert f"is inside the results directory {tmp_path}; type {tmp_path} instead." in error


@pytest.mark.slow
def test_query_of_published_curves_needs_no_results_and_is_cut(
    tmp_path, document, capsys, monkeypatch
):
    missing = tmp_path / "missing"
    sql = "SELECT count(DISTINCT task) AS tasks FROM published"
    assert document("query", sql, results=missing) == [{"tasks": 5}]
    assert not missing.exists()
    assert main(["query", "FROM published LIMIT 101", "--results", "reference"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("101 rows, the first 100 shown; --csv prints all")
    assert printed.count("vector-exact") == 100
    # JSON and a list are cut, and a sentence is not.
    for sql, shown in (
        ("'{" + "x" * 80 + "'", "{" + "x" * 78 + "…"),
        ("range(1500)", f"{str([*range(30)])[:79]}…"),
        ("[1, NULL]", "[1, None]"),
        ("'" + "x" * 81 + "'", "x" * 81),
    ):
        monkeypatch.setenv("COLUMNS", "100")
        assert main(["query", f"SELECT {sql} AS long FROM published LIMIT 1"]) == 0
        printed = capsys.readouterr().out
        assert printed.startswith("1 row; --csv prints long texts whole") == ("…" in shown)
        assert shown in printed


@pytest.mark.parametrize("verb", ["collect", "train-dae", "train", "report"])
def test_results_directory_that_is_file_is_refused(verb, tmp_path, refused):
    path = tmp_path / "results"
    path.write_text("mine")
    assert "is a file" in refused(verb, results=path)
    assert path.read_text() == "mine"


def test_help_has_full_sentence_and_valid_example_per_command(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main([]) == main(["--help"]) == 0
    listed = capsys.readouterr().out
    assert "…" not in listed
    assert listed.index("│ train ") < listed.index("Policies") < listed.index("│ render ")
    commands = get_command(app).commands
    for name in commands.keys() - {"train-agent"}:
        assert main([name, "--help"]) == 0
        example = commands[name].epilog.removeprefix("Example: ")
        printed = capsys.readouterr().out
        assert example[:60] in printed
        # No placeholder repeats the end of an option's name where it says nothing, and no type of
        # Python stands beside an argument.
        assert not re.search(r"<\w|  (FROM|EVERY|TASK \[|LAST)\b|\[x", printed)
        assert "\n" not in commands[name].help.replace("\n\n", "")  # the terminal breaks lines
        program, verb, *arguments = shlex.split(example)
        assert (program, verb) == ("jbench", name)
        # Raises an error for an unknown option.
        commands[name].make_context(name, arguments)


@pytest.mark.parametrize(
    ("text", "steps"), [("100k", 1e5), ("5M", 5e6), ("1.5m", 1.5e6), ("5e6", 5e6), ("1_000", 1e3)]
)
def test_counts_with_suffix_are_parsed(text, steps):
    assert parsing.count(text) == steps


def test_every_whole_number_of_every_verb_is_typed_in_one_way():
    options = 0
    for verb, command in get_command(app).commands.items():
        _, _, *example = shlex.split(command.epilog.removeprefix("Example: "))
        types = inspect.signature(command.callback, eval_str=True).parameters
        for option in command.params:
            if types[option.name].annotation in (int, int | None):
                context = command.make_context(verb, [*example, option.opts[0], "1k"])
                assert context.params[option.name] == 1000, (verb, option.opts)
                options += 1

    assert options > 30


def test_seeds_may_be_as_large_as_the_database_holds():
    largest = 2**63 - 1
    assert parsing.count(str(largest), least=0, most=largest) == largest
    with pytest.raises(BadParameter, match=f"type a whole number up to {largest}"):
        parsing.count(str(largest + 1), least=0, most=largest)


@pytest.mark.parametrize(
    "text", ["k", "1.5", "0.0001k", "1kk", "-5M", "nan", "inf", "1e300M", "1e999999M", ""]
)
def test_invalid_counts_are_refused(text):
    with pytest.raises(BadParameter, match="type a positive whole number"):
        parsing.count(text)


def test_task_of_another_robot_is_known_before_it_has_runs(tmp_path):
    pendulum = "gym:Pendulum-v1"
    assert parsing.known_or_held("task", pendulum, [Results(tmp_path)]) == pendulum
    with pytest.raises(RequestError, match="Unknown task 'gym:Pendulums-v1'"):
        parsing.known_or_held("task", "gym:Pendulums-v1", [Results(tmp_path)])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("runs", "--task", "fly"), "Unknown task 'fly'"),
        (("runs", "--fly"), "No such option: --fly"),
        (("query", "SELECT nothing"), "nothing"),
        (("query", "SELECT 1", "--csv"), "exclude each other"),
    ],
)
def test_json_of_failed_command_is_its_error(arguments, message, tmp_path, capsys):
    assert main([*arguments, "--json", "--results", str(tmp_path)]) == 2
    printed = capsys.readouterr()
    document = json.loads(printed.out)
    assert list(document) == ["version", "error"]
    assert message in document["error"]
    assert printed.err == f"Error: {document['error']}\n"


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="unpacked from an archive")
def test_version_of_a_checkout_has_its_revision(capsys):
    assert main(["--version"]) == 0
    version, revision = re.fullmatch(
        r"jbench (\S+) \((\S+?)(?:-dirty)?\)\n", capsys.readouterr().out
    ).groups()
    commits = [f"{name}^{{commit}}" for name in (revision, "HEAD")]
    parsed = subprocess.check_output(["git", "-C", ROOT, "rev-parse", *commits], text=True)
    assert (version, len({*parsed.split()})) == (__version__, 1)


RUNS_COMMANDS = """
import json, sys
import jbench
from jbench.cli import main
codes = [main(arguments) for arguments in json.loads(sys.argv[1])]
print(json.dumps([codes, list(sys.modules)]))
"""


@pytest.mark.parametrize(
    ("verbs", "permitted"),
    [
        (("--version", "--help", "--help"), set()),
        (("train --help", "runs --help", "report --help"), {"pydantic"}),
        (("runs", "verify", "repair"), {"numpy", "pandas", "pyarrow", "pydantic"}),
    ],
)
def test_commands_import_no_library_that_they_do_not_need(verbs, permitted, demo_results):
    where = ["--results", str(demo_results.path)] if "numpy" in permitted else []
    typed = json.dumps([[*verb.split(), *where] for verb in verbs])
    printed = subprocess.check_output([sys.executable, "-c", RUNS_COMMANDS, typed], text=True)
    codes, modules = json.loads(printed.splitlines()[-1])
    heavy = {"torch", "mujoco", "gymnasium", "duckdb", "matplotlib", "numpy", "pandas", "pyarrow"}
    heavy |= {"pydantic"}
    assert (codes, (heavy - permitted) & set(modules)) == ([0, 0, 0], set())


def test_completion_of_a_verb_imports_no_settings():
    typed = {"COMP_WORDS": "jbench tra", "COMP_CWORD": "1", "_JBENCH_COMPLETE": "complete_bash"}
    completed = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "jbench"],
        env={**os.environ, **typed},
        capture_output=True,
        text=True,
    )
    assert completed.stdout.split() == ["train-dae", "train-encoder", "train"]
    imported = {line.rsplit("|", 1)[-1].strip() for line in completed.stderr.splitlines()}
    # typer's own adapters import pydantic here.
    assert not imported & {"torch", "numpy", "jbench.settings", "jbench.commands.train"}


def test_flags_have_no_placeholder(run_command):
    for arguments in (("--help",), ("runs", "--help")):
        code, out, _ = run_command(*arguments)
        assert (code, "<bool>" in out, "--help" in out) == (0, False, True)


def test_placeholders_are_of_options_and_say_what_to_type(run_command):
    _, out, _ = run_command("sweep", "--help")
    assert re.search(r"--gpus-per-task +GPUS", out)
    assert re.search(r"--checkpoint-every +SECONDS", out)
    commands = get_command(app).commands.values()
    flags = {flag for command in commands for option in command.params for flag in option.opts}
    assert {*PLACEHOLDERS} <= flags


WORKS = """
import sys
from jbench.cli import main
for arguments in (["collect", "--steps", "2000"], ["train-dae", "--epochs", "1", "--latent", "2"]):
    assert main(arguments) == 0
# An update rule with autograd, as a worker trains it.
from jbench.agents.batched import autograd
print(*(name for name in ("torch._dynamo", "triton") if name in sys.modules))
"""


@pytest.mark.slow
def test_compiler_of_torch_is_not_imported(tmp_path):
    """Its triton ends the process if MuJoCo's renderer has loaded another LLVM before."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", WORKS], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == ""


def test_completion_imports_no_heavy_library():
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
        ("train --results {0} --encoder face_direction/", ["face_direction/dae14/s00-99f840bb"]),
        ("train-dae --results {0} --dataset r", ["random/s00-"]),
        ("train --set l", ["last_layer_bound=", "learning_rate=", "learning_starts="]),
        ("train-dae --set l", []),
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


def test_dry_run_of_train_shows_time_left_and_trains_nothing(
    tmp_path, document, brief_measurements, monkeypatch
):
    monkeypatch.setattr(speed, "stepping", lambda *_, **__: 0.001)
    one = ("--algo", "td3", "--seed", "3", "--steps", "1000")
    forecast = document("train", "--dry-run", *one, results=tmp_path)
    (cell,) = forecast["configurations"]
    assert (cell["missing"], cell["steps_left"], cell["algo"]) == (1, 1000, "td3")
    # Evaluations take no longer than the training, so that no share of them is named.
    assert cell["evaluating"] == 0
    # Ten episodes of evaluation, and one of random actions before the first update.
    ten = document("train", "--dry-run", *one, "--evaluate-episodes", "10", results=tmp_path)
    assert ten["configurations"][0]["evaluating"] == pytest.approx(10 / 11)
    # One run keeps one process busy.
    assert forecast["seconds_left"] == pytest.approx(cell["seconds_left"])
    assert (forecast["seconds_left"] > 0, cell["estimate"]) == (True, "a quick measurement")
    # By default, it trains the paper's experiment on one task.
    (cell,) = document("train", "--dry-run", results=tmp_path)["configurations"]
    assert (cell["missing"], cell["steps_left"]) == (10, 50_000_000)
    assert all(run.startswith("face_direction/ddpg/full/s0") for run in cell["runs"])
    assert not list(tmp_path.iterdir())


def test_dry_run_of_class_says_when_its_time_is_known(tmp_path, capsys):
    arguments = ["--algo", "stable_baselines3:A2C", "--seed", "0", "--steps", "1000"]
    assert main(["train", "--dry-run", *arguments, "--results", str(tmp_path)]) == 0
    assert ": unknown until each configuration has a finished run." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("typed", "package"),
    [(["report"], "jbench"), (["export", "--format", "croissant"], "mlcroissant")],
)
def test_output_beside_results_that_are_mounted_read_only_hints_at_out(
    typed, package, tmp_path, monkeypatch, refused
):
    pytest.importorskip(package)
    add_whole_run(Results(tmp_path), [10.0, 20.0, 60.0])

    def mkdir(path, **options):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr("jbench.store.files.Path.mkdir", mkdir)
    error = refused(*typed, results=tmp_path)
    says = "(Read-only file system); name a directory that you may write to by --out."
    assert error.count("\n") == 1
    assert says in error


def test_training_in_directory_without_permission_is_refused(tmp_path, monkeypatch, refused):
    # Root may write everywhere but in a file system that is mounted read-only.
    monkeypatch.setattr("jbench.store.files.os.access", lambda path, mode: not mode & os.W_OK)
    short = ("--steps", "1000", "--seeds", "0-1", "--set", "hidden_layers=[4]")
    error = refused("train", *short, results=tmp_path)
    assert "s00-" in error
    assert "is not writable; name a directory that you may write to." in error
    assert not list(tmp_path.rglob("manifest.json"))


def test_sweep_of_runs_too_short_to_learn_prints_one_warning(tmp_path, capsys):
    matrix = tmp_path / "short.toml"
    matrix.write_text('tasks = ["face_direction", "move_to_pose"]\nalgos = ["td3"]\nsteps = 5000')
    assert main(["sweep", str(matrix), "--dry-run", "--results", str(tmp_path)]) == 0
    (warning,) = [line for line in capsys.readouterr().err.splitlines() if "Warning" in line]
    assert "after 11,000 control steps, so a run of 5,000 learns nothing" in warning
    assert "[hyperparameters.td3]" in warning


def test_sweep_with_a_precision_that_the_device_lacks_is_refused(tmp_path, refused):
    matrix = tmp_path / "tf32.toml"
    matrix.write_text('tasks = ["move_to_pose"]\nalgos = ["td3"]\nprecision = "tf32"')
    results = tmp_path / "results"
    assert "Only a GPU has" in refused("sweep", str(matrix), "--device", "cpu", results=results)
    assert not results.exists()


PARTS = """
tasks = ["face_direction", "move_to_pose"]
algos = ["td3"]
steps = 1000
hyperparameters.td3.hidden_layers = [4]
evaluation.episodes = 0

[[part]]
name = "usual"

[[part]]
name = "slow"
hyperparameters.td3.tau = 0.001
"""


def test_sweep_of_some_parts_shows_only_their_runs(tmp_path, refused, capsys):
    matrix = tmp_path / "parts.toml"
    matrix.write_text(PARTS)
    typed = ["sweep", str(matrix), "--only", "move_to_pose,slow", "--seeds", "0-1", "--status"]
    assert main([*typed, "--json", "--results", str(tmp_path)]) == 0
    (row,) = json.loads(capsys.readouterr().out)["configurations"]
    shown = (row["task"], row["part"], row["changed"], row["missing"])
    assert shown == ("move_to_pose", "slow", "hidden_layers=[4], tau=0.001", 2)

    error = refused("sweep", str(matrix), "--only", "slwo", results=tmp_path)
    assert "Unknown part, task, algorithm or representation 'slwo'; did you mean slow?" in error
    error = refused("sweep", "authors", "--only", "raw", "--until-decided", results=tmp_path)
    assert "name them, without --only" in error
