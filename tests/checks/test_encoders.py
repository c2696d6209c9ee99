"""Tests of the checks of kinds of encoders on robots of any length of episodes."""

import pytest

from jbench.checks.code import CheckRequest, check_code


def lines(name, task):
    """Returns the state and the text of each check of a kind on a task."""
    checked = check_code("encoder", CheckRequest(name, task, {}))
    return {line.name: (line.state, line.text) for line in checked}


def test_kind_is_checked_on_whole_episodes_of_any_length():
    # Episodes of 999 control steps: five have fewer than 5,000, six have 5,994.
    checked = lines("pca", "gym:MountainCarContinuous-v0")
    assert {state for state, _ in checked.values()} == {"ok"}
    assert checked["training"][1].startswith("2 latents of 5,994 control steps explain ")


@pytest.mark.parametrize("kind", ["planar", "raw"])
def test_kind_without_a_size_on_the_task_is_refused_in_a_sentence(kind):
    sentence = f"There is no {kind} encoder of gym:Pendulum-v1; choose dae, pca or forward."
    assert lines(kind, "gym:Pendulum-v1") == {"class": ("fails", sentence)}
