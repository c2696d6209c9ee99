"""Tests of runs whose encoder is replaced by one of the same id with other weights."""

import shutil
from hashlib import sha256

import pytest
import safetensors.numpy

from jbench.encoders.saved import WEIGHTS
from jbench.errors import RequestError
from jbench.policies.saved import load_agent
from jbench.store import Results
from jbench.store.weights import ENCODER_WEIGHTS, weights_checksum
from jbench.training.batched_run import run_batch
from jbench.training.repeat import reevaluate, retrain
from tests.demo_results import ENCODER
from tests.short_episodes import EPISODE
from tests.store.store_rows import alter_manifest, manifest_of
from tests.training.small_runs import train
from tests.training.test_repeat import settings

pytestmark = pytest.mark.usefixtures("short_episodes")

ENCODED = {"encoder": ENCODER, "representation": "dae14", "evaluate_episodes": 1}
OTHER = f"was trained with another encoder {ENCODER} than the one in"


@pytest.fixture
def results(demo_results, tmp_path):
    shutil.copytree(demo_results.path / "encoders", tmp_path / "encoders")
    return Results(tmp_path)


def train_encoder_elsewhere(results):
    """Changes the weights of the encoder, as if another processor had trained it."""
    record = results.find("encoder", ENCODER)
    arrays = safetensors.numpy.load(record.read_file(WEIGHTS))
    content = safetensors.numpy.save({name: 1.01 * array for name, array in arrays.items()})
    (record.path / WEIGHTS).write_bytes(content)
    written = {"bytes": len(content), "sha256": sha256(content).hexdigest()}
    files = [
        entry | (written if entry["name"] == WEIGHTS else {})
        for entry in manifest_of(record)["files"]
    ]
    alter_manifest(record, files=files)


def without_weights(record):
    """Takes the checksum of the encoder from a record, which is then like those of old versions."""
    made = dict(record.manifest.provenance)
    del made[ENCODER_WEIGHTS]
    alter_manifest(record, provenance=made)
    record.refresh()


def test_finished_run_is_used_with_its_own_encoder_only(results):
    run = settings(steps=EPISODE, **ENCODED)
    record = train(run, results)
    encoder = results.find("encoder", ENCODER)
    assert record.manifest.provenance[ENCODER_WEIGHTS] == weights_checksum(encoder)
    assert load_agent(results, run.id).encoder is not None
    assert retrain(results, record, 1).verdict == "equal"

    train_encoder_elsewhere(results)

    with pytest.raises(RequestError, match=OTHER):
        load_agent(results, run.id)
    with pytest.raises(RequestError, match=OTHER):
        retrain(results, record, 1)
    repeated = reevaluate(results, record)
    assert repeated.verdict == "not comparable"
    assert OTHER in repeated.reason

    without_weights(record)
    assert load_agent(results, run.id).encoder is not None
    assert reevaluate(results, record).verdict == "different"
    assert retrain(results, record, 1).verdict == "different"


def test_run_is_neither_resumed_nor_continued_with_another_encoder(results):
    short, long = (settings(steps=steps, **ENCODED) for steps in (2 * EPISODE, 3 * EPISODE))
    begun = settings(steps=2 * EPISODE, seed=1, **ENCODED)
    train(short, results, keep_state="whole")
    train(begun, results, until=EPISODE)
    train_encoder_elsewhere(results)

    failures = run_batch([long, begun], results)

    assert {*failures} == {long.id, begun.id}
    for failure in failures.values():
        assert isinstance(failure, RequestError)
        assert OTHER in str(failure)
    assert not results.has("run", long.id)
    kept = results.find("run", begun.id)
    assert (kept.status, kept.rows("episodes")) == ("unfinished", 1)

    without_weights(kept)
    assert train(begun, results).is_finished


def test_runs_without_an_encoder_record_no_weights(tmp_path):
    record = train(settings(steps=EPISODE), Results(tmp_path))
    assert ENCODER_WEIGHTS not in record.manifest.provenance
