"""The cores of a process: its affinity and the limits of its control group."""

import os

import pytest

from jbench import cores


def test_cores_are_those_that_the_process_may_use(monkeypatch):
    monkeypatch.setattr(cores, "_quotas", lambda: [])
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {3, 5, 7})
    assert cores.cores() == 3
    monkeypatch.setattr(cores, "_quotas", lambda: [8, 2])
    assert cores.cores() == 2


def quotas(folder, group, limits):
    """The cores that these `cpu.max` files by directory allow a process of a control group."""
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
        # In a container, the limit is that of the root that it sees.
        ("0::/\n", {".": "200000 100000\n"}, [2]),
        ("4:cpu:/old\n", {".": "200000 100000\n"}, []),
        ("0::/a\n", {"a": "nonsense"}, []),
    ],
)
def test_limits_of_control_groups_are_read(group, limits, found, tmp_path):
    assert quotas(tmp_path, group, limits) == found


def test_without_control_groups_there_is_no_limit(tmp_path):
    assert cores._quotas(tmp_path / "missing", tmp_path) == []
