"""Tests of the settings of runs: which are alike, and the labels of variants."""

import pytest

from jbench.settings.algorithms import algorithm_settings, default_base
from jbench.settings.code_words import CodeVersion, first_dates
from jbench.settings.defaults import foreign_differences
from jbench.settings.labels import CUT
from jbench.settings.recorded import Unreadable, alike, comparable, flatten, read_run
from jbench.settings.records import ExternalSettings, Labels
from jbench.settings.run import RunSettings
from jbench.settings.variants import chosen_words, variant_labels, variant_words

RUN = {
    "task": "face_direction",
    "algo": "td3",
    "seed": 0,
    "steps": 1000,
    "evaluate_every": 1000,
    "evaluate_episodes": 1,
    "hyperparameters": {"tau": 0.005},
}


def test_unknown_settings_are_kept_as_recorded():
    assert read_run(RUN) == RunSettings(**RUN)
    newer = {**RUN, "seed": "none", "augment": 3, "gravity": -1.62}
    for values in (newer, {**RUN, "algo": "my agent"}, RUN | {"hyperparameters": {"tau": 2}}, {}):
        run = read_run(values)
        assert isinstance(run, Unreadable)
        assert run.values == values
    run = read_run(newer)
    assert (run.algo, run.seed, run.steps) == ("td3", None, 1000)
    assert (run.augment, run.robots, run.hyperparameters) == (3, 1, {"tau": 0.005})


def test_omitted_setting_equals_its_default():
    printed = {**RUN, **RunSettings.omitted()}
    assert alike(read_run(printed), ()) == alike(read_run(RUN), ())
    foreign = {**RUN, "algo": "my agent"}
    assert alike(read_run({**foreign, "robots": 1}), ()) == alike(read_run(foreign), ())
    assert alike(read_run({**RUN, "robots": 2, "steps": 4000}), ("steps",)) != alike(
        read_run(RUN), ("steps",)
    )


def test_settings_implied_by_free_setting_are_ignored():
    encoded = read_run({**RUN, "representation": "dae12", "encoder": "e"})
    assert comparable(encoded, "representation") == comparable(read_run(RUN), "representation")
    assert alike(encoded, ("representation",)) != alike(read_run(RUN), ("representation",))


def test_engine_is_implied_by_third_party_algorithm():
    others = [
        {"algo": "own", "engine": "plugin", "package": "their-agents", "hyperparameters": {}},
        {"algo": "sb3_contrib:TQC", "engine": "sb3", "hyperparameters": {}},
    ]
    ours = read_run(RUN)
    for other in others:
        run = read_run({**RUN, **other})
        assert isinstance(run, RunSettings)
        assert comparable(run, "algo") == comparable(ours, "algo")
        assert comparable(run, "task") != comparable(ours, "task")
    # An algorithm of jbench does not imply its engine.
    assert comparable(read_run({**RUN, "engine": "sb3"}), "algo") != comparable(ours, "algo")


def with_changes(algo, base="published", changes=()):
    chosen = algorithm_settings(algo, base, dict(changes)).model_dump(mode="json")
    return read_run({"algo": algo, "hyperparameters": chosen})


PPO = {"algo": "ppo", "hyperparameters": {"gamma": 0.9}}
HALF = {"precision": "bfloat16"}
SHARED = {"algo": "ppo", "hyperparameters": {"gamma": 0.9, "shared_layers": True}}


@pytest.mark.parametrize(
    "variants",
    [
        {"sigma=0.1": {"noise": {"sigma": 0.1}}, "sigma=(not set)": {}},
        {"x=(not set)": {"seed": 1, "steps": 2}, "x=1": {"seed": 3, "x": 1}},
        # A setting that is not recorded has its default.
        {"precision=float32": read_run({}), "precision=bfloat16": read_run(HALF)},
        {"shared_layers=false": read_run(PPO), "shared_layers=true": read_run(SHARED)},
        {f"tau={tau}": with_changes("td3", "script", {"tau": tau}) for tau in (0.1, 0.2)},
        {f"settings={base}": with_changes("ppo", base) for base in ("published", "script", "sb3")},
        # Ambiguous names are written with their full path.
        {f"actor.lr={n}, critic.lr={n}": {"actor": {"lr": n}, "critic": {"lr": n}} for n in (1, 2)},
    ],
)
def test_variants_are_labeled_by_what_differs(variants):
    assert variant_labels(variants) == {name: name for name in variants}


def test_truncated_labels_are_unique():
    many = {c: dict.fromkeys("pqrst", c) for c in "ab"}
    assert variant_labels(many)["a"] == "p=a, q=a, r=a, s=a, … (a)"
    changed = {c: with_changes("td3", changes={"tau": tau}) for c, tau in (("a", 0.1), ("b", 0.2))}
    shown = {**changed, "c": with_changes("td3", "script", {"gamma": 0.5, "batch_size": 7})}
    assert "batch_size=7, gamma=0.5, " in variant_labels(shown)["c"]
    assert variant_labels({c: {"algo": c, **dict.fromkeys("qrstu")} for c in "ab"})
    long = {c: {"x": "-" * 50 + c + "-" * 50} for c in "ab"}
    assert len(set(variant_labels(long).values())) == 2


def test_hyperparameters_of_the_option_are_no_words():
    runs = {base: with_changes("ppo", base) for base in ("published", "script")}
    assert variant_words(runs) == {"published": [], "script": ["settings=script"]}


def test_option_of_ours_is_named_only_where_it_is_used():
    runs = {"plain": with_changes("td3"), "mirrored": with_changes("td3", changes={"mirror": True})}
    assert variant_words(runs) == {"plain": [], "mirrored": ["mirror=true"]}


def full_run(algo="td3", base=None, changes=(), task="face_direction", **more):
    """Returns the settings of a run as `jbench train` records them."""
    source = default_base(task, base)
    specs = {"parts": ["x"], "sizes": [1], "action_minimum": [-1], "action_maximum": [1]}
    values = {**RUN, "algo": algo, "task": task, "specs": specs if ":" in task else None, **more}
    values["hyperparameters"] = algorithm_settings(algo, source, dict(changes)).values
    run = read_run(values)
    assert isinstance(run, RunSettings)
    return run


@pytest.mark.parametrize(
    ("run", "named"),
    [
        (full_run(), ""),
        (full_run("ddpg", time_limit="bootstrap", engine="batched"), ""),
        (full_run(task="dmc:cheetah-run"), ""),
        (full_run(changes={"batch_size": 64}), "batch_size=64"),
        (full_run(changes={"normalize": "running"}), "normalize=running"),
        (full_run("ppo", "script"), "settings=script"),
        (full_run("ddpg", "figure8", time_limit="terminal"), "settings=figure8"),
        (full_run("ddpg", "figure8"), "settings=figure8, time_limit=bootstrap"),
        (full_run("sac", "suite"), "settings=suite"),
        (full_run("sac", "published", task="dmc:cheetah-run"), "settings=published"),
        (full_run(augment=3), "augment=3"),
        (full_run(engine="sb3"), "stable-baselines3"),
        (full_run(representation="ofe12", ofe={"units": 12, "layers": 2}), "layers=2"),
        (full_run(evaluate_every=500, seed=3), ""),
    ],
)
def test_only_variant_is_named_by_what_is_not_the_default(run, named):
    assert variant_words({"a": run}) == {"a": named.split(", ") if named else []}


def test_setting_that_another_variant_changed_has_the_value_of_its_run():
    """The learning rate of `suite` is 1e-3, and the published one 1e-4."""
    robot = {"task": "dmc:cheetah-run"}
    runs = {"usual": full_run(**robot), "fast": full_run(changes={"learning_rate": 0.01}, **robot)}
    words = {"usual": ["learning_rate=0.001"], "fast": ["learning_rate=0.01"]}
    assert variant_words(runs) == words
    assert variant_labels(runs) == {name: word for name, (word,) in words.items()}

    runs = {
        "published": full_run(),
        "suite": full_run(base="suite"),
        "fast": full_run(base="suite", changes={"learning_rate": 0.01}),
    }
    assert variant_words(runs) == {
        "published": ["learning_rate=1e-04"],
        "suite": ["settings=suite", "learning_rate=0.001"],
        "fast": ["settings=suite", "learning_rate=0.01"],
    }


def test_time_limit_that_the_source_brings_is_no_word_beside_other_sources():
    runs = {
        "published": full_run("ddpg"),
        "figure8": full_run("ddpg", "figure8", time_limit="terminal"),
        "typed": full_run("ddpg", "figure8", time_limit="bootstrap"),
        "of the published": full_run("ddpg", time_limit="terminal"),
    }
    assert variant_words(runs) == {
        "published": [],
        "figure8": ["settings=figure8"],
        "typed": ["settings=figure8", "time_limit=bootstrap"],
        "of the published": ["time_limit=terminal"],
    }


def test_name_of_many_settings_is_cut_and_all_are_known():
    changes = {"tau": 0.5, "gamma": 0.9, "batch_size": 7, "buffer_size": 99, "noise_sigma": 0.3}
    run = full_run(changes=changes)
    assert variant_words({"a": run})["a"][-1] == f"{CUT} (a)"
    assert sorted(chosen_words(run).split(", ")) == sorted(f"{n}={v}" for n, v in changes.items())


def test_cut_names_have_the_settings_that_differ():
    changes = {"gamma": 0.9, "batch_size": 7, "buffer_size": 99, "noise_sigma": 0.3}
    runs = {f"{tau}": full_run(changes={**changes, "tau": tau}) for tau in (0.1, 0.2)}
    for tau, words in variant_words(runs).items():
        assert f"tau={tau}" in words
        assert sum("=" in word for word in words) == 4


def test_hyperparameters_of_another_package_are_named_where_any_of_its_runs_differ():
    """Their defaults are unknown, so a name with one representation does not say what differs."""
    runs = {
        name: full_run(representation=representation).model_copy(
            update={"algo": "mine:Huber", "hyperparameters": {"tau": tau, "batch_size": 64}}
        )
        for name, representation, tau in (("a", "full", 0.01), ("b", "dae4", 0.02))
    }
    foreign = foreign_differences([*runs.values(), full_run(changes={"batch_size": 7})])
    assert foreign == {"mine:Huber": {("hyperparameters", "tau")}}
    for name, words in (("a", ["tau=0.01"]), ("b", ["tau=0.02"])):
        assert variant_words({name: runs[name]}, elsewhere=foreign["mine:Huber"]) == {name: words}
        assert variant_words({name: runs[name]}) == {name: []}


def test_external_run_named_td3_has_only_its_hyperparameters():
    settings = ExternalSettings(**{**RUN, "hyperparameters": {"tau": 0.1}})
    named = {path for path in flatten(settings) if path[0] == "hyperparameters"}
    assert named == {("hyperparameters", "tau")}


def test_versions_of_one_code_have_the_time_where_they_share_the_date():
    versions = [
        CodeVersion("task a", "3f2a91", "2026-11-28T09:05:59+00:00"),
        CodeVersion("task a", "3f2a91", "2026-11-29T09:05:59+00:00"),
        CodeVersion("task a", "77c0d2", "2026-11-28T17:30:00+00:00"),
        CodeVersion("task a", "b10c4e", "2026-11-29T17:30:00+00:00"),
        # Other code of the same day is no other version; code that tasks share is one.
        CodeVersion("robot of a", "07c4d5", "2026-11-28T09:05:59+00:00"),
        CodeVersion("task b", "77c0d2", "2026-11-30T08:00:00+00:00"),
        CodeVersion("task b", None, "2026-11-30T08:00:00+00:00"),
    ]
    assert first_dates(versions) == {
        "3f2a91": "2026-11-28 09:05",
        "77c0d2": "2026-11-28 17:30",
        "b10c4e": "2026-11-29",
        "07c4d5": "2026-11-28",
    }


def test_task_of_a_recorded_or_imported_curve_is_a_path_below_the_results():
    for task in ("gym:ALE/Pong-v5", "gym:lab:arm/Reach-v0,mass=-1.5,xml=a/b.xml", "_own:stand"):
        assert Labels(task=task, algo="mine").task == task
    for task in ("", "..", "gym:a/../Pong-v5", "/srv/pong", "gym:ALE//Pong", "gym:a/", "a" * 201):
        with pytest.raises(ValueError, match="type the name of a task, such as face_direction"):
            Labels(task=task, algo="mine")
