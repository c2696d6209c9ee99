"""Tests of the list of runs: progress from the manifest, last returns on request."""

import pytest

from jbench.settings.algorithms import algorithm_settings
from jbench.store.listing import list_runs
from tests.store.store_rows import alter_manifest, episodes, listed
from tests.store.store_whole import add_whole_run
from tests.store.test_damage import truncate


def listed_ids(results, **expected):
    lines, problems = list_runs(results, expected)
    assert problems == []
    return [line["run"] for line in lines]


def test_finished_and_unfinished_runs_are_listed(results):
    run = add_whole_run(results)
    add_whole_run(results, [5.0], finish=False, seed=1, algo="sac")
    (done, begun), problems = list_runs(results, {})
    assert problems == []
    fields = ("run", "algo", "seed", "status", "episodes", "steps_done", "steps", "wall_time")
    assert [done[name] for name in fields] == [
        *(run.id, "ddpg", 0, "finished", 3, 3000, 3000, 7.5),
    ]
    assert (done["last_return"], done["created"]) == (None, run.manifest.created)
    assert [begun[name] for name in fields[1:]] == ["sac", 1, "unfinished", 1, 1000, 3000, None]


def test_variant_names_settings_that_differ_between_tasks_and_special_ones(results):
    published = algorithm_settings("ddpg", "published").model_dump(mode="json")
    read = {"engine": "batched", "evaluate_every": 20_000, "evaluate_episodes": 10}
    read["hyperparameters"] = published
    changed = {**read, "hyperparameters": {**published, "tau": 0.01}}
    add_whole_run(results, **read)
    add_whole_run(results, seed=1, **changed)
    add_whole_run(results, seed=2, precision="bfloat16", **changed)
    add_whole_run(results, algo="td3", precision="bfloat16", **read)
    lines, _ = list_runs(results, {})
    assert [line["variant"] for line in lines] == [
        "tau=0.001",
        "tau=0.01",
        "bfloat16, tau=0.01",
        "bfloat16",
    ]
    (line,), _ = list_runs(results, {"seed": {1}})
    assert line["variant"] == ""


def test_steps_of_finished_run_are_read_from_summary(results):
    run = add_whole_run(results)
    alter_manifest(run, summary={"steps_done": 4096})
    assert list_runs(results, {})[0][0]["steps_done"] == 4096


@pytest.mark.parametrize(
    ("count", "mean"),
    [
        (0, None),
        (1, 0.0),
        (3, 2.0),
        (8, 6.5),  # a quarter: 6 and 7
        (400, 349.5),  # 300 to 399
        (1000, 949.5),  # 100 at most: 900 to 999
    ],
)
def test_last_return_averages_last_quarter_capped_at_100(results, count, mean):
    add_whole_run(results, [float(n) for n in range(count)], finish=False)
    (line,), _ = list_runs(results, {}, returns=True)
    assert line["last_return"] == mean
    # Two seconds per episode; an unfinished run has no other wall time.
    assert line["wall_time"] == (2.0 * count or None)


def test_run_whose_files_are_joined_meanwhile_is_listed(results, monkeypatch):
    run = add_whole_run(results, [1.0], finish=False)
    run.append({"episodes": episodes(run.id, [1.0, 2.0]).slice(1)})
    before = results.scan("run")
    run.finish({})
    monkeypatch.setattr(results, "scan", lambda kind: before)
    (line,), problems = list_runs(results, {}, returns=True)
    assert (line["status"], line["last_return"], problems) == ("finished", 2.0, [])


def test_damaged_files_are_reported_only_if_read(results):
    run = add_whole_run(results)
    other = add_whole_run(results, seed=1)
    truncate(run.path / listed(run)[0])
    assert len(listed_ids(results)) == 2
    lines, (problem,) = list_runs(results, {}, returns=True)
    assert [line["run"] for line in lines] == [other.id]
    assert run.id in problem


def test_number_that_is_none_is_ignored_and_settings_of_wrong_type_are_reported(results):
    run = add_whole_run(results)
    alter_manifest(run, summary={"wall_time": float("inf"), "steps_done": "all"})
    (line,), _ = list_runs(results, {})
    assert (line["wall_time"], line["steps_done"]) == (None, 3000)
    alter_manifest(run, settings={"task": 5})
    lines, (problem,) = list_runs(results, {})
    assert lines == []
    assert problem.startswith(f"{run.path}/manifest.json has invalid settings (")
