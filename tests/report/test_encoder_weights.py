"""The note on agents of one curve whose encoders have one id and different weights."""

from jbench.report.data.encoder_weights import recorded_weights
from jbench.store.weights import ENCODER_WEIGHTS
from tests.store.store_rows import alter_manifest

ENCODER = "face_direction/dae12/s00-00000001"


def notes_with(fabric, weights):
    """Returns the notes of the configuration of seeds whose runs recorded these weights."""
    for seed, checksum in enumerate(weights):
        record = fabric.run([500.0] * 5, seed, representation="dae12", encoder=ENCODER)
        if checksum is not None:
            made = {**record.manifest.provenance, ENCODER_WEIGHTS: checksum}
            alter_manifest(record, provenance=made)
    ((config,), notes) = fabric.configurations()
    assert notes == []
    return [note for note in config.notes if "weights" in note]


def test_seeds_of_two_encoders_of_one_id_are_named(fabric):
    (note,) = notes_with(fabric, ["a", "b", "a", None, "b"])
    assert note == (
        f"2 encoders of different weights have the id {ENCODER}: that of seed 0, 2 and that of "
        "seed 1, 4"
    )


def test_one_encoder_or_an_unknown_one_needs_no_note(fabric):
    assert notes_with(fabric, ["a", None, "a", "a"]) == []


def test_weights_of_older_or_strange_provenance_are_unknown():
    command = f'{{"command": ["{ENCODER_WEIGHTS}"]}}'
    for text in (None, "{}", f'["{ENCODER_WEIGHTS}"]', command):
        assert recorded_weights(text) is None
    assert recorded_weights(f'{{"{ENCODER_WEIGHTS}": "a"}}') == "a"
