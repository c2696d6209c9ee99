"""Compares the states of two versions of MuJoCo: `python benchmarks/mujoco_versions.py FILE`.

Run it in an environment with one version, which writes FILE, and then in one with the other, which
prints the largest differences from FILE, in SI units, by the control steps since the start.
Six episodes of random actions begin upright or lying on any side.
"""

import argparse
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.task_specs import PHYSICS_STEPS
from jbench.tasks.jitterbug import model
from jbench.tasks.jitterbug.robots import load_model

EPISODES = 6
SHOWN = (1, 10, 40, 100)  # control steps


def states() -> NDArray[np.float64]:
    """Returns qpos and qvel (episodes, control steps, 31) with this version of MuJoCo."""
    robot, random = load_model(), np.random.default_rng(0)
    data, rows = mujoco.MjData(robot), []
    for episode in range(EPISODES):
        quaternion = random.normal(size=4) if episode % 2 else model.UPRIGHT
        model.place(data, quaternion / np.linalg.norm(quaternion))
        for control in random.uniform(-1, 1, SHOWN[-1]):
            data.ctrl[0] = control
            mujoco.mj_step(robot, data, nstep=PHYSICS_STEPS)
            rows.append(np.concatenate([data.qpos, data.qvel]))
    return np.reshape(rows, (EPISODES, SHOWN[-1], -1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="of states, .npy")
    file = parser.parse_args().file
    found = states()
    print("MuJoCo", mujoco.__version__)
    if not file.exists():
        with file.open("wb") as opened:  # np.save adds .npy to a path
            np.save(opened, found)
        return
    difference = np.abs(found - np.load(file)).max(axis=0)
    for step in SHOWN:
        position, velocity = difference[step - 1, :16].max(), difference[step - 1, 16:].max()
        print(f"{step:4} control steps: positions {position:.0e}, velocities {velocity:.0e}")


if __name__ == "__main__":
    main()
