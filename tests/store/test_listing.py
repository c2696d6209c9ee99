"""Tests of the list of runs: progress from the manifest, last returns on request."""

from jbench.settings.algorithms import algorithm_settings
from jbench.store.listing import list_runs
from jbench.store.roles import checkpoint_role
from tests.store.store_rows import alter_manifest, episodes, listed
from tests.store.store_whole import add_whole_run
from tests.store.test_damage import truncate


def test_finished_and_unfinished_runs_are_listed(results):
    run = add_whole_run(results)
    add_whole_run(results, [5.0], finish=False, seed=1, algo="sac")
    (done, begun), problems = list_runs(results, {})
    assert problems == []
    assert done.run == run.id
    assert (done.algo, done.seed, done.status) == ("ddpg", 0, "finished")
    assert (done.episodes, done.steps_done, done.steps, done.wall_time) == (3, 3000, 3000, 7.5)
    assert (done.last_return, done.created) == (None, run.manifest.created)
    assert (begun.algo, begun.seed, begun.status) == ("sac", 1, "unfinished")
    assert (begun.episodes, begun.steps_done, begun.steps, begun.wall_time) == (1, 1000, 3000, None)


def test_variant_names_settings_that_differ_between_tasks_and_special_ones(results):
    published = algorithm_settings("ddpg", "published").model_dump(mode="json")
    read = {"engine": "batched", "evaluate_every": 20_000, "evaluate_episodes": 10}
    read["hyperparameters"] = published
    changed = {**read, "hyperparameters": {**published, "tau": 0.01}}
    add_whole_run(results, **read)
    add_whole_run(results, seed=1, **changed)
    add_whole_run(results, seed=2, precision="bfloat16", **changed)
    read["hyperparameters"] = algorithm_settings("td3", "published").model_dump(mode="json")
    add_whole_run(results, algo="td3", precision="bfloat16", **read)
    lines, _ = list_runs(results, {})
    assert [line.variant for line in lines] == [
        "tau=0.001",
        "tau=0.01",
        "bfloat16, tau=0.01",
        "bfloat16",
    ]
    # Alone, it is named by what is not the default.
    (line,), _ = list_runs(results, {"seed": {1}})
    assert line.variant == "tau=0.01"
    (line,), _ = list_runs(results, {"seed": {0}, "algo": {"ddpg"}})
    assert line.variant == ""


def test_steps_of_finished_run_are_read_from_summary(results):
    run = add_whole_run(results)
    alter_manifest(run, summary={"steps_done": 4096})
    assert list_runs(results, {})[0][0].steps_done == 4096


def test_unfinished_run_has_time_of_its_last_episode(results):
    add_whole_run(results, [], finish=False)
    add_whole_run(results, [1.0, 4.0], finish=False, seed=1)
    lines, _ = list_runs(results, {}, returns=True)
    assert [line.last_return for line in lines] == [None, 4.0]
    assert [line.wall_time for line in lines] == [None, 4.0]


def test_run_whose_files_are_joined_meanwhile_is_listed(results, monkeypatch):
    run = add_whole_run(results, [1.0], finish=False)
    run.append({"episodes": episodes(run.id, [1.0, 2.0]).slice(1)})
    before = results.scan("run")
    run.finish({})
    monkeypatch.setattr(results, "scan", lambda kind: before)
    (line,), problems = list_runs(results, {}, returns=True)
    assert (line.status, line.last_return, problems) == ("finished", 2.0, [])


def test_damaged_files_are_reported_only_if_read(results):
    run = add_whole_run(results)
    other = add_whole_run(results, seed=1)
    truncate(run.path / listed(run)[0])
    lines, problems = list_runs(results, {})
    assert (len(lines), problems) == (2, [])
    lines, (problem,) = list_runs(results, {}, returns=True)
    assert [line.run for line in lines] == [other.id]
    assert run.id in problem


def test_number_that_is_none_is_ignored_and_settings_of_wrong_type_are_reported(results):
    run = add_whole_run(results)
    alter_manifest(run, summary={"wall_time": float("inf"), "steps_done": "all"})
    (line,), _ = list_runs(results, {})
    assert (line.wall_time, line.steps_done) == (None, 3000)
    alter_manifest(run, settings={"task": 5})
    lines, (problem,) = list_runs(results, {})
    assert lines == []
    assert problem.startswith(f"{run.path}/manifest.json has invalid settings (")


def test_failed_run_has_the_steps_of_its_last_episode(results):
    run = add_whole_run(results, [1.0], finish=False)
    run.append({"episodes": episodes(run.id, [1.0, 2.0]).slice(1)}, {checkpoint_role(1000, 0): b""})
    (line,), _ = list_runs(results, {})
    assert line.steps_done == 1000
    run.fail("its reward is nan")
    (line,), _ = list_runs(results, {})
    assert line.steps_done == 2000
