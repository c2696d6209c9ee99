"""Tests of kinds of users: hand-made numbers, trained torch modules, and mistakes in both."""

import re
import sys
from importlib.metadata import EntryPoint

import numpy as np
import pytest
import torch

from jbench import sources
from jbench.encoders import find_draws, load_encoder, registry, training
from jbench.encoders.find import find_encoder
from jbench.encoders.registry import find_kind, latent_sizes
from jbench.encoders.settings import encoder_settings
from jbench.encoders.states import States
from jbench.encoders.training import train_encoder
from jbench.errors import RequestError, WorkError
from jbench.store import Results
from jbench.store.code import ChangedCodeError
from jbench.store.tables import read_tables
from tests.documentation import code_of
from tests.encoders.encoder_data import observations_of

TASK = "face_direction"
PAGE = "your-own-encoder.md"

MISTAKES = """
from jbench.encoders.kind import Fitted
import numpy as np
import torch

class Nothing(Fitted): pass

class Rows(Fitted):
    def encode(self, weights, scaled):
        return scaled[[0, 1, 2]]

class Fit(Fitted):
    def fit(self, states, latents):
        return {"mean": states.means}
    def encode(self, weights, scaled):
        return scaled - weights["mean"]

class Arrays(Fitted):
    def encode(self, weights, scaled):
        return np.concatenate([scaled[..., :2], np.asarray(scaled)[..., 4:5]], axis=-1)

class Texts:
    pass
"""

SHIFTED = """
from jbench.encoders.kind import Fitted

class Shifted(Fitted):
    shift: float = 0.0
    chosen: list[int] = [0, 1]

    def encode(self, weights, scaled):
        return scaled[..., self.chosen] + self.shift
"""

CHOOSING = """
import torch
from jbench.encoders.pretrained import TorchEncoder

class Choice(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.register_buffer("chosen", torch.zeros(3, dtype=torch.int64))
        self.register_buffer("is_kept", torch.zeros(3, dtype=torch.bool))

    def forward(self, states):
        return states[..., self.chosen][..., self.is_kept]

class Choosing(TorchEncoder):
    def module(self):
        module = Choice()
        module.is_kept[:2] = True
        return module

    def state_dict(self):
        return {"chosen": torch.tensor([7, 2, 5]), "is_kept": torch.tensor([True, False, True])}
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """The module `mine` with both examples of the page, and mistakes; the file of a module."""
    parts = ("class Motions", "class MyVAE")
    blocks = [code_of(PAGE, "python", part) for part in parts]
    code = "\n".join([*blocks, MISTAKES, SHIFTED, CHOOSING])
    (tmp_path / "mine.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    module = find_kind("mine:MyVAE")().module()
    torch.save(module.state_dict(), tmp_path / "vae.pt")
    yield module
    sys.modules.pop("mine", None)


def made(kind, trained, results, **options):
    (latents,) = latent_sizes(kind, TASK, options)
    settings = encoder_settings(
        kind, options, dataset=trained.dataset.id, latents=latents, seed=2, task=TASK
    )
    states = States(trained.dataset, TASK, 2, scale=options.get("scale", "dataset"))
    return train_encoder(settings, states, results)


def test_numbers_made_by_hand_need_only_encode(mine, trained, results):
    record = made("mine:Motions", trained, results)
    assert record.path.parent.name == "motions9"
    encoder = load_encoder(results, record.id).encoder
    seen = observations_of(trained.dataset)[0]
    scaled = trained.states.scaled(seen)
    np.testing.assert_array_equal(encoder.encode(seen), scaled[:, 7:])

    # Nine features are the latents, and the others are predicted by linear regression.
    features = record.read("encoder_features").to_pandas()
    assert features["test_mse"][7:].max() < 1e-9
    assert features["test_mse"][:7].max() > 1e-4
    fraction = features["test_mse"].sum() / features["test_variance"].sum()
    (row,) = read_tables(Results(results.path), ["encoders"]).tables["encoders"].to_pylist()
    assert row["test_explained"] == pytest.approx(1 - fraction)
    assert row["test_explained"] > 0.3


def test_trained_module_is_saved_with_its_numbers(mine, trained, results, tmp_path):
    record = made("mine:MyVAE", trained, results, scale="observation")
    assert record.path.parent.name == "my-vae5-observation"
    (tmp_path / "vae.pt").unlink()  # it is not needed any more
    sources._known.clear()  # as in another process
    encoder = load_encoder(results, record.id).encoder
    seen = observations_of(trained.dataset)[0]
    with torch.no_grad():
        expected = mine(torch.from_numpy(seen))
    np.testing.assert_allclose(encoder.encode(seen), expected.numpy(), atol=1e-6)
    tensors = encoder.encode(torch.from_numpy(seen).double())
    assert tensors.dtype == torch.float64
    np.testing.assert_allclose(tensors, expected, atol=1e-6)
    assert encoder.encode(seen[0]).shape == (5,)


def test_integers_and_booleans_of_a_module_are_its_own_type(mine, trained, results):
    record = made("mine:Choosing", trained, results, scale="observation")
    encoder = load_encoder(results, record.id).encoder
    seen = observations_of(trained.dataset)[0]
    np.testing.assert_array_equal(encoder.encode(seen), seen[:, [7, 5]])
    tensors = encoder.encode(torch.from_numpy(seen).double())
    np.testing.assert_array_equal(tensors, seen[:, [7, 5]])


@pytest.mark.parametrize("options", [{"shift": -0.5}, {"chosen": [7, 2, 5]}])
def test_installed_kind_is_found_by_a_name_with_a_hashed_option(
    mine, trained, results, monkeypatch, options
):
    point = EntryPoint("mine", "mine:Shifted", "jbench.encoders")
    monkeypatch.setattr(registry, "offered_kinds", lambda: {"mine": point})
    monkeypatch.setattr(registry, "kind_provenance", lambda kind: {})
    monkeypatch.setattr(training, "kind_provenance", lambda kind: {})
    record = made("mine", trained, results, **options)
    name = record.path.parent.name
    assert re.fullmatch(r"mine[23]-(shift|chosen)-[0-9a-f]{8}", name)
    assert find_encoder(results, name, TASK) == record.id

    with pytest.raises(RequestError, match=f"No encoder mine2-shift-0123456f in .*{record.id}"):
        find_encoder(results, "mine2-shift-0123456f", TASK)
    with pytest.raises(RequestError, match="shift of mine can't be 'far'"):
        find_encoder(results, "mine2-shift-far", TASK)


def test_encoder_of_an_edited_file_is_refused(mine, trained, results, tmp_path):
    record = made("mine:MyVAE", trained, results, scale="observation")
    (tmp_path / "vae.pt").write_bytes(b"other weights")
    sources._known.clear()  # as in another process
    with pytest.raises(ChangedCodeError, match=rf"vae\.pt has changed since .* {record.id}"):
        load_encoder(results, record.id)


def test_encoders_of_all_seeds_are_found_by_accepted_code(mine, trained, results, tmp_path):
    record = made("mine:MyVAE", trained, results, scale="observation")
    (tmp_path / "vae.pt").write_bytes(b"other weights")
    sources._known.clear()  # as in another process
    name = record.path.parent.name
    with pytest.raises(ChangedCodeError, match=r"vae\.pt has changed since"):
        find_draws(results, name, TASK, [2])
    assert find_draws(results, name, TASK, [2], accept_changed=True).ids == {2: record.id}


@pytest.mark.parametrize(
    ("kind", "error", "message"),
    [
        ("VAE", RequestError, "mine:VAE is a torch module. Beside it, write a subclass of TorchE"),
        ("Texts", RequestError, "mine:Texts is not a kind of encoder: make it a subclass of Fit"),
        ("Nothing", WorkError, "mine:Nothing can't be used: it has no method .*encode"),
        ("Rows", WorkError, r"mine:Rows can't be used: .*encode fails \(IndexError"),
    ],
)
def test_mistake_is_one_sentence_before_anything_is_trained(mine, kind, error, message):
    with pytest.raises(error, match=f"{message}.*docs/your-own-encoder.md"):
        encoder_settings(f"mine:{kind}", {}, dataset="random/a", latents=3)


def test_error_of_fit_is_named(mine, trained, results):
    settings = encoder_settings("mine:Fit", {}, dataset=trained.dataset.id, latents=16, seed=2)
    with pytest.raises(WorkError, match=r"mine:Fit can't be used: fit fails \(AttributeError"):
        train_encoder(settings, States(trained.dataset, TASK, 2), results)


def test_numpy_array_for_a_torch_tensor_is_refused(mine, trained, results):
    settings = encoder_settings("mine:Arrays", {}, dataset=trained.dataset.id, latents=3, seed=2)
    message = r"mine:Arrays can't be used: encode gets a torch.Tensor .* returns a numpy.ndarray;"
    with pytest.raises(WorkError, match=message):
        train_encoder(settings, States(trained.dataset, TASK, 2), results)


def test_missing_file_of_a_module_is_named(mine, trained, results, tmp_path):
    (tmp_path / "vae.pt").unlink()
    with pytest.raises(WorkError, match=r"fit fails \(FileNotFoundError.*vae.pt"):
        made("mine:MyVAE", trained, results)
