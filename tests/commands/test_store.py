"""Tests of the commands on the results database: runs, verify, repair, merge and query."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from jbench.cli import main
from jbench.store import Results
from tests.command_line import jbench
from tests.store.store_rows import alter_manifest, listed
from tests.store.store_whole import add_chain, add_whole_run


@pytest.fixture
def results(tmp_path):
    """Three runs and a chain of a dataset, an encoder, a run and an evaluation."""
    results = Results(tmp_path / "results")
    add_chain(results)
    add_whole_run(results, seed=1)
    add_whole_run(results, [5.0], finish=False, seed=2, algo="sac")
    return results


@pytest.fixture
def run_command(capsys):
    """Returns a function that runs a command: exit code, standard output, standard error."""

    def run(*arguments, results):
        code = main([*arguments, "--results", str(results.path)])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


def damage(run):
    """Removes the last byte of a run's episodes."""
    path = run.path / listed(run)[0]
    path.write_bytes(path.read_bytes()[:-1])
    return path


def test_runs_are_listed_and_filtered(results, run_command):
    code, out, _ = run_command("runs", results=results)
    assert code == 0
    assert "3 runs" in out
    lines = [line.split() for line in out.splitlines() if "/s0" in line]
    assert [line[1] for line in lines] == ["finished", "finished", "unfinished"]
    assert lines[0][2:4] == ["3", "3,000"]
    assert lines[2][2:6] == ["1", "1,000", "of", "3,000"]
    for options, seeds in (
        (("--algo", "sac"), [2]),
        (("--seed", "0-1"), [0, 1]),
        (("--status", "finished", "--representation", "full"), [1]),
        (("--task", "move_to_pose"), []),
    ):
        code, out, _ = run_command("runs", "--json", *options, results=results)
        assert (code, [run["seed"] for run in json.loads(out)["runs"]]) == (0, seeds)


def test_runs_are_filtered_by_kind_of_representation(results, run_command):
    for seed, representation in enumerate(("planar12", "dae12", "dae4")):
        add_whole_run(results, seed=10 + seed, representation=representation)
    for typed, seeds in (("planar", [10]), ("dae", [11, 12]), ("dae4", [12]), ("pca3", [])):
        options = ("--json", "--seed", "10-12", "--representation", typed)
        code, out, _ = run_command("runs", *options, results=results)
        assert (code, sorted(run["seed"] for run in json.loads(out)["runs"])) == (0, seeds)
    listed_as = [
        run_command("runs", "--json", "--representation", name, results=results)[1]
        for name in ("none", "full")
    ]
    assert listed_as[0] == listed_as[1] != ""


def test_runs_with_unknown_names_are_listed(results, run_command):
    add_whole_run(results, seed=5, algo="dqn", task="fly", representation="mine7")
    for options in (("--algo", "dqn"), ("--task", "fly"), ("--representation", "mine7")):
        code, out, _ = run_command("runs", "--json", *options, results=results)
        assert (code, [run["seed"] for run in json.loads(out)["runs"]]) == (0, [5])
    # A known name without runs is not an error.
    for options in (("--algo", "ppo"), ("--representation", "pca3")):
        code, out, _ = run_command("runs", "--json", *options, results=results)
        assert (code, json.loads(out)["runs"]) == (0, [])


@pytest.mark.parametrize("verb", ["runs", "report"])
def test_unknown_name_without_runs_is_refused_with_names_found(verb, results, refused):
    error = refused(verb, "--algo", "dqn", results=results.path)
    assert error == "Error: Unknown algorithm 'dqn'; choose ddpg, ppo, sac or td3.\n"
    error = refused(verb, "--task", "face_direktion", results=results.path)
    assert "did you mean face_direction? Choose" in error


def test_json_of_runs_has_returns_times_and_status(results, run_command):
    _, out, _ = run_command("runs", "--json", "--returns", "--seed", "1", results=results)
    (run,) = json.loads(out)["runs"]
    # The last quarter of three episodes is the last one.
    assert (run["last_return"], run["episodes"], run["wall_time"]) == (60.0, 3, 7.5)
    assert (run["steps_done"], run["steps"], run["status"]) == (3000, 3000, "finished")


def test_failed_runs_are_listed_with_their_errors(results, run_command):
    record = add_whole_run(results, [5.0], finish=False, seed=9)
    record.fail("the critic's loss is not finite")
    _, out, _ = run_command("runs", "--status", "failed", results=results)
    assert "the critic's loss is not finite" in out
    _, out, _ = run_command("runs", "--json", results=results)
    errors = {run["seed"]: run["error"] for run in json.loads(out)["runs"]}
    assert (errors[9], errors[1]) == ("the critic's loss is not finite", None)
    _, out, _ = run_command("tail", "--once", "--seed", "9", results=results)
    assert out.endswith(": failed: the critic's loss is not finite\n")


def test_unreadable_run_is_reported_and_others_listed(results, run_command):
    run = results.scan("run")[0][0]
    (run.path / "manifest.json").write_bytes(b"{")
    code, out, err = run_command("runs", results=results)
    assert code == 1
    assert "2 runs" in out
    assert err.startswith(f"Warning: {run.path}/manifest.json is not a manifest")
    assert "Error: 1 record is damaged and left out; see above. `jbench verify" in err
    assert err.endswith(f"`jbench repair --results {results.path}` sets it aside.\n")


def test_repair_of_missing_results_is_refused(tmp_path, refused):
    missing = tmp_path / "missing"
    assert "missing does not exist; name another" in refused("repair", results=missing)
    assert not missing.exists()


def test_intact_results_are_verified(results, run_command):
    code, out, err = run_command("verify", results=results)
    assert code == 0
    assert out.startswith("Checked 6 records, 8 files, ")
    assert out.endswith(" MB: all of them intact.\n")
    assert "folders" in err
    code, out, _ = run_command("verify", "--json", results=results)
    document = json.loads(out)
    assert (code, document["records"], document["files"], document["findings"]) == (0, 6, 8, [])


def test_damage_is_reported_by_run_and_repaired(results, run_command):
    broken, whole = results.scan("run")[0][:2]
    path = damage(broken)
    (whole.path / ".writing-x").write_bytes(b"left")
    code, out, err = run_command("verify", results=results)
    assert code == 1
    assert f"run {broken.id}\n  {path} is damaged (" in out
    assert f"run {whole.id}\n  {whole.path}/.writing-x is listed by no manifest.\n" in out
    assert "1 damaged, 1 leftover, 1 warning." in out  # the evaluation of the damaged run
    assert f"jbench repair --results {results.path} sets them aside" in err

    code, out, _ = run_command("repair", "--dry-run", results=results)
    assert code == 0
    assert out.endswith("Would set 4 files aside.\n")
    assert path.exists()

    # As a sweep records it for each of its runs.
    alter_manifest(broken, provenance={"command": ["jbench", "sweep", "my matrix.toml"]})
    code, out, err = run_command("repair", "--json", results=results)
    command = "jbench sweep 'my matrix.toml'"
    assert err.endswith(f"To make damaged records again, repeat:\n    {command}\n")
    assert "repair: " in err
    document = json.loads(out)
    assert (code, document["dry_run"], document["left"]) == (0, False, [])
    assert document["commands"] == [command]
    assert len(document["moved"]) == 4
    assert all(Path(moved["to"]).exists() for moved in document["moved"])

    code, out, _ = run_command("repair", results=results)
    assert (code, out) == (0, "Nothing to set aside.\n")
    code, out, _ = run_command("verify", results=results)
    # The evaluation of the run that was set aside is intact; verify warns of it.
    assert (code, "1 warning." in out) == (0, True)


def test_verify_suggests_no_repair_of_newer_versions(results, run_command):
    alter_manifest(results.scan("run")[0][1], schema_version=7)
    code, _, err = run_command("verify", results=results)
    assert (code, "jbench repair" in err) == (1, False)
    assert "Error: Some results can't be checked; see above." in err


def test_merge_reports_copied_equal_and_conflicting_records(tmp_path, results, run_command):
    other, mine = Results(tmp_path / "other"), Results(tmp_path / "mine")
    for path, returns in ((other, [1.0]), (mine, [2.0])):
        add_whole_run(path, returns, seed=5)
    code, out, _ = run_command("merge", str(results.path), results=mine)
    assert code == 0
    assert out == f"Merged into {mine.path}: 6 copied.\n"
    code, out, err = run_command("merge", str(results.path), str(other.path), results=mine)
    assert code == 1
    assert "6 same, 1 refused" in out
    assert "episode_return of episodes" in err
    assert err.endswith("Error: 1 record is refused, see above; the others are merged.\n")
    code, out, _ = run_command("merge", str(results.path), "--json", results=mine)
    assert {record["outcome"] for record in json.loads(out)["records"]} == {"same"}
    code, _, err = run_command("merge", str(tmp_path), results=mine)
    assert (code, "holds no results" in err) == (2, True)


def test_query_prints_all_digits_of_whole_numbers(results, run_command):
    sql = "SELECT 4025000 * sum(length / 1000)::int AS total, 16100000.0::double AS x, 1/3 AS y"
    code, out, _ = run_command("query", f"{sql} FROM episodes WHERE episode < 1", results=results)
    # Three runs have a first episode of 1000 control steps.
    assert (code, out.splitlines()[-2].split()) == (0, ["12075000", "16100000", "0.333333"])


def test_database_commands_import_no_heavy_library(results):
    done = jbench("verify", "--json", results=results.path, short=True)
    assert (done.returncode, json.loads(done.stdout)["findings"]) == (0, [])
    script = (
        "import sys\n"
        "from jbench.cli import main\n"
        "code = main(sys.argv[1:])\n"
        "heavy = {'torch', 'mujoco', 'duckdb', 'matplotlib'}\n"
        "print(sorted(heavy & set(sys.modules)), code, file=sys.stderr)\n"
    )
    for verb in ("runs", "verify", "repair"):
        arguments = [sys.executable, "-c", script, verb, "--results", str(results.path)]
        done = subprocess.run(arguments, capture_output=True, text=True)
        assert done.stderr.splitlines()[-1] == "[] 0", done.stderr
