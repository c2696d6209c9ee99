"""CUDA graphs: a recorded sequence of kernels that one call launches."""

from collections.abc import Callable, Hashable

import torch


class Captured:
    """A function that is recorded on a GPU, one recording per argument, and then replayed.

    The function must read and write the same tensors at every call, must not branch on their
    values, and may depend only on its argument. An update of a small network is a hundred kernels,
    which Python takes longer to launch than they take to run.

    Recordings share memory for intermediate results, because only one runs at a time. A result
    that must outlive the next recording must be referenced or lie in memory of the caller.
    """

    def __init__(self, function: Callable[[Hashable], None], device: torch.device) -> None:
        """Wraps a function; on a CPU it is called directly."""
        self._function, self._device = function, device
        self._called: set[Hashable] = set()
        self._graphs: dict[Hashable, torch.cuda.CUDAGraph] = {}
        self._side_stream: torch.cuda.Stream | None = None

    def __call__(self, argument: Hashable) -> None:
        """Calls the function, or replays its recording."""
        if self._device.type != "cuda":
            self._function(argument)
        elif argument not in self._called:
            self._called.add(argument)
            self._warm_up(argument)
        else:
            if argument not in self._graphs:
                self._graphs[argument] = self._record(argument)
            self._graphs[argument].replay()

    def _warm_up(self, argument: Hashable) -> None:
        """Calls the function on the stream of the recording.

        This loads kernels and allocates buffers and the workspace of cuBLAS for this stream, none
        of which may happen during a recording.
        """
        stream, caller = self._stream(), torch.cuda.current_stream(self._device)
        stream.wait_stream(caller)
        with torch.cuda.stream(stream):
            self._function(argument)
        caller.wait_stream(stream)

    def _record(self, argument: Hashable) -> torch.cuda.CUDAGraph:
        """Records a call without running it."""
        graph = torch.cuda.CUDAGraph()
        pool = next((other.pool() for other in self._graphs.values()), None)
        # Entering `graph` synchronises the current device, which may be another one.
        with (
            torch.cuda.device(self._device),
            torch.cuda.graph(
                graph, pool=pool, stream=self._stream(), capture_error_mode="thread_local"
            ),
        ):
            self._function(argument)
        return graph

    def _stream(self) -> torch.cuda.Stream:
        if self._side_stream is None:
            self._side_stream = torch.cuda.Stream(self._device)
        return self._side_stream
