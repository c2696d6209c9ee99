"""Tests of the registration of the environments with Gymnasium."""

import subprocess
import sys

import pytest

MAKE = "print(gymnasium.make('{}Jitterbug/FaceDirection-v0').spec.id)"


@pytest.mark.parametrize(
    "program",
    [
        f"import jbench, gymnasium; {MAKE.format('jbench:')}",
        pytest.param(f"import jbench, gymnasium; {MAKE.format('')}", marks=pytest.mark.slow),
        pytest.param(f"import gymnasium, jbench; {MAKE.format('')}", marks=pytest.mark.slow),
        pytest.param(f"import gymnasium; {MAKE.format('jbench:')}", marks=pytest.mark.slow),
    ],
)
def test_environments_are_registered_in_any_order_of_imports(program):
    made = subprocess.check_output([sys.executable, "-c", program], text=True)
    assert made.split() == ["Jitterbug/FaceDirection-v0"]
