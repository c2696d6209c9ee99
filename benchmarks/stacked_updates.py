"""The updates of a stack of agents without their robots, for `benchmarks/gpu.py`."""

import time
from collections.abc import Callable
from typing import Any

import torch
from torch.profiler import ProfilerActivity, profile
from torch.utils.flop_counter import FlopCounterMode

from jbench.agents.batched.engine import BatchedEngine
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.on_policy import OnPolicyEngine


class Updates:
    """The updates of the agents of an engine, without their robots."""

    def __init__(self, engine: BatchedEngine[Any], transitions: int) -> None:
        """Fills the buffers with random transitions."""
        self._engine, self._done = engine, 0
        self.device = engine.tensors.device
        if isinstance(engine, OffPolicyEngine):
            rows = torch.randn(1, transitions, engine.environments.size + 2)
            for seed in range(len(engine.learners)):
                engine.replay.restore(seed, rows, transitions)
        else:
            assert isinstance(engine, OnPolicyEngine)
            engine._rollout.rows.normal_()

    def make(self, count: int) -> tuple[int, float, float]:
        """Makes updates of the whole stack; PPO makes those of one rollout.

        Returns:
            Their number, their seconds, and their seconds with those of drawing minibatches and
            noise. PPO draws between its updates: both include it.
        """
        engine = self._engine
        began = drawn = self._now()
        if isinstance(engine, OffPolicyEngine):
            (updates,) = engine.group_updates
            updates.prepare(self._done + 1, count)
            drawn = self._now()
            updates.run()
        else:
            assert isinstance(engine, OnPolicyEngine)
            (epochs,), settings = engine.group_updates, engine._settings
            count = settings.n_epochs * -(-epochs._transitions // settings.batch_size)
            epochs.run()
        ended = self._now()
        self._done += count
        return count, ended - drawn, ended - began

    def flops(self) -> float:
        """Returns floating point operations of the products of matrices of one update."""
        engine = self._engine
        if isinstance(engine, OffPolicyEngine):
            (updates,) = engine.group_updates
            # TD3 updates its actor every other time.
            arguments: list[Any] = [updates._learner.is_delayed_update(i, 0) for i in (1, 2)]
            function: Callable[[Any], None] = updates._update_once
        else:
            assert isinstance(engine, OnPolicyEngine)
            arguments = [engine._settings.batch_size]
            function = engine.group_updates[0]._update_once
        with FlopCounterMode(display=False) as counter:
            for argument in arguments:
                function(argument)
        return float(counter.get_total_flops() / len(arguments))

    def kernels(self, count: int) -> tuple[int, dict[str, tuple[int, float]]]:
        """Returns the number of updates and, by kernel, how often it ran and its seconds.

        On a CPU they are torch's operations.
        """
        gpu = self.device.type == "cuda"
        with profile(activities=[ProfilerActivity.CUDA if gpu else ProfilerActivity.CPU]) as found:
            made, _, _ = self.make(count)
        kind = "CUDA" if gpu else "CPU"
        return made, {
            str(event.key): (
                event.count,
                (event.self_device_time_total if gpu else event.self_cpu_time_total) / 1e6,
            )
            for event in found.key_averages()
            if event.device_type.name == kind
        }

    def _now(self) -> float:
        """Returns the time, in seconds, once the device has made what was asked of it."""
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        return time.perf_counter()


def peak(precision: str, rows: int, device: torch.device) -> float:
    """Returns the floating point operations per second of a large product of matrices."""
    if device.type == "cuda":
        torch.backends.cuda.matmul.fp32_precision = "tf32" if precision == "tf32" else "ieee"
    matrix = torch.randn(rows, rows, device=device)
    if precision == "bfloat16":
        matrix = matrix.bfloat16()
    seconds = []
    for _ in range(6):
        began = time.perf_counter()
        torch.mm(matrix, matrix)[0, 0].item()  # reading a value waits for the product
        seconds.append(time.perf_counter() - began)
    return 2 * rows**3 / min(seconds)
