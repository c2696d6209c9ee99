"""Tries the augmented robots of many seeds: `python benchmarks/augmented.py --seeds 1000`.

Every seed's robot is drawn, stands for a second, and lives another under random torque. Prints how
many seeds gave no robot, how many redraws there were, how the robots stand, how often MuJoCo warned
of a bad state, and in how many robots two parts touched each other at the end of a control step.
"""

import argparse
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import mujoco
import numpy as np

from jbench.errors import WorkError
from jbench.names import PHYSICS_STEPS
from jbench.tasks import augmented, model

CONTROL_STEPS = 100  # of random torque: 1 s
THREADS = 2


class Trial(NamedTuple):
    """What one seed's robot did.

    Attributes:
        redraws: draws before it that gave no robot that stands; -1 if none ever did.
        standing: its upright reward after a second without torque.
        warnings: MuJoCo's warnings in a second of random torque.
        touches: pairs of its own parts in contact, summed over the control steps of that second.
    """

    redraws: int
    standing: float = 1.0
    warnings: int = 0
    touches: int = 0


def attempt(seed: int, vary_masses: bool) -> Trial:
    """Returns what the robot of a seed does."""
    try:
        morphology = augmented.draw(seed, vary_masses=vary_masses)
    except WorkError:
        return Trial(-1)
    robot = augmented.build(morphology)
    data = mujoco.MjData(robot)
    model.place(data, np.array([1.0, 0, 0, 0]))
    floor, touches = robot.geom("floor").id, 0
    for control in np.random.default_rng(seed).uniform(-1, 1, CONTROL_STEPS):
        data.ctrl[:] = control
        mujoco.mj_step(robot, data, nstep=PHYSICS_STEPS)
        touches += sum(floor not in contact.geom for contact in data.contact)
    warnings = int(data.warning.number.sum())
    return Trial(morphology.redraws, augmented.standing_reward(robot), warnings, touches)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1000, help="seeds 0 to this are tried")
    parser.add_argument("--vary-masses", action="store_true", help="draw densities and gear, too")
    arguments = parser.parse_args()
    with ThreadPoolExecutor(THREADS) as threads:
        trials = list(
            threads.map(lambda seed: attempt(seed, arguments.vary_masses), range(arguments.seeds))
        )
    robots = [trial for trial in trials if trial.redraws >= 0]
    standing = np.array([trial.standing for trial in robots])
    print(f"{len(trials)} seeds, {len(trials) - len(robots)} of them without a robot")
    print(f"{sum(trial.redraws for trial in robots)} redraws")
    print(f"upright reward when standing: lowest {standing.min():.4f}, mean {standing.mean():.4f}")
    print(f"{sum(trial.warnings for trial in robots)} warnings under random torque")
    print(f"{sum(trial.touches > 0 for trial in robots)} robots with parts that touched each other")


if __name__ == "__main__":
    main()
