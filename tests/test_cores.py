"""Tests of the number of usable cores: CPU affinity and limits of the control group."""

import os

import pytest

from jbench import cores


def test_cores_respect_affinity_and_quota(monkeypatch):
    monkeypatch.setattr(cores, "_quotas", lambda: [])
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {3, 5, 7})
    assert cores.cores() == 3
    monkeypatch.setattr(cores, "_quotas", lambda: [8, 2])
    assert cores.cores() == 2


def quotas(folder, group, limits):
    """Writes `cpu.max` files; returns the limits that apply to a process of a control group."""
    for name, text in limits.items():
        (folder / "fs" / name).mkdir(parents=True, exist_ok=True)
        (folder / "fs" / name / "cpu.max").write_text(text)
    (folder / "cgroup").write_text(group)
    return cores._quotas(folder / "cgroup", folder / "fs")


@pytest.mark.parametrize(
    ("group", "limits", "found"),
    [
        ("0::/a/b\n", {"a/b": "max 100000\n", "a": "250000 100000\n"}, [3]),
        ("0::/a/b\n", {"a/b": "50000 100000\n", "a": "400000 100000\n"}, [1, 4]),
        # In a container, the limit is in the root directory.
        ("0::/\n", {".": "200000 100000\n"}, [2]),
        ("4:cpu:/old\n", {".": "200000 100000\n"}, []),
        ("0::/a\n", {"a": "nonsense"}, []),
    ],
)
def test_control_group_limits_are_read(group, limits, found, tmp_path):
    assert quotas(tmp_path, group, limits) == found
    assert cores._quotas(tmp_path / "missing", tmp_path) == []
