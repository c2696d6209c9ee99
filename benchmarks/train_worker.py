"""A process that trains on one core on request, for `benchmarks/train.py`.

    python benchmarks/train_worker.py \
        '{"kind": "sb3", "task": "face_direction", "algo": "td3", "seeds": [0], "core": 0}'

It prints {"ready": true} after its warm-up. Then it reads lines like {"seconds": 2} and answers
each with its control steps per second of wall time and per second of processor time, the control
steps of each seed since the start, and all episodes. An answer is about whole rollouts, since PPO
makes all updates of a rollout at its end. Several seeds of a library train in turn. Each kind
imports only what it needs, since SBX has a separate environment.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from threading import Semaphore, Thread
from typing import Any

WARM_UP = 270  # control steps of each seed; updates begin after 256

Request = dict[str, Any]
Episodes = list[tuple[int, int, float]]
"""Seed, control step at the end, and return of each episode."""
Run = Callable[[float], tuple[int, int, Episodes]]
"""Trains for some seconds; returns the control steps made, those of each seed since the start, and
all episodes so far."""


def settings_of(request: Request) -> Any:
    """Returns the settings of the task with one update per control step."""
    from jbench.settings.algorithms import algorithm_settings, default_base

    every = {"train_freq": 1, "gradient_steps": 1, "learning_starts": 256, "buffer_size": 100_000}
    changes = request.get("changes", {}) | ({} if request["algo"] == "ppo" else every)
    return algorithm_settings(request["algo"], default_base(request["task"]), changes)


def rollout_length(settings: Any) -> int:
    """Returns the control steps of a seed from one learning phase to the next."""
    steps: int = settings.rollout(getattr(settings, "n_envs", 1))
    return steps


def batched(request: Request) -> Run:
    """Returns whole training on the batched engine."""
    from jbench.agents.batched.make import make_batched_engine
    from jbench.agents.ending_environments import environments_class

    settings = settings_of(request)
    task = request["task"]
    robots = environments_class(task)(task, request["seeds"], getattr(settings, "n_envs", 1))
    engine = make_batched_engine(request["algo"], settings, robots, **request.get("options", {}))
    steps, episodes = engine.learn(10**12), Episodes()
    rollout = rollout_length(settings)

    def step() -> None:
        ends = next(steps)
        if ends is not None:
            for index, seed in enumerate(request["seeds"]):
                returns = ends.returns[index, ends.ended[index]].tolist()
                episodes.extend((seed, engine.control_steps, each) for each in returns)

    while engine.control_steps < WARM_UP or engine.control_steps % rollout:
        step()

    def run(seconds: float) -> tuple[int, int, Episodes]:
        first, end = engine.control_steps, time.perf_counter() + seconds
        while time.perf_counter() < end or engine.control_steps % rollout:
            step()
        made = len(request["seeds"]) * (engine.control_steps - first)
        return made, engine.control_steps, episodes

    return run


def in_turn(runs: list[Run]) -> Run:
    """Returns training of several seeds one after another; the steps are the fewest of a seed."""

    def run(seconds: float) -> tuple[int, int, Episodes]:
        answers = [each(seconds / len(runs)) for each in runs]
        made, steps, episodes = zip(*answers, strict=True)
        return sum(made), min(steps), [each for its in episodes for each in its]

    return run


def library(agent: Any, seed: int, rollout: int = 1) -> Run:
    """Returns training of an agent of stable-baselines3 or SBX, which have the same interface.

    `learn` runs in a thread and pauses at the ends of rollouts, of this many control steps. An
    agent whose `learn` is ended and called again would lose its last transition, and PPO a whole
    rollout.
    """
    import numpy as np
    from stable_baselines3.common.callbacks import BaseCallback

    go = Semaphore(0)
    paused = Semaphore(0)

    class Pauses(BaseCallback):
        """Pauses after some seconds and control steps; keeps the episodes."""

        def __init__(self) -> None:
            super().__init__()
            self.episodes = Episodes()
            self.returns = np.zeros(agent.n_envs)
            self.end = 0.0

        def _on_step(self) -> bool:
            self.returns += self.locals["rewards"]
            ended = np.flatnonzero(self.locals["dones"])
            at = seed, self.num_timesteps
            self.episodes.extend((*at, float(self.returns[i])) for i in ended)
            self.returns[ended] = 0

            is_over = self.num_timesteps >= WARM_UP and time.perf_counter() >= self.end
            if is_over and self.num_timesteps % rollout == 0:
                paused.release()
                go.acquire()
            return True

    pauses = Pauses()

    def learn() -> None:
        try:
            agent.learn(10**12, pauses, log_interval=None)
        finally:
            paused.release()

    thread = Thread(target=learn, daemon=True)
    thread.start()
    paused.acquire()

    def run(seconds: float) -> tuple[int, int, Episodes]:
        first = agent.num_timesteps
        pauses.end = time.perf_counter() + seconds
        go.release()
        paused.acquire()
        if agent.num_timesteps == first:
            raise SystemExit("The training has ended with an error; see above.")
        return agent.num_timesteps - first, agent.num_timesteps, pauses.episodes

    return run


def environment(task: str, count: int = 1) -> Any:
    """Returns the environment that a library trains in."""
    import gymnasium
    from stable_baselines3.common.vec_env import DummyVecEnv

    from jbench.registration import environment_id, register_task

    register_task(task)
    made = environment_id(task)
    return DummyVecEnv([lambda: gymnasium.make(made, disable_env_checker=True)] * count)


def sb3(request: Request) -> Run:
    """Returns training on stable-baselines3 as `jbench train --engine sb3` configures it."""
    from jbench.agents import sb3 as ours

    settings = settings_of(request)

    def training(seed: int) -> Run:
        env = environment(request["task"], getattr(settings, "n_envs", 1))
        agent = ours.build(request["algo"], settings, env, seed)
        return library(agent, seed, rollout_length(settings))

    return in_turn([training(seed) for seed in request["seeds"]])


def sbx(request: Request) -> Run:
    """Returns training on SBX with the same networks, batches and updates, without action noise."""
    import sbx as jax_agents

    algo = request["algo"]
    arguments: dict[str, Any] = {
        "policy_kwargs": {"net_arch": {"pi": [350, 250], "qf": [350, 250]}},
        "learning_rate": 1e-4,
        "batch_size": 256,
        "learning_starts": 256,
        "buffer_size": 100_000,
        "train_freq": 1,
        "gradient_steps": 1,
    }
    kind = {"ddpg": jax_agents.DDPG, "td3": jax_agents.TD3, "sac": jax_agents.SAC}[algo]
    seed = request["seeds"][0]
    return library(kind("MlpPolicy", environment(request["task"]), seed=seed, **arguments), seed)


KINDS = {"batched": batched, "sb3": sb3, "sbx": sbx}


def main() -> None:
    request = json.loads(sys.argv[1])
    if "core" in request:
        os.sched_setaffinity(0, {request["core"]})
    if request["kind"] != "sbx" and "core" in request:
        import torch

        torch.set_num_threads(1)
    run = KINDS[request["kind"]](request)
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        wall, processor = time.perf_counter(), time.process_time()
        made, steps, episodes = run(json.loads(line)["seconds"])
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        answer = {"wall": made / wall, "processor": made / processor}
        print(json.dumps({**answer, "steps": steps, "episodes": episodes}), flush=True)


if __name__ == "__main__":
    main()
