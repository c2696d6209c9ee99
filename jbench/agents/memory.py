"""What to say if replay buffers do not fit into the memory."""

import torch

from jbench.errors import WorkError
from jbench.settings.algorithms import Algorithm, OffPolicySettings
from jbench.wording import counted, in_matrix_file


def memory_error(
    error: MemoryError | RuntimeError, settings: Algorithm, seeds: int, memory: str
) -> WorkError | None:
    """Returns the error to raise instead of one that ended the making of agents.

    None if the agents have no replay buffers, or the error is not that of too little memory.

    Args:
        error: of numpy or torch.
        settings: of the agents.
        seeds: number of agents.
        memory: which one is too little, such as "GPU's memory".
    """
    if not isinstance(settings, OffPolicySettings) or not _is_of_memory(error):
        return None

    advice = "type"
    if seeds > 1:
        advice = "type fewer --seeds at a time, or"
    key = in_matrix_file("a key", "hyperparameters.ALGORITHM")
    return WorkError(
        f"The {memory} is not enough for the replay buffers of {counted(seeds, 'seed')}: {advice} "
        f"less than --set buffer_size={settings.buffer_size} {key}."
    )


def _is_of_memory(error: MemoryError | RuntimeError) -> bool:
    """Returns whether an error is that of too little memory.

    torch has no class for that of a processor, and another text if a size exceeds 64 bits.
    """
    if isinstance(error, MemoryError | torch.OutOfMemoryError):
        return True
    return "can't allocate memory" in str(error) or "calculation overflowed" in str(error)
