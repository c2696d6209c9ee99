"""Fixtures of encoder tests: a results directory, and an encoder trained once."""

from types import SimpleNamespace

import pytest

from jbench.encoders.settings import encoder_settings
from jbench.encoders.states import States
from jbench.encoders.training import train_encoder
from jbench.store import Results
from tests.encoders.encoder_data import make_dataset
from tests.short_encoders import short_encoder_evaluation as short_evaluation


@pytest.fixture(autouse=True)
def _short_evaluation(short_encoder_evaluation):
    """Shortens the evaluation of encoders in all tests of this package."""


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results")


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """A dataset of five episodes and an encoder of it; tests must not change them."""
    results = Results(tmp_path_factory.mktemp("trained") / "results")
    dataset = make_dataset(results)
    options = {"epochs": 4, "batch": 500}
    settings = encoder_settings("dae", options, dataset=dataset.id, latents=3, seed=2)
    settings = settings.without_names  # so it is dae3
    states = States(dataset, "face_direction", 2)
    with short_evaluation():
        record = train_encoder(settings, states, results)
    return SimpleNamespace(
        results=results, dataset=dataset, settings=settings, states=states, record=record
    )
