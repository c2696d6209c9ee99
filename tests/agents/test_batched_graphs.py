"""Tests that functions recorded as CUDA graphs can be replayed, emulated on a CPU.

A CUDA graph replays kernels with the addresses and scalars of the recorded call. Here the torch
operations of a call are recorded with their arguments and replayed on the same tensors.
`test_captured_regions.py` finds operations that can't be recorded.
"""

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from jbench.agents.batched.graphs import Captured
from jbench.settings.algorithms import ALGORITHMS
from tests.agents.test_batched_engine import (
    SCRIPTS,
    STEPS,
    assert_same,
    build_engine,
    slow,
    trajectory,
)


class Recording(TorchDispatchMode):
    """Records all operations on tensors."""

    def __init__(self):
        super().__init__()
        self.operations = []

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        result = function(*args, **(kwargs or {}))
        self.operations.append((function, args, kwargs or {}, result))
        return result

    def repeat(self):
        """Replays the operations in the same memory."""
        for function, args, kwargs, before in self.operations:
            given = {part.data_ptr() for part in tensors_in((args, kwargs))}
            for old, new in zip(
                tensors_in(before), tensors_in(function(*args, **kwargs)), strict=True
            ):
                # Views and results of in-place operations need no copy.
                if old.data_ptr() != new.data_ptr() and new.data_ptr() not in given:
                    old.copy_(new)


def tensors_in(tree):
    return [leaf for leaf in tree_leaves(tree) if isinstance(leaf, torch.Tensor)]


class Replayed(Captured):
    """Calls a function once, records the second call, and replays later ones."""

    repeats = 0

    def __init__(self):
        super().__init__(torch.device("cpu"))
        self.recordings = {}

    def __call__(self, function, argument):
        if argument not in self._called:
            self._called.add(argument)
            function(argument)
        elif argument not in self.recordings:
            with Recording() as recording:
                function(argument)
            self.recordings[argument] = recording
        else:
            Replayed.repeats += 1
            self.recordings[argument].repeat()


def with_replay(engine):
    """Makes an engine replay its updates and actions."""
    for updates in engine._group_updates:
        updates._update = Replayed()
    engine._captured = Replayed()
    return engine


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *((algo, {}) for algo in ALGORITHMS),
        *(slow(*case) for case in SCRIPTS.items()),
        ("td3", {"time_limit": "terminal", "precision": "bfloat16"}),
        ("ddpg", {"changes": {"mirror": True}}),
        ("ppo", {"changes": {"batch_size": 12}}),
        ("sac", {"changes": {"gradient_steps": 4, "train_freq": 4, "target_update_interval": 3}}),
    ],
)
def test_replayed_recording_has_same_results(algo, options):
    options = {"stacked": True, **options}
    with build_engine(algo, [0, 1], **options) as plain:
        expected = trajectory(plain, 1)
    before = Replayed.repeats
    with build_engine(algo, [0, 1], **options) as engine:
        assert_same(trajectory(with_replay(engine), 1), expected)
    # The policies act in at least half of the steps.
    assert Replayed.repeats - before > STEPS / 2
