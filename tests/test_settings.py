"""Tests of the settings of runs: which are alike, and the labels of variants."""

from jbench.settings.algorithms import algorithm_settings
from jbench.settings.alike import alike, comparable, flatten
from jbench.settings.recorded import Unreadable, read_run
from jbench.settings.run import RunSettings
from jbench.settings.variants import variant_labels, variant_words

RUN = {
    "task": "face_direction",
    "algo": "td3",
    "seed": 0,
    "steps": 1000,
    "evaluate_every": 1000,
    "evaluate_episodes": 1,
    "hyperparameters": {"tau": 0.005},
}


class TestSettings:
    def test_unknown_settings_are_kept_as_recorded(self):
        assert read_run(RUN) == RunSettings(**RUN)
        newer = {**RUN, "seed": "none", "augment": 3, "gravity": -1.62}
        for values in (
            newer,
            {**RUN, "algo": "my agent"},
            RUN | {"hyperparameters": {"tau": 2}},
            {},
        ):
            run = read_run(values)
            assert isinstance(run, Unreadable)
            assert run.values == values
        run = read_run(newer)
        assert (run.algo, run.seed, run.steps) == ("td3", None, 1000)
        assert (run.augment, run.robots, run.hyperparameters) == (3, 1, {"tau": 0.005})

    def test_omitted_setting_equals_its_default(self):
        printed = {**RUN, **RunSettings.omitted()}
        assert alike(read_run(printed), ()) == alike(read_run(RUN), ())
        foreign = {**RUN, "algo": "my agent"}
        assert alike(read_run({**foreign, "robots": 1}), ()) == alike(read_run(foreign), ())
        assert alike(read_run({**RUN, "robots": 2, "steps": 4000}), ("steps",)) != alike(
            read_run(RUN), ("steps",)
        )

    def test_settings_implied_by_free_setting_are_ignored(self):
        encoded = read_run({**RUN, "representation": "dae12", "encoder": "e"})
        assert comparable(encoded, "representation") == comparable(read_run(RUN), "representation")
        assert alike(encoded, ("representation",)) != alike(read_run(RUN), ("representation",))

    def test_engine_is_implied_by_third_party_algorithm(self):
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


class TestLabels:
    def test_setting_missing_in_one_variant_is_labeled_not_set(self):
        labels = variant_labels({"a": {"noise": {"sigma": 0.1}}, "b": {}})
        assert labels == {"a": "sigma=0.1", "b": "sigma=(not set)"}

    def test_default_of_omitted_run_setting_is_labeled(self):
        labels = variant_labels({"a": read_run({}), "b": read_run({"precision": "bfloat16"})})
        assert labels == {"a": "precision=float32", "b": "precision=bfloat16"}

    def test_default_of_omitted_hyperparameter_is_labeled(self):
        runs = {
            name: read_run({"algo": "ppo", "hyperparameters": {"gamma": 0.9, **more}})
            for name, more in {"a": {}, "b": {"shared_layers": True}}.items()
        }
        assert variant_labels(runs) == {"a": "shared_layers=false", "b": "shared_layers=true"}

    def test_hyperparameter_sets_are_labeled_by_their_option(self):
        runs = {}
        for base in ("published", "script", "sb3"):
            chosen = algorithm_settings("ppo", base)
            runs[base] = read_run(
                {"algo": "ppo", "hyperparameters": chosen.model_dump(mode="json")}
            )
        assert variant_labels(runs) == {name: f"settings={name}" for name in runs}
        words = ("", "settings=script", "settings=sb3")
        assert variant_words(runs) == dict(zip(runs, words, strict=True))

    def test_changed_hyperparameter_is_labeled_by_name(self):
        changes = [algorithm_settings("td3", "script", {"tau": tau}) for tau in (0.1, 0.2)]
        runs = {
            str(i): read_run({"algo": "td3", "hyperparameters": values.model_dump(mode="json")})
            for i, values in enumerate(changes)
        }
        assert variant_labels(runs) == {"0": "tau=0.1", "1": "tau=0.2"}

    def test_flattened_defaults_equal_omitted_settings(self):
        omitted = flatten(read_run({}))
        assert omitted == {(name,): value for name, value in RunSettings.omitted().items()}
        whole = RunSettings(**RUN, **RunSettings.omitted())
        assert not {path[0] for path in omitted} & set(whole.values)

    def test_ambiguous_names_are_written_with_full_path(self):
        settings = {
            "a": {"actor": {"lr": 1}, "critic": {"lr": 1}},
            "b": {"actor": {"lr": 2}, "critic": {"lr": 3}},
        }
        labels = variant_labels(settings)
        assert labels == {"a": "actor.lr=1, critic.lr=1", "b": "actor.lr=2, critic.lr=3"}

    def test_seed_and_steps_are_not_labeled(self):
        assert variant_labels({"a": {"seed": 1, "steps": 2}, "b": {"seed": 3, "x": 1}}) == {
            "a": "x=(not set)",
            "b": "x=1",
        }

    def test_truncated_labels_are_unique(self):
        many = {c: dict.fromkeys("pqrst", c) for c in "ab"}
        assert variant_labels(many) == {
            "a": "p=a, q=a, r=a, s=a, … (a)",
            "b": "p=b, q=b, r=b, s=b, … (b)",
        }
        long = {c: {"x": "-" * 50 + c + "-" * 50} for c in "ab"}
        assert len(set(variant_labels(long).values())) == 2
