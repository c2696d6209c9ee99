"""Tests of the checksum by which a run knows the weights of its encoder."""

import json

import numpy as np
import pytest
import safetensors.numpy

from jbench.errors import RequestError
from jbench.store import Results
from jbench.store.merge import merge
from jbench.store.verify import verify
from jbench.store.weights import ENCODER_WEIGHTS, check_encoder, encoder_weights, weights_checksum
from tests.store.store_rows import alter_manifest
from tests.store.store_whole import add, add_whole_run

SETTINGS = {"kind": "dae", "latents": 1, "seed": 0, "task": "face_direction"}


def add_encoder(results, *, weight=1.0, minimum=-1.0, kind="dae", finish=True):
    """Adds an encoder of one id, with these numbers."""
    described = {"kind": kind, "minimum": [minimum], "maximum": [1.0]}
    arrays = {"encoder.weight": np.array([weight], np.float32)}
    files = {
        "encoder.json": json.dumps(described).encode(),
        "encoder.safetensors": safetensors.numpy.save(arrays),
    }
    return add(results, "encoder", "face_direction/dae1", SETTINGS, files=files, finish=finish)


def add_agent(results, encoder, weights):
    """Adds a run with an encoder; weights are what its provenance says of it."""
    run = add_whole_run(results, representation="dae1", encoder=encoder.id)
    alter_manifest(run, provenance={**run.manifest.provenance, **weights})
    run.refresh()
    return run


def test_checksum_is_of_weights_and_scaling(tmp_path):
    variants = [{}, {}, {"kind": "kind-a"}, {"weight": 1.5}, {"minimum": -0.5}]
    checksums = [
        weights_checksum(add_encoder(Results(tmp_path / str(number)), **variant))
        for number, variant in enumerate(variants)
    ]
    # An archive without names calls the kind otherwise.
    assert checksums[0] == checksums[1] == checksums[2]
    assert len(set(checksums)) == 3
    assert len(checksums[0]) == 64


def test_checksum_of_an_encoder_without_intact_files_is_unknown(results):
    encoder = add_encoder(results, finish=False)
    assert weights_checksum(encoder) is None
    encoder = add_encoder(results)
    (encoder.path / "encoder.json").write_text("[")
    assert weights_checksum(encoder) is None
    assert encoder_weights(results, encoder.id) == encoder_weights(results, None) == {}


def test_run_of_another_encoder_of_the_same_id_is_refused_and_named(tmp_path, results):
    encoder = add_encoder(results)
    run = add_agent(results, encoder, encoder_weights(results, encoder.id))
    check_encoder(run, results)
    assert verify(results, 1).findings == []

    other = Results(tmp_path / "other")
    add_encoder(other, weight=1.5)
    says = rf"The run {run.id} was trained with another encoder {encoder.id} than .* in .*other"
    with pytest.raises(RequestError, match=says):
        check_encoder(run, other)

    add_agent(other, encoder, encoder_weights(results, encoder.id))
    (found,) = verify(other, 1).findings
    assert (found.sort, found.id) == ("warning", run.id)
    assert f"was trained with another encoder {encoder.id} than the one in these" in str(found)


def test_older_run_and_run_without_its_encoder_are_accepted(tmp_path, results):
    encoder = add_encoder(results)
    older = add_agent(results, encoder, {})
    assert ENCODER_WEIGHTS not in older.manifest.provenance
    check_encoder(older, results)
    lonely = add_agent(Results(tmp_path / "lonely"), encoder, {ENCODER_WEIGHTS: "0" * 64})
    check_encoder(lonely, Results(tmp_path / "lonely"))
    assert verify(results, 1).findings == []
    # What is not an id could lead out of the results.
    stray = add_whole_run(results, representation="dae1", encoder="../encoders", seed=1)
    alter_manifest(stray, provenance={ENCODER_WEIGHTS: "0" * 64})
    stray.refresh()
    check_encoder(stray, results)


@pytest.mark.parametrize(("weight", "outcome"), [(1.0, "copied"), (1.5, "refused")])
def test_merge_refuses_a_run_of_another_encoder_also_without_that_encoder(
    weight, outcome, tmp_path, results
):
    add_encoder(results, weight=weight)
    elsewhere = Results(tmp_path / "elsewhere")
    encoder = add_encoder(elsewhere)
    source = Results(tmp_path / "source")
    run = add_agent(source, encoder, encoder_weights(elsewhere, encoder.id))

    (merged,) = merge(results, [source])

    assert (merged.record, merged.outcome) == (f"run {run.id}", outcome)
    if outcome == "refused":
        assert f"was made with another encoder {encoder.id} than that of" in merged.reason
