"""Tests of the functions that are recorded as CUDA graphs, on a CPU.

One test calls them on torch's device "meta". Its tensors have no content, so reading a value and
shapes that depend on data are errors, as in a recording. A dispatch mode finds tensors of the CPU.

The other test emulates replays: a CUDA graph replays kernels with the addresses and scalars of the
recorded call, so the torch operations of a call are repeated on the same tensors.
"""

from functools import partial

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from jbench.agents.batched.autograd import AutogradLearner
from jbench.agents.batched.engine import SeedGroup
from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.make import on_features, own_learner
from jbench.agents.batched.normalize import running_statistics
from jbench.agents.batched.on_policy import Epochs
from jbench.agents.batched.ppo import Transitions
from jbench.agents.batched.replay import ReplayBuffer, Sizes
from jbench.agents.batched.rule import make_rule
from jbench.agents.batched.tensors import Tensors
from jbench.agents.batched.updates import Updates
from jbench.agents.environments import Generators
from jbench.settings.algorithms import ALGORITHMS, algorithm_settings
from tests.agents.small_rules import TQC
from tests.agents.test_batched_engine import (
    FEW,
    MANY,
    SCRIPTS,
    STEPS,
    assert_same,
    build_engine,
    slow,
    trajectory,
)

GPU = torch.device("meta")
SEEDS, SIZE = 2, 16


def tensors_in(tree):
    return [leaf for leaf in tree_leaves(tree) if isinstance(leaf, torch.Tensor)]


class Region(TorchDispatchMode):
    """Checks the operations of a region."""

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        result = function(*args, **(kwargs or {}))
        for tensor in tensors_in((args, kwargs, result)):
            assert tensor.device == GPU, f"{function} on the {tensor.device}"
        assert torch.Tag.nondeterministic_seeded not in function.tags, f"{function} is random"
        return result


def check(tensors, function, *arguments):
    """Checks the second call; the first call makes the buffers."""
    function(*arguments)
    before = len(tensors._scratch), len(tensors.saved)
    with Region():
        function(*arguments)
    assert (len(tensors._scratch), len(tensors.saved)) == before


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *((algo, {}) for algo in (*ALGORITHMS, TQC)),
        *(slow(algo, {"base": "script"}) for algo in SCRIPTS),
        ("ddpg", {"base": "figure8"}),
        ("sac", {"precision": "bfloat16"}),
        *(slow(algo, {"precision": "bfloat16"}) for algo in ("ddpg", "td3")),
        ("td3", {"limit": "terminal"}),
        ("sac", {"changes": {"ent_coef": 0.1, "target_update_interval": 2}}),
        ("ppo", {"changes": {"clip_range_vf": None, "normalize_advantage": False}}),
        ("ddpg", {"ofe": FEW, "precision": "bfloat16"}),
        ("td3", {"ofe": MANY}),
        ("sac", {"ofe": MANY}),
    ],
)
def test_recorded_functions_stay_on_gpu(algo, options):
    changes, ofe = options.get("changes", {}), options.get("ofe")
    if isinstance(algo, str):
        settings = algorithm_settings(algo, options.get("base", "published"), changes)
        rule = own_learner(algo) if ofe is None else on_features(algo, ofe)
    else:
        settings = algo.Settings()
        rule = partial(AutogradLearner, rule=make_rule(algo, settings, SIZE))
    low_precision = options.get("precision") == "bfloat16"
    tensors = Tensors(SEEDS, torch.float32, GPU, low_precision=low_precision)
    learner = rule(settings, SIZE, 1, tensors)
    group = SeedGroup(learner, range(SEEDS), [Generators(seed, 1) for seed in range(SEEDS)])
    seen, noise = (torch.empty(SEEDS, 1, size, device=GPU) for size in (SIZE, 1))
    check(tensors, learner.act, seen)
    if algo == "ppo":
        rows = torch.zeros(SEEDS, 8, 16, Transitions.width(SIZE, 1))
        epochs = Epochs(settings, group, Transitions(rows, action_size=1))
        check(tensors, epochs._update_once, settings.batch_size)
        check(tensors, learner.explore, seen, noise)
        check(tensors, learner.value, seen)
        return
    sizes = Sizes(SEEDS, 1, 100, SIZE, 1)
    replay = ReplayBuffer(
        sizes,
        flush_every=1,
        episode_steps=1000,
        ends_are_terminal=options.get("limit") == "terminal",
        device=GPU,
    )
    statistics = running_statistics(settings, SEEDS, SIZE, torch.float32, GPU)
    updates = Updates(settings, group, replay, statistics=statistics)
    for delayed in (True, False):
        check(tensors, updates._update_once, delayed)
    if ofe is not None:
        check(tensors, updates._update_once, None)
    if learner.is_stochastic:
        check(tensors, learner.explore, seen, noise)


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


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *(slow(algo, {}) for algo in ALGORITHMS),
        *(slow(*case) for case in SCRIPTS.items()),
        ("td3", {"time_limit": "terminal", "precision": "bfloat16"}),
        ("ddpg", {"changes": {"mirror": True, "normalize": "running"}}),
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
        for updates in engine.group_updates:
            updates._update = Replayed()
        engine._captured = Replayed()
        assert_same(trajectory(engine, 1), expected)
    # The policies act in at least half of the steps.
    assert Replayed.repeats - before > STEPS / 2
