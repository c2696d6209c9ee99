"""Tests of the command and the device in a record's provenance."""

import sys

import pytest
import torch

from jbench.store import provenance
from jbench.store.provenance import describe_changes, device_provenance, differences, shell_command

H100 = {
    "device": "cuda",
    "gpu": "NVIDIA H100",
    "gpu_device": "cuda:1",
    "cuda": "13.0",
    "driver": "580.65.06",
}


@pytest.mark.parametrize("word", ["--seed-from=seed(\\d+)", "-a|b", "=x", "@x", "<b>"])
def test_command_is_recorded_as_typed(results, monkeypatch, word):
    monkeypatch.setattr(sys, "argv", ["/usr/bin/jbench", "import", word, "a\x1b"])
    command = results.create("run", "a", {}).manifest.provenance["command"]
    assert command == ["jbench", "import", word, "a\ufffd"]


def test_cpu_and_gpu_are_recorded_in_provenance(monkeypatch):
    assert device_provenance(torch.device("cpu")) == {"device": "cpu"}
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: "NVIDIA H100")
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    monkeypatch.setattr(provenance, "_driver", lambda: "580.65.06")
    assert device_provenance(torch.device("cuda", 1)) == H100


@pytest.mark.parametrize(
    ("now", "changed"),
    [
        (H100, {}),
        (H100 | {"gpu_device": "cuda:0"}, {}),  # another GPU of the same kind
        ({"device": "cpu"}, {"device": ["cuda", "cpu"]}),
        (H100 | {"gpu": "NVIDIA H200"}, {"gpu": ["NVIDIA H100", "NVIDIA H200"]}),
        (H100 | {"cuda": "13.1"}, {"cuda": ["13.0", "13.1"]}),
        (H100 | {"driver": "590.1"}, {"driver": ["580.65.06", "590.1"]}),
    ],
)
def test_changed_device_is_reported(now, changed):
    assert differences(H100, now) == changed


def test_unrecorded_device_is_not_compared():
    assert differences({"processor": "x"}, {"processor": "x", "device": "cpu"}) == {}


def test_entries_without_value_before_are_unknown():
    changed = {"mujoco": ["3.17.0", "3.18.0"], "git_revision": [None, "abc"]}
    assert describe_changes(changed) == (
        "mujoco 3.17.0 is now 3.18.0, jbench's git revision unknown is now abc"
    )


def test_command_is_shown_as_typed():
    recorded = ["jbench", "train", "--set", "hidden_layers=[8, 8]"]
    typed = "jbench train --set 'hidden_layers=[8, 8]'"
    assert shell_command({"command": recorded}) == typed
    assert shell_command({"command": ["__main__.py", *recorded[1:]]}) == typed
