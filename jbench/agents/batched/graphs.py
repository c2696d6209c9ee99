"""CUDA graphs: a recorded sequence of kernels that one call launches."""

from collections.abc import Callable, Hashable
from typing import Any

import torch

Function = Callable[[Any], None]  # A function that `Captured` calls with an argument


class Captured:
    """Calls a function, which is recorded on a GPU, once per argument, and then replayed.

    It does not keep the function: an owner that calls one of its own methods is then freed with its
    last reference, and not at some later collection of cycles.

    The function must be the same at every call. It must read and write the same tensors, must not
    branch on their values, and may depend only on its argument. An update of a small network is a
    hundred kernels, which Python takes longer to launch than they take to run. Recordings share
    memory for intermediate results: one that must outlive the next recording must be referenced.
    """

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._called: set[Hashable] = set()
        self._graphs: dict[Hashable, torch.cuda.CUDAGraph] = {}
        self._stream: Any = torch.cuda.Stream(device) if device.type == "cuda" else None

    def __call__(self, function: Function, argument: Hashable) -> None:
        """Calls the function, or replays its recording."""
        if self._device.type != "cuda":
            function(argument)
        elif argument not in self._called:
            # Loads kernels and allocates on the recording's stream, where a recording must not.
            self._called.add(argument)
            caller = torch.cuda.current_stream(self._device)
            self._stream.wait_stream(caller)
            with torch.cuda.stream(self._stream):
                function(argument)
            caller.wait_stream(self._stream)
        else:
            if argument not in self._graphs:
                self._graphs[argument] = self._record(function, argument)
            self._graphs[argument].replay()

    def _record(self, function: Function, argument: Hashable) -> torch.cuda.CUDAGraph:
        """Returns a recording of the function with an argument."""
        graph = torch.cuda.CUDAGraph()
        pool = next((other.pool() for other in self._graphs.values()), None)
        # Entering `graph` synchronizes the current device, which may be another one.
        with (
            torch.cuda.device(self._device),
            torch.cuda.graph(
                graph, pool=pool, stream=self._stream, capture_error_mode="thread_local"
            ),
        ):
            function(argument)
        return graph
