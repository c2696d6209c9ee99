"""Checks the augmented robots of many seeds: `python benchmarks/augmented.py --seeds 1000`.

Each robot is simulated for a second without torque and for a second of random torque. Prints the
number of seeds without a robot, the redraws, the upright rewards without torque, MuJoCo's warnings
of bad states, and the number of robots in which two parts were in contact after a control step.
"""

import argparse
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import mujoco
import numpy as np

from jbench.errors import WorkError
from jbench.task_specs import PHYSICS_STEPS
from jbench.tasks.jitterbug import model, robots

CONTROL_STEPS = 100  # of random torque: 1 s
THREADS = 2


class Trial(NamedTuple):
    """Outcome for the robot of one seed.

    Attributes:
        redraws: draws that were rejected before this robot; -1 if there is no robot.
        upright: its upright reward after a second without torque.
        warnings: MuJoCo's warnings in a second of random torque.
        touches: contacts between its own parts, summed over the control steps of that second.
    """

    redraws: int
    upright: float = 1.0
    warnings: int = 0
    touches: int = 0


def attempt(seed: int, vary_masses: bool) -> Trial:
    """Simulates the robot of a seed."""
    try:
        morphology = robots.draw(seed, vary_masses=vary_masses)
    except WorkError:
        return Trial(-1)
    robot = robots.build(morphology)
    data = mujoco.MjData(robot)
    model.place(data, np.array([1.0, 0, 0, 0]))
    floor, touches = robot.geom("floor").id, 0
    for control in np.random.default_rng(seed).uniform(-1, 1, CONTROL_STEPS):
        data.ctrl[:] = control
        mujoco.mj_step(robot, data, nstep=PHYSICS_STEPS)
        touches += sum(floor not in contact.geom for contact in data.contact)
    warnings = int(data.warning.number.sum())
    return Trial(morphology.redraws, robots.standing_reward(robot), warnings, touches)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1000, help="number of seeds, from 0")
    parser.add_argument(
        "--vary-masses", action="store_true", help="randomize densities and gear too"
    )
    arguments = parser.parse_args()
    with ThreadPoolExecutor(THREADS) as threads:
        trials = list(
            threads.map(lambda seed: attempt(seed, arguments.vary_masses), range(arguments.seeds))
        )
    robots = [trial for trial in trials if trial.redraws >= 0]
    upright = np.array([trial.upright for trial in robots])
    print(f"{len(trials)} seeds, {len(trials) - len(robots)} of them without a robot")
    print(f"{sum(trial.redraws for trial in robots)} redraws")
    print(f"upright reward without torque: lowest {upright.min():.4f}, mean {upright.mean():.4f}")
    print(f"{sum(trial.warnings for trial in robots)} warnings under random torque")
    print(
        f"{sum(trial.touches > 0 for trial in robots)} robots with contacts between their own parts"
    )


if __name__ == "__main__":
    main()
