"""Memory that the replay buffers of runs need."""

from collections.abc import Sequence
from pathlib import Path

from jbench.settings.run import RunSettings
from jbench.simulation import find_task

_MIN_REPORTED = 2_000_000_000  # bytes
_USABLE = 0.8  # of the free memory; networks and minibatches take the rest


def replay_bytes(run: RunSettings, device: str = "cpu") -> int:
    """Returns the maximum bytes of a run's replay buffer on the batched engine; 0 for PPO.

    Each observation is stored once, in float32, with an action and a reward. An encoder reduces
    its size. A GPU allocates the whole buffer at the start, also for a run that does not fill it.
    """
    task = find_task(run.task)
    return 4 * (task.observation_size + task.action_size + 1) * _transitions(run, device)


def memory_sentence(runs: Sequence[RunSettings], device: str = "cpu") -> str | None:
    """Returns a sentence on the replay buffers of concurrent runs; None if they are small."""
    needed = sum(replay_bytes(run, device) for run in runs if run.engine == "batched")
    if needed < _MIN_REPORTED:
        return None
    whose = "memory" if device == "cpu" else "the GPU's memory"
    text = (
        f"The replay buffers of {len(runs)} runs will take up to {needed / 1e9:.1f} GB of {whose}"
    )
    free = _available() if device == "cpu" else _available_on_gpu(device)
    if free is None or needed <= _USABLE * free:
        return f"{text}."
    less = int(max(_transitions(run, device) for run in runs) * free / needed / 2)
    return (
        f"{text}, and {free / 1e9:.1f} GB are free here: for less, fewer --seeds at a time, or "
        f"--set buffer_size={less}."
    )


def _transitions(run: RunSettings, device: str) -> int:
    size = int(run.hyperparameters.get("buffer_size", 0))
    return min(size, run.steps) if device == "cpu" else size


def _available_on_gpu(device: str) -> int | None:
    """Returns the bytes of available memory of a GPU of this machine; None if it has none.

    For a cluster these are a guess: its GPUs may have more or less memory.
    """
    import torch

    return torch.cuda.mem_get_info(device)[0] if torch.cuda.is_available() else None


def _available() -> int | None:
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return None
