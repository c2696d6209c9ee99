"""Measures what takes the time of whole training: `python benchmarks/shares.py`.

Five seeds, as many as one of two processes has of ten, are trained with the published settings by
`run_batch`, as `jbench train` does it, with updates from 256 control steps on. They are evaluated
once, at the end, and that time is scaled to one evaluation in 50,000 control steps, the default.
Replay buffers are small here; `benchmarks/checkpoint.py` measures checkpoints of full ones.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import torch

from jbench.settings.algorithms import algorithm_settings
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.timing import measured
from jbench.training.batched_run import run_batch

SEEDS = 5
STEPS = {"ddpg": 5_000, "td3": 5_000, "sac": 5_000, "ppo": 50_000}
"""Control steps of each seed: between 10 seconds and 5 minutes."""
EVALUATE_EVERY = 50_000
EVALUATED = 10
"""Episodes of an evaluation."""
PARTS = (
    "robots",
    "acting",
    "transitions",
    "updates",
    "rows",
    "checkpoints",
    "evaluation",
)


def settings_of(algo: str, seed: int, steps: int) -> RunSettings:
    """Returns a run with the published settings whose updates begin early."""
    overrides = {} if algo == "ppo" else {"learning_starts": 256}
    return RunSettings(
        task="face_direction",
        algo=algo,
        seed=seed,
        steps=steps,
        evaluate_every=10 * steps,
        evaluate_episodes=EVALUATED,
        hyperparameters=algorithm_settings(algo, overrides=overrides).model_dump(mode="json"),
    )


def shares(algo: str, steps: int) -> dict[str, float]:
    """Returns the share of each part in the time of training, and that of everything else."""
    runs = [settings_of(algo, seed, steps) for seed in range(SEEDS)]
    with tempfile.TemporaryDirectory() as folder, measured() as seconds:
        began = time.perf_counter()
        failures = run_batch(runs, Results(Path(folder)), final_episodes=EVALUATED)
        whole = time.perf_counter() - began
    for failure in failures.values():
        raise failure

    # On a CPU, nothing but the updates themselves is waited for.
    seconds["updates"] += seconds.pop("waiting for updates", 0.0)
    spent = {part: seconds[part] for part in PARTS}
    spent["rest"] = whole - sum(spent.values())
    spent["evaluation"] *= steps / EVALUATE_EVERY
    total = sum(spent.values())
    return {part: each / total for part, each in spent.items()}


def rows(steps: Mapping[str, int] = STEPS) -> None:
    """Prints the shares of algorithms as Markdown, measured on one core."""
    torch.set_num_threads(1)
    columns = {}
    for algo, count in steps.items():
        print(f"{algo}: {SEEDS} seeds of {count:,} control steps", file=sys.stderr, flush=True)
        columns[algo] = shares(algo, count)
    print("| share of training (%) | " + " | ".join(map(str.upper, columns)) + " |")
    print("|---" * (len(columns) + 1) + "|")
    for part in (*PARTS, "rest"):
        numbers = (f"{100 * column[part]:.1f}" for column in columns.values())
        print(f"| {part} | " + " | ".join(numbers) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--algos", default=",".join(STEPS))
    parser.add_argument("--steps", type=int, help="control steps of each seed")
    arguments = parser.parse_args()
    rows({algo: arguments.steps or STEPS[algo] for algo in arguments.algos.split(",")})


if __name__ == "__main__":
    main()
