"""Tests of the grouping of runs into configurations, of their variants and of notes on them."""

import numpy as np

from jbench.report.data.build import usable_runs
from jbench.report.frames import Frames
from jbench.report.page import render
from jbench.report.reading import notes_on
from jbench.report.report import table_files
from jbench.representation_names import shown_representation
from jbench.settings.algorithms import algorithm_settings
from jbench.store.listing import list_runs
from jbench.store.tables import read_tables
from tests.store.store_rows import alter_manifest


def test_configuration_groups_seeds_of_one_setting(fabric):
    fabric.run([1, 2, 3], seed=4)
    fabric.run([5, 6, 7], seed=2)
    (config,), notes = fabric.configurations()
    assert (config.task, config.algo, config.representation) == ("face_direction", "td3", "full")
    assert config.seeds.tolist() == [2, 4]
    assert config.returns.tolist() == [[5, 6, 7], [1, 2, 3]]
    assert config.control_steps.tolist() == [[1000, 2000, 3000]] * 2
    assert config.words == ""
    assert notes == []


def test_configurations_follow_order_of_paper_with_full_first(fabric):
    ordered = [
        ("face_direction", "ddpg", "full"),
        ("face_direction", "ddpg", "dae12"),
        ("face_direction", "td3", "full"),
        ("face_direction", "mine", "full"),
        ("move_to_pose", "sac", "full"),
        ("my_task", "ddpg", "full"),
    ]
    for task, algo, representation in reversed(ordered):
        fabric.run([1], task=task, algo=algo, representation=representation)
    found = [(c.task, c.algo, c.representation) for c in fabric.configurations()[0]]
    assert found == ordered


def with_defaults(**overrides):
    """Returns settings of a run of TD3 as jbench records them, with other hyperparameters."""
    return {
        "engine": "batched",
        "evaluate_every": 1000,
        "evaluate_episodes": 2,
        "hyperparameters": algorithm_settings("td3", overrides=overrides).values,
    }


def test_every_place_names_the_settings_that_are_not_defaults(fabric):
    changed = with_defaults(batch_size=64)
    for seed in range(3):
        fabric.run([500.0] * 3, seed, evaluated={3000: 500.0}, **changed)
    plain = with_defaults()
    fabric.run([500.0] * 3, 0, evaluated={3000: 500.0}, representation="dae12", **plain)
    frames = Frames(fabric.results)
    labels = {"TD3 full, batch_size=64", "TD3 dae12"}
    assert {*frames.lead(frames.configurations)["label"]} == labels
    assert {*frames.curves["label"]} == labels
    assert not any("batch_size" in note for note in frames.notes)
    files = dict(table_files(frames))
    assert "full, batch_size=64" in files["final_returns.md"]
    latex = files["final_returns.tex"].replace(r"\allowbreak{}", "")
    assert r"full, batch\_size=64" in latex
    assert "batch_size=64" in render(frames, [])


def test_settings_that_all_runs_share_are_noted_once(fabric):
    for name, tau in (("full", 0.5), ("dae12", 0.5), ("dae12", 0.005)):
        changed = with_defaults(batch_size=64, hidden_layers=[8, 8], tau=tau)
        fabric.run([500.0] * 3, 0, evaluated={3000: 500.0}, representation=name, **changed)
    frames = Frames(fabric.results)
    labels = {"TD3 full, tau=0.5", "TD3 dae12, tau=0.5", "TD3 dae12, tau=0.005"}
    assert {*frames.lead(frames.configurations)["label"]} == labels
    shared = "All runs: batch_size=64, hidden_layers=[8, 8]"
    assert f"{shared}, not the defaults." in frames.notes
    assert f"{shared}, not the defaults." in render(frames, [])
    files = dict(table_files(frames))
    assert f"{shared}." in files["final_returns.md"].replace("\\", "")


def test_settings_that_recorded_runs_lack_are_not_said_of_all_runs(fabric):
    for name in ("full", "dae12"):
        fabric.run([500.0] * 3, representation=name, **with_defaults(hidden_layers=[8, 8]))
    recorded = {"engine": "external", "algo": "sb3-ppo", "hyperparameters": {"n_steps": 128}}
    fabric.run([400.0] * 3, **recorded)

    frames = Frames(fabric.results)
    assert "All runs of TD3: hidden_layers=[8, 8], not the defaults." in frames.notes
    table = dict(table_files(frames))["final_returns.md"].replace("\\", "")
    assert "All runs of TD3: hidden_layers=[8, 8]." in table
    assert "All runs: " not in table


def test_runs_that_differ_only_in_the_code_of_their_encoder_are_named_by_it(fabric):
    for code, seed in (("3f2a91aa", 0), ("07c4d5bb", 0), ("07c4d5bb", 1)):
        id = f"face_direction/mine6/s0{seed}-{code}"
        settings = {"kind": "mine:Six", "latents": 6, "seed": seed, "sources": code}
        record = fabric.results.create("encoder", id, {"task": "face_direction", **settings})
        record.finish({})
        hour = "09" if code == "3f2a91aa" else f"1{seed}"
        alter_manifest(record, created=f"2026-11-28T{hour}:05:00+00:00")
        for level in (500.0, 600.0):
            settings = {"representation": "mine6", "encoder": id, **with_defaults()}
            fabric.run([level] * 3, int(level), **settings)

    named = {config.words for config in Frames(fabric.results).source.configurations}
    assert named == {
        "code 3f2a91 of 2026-11-28 09:05",
        "code 07c4d5 of 2026-11-28 10:05",
        "encoder=face_direction/mine6/s01-07c4d5bb",
    }
    lines, _ = list_runs(fabric.results, {})
    assert {line.variant for line in lines} == named


def test_longest_run_of_seed_is_used_and_noted(fabric):
    fabric.run([1] * 3, seed=0, steps=3000)
    fabric.run([2] * 5, seed=0, steps=5000)
    fabric.run([3] * 5, seed=1, steps=5000)
    # This run was to be the longest but stopped early: recorded episodes count, not `steps`.
    fabric.run([4], seed=1, steps=9000, status="unfinished")
    (config,), _ = fabric.configurations()
    assert config.returns.tolist() == [[2] * 5, [3] * 5]
    notes = [note for note in config.notes if "longest" in note]
    assert notes == [
        "seed 0 has 2 runs: the longest is used, of 5 episodes, not that of 3",
        "seed 1 has 2 runs: the longest is used, of 5 episodes, not that of 1",
    ]
    assert not any("unfinished" in note for note in config.notes)


def test_run_of_more_control_steps_is_used_although_it_has_fewer_episodes(fabric):
    fabric.run([1.0] * 5, steps=100, ends=[20, 40, 60, 80, 100], task="gym:Hopper-v5")
    fabric.run([2.0] * 3, steps=3000, task="gym:Hopper-v5")
    (config,), _ = fabric.configurations()
    assert config.returns.tolist() == [[2.0] * 3]


def test_failed_and_unfinished_runs_are_used_and_noted(fabric):
    fabric.run([1] * 4, seed=0)
    fabric.run([2] * 2, seed=1, status="failed", steps=4000)
    fabric.run([3] * 3, seed=2, status="unfinished", steps=4000)
    (config,), _ = fabric.configurations()
    assert config.lengths.tolist() == [4, 2, 3]
    np.testing.assert_equal(config.returns[1], [2, 2, np.nan, np.nan])
    np.testing.assert_equal(config.control_steps[2], [1000, 2000, 3000, np.nan])
    assert config.notes == (
        "seed 1 failed after 2 episodes",
        "seed 2 unfinished after 3 episodes",
        "seeds of unequal length, 2 to 4 episodes",
        "its curve of training returns ends at 2,000 control steps, the last that every seed has "
        "reached",
    )


def test_seeds_whose_episodes_end_early_are_not_called_unequal(fabric):
    for seed, count in enumerate((4, 6)):
        fabric.run([1.0] * count, seed, steps=3000)
    (config,), _ = fabric.configurations()
    assert config.lengths.tolist() == [4, 6]
    assert not any("unequal" in note for note in config.notes)


def test_non_finite_returns_are_noted(fabric):
    for seed, returns in enumerate(([1, np.nan, 2], [np.inf, -np.inf, 3], [4])):
        fabric.run(returns, seed=seed)
    (config,), _ = fabric.configurations()
    np.testing.assert_equal(config.returns[:2], [[1, np.nan, 2], [np.nan, np.nan, 3]])
    assert [note for note in config.notes if "not finite" in note] == [
        "1 return of seed 0 is not finite and left out",
        "2 returns of seed 1 are not finite and left out",
    ]


def test_run_without_task_is_reported_as_problem(fabric):
    fabric.run([1], task=None)
    fabric.run([1])
    runs, problems = usable_runs(read_tables(fabric.results).tables["runs"])
    assert runs["run"].tolist() == ["face_direction/r0002"]
    assert len(problems) == 1
    assert "face_direction/r0001" in problems[0]


def test_variant_is_named_by_its_differences_and_alike_on_every_task(fabric):
    for task, engine, rate in (
        ("face_direction", "batched", 1e-4),
        ("face_direction", "sb3", 1e-4),
        ("move_to_pose", "sb3", 1e-4),
        ("move_to_pose", "batched", 0.01),
    ):
        fabric.run([1], task=task, engine=engine, hyperparameters={"learning_rate": rate})
    assert [(config.task, config.label) for config in fabric.configurations()[0]] == [
        ("face_direction", "TD3 full, learning_rate=1e-04"),
        ("face_direction", "TD3 full, stable-baselines3, learning_rate=1e-04"),
        ("move_to_pose", "TD3 full, learning_rate=0.01"),
        ("move_to_pose", "TD3 full, stable-baselines3, learning_rate=1e-04"),
    ]


def test_different_evaluations_are_no_different_configurations(fabric):
    for seed, every in enumerate((10, 20, 30)):
        fabric.run([1], seed, evaluate_every=every, evaluate_episodes=seed + 1)
    (found,) = fabric.configurations()[0]
    assert (found.label, found.seeds.tolist()) == ("TD3 full", [0, 1, 2])


def test_size_that_follows_from_task_is_not_in_name(fabric):
    for task, name in (("face_direction", "scaled16"), ("move_in_direction", "scaled19")):
        fabric.run([1], task=task, representation=name)
    fabric.run([1], representation="dae12")
    found = [config.identity for config in fabric.configurations()[0]]
    assert [(one["representation"], one["kind"]) for one in found] == [
        ("dae12", "dae"),
        ("scaled", "scaled"),
        ("scaled", "scaled"),
    ]
    assert shown_representation("planar13-observation-whitened") == "planar-observation-whitened"
    assert shown_representation("dae12-whitened") == "dae12-whitened"


def test_note_counts_a_configuration_once(fabric):
    for seed in range(2):
        fabric.run([1.0] * 4, seed, evaluated={2000: 1.0, 4000: 1.0})
    found = Frames(fabric.results)
    (config, *_) = found.source.configurations
    config.notes = ("bot.py has changed",)
    assert notes_on([config, config]) == [f"{config.configuration}: bot.py has changed."]
