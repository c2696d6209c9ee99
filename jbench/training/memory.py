"""How much memory runs will take, said before it is tried."""

from collections.abc import Sequence
from pathlib import Path

from jbench.settings.run import RunSettings
from jbench.tasks.features import TASK_SPECS

_WORTH_SAYING = 2_000_000_000  # bytes


def replay_bytes(run: RunSettings) -> int:
    """Returns the bytes, at most, of a run's replay buffer on the batched engine; PPO has none.

    An episode's observations are kept once, in float32, each with an action and a reward. An
    encoder makes them smaller.
    """
    size = TASK_SPECS[run.task].observation_size
    transitions = min(int(run.hyperparameters.get("buffer_size", 0)), run.steps)
    return 4 * (size + 2) * transitions


def memory_sentence(runs: Sequence[RunSettings]) -> str | None:
    """Returns a sentence on the replay buffers of runs that go on at a time, or None for little."""
    needed = sum(replay_bytes(run) for run in runs if run.engine == "batched")
    if needed < _WORTH_SAYING:
        return None
    told = f"The replay buffers of {len(runs)} runs will take up to {needed / 1e9:.1f} GB of memory"
    free = _available()
    if free is None or needed < free:
        return f"{told}."
    return (
        f"{told}, and {free / 1e9:.1f} GB are free here: for less, fewer --seeds at a time, or "
        f"--set buffer_size={int(runs[0].hyperparameters['buffer_size'] * free / needed / 2):d}."
    )


def _available() -> int | None:
    """Returns the bytes that programs may still take, where the system says so."""
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return None
