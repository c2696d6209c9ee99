"""Where a record was made: the device and the cores of its process."""

import os

import pytest
import torch

from jbench.store import provenance
from jbench.store.provenance import cores, device_provenance, differences

H100 = {"device": "cuda", "gpu": "NVIDIA H100", "cuda": "13.0", "driver": "580.65.06"}


def test_a_processor_and_a_gpu_are_told_apart(monkeypatch):
    assert device_provenance(torch.device("cpu")) == {"device": "cpu"}
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: "NVIDIA H100")
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    monkeypatch.setattr(provenance, "_driver", lambda: "580.65.06")
    assert device_provenance(torch.device("cuda")) == H100


@pytest.mark.parametrize(
    ("now", "changed"),
    [
        (H100, {}),
        ({"device": "cpu"}, {"device": ["cuda", "cpu"]}),
        (H100 | {"gpu": "NVIDIA H200"}, {"gpu": ["NVIDIA H100", "NVIDIA H200"]}),
        (H100 | {"cuda": "13.1"}, {"cuda": ["13.0", "13.1"]}),
        (H100 | {"driver": "590.1"}, {"driver": ["580.65.06", "590.1"]}),
    ],
)
def test_another_device_is_a_difference(now, changed):
    assert differences(H100, now) == changed


def test_a_device_that_was_not_recorded_is_no_difference():
    assert differences({"processor": "x"}, {"processor": "x", "device": "cpu"}) == {}


def test_cores_are_those_that_the_process_may_use(monkeypatch):
    monkeypatch.setattr(provenance, "_quotas", lambda: [])
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {3, 5, 7})
    assert cores() == 3
    monkeypatch.setattr(provenance, "_quotas", lambda: [8, 2])
    assert cores() == 2


def quotas(folder, group, limits):
    """The cores that these `cpu.max` files by directory allow a process of a control group."""
    for name, text in limits.items():
        (folder / "fs" / name).mkdir(parents=True, exist_ok=True)
        (folder / "fs" / name / "cpu.max").write_text(text)
    (folder / "cgroup").write_text(group)
    return provenance._quotas(folder / "cgroup", folder / "fs")


@pytest.mark.parametrize(
    ("group", "limits", "found"),
    [
        ("0::/a/b\n", {"a/b": "max 100000\n", "a": "250000 100000\n"}, [3]),
        ("0::/a/b\n", {"a/b": "50000 100000\n", "a": "400000 100000\n"}, [1, 4]),
        # In a container, the limit is that of the root that it sees.
        ("0::/\n", {".": "200000 100000\n"}, [2]),
        ("4:cpu:/old\n", {".": "200000 100000\n"}, []),
        ("0::/a\n", {"a": "nonsense"}, []),
    ],
)
def test_limits_of_control_groups_are_read(group, limits, found, tmp_path):
    assert quotas(tmp_path, group, limits) == found


def test_without_control_groups_there_is_no_limit(tmp_path):
    assert provenance._quotas(tmp_path / "missing", tmp_path) == []
