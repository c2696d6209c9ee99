"""CUDA graphs: a recorded sequence of kernels that one call launches."""

from collections.abc import Callable, Hashable

import torch


class Captured:
    """A function that is recorded on a GPU, one recording per argument, and then replayed.

    The function must read and write the same tensors at every call, must not branch on their
    values, and may depend only on its argument. An update of a small network is a hundred kernels,
    which Python takes longer to launch than they take to run.
    """

    def __init__(self, function: Callable[[Hashable], None], device: torch.device) -> None:
        """Wraps a function; on a CPU it is called directly."""
        self._function, self._device = function, device
        self._called: set[Hashable] = set()
        self._graphs: dict[Hashable, torch.cuda.CUDAGraph] = {}

    def __call__(self, argument: Hashable) -> None:
        """Calls the function, or replays its recording."""
        if self._device.type != "cuda" or argument not in self._called:
            # The first call loads kernels and allocates memory, which must not be recorded.
            self._called.add(argument)
            self._function(argument)
            return
        if argument not in self._graphs:
            self._graphs[argument] = self._record(argument)
        self._graphs[argument].replay()

    def _record(self, argument: Hashable) -> torch.cuda.CUDAGraph:
        """Records a call without running it."""
        graph = torch.cuda.CUDAGraph()
        pool = next((other.pool() for other in self._graphs.values()), None)
        with torch.cuda.graph(graph, pool=pool, capture_error_mode="thread_local"):
            self._function(argument)
        return graph
