"""Tests of the functions that are recorded as CUDA graphs, on torch's device "meta".

Tensors of that device have no content, so reading a value and shapes that depend on data are
errors, as in a recording. A dispatch mode finds tensors of the CPU.
"""

from functools import partial

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from jbench.agents.batched import engine, off_policy
from jbench.agents.batched.autograd import AutogradLearner
from jbench.agents.batched.engine import Group
from jbench.agents.batched.make import LEARNERS, on_features
from jbench.agents.batched.on_policy import Epochs
from jbench.agents.batched.ppo import COLUMNS, PPO
from jbench.agents.batched.replay import ReplayBuffer
from jbench.agents.batched.rule import make_rule
from jbench.agents.batched.tensors import Tensors
from jbench.agents.batched.updates import Updates
from jbench.agents.environments import Generators
from jbench.settings.algorithms import ALGORITHMS, algorithm_settings
from jbench.settings.bases import SCRIPT
from tests.agents.small_rules import REDQ, TQC
from tests.agents.test_batched_engine import FEW, MANY

GPU = torch.device("meta")
SEEDS, SIZE = 2, 16


class Region(TorchDispatchMode):
    """Checks the operations of a region."""

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        result = function(*args, **(kwargs or {}))
        for leaf in tree_leaves((args, kwargs, result)):
            if isinstance(leaf, torch.Tensor):
                assert leaf.device == GPU, f"{function} on the {leaf.device}"
        assert torch.Tag.nondeterministic_seeded not in function.tags, f"{function} is random"
        return result


def check(tensors, function, *arguments):
    """Checks the second call; the first call makes the buffers."""
    function(*arguments)
    before = len(tensors._scratch), len(tensors.saved)
    with Region():
        function(*arguments)
    assert (len(tensors._scratch), len(tensors.saved)) == before


def build_group(rule, settings, precision="float32"):
    tensors = Tensors(SEEDS, torch.float32, GPU, low_precision=precision == "bfloat16")
    learner = rule(settings, SIZE, 1, tensors)
    return Group(learner, range(SEEDS), [Generators(seed, 1) for seed in range(SEEDS)])


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *((algo, {}) for algo in (*ALGORITHMS, TQC, REDQ)),
        *((algo, {"base": "script"}) for algo in SCRIPT),
        *((algo, {"precision": "bfloat16"}) for algo in ("ddpg", "td3", "sac")),
        ("td3", {"limit": "terminal"}),
        ("sac", {"changes": {"ent_coef": 0.1, "target_update_interval": 2}}),
        ("ppo", {"changes": {"clip_range_vf": None, "normalize_advantage": False}}),
        ("ddpg", {"ofe": FEW, "precision": "bfloat16"}),
        ("td3", {"ofe": MANY}),
        ("sac", {"ofe": MANY}),
    ],
)
def test_recorded_functions_stay_on_gpu(algo, options):
    given = {"base": "published", "changes": {}, "ofe": None, "limit": "bootstrap", **options}
    if isinstance(algo, str):
        settings = algorithm_settings(algo, given["base"], given["changes"])
        ofe = given["ofe"]
        rule = LEARNERS[algo] if ofe is None else on_features(algo, ofe)
    else:
        settings = algo.Settings()
        rule = partial(AutogradLearner, rule=make_rule(algo, settings, SIZE))
    group = build_group(rule, settings, given.get("precision", "float32"))
    learner, tensors = group.learner, group.learner.view
    seen, noise = (torch.empty(SEEDS, 1, size, device=GPU) for size in (SIZE, 1))
    check(tensors, engine.act, learner, seen)
    if algo == "ppo":
        epochs = Epochs(settings, group, torch.zeros(SEEDS, 8, 16, SIZE + 1 + COLUMNS))
        check(tensors, epochs._update_once, settings.batch_size)
        check(tensors, PPO.explore, learner, seen, noise)
        check(tensors, PPO.value, learner, seen)
        return
    replay = ReplayBuffer(SEEDS, 1, 100, SIZE, 1, flush_every=1, device=GPU)
    updates = Updates(settings, group, replay, given["limit"])
    for delayed in (True, False):
        check(tensors, updates._update_once, delayed)
    if given["ofe"] is not None:
        check(tensors, updates._pretrain_once, None)
    if learner.is_stochastic:
        check(tensors, off_policy._explore, learner, seen, noise)
