"""Tests of robots with odd specifications and observations."""

import re

import numpy as np
import pytest

from jbench.errors import RequestError
from jbench.tasks.find import checked_task, find_task
from jbench.tasks.worlds import EpisodeError

ODD = "tests.odd_tasks"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            "NoObservationSpec",
            "its observation_spec fails (NotImplementedError: later, line N of odd_tasks.py).",
        ),
        ("NoActionSpec", "its action_spec fails (KeyError: 'nope', line N of odd_tasks.py)."),
        ("nothing_observed", "its observation has no values: give it at least one number."),
        (
            "two_cases",
            "a dataset of it would have the columns q and Q, which SQL takes for one; rename that "
            "part of its observation.",
        ),
        (
            "drawn",
            "its observation eye is a picture of shape (16, 16, 3), and jbench takes a few "
            "numbers; give it an observation of positions and velocities.",
        ),
        ("TimestepInText", "its control_timestep is '0.01', not a number of seconds."),
        (
            "Nested",
            "its observation arm is a dictionary, not an array; return one dictionary of named "
            "arrays.",
        ),
    ],
)
def test_task_is_refused_in_a_sentence(name, sentence, refused):
    assert re.sub(r"line \d+ of", "line N of", refused("tasks", f"{ODD}:{name}")) == (
        f"Error: jbench can't use the task {ODD}:{name}: {sentence}\n"
    )


def test_step_that_begins_an_episode_is_refused():
    with pytest.raises(RequestError, match=r"at control step 1 of .*, its reward is None\.$"):
        checked_task(f"{ODD}:BeginsAgain")


def test_physics_of_another_simulator_is_no_model_of_mujoco():
    task = checked_task(f"{ODD}:OtherSimulator")
    assert not task.has_physics
    assert (task.specs.model, task.specs.compiled) == (None, None)


def test_part_without_values_is_left_out_with_a_note(run_command, tmp_path):
    name = f"{ODD}:without_sensors"
    task = checked_task(name)
    assert dict(task.parts) == {"q": 1}
    assert task.episode_steps == 20
    note = f"Warning: {name}: sensors of its observation has no values and is left out.\n"
    assert run_command("tasks", name)[::2] == (0, note)
    evaluated = ("evaluate", "random", "--task", name, "--episodes", 1)
    assert run_command(*evaluated, results=tmp_path)[::2] == (0, note)
    code, out, err = run_command("collect", "--task", name, "--steps", 40, results=tmp_path)
    assert code == 0
    assert note in err
    # An encoder can have one latent of one number, and the default is 12.
    assert f"Next: jbench train-dae --task {name} --latent 1" in out


def test_floats_and_lists_are_parts_of_an_observation():
    task = checked_task(f"{ODD}:scalars")
    assert dict(task.parts) == {"q": 1, "v": 1}
    with task.worlds(1) as worlds:
        worlds.reset([np.random.default_rng(0)])
        observations, _ = worlds.step(np.array([[0.5]]))
    # Semi-implicit Euler: a force of 3 * 0.5 N moves 1 kg for 0.01 s.
    np.testing.assert_allclose(observations, [[1.5e-4, 1.5e-2]], rtol=1e-6)


def test_physics_that_diverges_stops_its_world_alone():
    name = f"{ODD}:diverging"
    pushes = np.array([[1.0], [0.01]])
    with find_task(name).worlds(2) as worlds:
        first = worlds.reset([np.random.default_rng(seed) for seed in (0, 1)])
        stopped, moved = worlds.step(pushes)[0]
        assert list(worlds.failures) == [0]
        assert re.fullmatch(
            rf"jbench can't use the task {name}: at control step 1 of the episode with seed "
            r"\d+, it fails \(PhysicsError: .*\)\.",
            str(worlds.failures[0]),
        )
        np.testing.assert_array_equal(stopped, first[0])
        # 1e9 N move 1 kg for 0.01 s to 1e7 m/s, of which the hyperbolic tangent of 1e-2 is seen.
        np.testing.assert_allclose(moved, np.tanh([1e-2]), rtol=1e-6)
        with pytest.raises(EpisodeError):
            worlds.check()
        worlds.reset([np.random.default_rng(seed) for seed in (0, 1)])
        assert not worlds.failures
