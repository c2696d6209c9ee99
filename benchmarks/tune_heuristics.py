"""Tunes the constants of a hand-written policy by the cross-entropy method.

    python benchmarks/tune_heuristics.py --task face_direction --candidates 120 --episodes 8

Every generation draws its candidates around the best constants so far, lets all of them live the
same fresh episodes, and moves to its best quarter. Prints the constants it ends with, and what
they earn on the tuning's episodes and on held-out ones (seeds 0 to 99) as median [10th, 90th].
`--candidates 0` only evaluates the constants as they are in `jbench.tasks.heuristics`.
"""

import argparse
import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.names import EPISODE_STEPS, PHYSICS_STEPS, TASKS
from jbench.tasks import features, heuristics, model, resets

Array = NDArray[np.float64]

FIRST_TUNING_SEED = 10_000
HELD_OUT_SEEDS = range(100)
POPULATION = 12  # candidates in a generation
ELITE = 4  # of them, those that the next generation is drawn around
SPREAD = 0.15  # standard deviation of the first draws, as a share of each constant
KEPT_SPREAD = 0.5  # share of the spread that a generation keeps, whatever its elite
THREADS = 2
COARSE = 2  # physics steps made into one while tuning: twice as fast, the same returns


class Robots:
    """Robots that live an episode in lockstep, each in MuJoCo memory of its own."""

    def __init__(self, task: str, seeds: Sequence[int], coarse: int = 1) -> None:
        """Puts one robot for each seed at the beginning of its episode.

        Args:
            task: which targets to draw and what to reward.
            seeds: of the generators, as `JitterbugEnv.reset` takes them.
            coarse: physics steps to make into one.
        """
        self.task = task
        self._model = model.load()
        self._model.opt.timestep *= coarse
        self._steps = PHYSICS_STEPS // coarse
        self._offset = model.torso_offset(self._model)
        self._data = [mujoco.MjData(self._model) for _ in seeds]
        targets = []
        for data, seed in zip(self._data, seeds, strict=True):
            random = np.random.default_rng(seed)
            model.place(data, resets.draw_quaternion(random))
            targets.append(resets.draw_target(task, random))
        self.target = features.Target(
            np.array([t.position for t in targets]), np.array([t.yaw for t in targets])
        )
        self._qpos = np.array([data.qpos for data in self._data])
        self._qvel = np.array([data.qvel for data in self._data])
        self._executor = ThreadPoolExecutor(THREADS)

    def state(self) -> features.State:
        """Returns the state of all robots."""
        return model.state_of(self._qpos, self._qvel, self._offset)

    def step(self, torque: Array) -> None:
        """Holds torques (robots,) for one control step."""
        shares = np.array_split(np.arange(len(self._data)), THREADS)
        list(self._executor.map(lambda share: self._step(share, torque), shares))

    def _step(self, share: NDArray[np.intp], torque: Array) -> None:
        for i in share:
            data = self._data[i]
            data.ctrl[0] = torque[i]
            mujoco.mj_step(self._model, data, nstep=self._steps)
            self._qpos[i], self._qvel[i] = data.qpos, data.qvel


def returns(
    policy: heuristics.Heuristic, seeds: Sequence[int], steps: int = EPISODE_STEPS, coarse: int = 1
) -> Array:
    """Returns the (robots,) returns of one episode for each seed, per 1000 steps."""
    robots = Robots(policy.task, seeds, coarse)
    policy.reset(len(seeds))
    total = np.zeros(len(seeds))
    for _ in range(steps):
        observed = features.observation(policy.task, robots.state(), robots.target)
        robots.step(policy.act(observed)[:, 0])
        total += features.reward(policy.task, robots.state(), robots.target)
    return total * (EPISODE_STEPS / steps)


def constants(policy: heuristics.Heuristic) -> dict[str, float]:
    """Returns the tunable constants of a policy by name."""
    fields = dataclasses.fields(policy)  # type: ignore[arg-type]
    return {field.name: float(getattr(policy, field.name)) for field in fields}


def with_constants(task: str, values: dict[str, Any]) -> heuristics.Heuristic:
    """Returns a task's policy with other constants, floats or one for each robot."""
    law: Any = type(heuristics.heuristic(task))
    policy: heuristics.Heuristic = law(**values)
    return policy


def tune(args: argparse.Namespace) -> dict[str, float]:
    """Returns the constants that the search ends with."""
    start = constants(heuristics.heuristic(args.task))
    names = [name for name in start if not args.constants or name in args.constants]
    mean = np.array([start[name] for name in names])
    spread = SPREAD * np.abs(mean)
    random = np.random.default_rng(args.seed)
    for generation in range(args.candidates // POPULATION):
        drawn = mean + spread * random.standard_normal((POPULATION, len(names)))
        first = FIRST_TUNING_SEED + (1000 * args.seed + generation) * args.episodes
        seeds = np.tile(np.arange(first, first + args.episodes), POPULATION)
        per_robot = dict(zip(names, np.repeat(drawn, args.episodes, axis=0).T, strict=True))
        policy = with_constants(args.task, {**start, **per_robot})
        earned = returns(policy, seeds.tolist(), args.steps, COARSE)
        score = earned.reshape(POPULATION, args.episodes).mean(1)
        elite = drawn[np.argsort(score)[-ELITE:]]
        mean = mean + 0.5 * (elite.mean(0) - mean)
        spread = np.sqrt(KEPT_SPREAD * spread**2 + (1 - KEPT_SPREAD) * elite.var(0))
        found = " ".join(f"{n}={v:.4g}" for n, v in zip(names, mean, strict=True))
        print(f"{generation}: mean {score.mean():.0f} best {score.max():.0f}: {found}", flush=True)
    return {**start, **dict(zip(names, mean.tolist(), strict=True))}


def summary(earned: Array) -> str:
    """Returns the median [10th, 90th percentile] of returns."""
    median, low, high = np.percentile(earned, [50, 10, 90])
    return f"{median:.0f} [{low:.0f}, {high:.0f}]"


def main() -> None:
    """Runs the search from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--task", choices=TASKS, required=True)
    parser.add_argument("--candidates", type=int, default=120)
    parser.add_argument("--episodes", type=int, default=8, help="that each candidate lives")
    parser.add_argument("--steps", type=int, default=EPISODE_STEPS, help="of a tuning's episode")
    parser.add_argument("--constants", nargs="*", default=[], help="to tune; else all of them")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    best = tune(args)
    for name, value in best.items():
        print(f"    {name} = {value:.4g}")
    policy = with_constants(args.task, best)
    tuning = range(FIRST_TUNING_SEED, FIRST_TUNING_SEED + len(HELD_OUT_SEEDS))
    if args.candidates:
        print(f"{args.task}: tuning {summary(returns(policy, tuning))}", flush=True)
    print(f"{args.task}: held out {summary(returns(policy, HELD_OUT_SEEDS))}")


if __name__ == "__main__":
    main()
