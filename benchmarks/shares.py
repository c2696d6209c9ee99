"""Measures what takes the time of whole training, for `benchmarks/train.py`.

Five seeds, as many as one of two processes has of ten, are trained with the published settings by
`run_batch`, as `jbench train` does it, with updates from 256 control steps on. They are evaluated
once, at the end, and that time is scaled to one evaluation in 50,000 control steps, the default.
Replay buffers are small here; `benchmarks/checkpoint.py` measures checkpoints of full ones.
"""

import tempfile
import time
from pathlib import Path
from unittest import mock

import torch
from clock import Clock

from jbench.settings.algorithms import algorithm_settings
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training import group
from jbench.training.batched_run import run_batch
from jbench.training.engines import make_trainer

SEEDS = 5
STEPS = {"ddpg": 5_000, "td3": 5_000, "sac": 5_000, "ppo": 50_000}
"""Control steps of each seed: between 10 seconds and 5 minutes."""
EVALUATE_EVERY = 50_000
PARTS = (
    *("robots", "acting", "transitions", "updates"),
    *("rows", "checkpoints", "evaluation"),
)


def settings_of(algo: str, seed: int) -> RunSettings:
    """Returns a run with the published settings whose updates begin early."""
    overrides = {} if algo == "ppo" else {"learning_starts": 256}
    return RunSettings(
        task="face_direction",
        algo=algo,
        seed=seed,
        steps=STEPS[algo],
        evaluate_every=10 * STEPS[algo],
        evaluate_episodes=10,
        hyperparameters=algorithm_settings(algo, overrides=overrides).model_dump(mode="json"),
    )


def shares(algo: str) -> dict[str, float]:
    """Returns the share of each part in the time of training, and that of everything else."""
    clock = Clock()

    def make_measured(*arguments: object) -> object:
        engine = make_trainer(*arguments)  # type: ignore[arg-type]
        clock.watch_loop(engine)
        return engine

    class Measured(group.TrainingGroup):
        """A group whose methods are measured."""

    clock.watch(Measured, "_note_episodes", "rows")
    clock.watch(Measured, "_save", "checkpoints")
    clock.watch(Measured, "_evaluate", "evaluation")
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch("jbench.training.group.make_trainer", make_measured),
        mock.patch("jbench.training.batched_run.TrainingGroup", Measured),
    ):
        began = time.perf_counter()
        run_batch([settings_of(algo, seed) for seed in range(SEEDS)], Results(Path(folder)))
        whole = time.perf_counter() - began
    clock.spent["updates"] += clock.spent.pop("waiting for updates")
    spent = {part: clock.spent[part] for part in PARTS}
    rest = whole - sum(spent.values())
    spent["evaluation"] *= STEPS[algo] / EVALUATE_EVERY
    total = sum(spent.values()) + rest
    return {**{part: seconds / total for part, seconds in spent.items()}, "rest": rest / total}


def rows() -> None:
    """Prints the shares as Markdown, measured on one core."""
    torch.set_num_threads(1)
    columns = {algo: shares(algo) for algo in STEPS}
    print("| share of training (%) | " + " | ".join(map(str.upper, columns)) + " |")
    print("|---" * (len(columns) + 1) + "|")
    for part in (*PARTS, "rest"):
        numbers = (f"{100 * column[part]:.1f}" for column in columns.values())
        print(f"| {part} | " + " | ".join(numbers) + " |", flush=True)


if __name__ == "__main__":
    rows()
