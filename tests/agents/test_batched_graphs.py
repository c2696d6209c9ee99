"""What a GPU would record and repeat does the same again: as far as a CPU can tell.

A CUDA graph repeats kernels on the addresses and with the numbers of the one call that was
recorded. Here the operations of a call are recorded with the tensors and numbers that they were
given, and repeated on the same tensors, without the code that made them.
"""

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from jbench.agents.batched.graphs import Captured
from jbench.names import ALGORITHMS
from tests.agents.test_batched_engine import LENGTH, SCRIPTS, STEPS, assert_same, engine_of, story

# What looks at numbers, or has outputs whose size depends on them, can't be recorded.
FORBIDDEN = ("_local_scalar_dense", "nonzero", "masked_select", "is_nonzero", "unique", "equal")


class Recording(TorchDispatchMode):
    """Writes down all operations on tensors."""

    def __init__(self):
        super().__init__()
        self.operations = []

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        name = function.__name__.split(".")[0]
        assert name not in FORBIDDEN, f"{name} can't be a part of a CUDA graph"
        result = function(*args, **(kwargs or {}))
        self.operations.append((function, args, kwargs or {}, result))
        return result

    def repeat(self):
        """Does all of it again, in the same memory."""
        for function, args, kwargs, before in self.operations:
            given = {part.data_ptr() for part in tensors_in((args, kwargs))}
            for old, new in zip(
                tensors_in(before), tensors_in(function(*args, **kwargs)), strict=True
            ):
                # A view, or what was written in place, is there already.
                if old.data_ptr() != new.data_ptr() and new.data_ptr() not in given:
                    old.copy_(new)


def tensors_in(tree):
    return [leaf for leaf in tree_leaves(tree) if isinstance(leaf, torch.Tensor)]


class Repeated(Captured):
    """A function that is called twice by itself, and then only repeated."""

    repeats = 0

    def __init__(self, captured):
        super().__init__(captured._function, torch.device("cpu"))
        self.recordings = {}

    def __call__(self, argument):
        if argument not in self._called:
            self._called.add(argument)
            self._function(argument)
        elif argument not in self.recordings:
            with Recording() as recording:
                self._function(argument)
            self.recordings[argument] = recording
        else:
            Repeated.repeats += 1
            self.recordings[argument].repeat()


def repeating(engine):
    """Lets the updates and the actions of an engine be repeated."""
    for updates in getattr(engine, "_groups", None) or engine._epochs:
        updates._update = Repeated(updates._update)
    engine._team._captured = Repeated(engine._team._captured)
    return engine


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *((algo, {}) for algo in ALGORITHMS),
        *SCRIPTS.items(),
        ("td3", {"time_limit": "terminal", "precision": "bfloat16"}),
        ("ppo", {"changes": {"batch_size": 15}}),
        ("sac", {"changes": {"gradient_steps": 4, "train_freq": 4, "target_update_interval": 3}}),
    ],
)
def test_repeating_what_was_recorded_does_the_same(algo, options):
    options = {"stacked": True, **options}
    with engine_of(algo, [0, 1], **options) as plain:
        wanted = story(plain, 1)
    before = Repeated.repeats
    with engine_of(algo, [0, 1], **options) as engine:
        assert_same(story(repeating(engine), 1), wanted)
    # Actions alone are asked for at every step, and given in rollouts of at most 20.
    assert Repeated.repeats - before > STEPS - LENGTH
