"""A results directory, and an encoder trained once."""

from types import SimpleNamespace

import pytest
import torch
from encoder_data import make_dataset

from jbench.encoders.training import EncoderSettings, train_encoder
from jbench.store import Results


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    """These networks are so small that threads only wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results")


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """A dataset of five episodes and an encoder of it, to look at and not to change."""
    results = Results(tmp_path_factory.mktemp("trained") / "results")
    dataset = make_dataset(results)
    settings = EncoderSettings(dataset=dataset.id, latents=3, epochs=4, batch=500, seed=2)
    record = train_encoder(settings, dataset, results)
    return SimpleNamespace(results=results, dataset=dataset, settings=settings, record=record)
