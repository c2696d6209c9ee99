"""Tests of the registration of the environments with Gymnasium."""

import subprocess
import sys

import pytest
from gymnasium.envs.registration import registry

from jbench.registration import environment_id, register_task

MAKE = "print(gymnasium.make('{}Jitterbug/FaceDirection-v0').spec.id)"

LOOK = "import importlib.util as util, jbench; util.find_spec('gymnasium'); import gymnasium"
"""As programs do that ask whether Gymnasium is installed."""


@pytest.mark.parametrize(
    "program",
    [
        f"{LOOK}; {MAKE.format('jbench:')}",
        pytest.param(f"import jbench, gymnasium; {MAKE.format('jbench:')}", marks=pytest.mark.slow),
        pytest.param(f"import jbench, gymnasium; {MAKE.format('')}", marks=pytest.mark.slow),
        pytest.param(f"import gymnasium, jbench; {MAKE.format('')}", marks=pytest.mark.slow),
        pytest.param(f"import gymnasium; {MAKE.format('jbench:')}", marks=pytest.mark.slow),
    ],
)
def test_environments_are_registered_in_any_order_of_imports(program):
    made = subprocess.check_output([sys.executable, "-c", program], text=True)
    assert made.split() == ["Jitterbug/FaceDirection-v0"]


def test_id_of_a_task_is_asked_for_without_registering_it():
    task = "dmc:reacher-hard"
    before = registry.pop(environment_id(task))
    try:
        assert environment_id(task) == "jbench/dmc-reacher-hard-v0"
        assert environment_id(task) not in registry
        register_task(task)
        assert registry[environment_id(task)] == before
    finally:
        registry[environment_id(task)] = before
