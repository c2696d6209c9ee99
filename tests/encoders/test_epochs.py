"""Tests of the number of epochs of encoders whose epochs are not given."""

import pytest

from jbench.encoders.settings import encoder_settings, options_with_epochs


@pytest.mark.parametrize(
    ("kind", "options", "episodes", "epochs"),
    [
        # 4,000 episodes for training: 489 batches of 8,192 rows, so 97,800 updates.
        ("dae", {}, 5000, 200),
        ("contrastive", {}, 5000, 50),
        ("dae", {}, 20, 2000),  # 16,000 rows: 2 batches
        ("dae", {}, 100, 400),  # 80,000 rows: 10 batches
        ("dae", {"batch": 256}, 20, 200),  # 63 batches: 12,600 updates
        ("dae", {"epochs": 3}, 20, 3),
    ],
)
def test_epochs_of_dataset(kind, options, episodes, epochs):
    assert options_with_epochs(kind, options, episodes, seed=0) == {**options, "epochs": epochs}


def test_closed_form_has_no_epochs():
    assert options_with_epochs("pca", {}, 20, seed=0) == {}


def test_ids_of_encoders_of_papers_dataset_stay():
    about = {"task": "face_direction", "dataset": "random/s00-1f9a2c4e", "latents": 12, "seed": 0}
    chosen = options_with_epochs("dae", {}, 5000, seed=0)
    assert encoder_settings("dae", chosen, **about) == encoder_settings("dae", {}, **about)
