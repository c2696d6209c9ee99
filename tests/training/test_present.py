"""Tests of which records have other code than the present one."""

import sys

import pytest

from jbench.sources import source_files
from jbench.store import Results
from jbench.training.present import other_code

FILES = {
    "__init__.py": "from gymnasium import register\nregister('own/Arm-v0', 'own_arms.arm:Arm')\n",
    "arm.py": "from .reward import GAIN\n",
    "reward.py": "GAIN = 1\n",
}
RECORDED = {"own_arms/__init__.py", "own_arms/arm.py", "own_arms/reward.py"}


@pytest.fixture
def package(tmp_path, monkeypatch):
    """The folder of a package that registers an environment of another one of its modules."""
    folder = tmp_path / "own_arms"
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    return folder


def test_code_of_an_environment_that_a_module_registers_is_compared(package, tmp_path):
    files = {**source_files("own_arms.arm"), **source_files("own_arms")}
    assert files.keys() == RECORDED
    results = Results(tmp_path / "results")
    results.create(
        "dataset",
        "gym.own_arms.own/Arm-v0/random/s00-12345678",
        {"robot": "gym:own_arms:own/Arm-v0"},
        {"task_sources": files},
    ).finish({})

    def other():
        return [one.files for one in other_code(results.scan("dataset")[0])]

    assert other() == []
    (package / "reward.py").write_text("GAIN = 1  # of the reward\n")
    assert other() == []
    (package / "reward.py").write_text("GAIN = 2\n")
    assert other() == [("own_arms/reward.py",)]
    (package / "reward.py").unlink()
    assert other() == [("own_arms/reward.py",)]
    (package / "arm.py").unlink()
    (package / "__init__.py").unlink()
    assert other() == [()]  # not at hand
    assert "own_arms" not in sys.modules
