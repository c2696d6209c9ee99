"""Tests of runs with online feature extraction (OFE): settings, ids, rows and policies."""

import json

import numpy as np
import pytest

from jbench.errors import RequestError
from jbench.policies.find import find_policy
from jbench.policies.network import SavedNetwork
from jbench.policies.saved import load_agent
from jbench.settings.recorded import comparable
from jbench.settings.records import OFESettings
from jbench.settings.run import RunSettings
from jbench.settings.variants import variant_labels
from jbench.store import Results
from jbench.studies.comparisons import comparisons
from jbench.studies.matrix import read_matrix
from jbench.sweeps.cell import matrix_cells
from jbench.training.batched_run import run_batch
from tests.short_episodes import shorten_episodes
from tests.training.small_runs import requested, small_run

ABOUT = {"steps": 100, "evaluate_every": 50, "evaluate_episodes": 1}


def settings(algo="td3", units=6, engine="batched", **changes):
    small = {"learning_starts": 40, "train_freq": 10, "gradient_steps": 2, "batch_size": 16}
    ofe = OFESettings(units=units, layers=2)
    changes = {**ABOUT, "ofe": ofe, "representation": f"ofe{units}", "engine": engine, **changes}
    return small_run(algo, {} if algo == "ppo" else small, **changes)


def test_ofe_is_part_of_settings_and_id(tmp_path):
    results = Results(tmp_path)
    full, few = (requested(results, {}, encoder=encoder) for encoder in ("none", "ofe12"))
    other = requested(results, {"ofe.layers": 3, "ofe.pretraining": 0}, encoder="ofe:12")
    assert "ofe" not in full.model_dump()
    assert few.id.startswith("face_direction/td3/ofe12/s00-")
    assert few.ofe == OFESettings(units=12)
    assert other.ofe == OFESettings(units=12, layers=3, pretraining=0.0)
    assert len({run.id for run in (full, few, other)}) == 3
    for run in (full, few, other):
        assert RunSettings(**json.loads(json.dumps(run.model_dump(mode="json")))) == run
    runs = (full, few, other)
    # Runs that differ only in their representation and its settings are comparable.
    assert len({comparable(run, "representation") for run in runs}) == 1
    assert len({comparable(run) for run in runs}) == 3
    labels = variant_labels({str(i): run for i, run in enumerate(runs[1:])})
    assert labels == {"1": "layers=3, pretraining=0", "0": "layers=6, pretraining=1"}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"algo": "ppo"}, "TD3 and SAC of the batched engine, not for ppo of .*; choose td3"),
        ({"engine": "sb3"}, "not for td3 of the engine sb3; choose the engine batched, or"),
        ({"encoder": "face_direction/dae12/s00-0"}, "ofe6 learns from observations: it can't have"),
        ({"representation": "ofe7"}, "6 learned features are called ofe6"),
        ({"representation": "full"}, "6 learned features are called ofe6"),
        ({"ofe": None}, "ofe6 needs the settings of its features, ofe"),
    ],
)
def test_settings_incompatible_with_ofe_are_refused(changes, says):
    with pytest.raises(ValueError, match=says):
        settings(**changes)


def write_matrix(path, representation="ofe12", option="layers = 3"):
    file = path / "features.toml"
    file.write_text(
        'tasks = ["face_direction"]\nalgos = ["td3"]\nseeds = "0"\n'
        f'representations = ["full", "{representation}"]\n[ofe]\n{option}\n'
    )
    return str(file)


def test_matrix_accepts_ofe_as_representation(tmp_path):
    path = write_matrix(tmp_path)
    parts = read_matrix(path)
    full, few = matrix_cells(parts, Results(tmp_path))
    assert few.encoders == ()
    assert few.runs[0].ofe == OFESettings(units=12, layers=3)
    assert full.runs[0].ofe is None
    names = [comparison.name for comparison in comparisons(parts, {}, (), 30)]
    assert names == ["face_direction td3 ofe12 against full"]
    for change, says in (
        ({"option": "layer = 3"}, r"Unknown setting of ofe 'layer'; did you mean layers\?"),
        ({"option": "layers = 0"}, "layers of ofe12 can't be 0"),
        ({"representation": "ofe"}, "ofe needs a number of features: type ofe12 or ofe240"),
    ):
        path = write_matrix(tmp_path, **change)
        with pytest.raises(RequestError, match=says):
            matrix_cells(read_matrix(path), Results(tmp_path))


def test_ofe_run_records_prediction_loss_and_policy_with_features(tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    results, run = Results(tmp_path), settings()
    assert run_batch([run], results) == {}
    record = results.find("run", run.id)
    losses = record.read("episodes")["prediction_loss"].to_pylist()
    assert len(losses) == 2
    assert 0 < losses[1] < 10
    agent = load_agent(results, run.id)
    observations = np.random.default_rng(0).normal(size=(5, 16)).astype(np.float32)
    actions = find_policy(results, run.id, "face_direction").act(observations)
    np.testing.assert_array_equal(actions, agent.act(observations))
    # The policy depends on the six units alone.
    kinds = [layer.kind for layer in agent.policy.layers]
    assert kinds.count("concat") == 2
    blind = SavedNetwork(agent.policy.layers[kinds.index("columns") + 1 :])
    assert blind.sizes[0] == 6
