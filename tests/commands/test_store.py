"""Tests of the commands on the results database: runs, verify, repair, merge and query."""

import json
from pathlib import Path

import pytest

from jbench.store import Results
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


def test_runs_are_listed_and_filtered(results, run_command, document):
    code, out, _ = run_command("runs", results=results.path)
    assert code == 0
    assert "3 runs" in out
    lines = [line.split() for line in out.splitlines() if "/s0" in line]
    assert [line[1] for line in lines] == ["finished", "finished", "unfinished"]
    assert lines[0][2:4] == ["3", "3,000"]
    assert lines[2][2:6] == ["1", "1,000", "of", "3,000"]
    more = {"algo": "dqn", "task": "fly"}  # as another version may have recorded it
    for seed, representation in enumerate(("planar12", "dae13", "dae4", "planar12-whitened"), 10):
        add_whole_run(results, seed=seed, representation=representation, **more)
    for options, seeds in (
        (("--algo", "sac"), [2]),
        (("--seed", "0-1"), [0, 1]),
        (("--status", "finished", "--representation", "full"), [1]),
        (("--status", "finished", "--representation", "none"), [1]),
        # A known name without runs is not an error.
        (("--task", "move_to_pose"), []),
        (("--representation", "pca3"), []),
        (("--task", "fly"), [10, 11, 12, 13]),
        (("--algo", "dqn", "--representation", "planar"), [10]),
        (("--algo", "dqn", "--representation", "planar12"), [10]),
        (("--algo", "dqn", "--representation", "planar-whitened"), [13]),
        (("--algo", "dqn", "--representation", "dae"), [11, 12]),
        (("--algo", "dqn", "--representation", "dae4"), [12]),
    ):
        runs = document("runs", *options, results=results.path)["runs"]
        assert sorted(run["seed"] for run in runs) == seeds


@pytest.mark.parametrize("verb", ["runs", "report"])
def test_unknown_name_without_runs_is_refused_with_names_found(verb, results, refused):
    error = refused(verb, "--algo", "dqn", results=results.path)
    assert error == "Error: Unknown algorithm 'dqn'; choose ddpg, ppo, sac or td3.\n"
    error = refused(verb, "--task", "face_direktion", results=results.path)
    assert "did you mean face_direction? Choose" in error


def test_json_of_runs_has_returns_times_and_status(results, document):
    (run,) = document("runs", "--returns", "--seed", "1", results=results.path)["runs"]
    # The last quarter of three episodes is the last one.
    assert (run["last_return"], run["episodes"], run["wall_time"]) == (60.0, 3, 7.5)
    assert (run["steps_done"], run["steps"], run["status"]) == (3000, 3000, "finished")


def test_failed_runs_are_listed_with_their_errors(results, run_command, document):
    record = add_whole_run(results, [5.0], finish=False, seed=9)
    record.fail("the critic's loss is not finite")
    _, out, _ = run_command("runs", "--status", "failed", results=results.path)
    assert "the critic's loss is not finite" in out
    runs = document("runs", results=results.path)["runs"]
    errors = {run["seed"]: run["error"] for run in runs}
    assert (errors[9], errors[1]) == ("the critic's loss is not finite", None)
    _, out, _ = run_command("tail", "--once", "--seed", "9", results=results.path)
    assert out.endswith(": failed: the critic's loss is not finite\n")


def test_runs_with_a_policy_are_listed(results, run_command, document):
    record = add_whole_run(results, [5.0], finish=False, seed=9)
    record.finish({}, {"policy.json": b"{}", "policy.safetensors": b""})
    runs = document("runs", "--policies", results=results.path)["runs"]
    assert [(run["run"], run["has_policy"]) for run in runs] == [(record.id, True)]
    runs = document("runs", results=results.path)["runs"]
    assert {run["seed"]: run["has_policy"] for run in runs}[1] is False
    code, _, err = run_command("runs", "--policies", "--imports", results=results.path)
    assert (code, err) == (
        2,
        "Error: --imports and --policies exclude each other: imports have no policy.\n",
    )


def test_unreadable_run_is_reported_and_others_listed(results, run_command):
    run = results.scan("run")[0][0]
    (run.path / "manifest.json").write_bytes(b"{")
    code, out, err = run_command("runs", results=results.path)
    assert code == 1
    assert "2 runs" in out
    assert err.startswith(f"Warning: {run.path}/manifest.json is not a manifest")
    assert "Error: 1 record is left out; see above. `jbench verify" in err
    assert err.endswith(f"`jbench repair --results {results.path}` sets aside what is damaged.\n")


def test_damage_is_reported_by_run_and_repaired(results, run_command, document):
    code, out, err = run_command("verify", results=results.path)
    assert (code, "folders" in err) == (0, True)
    assert out.startswith("Checked 6 records, 8 files, ")
    assert out.endswith(" MB: all of them intact.\n")
    broken, whole = results.scan("run")[0][:2]
    path = broken.path / listed(broken)[0]
    path.write_bytes(path.read_bytes()[:-1])
    (whole.path / ".writing-x").write_bytes(b"left")
    code, out, err = run_command("verify", results=results.path)
    assert code == 1
    assert f"run {broken.id}\n  {path} is damaged (" in out
    assert f"run {whole.id}\n  {whole.path}/.writing-x is listed by no manifest.\n" in out
    assert "1 damaged, 1 leftover, 1 warning." in out  # the evaluation of the damaged run
    assert f"jbench repair --results {results.path} sets them aside" in err
    found = document("verify", results=results.path, code=1)
    assert (found["records"], len(found["findings"])) == (6, 3)

    code, out, _ = run_command("repair", "--dry-run", results=results.path)
    assert code == 0
    assert out.endswith("Would set 4 files aside.\n")
    assert path.exists()

    # As a sweep records it for each of its runs.
    alter_manifest(broken, provenance={"command": ["jbench", "sweep", "my matrix.toml"]})
    code, out, err = run_command("repair", "--json", results=results.path)
    command = "jbench sweep 'my matrix.toml'"
    assert err.endswith(f"To make damaged records again, repeat:\n    {command}\n")
    assert "repair: " in err
    done = json.loads(out)
    assert (code, done["dry_run"], done["left"]) == (0, False, [])
    assert done["commands"] == [command]
    assert [Path(moved["to"]).exists() for moved in done["moved"]] == [True] * 4

    code, out, _ = run_command("repair", results=results.path)
    assert (code, out) == (0, "Nothing to set aside.\n")
    code, out, _ = run_command("verify", results=results.path)
    # The evaluation of the run that was set aside is intact; verify warns of it.
    assert (code, "1 warning." in out) == (0, True)


def test_verify_suggests_no_repair_of_newer_versions(results, run_command):
    alter_manifest(results.scan("run")[0][1], schema_version=7)
    code, _, err = run_command("verify", results=results.path)
    assert (code, "jbench repair" in err) == (1, False)
    assert "Error: Some results can't be checked; see above." in err


def test_merge_reports_copied_equal_and_conflicting_records(
    tmp_path, results, run_command, document
):
    other, mine = tmp_path / "other", tmp_path / "mine"
    for path, returns in ((other, [1.0]), (mine, [2.0])):
        add_whole_run(Results(path), returns, seed=5)
    code, out, _ = run_command("merge", results.path, results=mine)
    assert code == 0
    assert out == f"Merged into {mine}: 6 copied.\n"
    code, out, err = run_command("merge", results.path, other, results=mine)
    assert code == 1
    assert "6 same, 1 refused" in out
    assert "episode_return of episodes" in err
    assert err.endswith("Error: 1 record is refused, see above; the others are merged.\n")
    merged = document("merge", results.path, results=mine)["records"]
    assert {record["outcome"] for record in merged} == {"same"}
    code, _, err = run_command("merge", tmp_path, results=mine)
    assert (code, "holds no results" in err) == (2, True)


def test_query_prints_all_digits_of_whole_numbers(results, run_command):
    sql = "SELECT 4025000 * sum(length / 1000)::int AS total, 16100000.0::double AS x, 1/3 AS y"
    code, out, _ = run_command(
        "query", f"{sql} FROM episodes WHERE episode < 1", results=results.path
    )
    # Three runs have a first episode of 1000 control steps.
    assert (code, out.splitlines()[-2].split()) == (0, ["12075000", "16100000", "0.333333"])
