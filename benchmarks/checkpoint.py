"""Measures the cost of checkpoints: `python benchmarks/checkpoint.py`.

Five seeds (a process has five of ten seeds on two cores) train with the paper's settings and a full
replay buffer of a million transitions. Training alternates with a checkpoint of all seeds after
each episode, the shortest interval possible. The first figure is the time of the checkpoints
relative to that of the training. `jbench train` makes at most one checkpoint per minute and limits
them to 2% of its time. The second part writes the checkpoints of a million control steps without
training and prints the bytes written and how often each row of the replay buffer was written. The
third part prints the bytes of a compact state, and the time in which replay buffers are computed
again from random actions, of one seed and of ten together.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

os.environ.setdefault("MUJOCO_GL", "disable")

import numpy as np
import torch

from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.on_policy import OnPolicyEngine
from jbench.settings.algorithms import ALGORITHMS, algorithm_settings
from jbench.settings.run import RunSettings
from jbench.store import Record, Results, files
from jbench.task_specs import EPISODE_STEPS
from jbench.training.checkpoints import save
from jbench.training.engines import make_engine
from jbench.training.log import RunLog
from jbench.wording import counted

SEEDS = 5
TRAINED = 100  # control steps between DDPG's updates
MILLION = 1_000_000


class Written:
    """Counts the bytes written after its creation, by kind of file."""

    def __init__(self) -> None:
        self.bytes: dict[str, int] = {}
        original = files.write_atomic

        def write_and_count(path: Path, content: bytes) -> None:
            kind = path.name.partition("-")[0].partition(".")[0]
            self.bytes[kind] = self.bytes.get(kind, 0) + len(content)
            original(path, content)

        files.write_atomic = write_and_count


def settings_of(algo: str, seed: int) -> RunSettings:
    """Returns a run with the paper's settings whose updates begin immediately."""
    overrides = {"learning_starts": 256} if algo == "td3" else {}
    return RunSettings(
        task="face_direction",
        algo=algo,
        engine="batched",
        seed=seed,
        steps=5_000_000,
        evaluate_every=50_000,
        evaluate_episodes=10,
        hyperparameters=algorithm_settings(algo, overrides=overrides).model_dump(mode="json"),
    )


def untrained_engine(runs: list[RunSettings]) -> OffPolicyEngine | OnPolicyEngine:
    """Returns the batched engine of some runs without encoders, on the CPU."""
    engine = make_engine(runs, [None] * len(runs), "cpu")
    assert isinstance(engine, OffPolicyEngine | OnPolicyEngine)
    return engine


def begin(path: Path, run: RunSettings) -> tuple[Record, RunLog]:
    """Creates the record of a run."""
    record = Results(path).create("run", run.id, run.model_dump(mode="json"))
    return record, RunLog(record)


def cost(algo: str, rounds: int, control_steps: int) -> None:
    """Prints the time of checkpoints relative to that of training, with a full replay buffer."""
    full = control_steps // EPISODE_STEPS * (EPISODE_STEPS + 1)  # rows
    runs = [settings_of(algo, seed) for seed in range(SEEDS)]
    shares, times = [], []
    with (
        tempfile.TemporaryDirectory() as folder,
        untrained_engine(runs) as engine,
    ):
        begun = [begin(Path(folder), run) for run in runs]
        if isinstance(engine, OffPolicyEngine):
            for seed in range(SEEDS):
                engine.replay.restore(seed, torch.randn(1, full, 18), full)
            engine.replay.begin(engine.environments.observations)
            # TD3 makes a thousand updates after every thousand steps.
            engine.control_steps = control_steps
        steps = engine.learn(10**12)
        measured = EPISODE_STEPS if algo in ("td3", "ppo") else TRAINED
        for number in range(rounds + 1):
            clock = time.perf_counter()
            for _ in range(measured):
                next(steps)
            training = (time.perf_counter() - clock) * EPISODE_STEPS / measured
            if isinstance(engine, OffPolicyEngine):
                add_rows(engine, SEEDS, EPISODE_STEPS - measured)  # those of the whole episode
            clock = time.perf_counter()
            for index, (record, log) in enumerate(begun):
                log.episode(number, 500.0, engine.losses(index), EPISODE_STEPS)
                save(record, log, engine, index)
            checkpoint = time.perf_counter() - clock
            if number:  # the first one writes the whole buffer
                shares.append(checkpoint / training)
                times.append(checkpoint / SEEDS)
    print(
        f"{algo:5} a checkpoint of a seed takes {1000 * median(times):.1f} ms; after every "
        f"episode, checkpoints take {100 * median(shares):.2f}% of the training time",
        flush=True,
    )


def add_rows(engine: OffPolicyEngine, seeds: int, count: int) -> None:
    """Adds random transitions to the replay buffer of each seed, in place of an episode's end."""
    random = np.random.default_rng(0)
    observations = torch.zeros(seeds, 1, engine.environments.size)
    for _ in range(count):
        engine.replay.flush()
        actions = random.random((seeds, 1, 1))
        rewards = random.random((seeds, 1))
        engine.replay.add(actions, rewards, observations)
    engine.replay.begin(observations)


def volume(algo: str, control_steps: int) -> None:
    """Prints what the checkpoints of training write, with one per episode."""
    run = settings_of(algo, 0)
    written = Written()
    with tempfile.TemporaryDirectory() as folder, untrained_engine([run]) as engine:
        record, log = begin(Path(folder), run)
        most = 0
        for number in range(1, control_steps // EPISODE_STEPS + 1):
            engine.control_steps = number * EPISODE_STEPS
            if isinstance(engine, OffPolicyEngine):
                add_rows(engine, 1, EPISODE_STEPS)
            log.episode(engine.control_steps, 500.0, {}, EPISODE_STEPS)
            save(record, log, engine, 0)
            most = max(most, len(record.manifest.files))
    sizes = ", ".join(f"{kind} {size / 1e6:.0f} MB" for kind, size in written.bytes.items())
    print(
        f"{algo:5} {control_steps:,} control steps, {number} checkpoints: {sizes}; at most "
        f"{most} files"
    )
    if "replay" in written.bytes:
        assert isinstance(engine, OffPolicyEngine)
        times = written.bytes["replay"] / (4 * 18 * engine.replay.row)
        print(f"{algo:5} each row of the replay buffer is written {times:.2f} times")


def compact(algo: str, repeated: int) -> None:
    """Prints the size of a compact state, and the processor time of its rows for each step."""
    for seeds in (1, 10):
        runs = [settings_of(algo, seed) for seed in range(seeds)]
        shape = repeated, seeds, 1, 1
        actions = np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)
        with untrained_engine(runs) as engine:
            assert isinstance(engine, OffPolicyEngine)
            before = [torch.zeros(1, 0, 18)] * seeds
            clock = time.process_time()
            engine.repeat(0, before, 0, actions)
            seconds = (time.process_time() - clock) / (repeated * seeds)
            state = sum(tensor.nbytes for tensor in engine.state(0).tensors.values())
        print(
            f"{algo:5} {counted(seeds, 'seed')}: a million control steps of a seed are computed "
            f"again in {1e6 * seconds:.0f} s of a processor",
            flush=True,
        )
    print(
        f"{algo:5} a compact state is {state / 1e6:.1f} MB and {actions[0, 0].nbytes} bytes for "
        "each control step"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--algos", default=",".join(ALGORITHMS))
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--steps", type=int, default=MILLION, help="in a full replay buffer")
    parser.add_argument("--repeated", type=int, default=2000, help="steps computed again")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    algos = arguments.algos.split(",")
    for algo in algos:
        print(f"{algo}: training and checkpoints in turn", file=sys.stderr, flush=True)
        cost(algo, arguments.rounds, arguments.steps)
    for algo in ("ddpg", "ppo"):
        if algo in algos:
            print(f"{algo}: checkpoints of {arguments.steps:,} steps", file=sys.stderr, flush=True)
            volume(algo, arguments.steps)
    for algo in algos:
        if algo != "ppo":
            compact(algo, arguments.repeated)


if __name__ == "__main__":
    main()
