"""Tunes the constants of a hand-written policy by evolution (CMA-ES).

    python benchmarks/tune_heuristics.py --task face_direction --candidates 240 --episodes 8

Every generation draws its candidates around the best constants so far, lets all of them live the
same fresh episodes, and moves to its better half. Prints the constants it ends with, and what they
earn on the tuning's episodes and on held-out ones (seeds 0 to 99) as median [10th, 90th].
`--candidates 0` only evaluates the constants as they are in `jbench.tasks.jitterbug.heuristics`.

The constants of three tasks came, rounded, from these searches. Their starting points:

    move_from_origin, at the constants of `_Driver`: --candidates 160 --episodes 40 --steps 75
        --seed 7, for spring to bearing_gain, origin_radius and start_bearing
    move_in_direction, at the result described below: --candidates 336 --episodes 8 --steps 400
        --coarse 5 --seed 7, for all but max_tilt and fall_tilt
    move_to_pose, at the result of an earlier search: --candidates 208
        --episodes 8 --steps 600 --coarse 5 --seed 9, for all that the class lists but
        max_steer_angle and homing_distance, and for side_gain

The terms of `MoveInDirection` were first sought among 62 products of what the robot sees (mass,
tilt, rates, speeds, bearing) by a natural policy gradient on torques with noise, then kept if a
least-squares fit of the whole torque by few terms needed them, and tuned on by the same gradient.
That program is not kept, so the last two searches can be continued, not repeated. What did not
help: a whirl of uneven speed instead of a swing (slower); a larger bound on the tilt (more falls);
an earlier righting (fewer falls, but slower); gains that depend on the bearing; the terms of
`MoveInDirection` in `MoveToPose` (it strays more).
"""

import argparse
import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.names import TASKS
from jbench.task_specs import EPISODE_STEPS, PHYSICS_STEPS
from jbench.tasks.jitterbug import features, geometry, heuristics, model, resets, rewards
from jbench.tasks.jitterbug.control_laws import Law
from jbench.tasks.jitterbug.robots import load_model

Array = NDArray[np.float64]

FIRST_TUNING_SEED = 10_000
HELD_OUT = 100  # episodes, of the seeds from 0
POPULATION = 16  # candidates in a generation
SPREAD = 0.12  # standard deviation of the first draws, as a share of each constant
THREADS = 2
COARSE = 2  # physics steps made into one while tuning: twice as fast, the same returns


class Robots:
    """Robots that live an episode in lockstep, each in MuJoCo memory of its own."""

    def __init__(self, task: str, seeds: Sequence[int], coarse: int = 1) -> None:
        """Puts one robot for each seed at the beginning of its episode.

        Args:
            task: which targets to draw and what to reward.
            seeds: of the generators, as `RobotEnv.reset` takes them.
            coarse: physics steps to make into one.
        """
        self.task = task
        self._model = load_model()
        self._model.opt.timestep *= coarse
        self._steps = PHYSICS_STEPS // coarse
        self._offset = model.torso_offset(self._model)
        self._data = [mujoco.MjData(self._model) for _ in seeds]
        targets = []
        for data, seed in zip(self._data, seeds, strict=True):
            random = np.random.default_rng(seed)
            model.place(data, resets.draw_quaternion(random))
            targets.append(resets.draw_target(task, random))
        self.target = geometry.Target(
            np.array([t.position for t in targets]), np.array([t.yaw for t in targets])
        )
        self._qpos = np.array([data.qpos for data in self._data])
        self._qvel = np.array([data.qvel for data in self._data])
        self._executor = ThreadPoolExecutor(THREADS)

    def state(self) -> geometry.State:
        """Returns the state of all robots."""
        return model.read_state(self._qpos, self._qvel, self._offset)

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
    policy: Law, seeds: Sequence[int], steps: int = EPISODE_STEPS, coarse: int = 1
) -> Array:
    """Returns the (robots,) returns of one episode for each seed, per 1000 steps."""
    robots = Robots(policy.task, seeds, coarse)
    policy.reset(len(seeds))
    total = np.zeros(len(seeds))
    for _ in range(steps):
        observed = features.observation(policy.task, robots.state(), robots.target)
        robots.step(policy.act(observed)[:, 0])
        total += rewards.reward(policy.task, robots.state(), robots.target)
    return total * (EPISODE_STEPS / steps)


def constants(policy: Law) -> dict[str, float]:
    """Returns the tunable constants of a policy by name."""
    fields = dataclasses.fields(policy)
    return {field.name: float(getattr(policy, field.name)) for field in fields}


def with_constants(task: str, values: dict[str, Any]) -> Law:
    """Returns a task's policy with other constants, floats or one for each robot."""
    law: Any = heuristics.LAWS[task]
    policy: Law = law(**values)
    return policy


class Search:
    """Evolution with covariance matrix adaptation (CMA-ES; symbols as in arXiv:1604.00772).

    It searches near the zero vector in coordinates in which one is a likely step.
    """

    def __init__(self, size: int, random: np.random.Generator) -> None:
        """Starts at zero with draws of standard deviation 1.

        Args:
            size: how many numbers to search.
            random: draws the candidates.
        """
        self.mean, self.sigma = np.zeros(size), 1.0
        self._random, self._generation = random, 0
        weights = np.log((POPULATION + 1) / 2) - np.log(np.arange(1, POPULATION // 2 + 1))
        self._weights = weights / weights.sum()
        self._mu = 1 / (self._weights**2).sum()
        mu = self._mu
        self._c_path = (4 + mu / size) / (size + 4 + 2 * mu / size)
        self._c_sigma = (mu + 2) / (size + mu + 5)
        self._c_one = 2 / ((size + 1.3) ** 2 + mu)
        self._c_mu = min(1 - self._c_one, 2 * (mu - 2 + 1 / mu) / ((size + 2) ** 2 + mu))
        self._damping = 1 + 2 * max(0.0, np.sqrt((mu - 1) / (size + 1)) - 1) + self._c_sigma
        self._length = np.sqrt(size) * (1 - 1 / (4 * size) + 1 / (21 * size**2))
        self._covariance = np.eye(size)
        self._path, self._sigma_path = np.zeros(size), np.zeros(size)

    def draw(self) -> Array:
        """Returns (POPULATION, size) candidates."""
        values, self._axes = np.linalg.eigh(self._covariance)
        self._lengths = np.sqrt(np.maximum(values, 1e-12))
        half = self._random.standard_normal((POPULATION // 2, self.mean.size))
        # In mirrored pairs: the mean of a generation is then not moved by chance.
        self._steps = (np.concatenate([half, -half]) * self._lengths) @ self._axes.T
        candidates: Array = self.mean + self.sigma * self._steps
        return candidates

    def learn(self, scores: Array) -> None:
        """Moves towards the candidates of the last draw with the highest (POPULATION,) scores."""
        best = self._steps[np.argsort(-scores)[: self._weights.size]]
        step = self._weights @ best
        self.mean = self.mean + self.sigma * step
        self._generation += 1
        kept, white = 1 - self._c_sigma, self._axes @ ((self._axes.T @ step) / self._lengths)
        self._sigma_path = kept * self._sigma_path + np.sqrt((1 - kept**2) * self._mu) * white
        length = np.linalg.norm(self._sigma_path) / self._length
        usual = length / np.sqrt(1 - kept ** (2 * self._generation))
        stalls = usual > 1.4 + 2 / (step.size + 1)
        kept = 1 - self._c_path
        self._path = kept * self._path + (not stalls) * np.sqrt((1 - kept**2) * self._mu) * step
        self._covariance = (
            (1 - self._c_one - self._c_mu) * self._covariance
            + self._c_one * np.outer(self._path, self._path)
            + self._c_mu * (best.T * self._weights) @ best
        )
        self.sigma = min(self.sigma * np.exp(self._c_sigma / self._damping * (length - 1)), 2)


def tune(args: argparse.Namespace) -> dict[str, float]:
    """Returns the constants that the search ends with."""
    start = constants(heuristics.LAWS[args.task]())
    names = [name for name in start if not args.constants or name in args.constants]
    first = np.array([start[name] for name in names])
    mean = first
    search = Search(len(names), np.random.default_rng(args.seed))
    for generation in range(args.candidates // POPULATION):
        drawn = first + SPREAD * np.abs(first) * search.draw()
        seed = first_tuning_seed(args) + generation * args.episodes
        seeds = np.tile(np.arange(seed, seed + args.episodes), POPULATION)
        per_robot = dict(zip(names, np.repeat(drawn, args.episodes, axis=0).T, strict=True))
        policy = with_constants(args.task, {**start, **per_robot})
        earned = returns(policy, seeds.tolist(), args.steps, args.coarse)
        score = earned.reshape(POPULATION, args.episodes).mean(1)
        search.learn(score)
        mean = first + SPREAD * np.abs(first) * search.mean
        found = " ".join(f"{n}={v:.4g}" for n, v in zip(names, mean, strict=True))
        print(f"{generation}: mean {score.mean():.0f} best {score.max():.0f}: {found}", flush=True)
    return {**start, **dict(zip(names, mean.tolist(), strict=True))}


def first_tuning_seed(args: argparse.Namespace) -> int:
    """Returns the seed of the search's first episode; each generation has further ones."""
    first: int = FIRST_TUNING_SEED + 1000 * args.seed * args.episodes
    return first


def summary(earned: Array) -> str:
    """Returns the median [10th, 90th percentile] of returns."""
    median, low, high = np.percentile(earned, [50, 10, 90])
    return f"{median:.0f} [{low:.0f}, {high:.0f}]"


def main() -> None:
    """Runs the search from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--task", choices=TASKS, required=True)
    parser.add_argument("--candidates", type=int, default=240)
    parser.add_argument("--episodes", type=int, default=8, help="that each candidate lives")
    parser.add_argument("--steps", type=int, default=EPISODE_STEPS, help="of a tuning's episode")
    parser.add_argument("--coarse", type=int, default=COARSE, help="physics steps made into one")
    parser.add_argument("--constants", nargs="*", default=[], help="to tune; else all of them")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--held-out", type=int, default=HELD_OUT, help="episodes of the result")
    args = parser.parse_args()
    best = tune(args)
    for name, value in best.items():
        print(f"    {name} = {value:.4g}")
    policy = with_constants(args.task, best)
    generations = args.candidates // POPULATION
    tuning = range(min(args.held_out, generations * args.episodes))
    if tuning:
        seeds = [first_tuning_seed(args) + number for number in tuning]
        print(f"{args.task}: tuning {summary(returns(policy, seeds))}", flush=True)
    print(f"{args.task}: held out {summary(returns(policy, range(args.held_out)))}")


if __name__ == "__main__":
    main()
