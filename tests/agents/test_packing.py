"""Tests of packing the state of agents into tensors and JSON."""

import json

import numpy as np
import pytest
import safetensors.torch
import torch

from jbench.agents.plugin import pack, unpack
from jbench.errors import WorkError


def through_files(value):
    """Packs a value, writes and reads it as a checkpoint, and unpacks it."""
    tensors = {}
    node = json.loads(json.dumps(pack(value, tensors), allow_nan=False))
    return unpack(node, safetensors.torch.load(safetensors.torch.save(tensors)))


def test_optimizer_continues_from_packed_state():
    torch.manual_seed(0)
    states = []
    module = torch.nn.Linear(3, 2)
    optimizer = torch.optim.Adam(module.parameters(), lr=0.1)
    for i in range(4):
        if i == 2:
            states = through_files({"module": module.state_dict(), "adam": optimizer.state_dict()})
        optimizer.zero_grad()
        module(torch.ones(1, 3)).square().sum().backward()
        optimizer.step()
    again = torch.nn.Linear(3, 2)
    other = torch.optim.Adam(again.parameters(), lr=0.1)
    again.load_state_dict(states["module"])
    other.load_state_dict(states["adam"])
    for _ in range(2):
        other.zero_grad()
        again(torch.ones(1, 3)).square().sum().backward()
        other.step()
    assert torch.equal(again.weight, module.weight)


def test_values_keep_their_types_and_bits():
    generator = np.random.default_rng(5)
    value = {
        "generator": generator.bit_generator.state,
        "pair": (1, [True, None, "text"]),
        "best": -np.inf,
        "total": np.float32(0.1),
        "flags": np.array([True, False]),
        "empty": np.zeros((0, 4)),
        "transposed": np.arange(6.0).reshape(2, 3).T,
        3: torch.arange(4, dtype=torch.int64),
    }
    found = through_files(value)
    assert found["generator"] == value["generator"]
    assert found["pair"] == (1, [True, None, "text"])
    assert found["best"] == -np.inf
    assert type(found["total"]) is np.float32
    assert found["total"] == np.float32(0.1)
    assert found["flags"].dtype == bool
    assert found["empty"].shape == (0, 4)
    assert np.array_equal(found["transposed"], value["transposed"])
    assert torch.equal(found[3], value[3])


def test_packed_tensor_is_copy():
    array, tensors = np.zeros(2), {}
    node = pack(array, tensors)
    array[0] = 1
    assert unpack(node, tensors).tolist() == [0, 0]


def test_unsupported_object_is_refused_with_its_path():
    with pytest.raises(WorkError, match=r"state\(\)\['buffer'\]\[1\] of the agent is a set"):
        pack({"buffer": [0, {1, 2}]}, {})
