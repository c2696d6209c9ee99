"""Tests of results as data frames: the shipped runs, those of the demo, and fabricated ones."""

import shutil

import numpy as np
import pytest

import jbench
from jbench.errors import RequestError
from jbench.store.shipped import shipped_results
from tests.report.conftest import FabricatedResults, import_curves


@pytest.fixture(scope="module")
def shipped():
    """Returns the shipped results."""
    return jbench.open("reference")


@pytest.fixture(scope="module")
def sac_results(tmp_path_factory):
    """Returns the shipped runs of SAC on face_direction alone, which are read sooner than all."""
    path = tmp_path_factory.mktemp("sac")
    whole = shipped_results().path
    for kept in ("runs/face_direction/sac", "evaluations/face_direction/face_direction.sac.*"):
        for folder in whole.glob(kept):
            shutil.copytree(folder, path / folder.relative_to(whole))
    return jbench.open(path)


@pytest.mark.parametrize(
    ("results", "algo", "precisions"),
    [
        ("sac_results", "sac", {"float32"}),
        pytest.param("shipped", "td3", {"float32", "bfloat16"}, marks=pytest.mark.slow),
    ],
)
def test_runs_have_final_returns_and_settings(results, algo, precisions, request):
    opened = request.getfixturevalue(results)
    runs = opened.runs(task="face_direction", algo=algo).set_index("run")
    assert len(runs) == opened.query(
        f"SELECT count(*) AS n FROM runs WHERE task = 'face_direction' AND algo = '{algo}'"
    ).iloc[0, 0]  # fmt: skip
    last = opened.query(
        "SELECT run, avg(episode_return) AS mean FROM evaluations WHERE (run, evaluation) IN "
        "(SELECT (run, max(evaluation)) FROM evaluations GROUP BY run) GROUP BY run"
    ).set_index("run")["mean"]
    more = opened.query(
        "SELECT policy AS run, avg(episode_return) AS mean FROM policy_episodes "
        "JOIN policy_evaluations USING (evaluation) GROUP BY policy"
    ).set_index("run")["mean"]
    at_end = runs["evaluation_return_at_end"]
    assert np.allclose(at_end, last.loc[runs.index])
    in_sql = opened.query("SELECT run, evaluation_return_at_end AS x FROM final_returns")
    assert np.allclose(at_end, in_sql.set_index("run")["x"].loc[runs.index])
    # Ten episodes in training, and 90 by `jbench evaluate`.
    last.update(0.1 * last + 0.9 * more)
    assert np.allclose(runs["evaluation_return"], last.loc[runs.index])
    # The final training return: 100 episodes of 1000 control steps, of which a quarter counts.
    run = runs.index[runs["engine"] == "sb3"][0]
    training = opened.query(
        f"SELECT avg(episode_return) FROM episodes WHERE run = '{run}' AND episode >= 75"
    ).iloc[0, 0]
    assert runs.loc[run, "training_return"] == pytest.approx(training)
    (recorded,) = opened.query(
        f"SELECT settings->'hyperparameters'->>'buffer_size' AS n FROM runs WHERE run = '{run}'"
    )["n"]
    assert runs.loc[run, "buffer_size"] == int(recorded)
    assert set(runs["precision"]) == precisions


@pytest.mark.slow
@pytest.mark.parametrize("typed", ["planar", "planar12"])
def test_representation_may_be_typed_as_reports_show_it(shipped, typed):
    asked = {"task": "face_direction", "algo": "td3", "representation": typed}
    runs = shipped.runs(**asked)
    assert set(runs["representation"]) == {"planar12"}
    assert set(runs["shown_representation"]) == {"planar"}
    recorded = shipped.query(
        "SELECT run FROM runs WHERE task = 'face_direction' AND algo = 'td3' "
        "AND representation = 'planar12'"
    )
    assert set(runs["run"]) == set(recorded["run"])
    assert set(shipped.curves(**asked)["representation"]) == {"planar12"}


def test_missing_representation_is_refused_with_those_that_there_are(demo_results):
    opened = jbench.open(demo_results.path)
    with pytest.raises(RequestError, match=r"'pca7'; there are dae14 and full\.$"):
        opened.runs(representation="pca7")
    by_two_names = [opened.runs(representation=name) for name in ("none", "full")]
    assert [len(runs) for runs in by_two_names] == [2, 2]


def test_representation_of_results_without_runs_is_refused(tmp_path):
    opened = jbench.open(tmp_path)
    assert opened.runs().empty
    with pytest.raises(RequestError, match=r"no runs with the representation 'planar'\.$"):
        opened.curves(representation="planar")


def test_curves_name_the_settings_that_differ(tmp_path):
    fabric = FabricatedResults(tmp_path / "results")
    for settings in ({}, {"precision": "bfloat16"}, {"engine": "sb3"}):
        fabric.flat([500, 501], **{"engine": "batched", **settings})
    curves = jbench.open(fabric.results.path).curves(returns="training")
    named = curves.groupby("settings")[["precision", "engine"]].first()
    assert named.to_dict("index") == {
        "": {"precision": "float32", "engine": "batched"},
        "bfloat16": {"precision": "bfloat16", "engine": "batched"},
        "stable-baselines3": {"precision": "float32", "engine": "sb3"},
    }
    assert "learning_rate" not in curves  # one for all


@pytest.mark.slow
def test_curves_of_seeds_have_the_quantiles_of_the_curves(shipped):
    asked = {"task": "face_direction", "algo": "td3"}
    seeds = shipped.curves(**asked, per_seed=True)
    keys = ["representation", "variant", "control_steps"]
    medians = seeds.groupby(keys)["episode_return"].median()
    curves = shipped.curves(**asked).set_index(keys)["q50"]
    assert np.allclose(medians.sort_index(), curves.sort_index())
    # Each seed ends with its final return.
    finals = shipped.runs(**asked).set_index("run")["evaluation_return"]
    ends = seeds.groupby("run")["episode_return"].last()
    assert np.allclose(ends, finals.loc[ends.index])
    training = shipped.curves(**asked, returns="training", per_seed=True)
    assert set(training["returns"]) == {"training"}
    assert training.groupby("run").size().nunique() == 1


def test_imported_evaluations_have_their_return_at_the_end(tmp_path):
    import_curves(tmp_path, "other", {0: [1.0, 2.0], 1: [3.0, 5.0]}, "--returns", "evaluation")
    runs = jbench.open(tmp_path).runs().set_index("seed")
    assert runs["evaluation_return_at_end"].to_dict() == {0: 2.0, 1: 5.0}
    assert runs["evaluation_return"].to_dict() == {0: 2.0, 1: 5.0}
