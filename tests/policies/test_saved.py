"""Tests of saved networks and of the format of their files before."""

import json

import numpy as np
import pytest
import safetensors.numpy

from jbench.policies.layer_sequences import relu_layers
from jbench.policies.layers import Linear
from jbench.policies.network import WEIGHTS, SavedNetwork


def matrices(shapes):
    random = np.random.default_rng(0)
    return [random.normal(size=shape).astype("f4") for shape in shapes]


FIRST, BIAS, LAST = matrices([(8, 16), (8,), (2, 8)])
MEAN, DEVIATION, WIDE, WIDER, ON_UNITS = matrices([(4,), (4,), (5, 4), (6, 9), (1, 11)])
LINEAR = [
    Linear(weight=FIRST, bias=BIAS),
    Linear(weight=LAST, bias=np.zeros(2, "f4")),
]


def older_files(layers, squash, features=None, **arrays):
    """A policy as it was saved before all policies became networks."""
    names = {name.replace("_", "."): array for name, array in arrays.items()}
    tensors = {
        **{f"{i}.weight": weight for i, (weight, _) in enumerate(layers)},
        **{f"{i}.bias": bias for i, (_, bias) in enumerate(layers)},
        **{f"features.{name}": array for name, array in names.items()},
    }
    described = {"layers": len(layers), "squash": squash}
    if features is not None:
        described["features"] = features
    return safetensors.numpy.save(tensors), json.dumps(described).encode()


@pytest.mark.parametrize("squash", ["tanh", "clip"])
def test_older_files_are_read(squash):
    files = older_files([(FIRST, BIAS), (LAST, np.zeros(2, "f4"))], squash)
    (observations,) = matrices([(50, 16)])
    raw = np.maximum(observations @ FIRST.T + BIAS, 0) @ LAST.T
    expected = np.tanh(raw) if squash == "tanh" else np.clip(raw, -1, 1)
    read = SavedNetwork.from_files(*files)
    np.testing.assert_array_equal(read.act(observations), expected)
    assert read.structure() == SavedNetwork(relu_layers(LINEAR, squash)).structure()


@pytest.mark.parametrize("appended", [True, False])
def test_older_files_with_learned_features_are_read(appended):
    output = np.concatenate([DEVIATION[None], ON_UNITS], axis=1) if appended else ON_UNITS
    biases = {"0_bias": np.ones(5, "f4"), "1_bias": np.ones(6, "f4")}
    files = older_files(
        [(output, np.zeros(1, "f4"))],
        "tanh",
        {"layers": 2, "appended": appended},
        **{"mean": MEAN, "deviation": DEVIATION, "0_weight": WIDE, "1_weight": WIDER, **biases},
    )
    (observations,) = matrices([(50, 4)])
    values = np.clip((observations - MEAN) / DEVIATION, -10, 10)
    for weight in (WIDE, WIDER):
        raw = values @ weight.T + 1
        values = np.concatenate([values, raw / (1 + np.exp(-raw))], axis=1)
    features = np.concatenate([observations, values[:, 4:]], axis=1) if appended else values[:, 4:]
    read = SavedNetwork.from_files(*files)
    np.testing.assert_allclose(read.act(observations), np.tanh(features @ output.T), atol=1e-5)
    again = SavedNetwork.from_files(*read.files().values())
    np.testing.assert_array_equal(again.act(observations), read.act(observations))


@pytest.mark.parametrize(
    ("weights", "description"),
    [
        (b"not safetensors", b'{"network": [{"layer": "linear"}]}'),
        (None, b'{"network": [{"layer": "linear"}, {"layer": "exec"}]}'),
        (None, b'{"network": [{"layer": "linear"}, {"layer": "linear"}]}'),
        (None, b'{"network": [{"layer": "linear"}, {"layer": "concat", "earlier": 9}]}'),
        (None, b'{"network": [{"layer": "linear"}, {"layer": "columns", "first": Infinity}]}'),
        (None, b'{"network": [{"layer": "relu"}]}'),
        (None, b'{"layers": 9, "squash": "tanh"}'),
        (None, b'{"layers": 1, "squash": "exec"}'),
        (None, b'{"layers": 0, "squash": "tanh"}'),
        (None, b"[]"),
        (None, b"{"),
    ],
)
def test_invalid_files_are_refused(weights, description):
    kept = SavedNetwork(LINEAR[:1]).files()[WEIGHTS]
    with pytest.raises(ValueError, match=r"policy|Expecting"):
        SavedNetwork.from_files(weights or kept, description)


def test_layers_that_do_not_fit_are_refused():
    files = SavedNetwork([LINEAR[1], LINEAR[0]]).files()
    with pytest.raises(ValueError, match="mismatch"):
        SavedNetwork.from_files(*files.values())
