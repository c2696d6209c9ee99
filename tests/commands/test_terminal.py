"""Tests of what a terminal shows and takes: Ctrl-C, characters, notes and hints."""

import os
import re
import signal
import subprocess
import sys

import pytest

from jbench.commands import output, parsing
from jbench.store import Results
from tests.command_line import wait_until
from tests.training.small_runs import small_run

WITHOUT_EVALUATIONS = {"steps": 1000, "evaluate_every": 1000, "evaluate_episodes": 0}


def test_ctrl_c_ends_the_loop_of_a_shell(tmp_path):
    script = f"for i in 1 2 3; do {sys.executable} -m jbench collect --steps 500000; done; echo on"
    shell = subprocess.Popen(
        ["bash", "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A background process of a script ignores it.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        wait_until(lambda: any(tmp_path.rglob("manifest.json")), shell)
        os.killpg(shell.pid, signal.SIGINT)
        said, errors = shell.communicate(timeout=120)
    finally:
        shell.kill()
    assert "on" not in said.split()
    assert errors.count("Stopped. ") == 1
    assert re.search(r"kept( yet)?; the same command (continues there|begins again)\.", errors)
    assert shell.returncode in (-signal.SIGINT, 130)


_ENCODINGS = ["ascii", "latin-1", "cp1252"]


@pytest.mark.parametrize(
    ("encoding", "commands"),
    [("ascii", 2), *(pytest.param(name, 4, marks=pytest.mark.slow) for name in _ENCODINGS)],
)
def test_characters_that_a_pipe_lacks_are_replaced(encoding, commands, tmp_path):
    place = tmp_path / "Öl-✓-▁"
    run = small_run("td3", {}, **WITHOUT_EVALUATIONS)
    Results(place).create("run", run.id, run.model_dump(mode="json")).fail("✗ über")
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
    for arguments, printed, code in (
        (["runs", "--results", place], run.id, 0),
        (["runs", "--results", tmp_path / "✗"], "Error: ", 2),
        (["query", "SELECT '▁█ é' AS curve", "--csv", "--results", place], "curve", 0),
        (["--help"], "Usage: ", 0),
    )[:commands]:
        done = subprocess.run(
            [sys.executable, "-m", "jbench", *map(str, arguments)],
            env=environment,
            capture_output=True,
        )
        said = (done.stdout + done.stderr).decode(encoding)
        assert printed in said
        assert "UnicodeEncodeError" not in said
        assert done.returncode == code


@pytest.mark.parametrize(
    ("typed", "note"),
    [
        (["--seeds", "3"], "Note: --seeds 3 is the seed 3 alone; type 0-2 for 3 seeds.\n"),
        (["--seeds=1"], "Note: --seeds 1 is the seed 1 alone; type 0 for one seed.\n"),
        (["--seed", "3"], ""),
        (["--seeds", "0"], ""),
        (["--seeds", "2-4"], ""),
    ],
)
def test_number_of_seeds_is_noted(typed, note, monkeypatch, capsys):
    monkeypatch.setattr(output, "typed", typed)
    parsing.seeds(typed[-1].rpartition("=")[2])
    assert capsys.readouterr().out == note


def test_counts_are_typed_as_steps_are():
    typed = [
        "learning_starts=1k",
        "buffer_size=1.5M",
        "gamma=0.5",
        "hidden_layers=64,64",
        "a=x1k",
        "b=[8,8]",
    ]
    assert parsing.parse_overrides(typed) == {
        "learning_starts": 1000,
        "buffer_size": 1_500_000,
        "gamma": 0.5,
        "hidden_layers": [64, 64],
        "a": "x1k",
        "b": [8, 8],
    }


def test_arguments_of_a_task_stay_with_it_among_names():
    hopper = "gym:Hopper-v5,frame_skip=2,ctrl_cost_weight=0"
    assert parsing.names_of_matrix(f"td3,{hopper},gym:Pendulum-v1, full") == [
        "td3",
        hopper,
        "gym:Pendulum-v1",
        "full",
    ]
    assert parsing.names_of_matrix("td3,g=9.8") == ["td3", "g=9.8"]
    assert parsing.names_of_matrix(None) == []


@pytest.mark.parametrize(
    ("typed", "hint"),
    [
        (["--set", "batch_size", "64"], "type --set batch_size=64; "),
        (["--set", "hidden_layers=[32,", "32]"], "type --set hidden_layers=[32,32]; "),
    ],
)
def test_setting_with_a_space_is_hinted_at(typed, hint, refused):
    assert hint in refused("train", *typed, "--seeds", "0")


def test_failed_runs_are_listed_with_their_errors(tmp_path, run_command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for seed in (0, 1):
        run = small_run("td3", {}, seed=seed, **WITHOUT_EVALUATIONS)
        record = Results(tmp_path).create("run", run.id, run.model_dump(mode="json"))
        if seed:
            record.fail("the agent diverged at control step 500 of episode 7 and so on")
    code, out, _ = run_command("runs", "--failed", results=tmp_path)
    assert code == 0
    assert "1 run\n" in out
    assert re.search(r"the agent diverged\s+at control\s+step 500", out)
    code, _, err = run_command("runs", "--failed", "--status", "finished", results=tmp_path)
    assert (code, "exclude each other" in err) == (2, True)
