"""Tests of the functions that are recorded as CUDA graphs, on torch's device "meta".

Tensors of that device have no content, so reading a value and shapes that depend on data are
errors, as in a recording. A dispatch mode finds tensors of the CPU.
"""

import re
from functools import partial
from pathlib import Path

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from jbench.agents.batched import engine, off_policy
from jbench.agents.batched.autograd import AutogradLearner
from jbench.agents.batched.make import LEARNERS, ON_FEATURES
from jbench.agents.batched.on_policy import Epochs
from jbench.agents.batched.ppo import PPO
from jbench.agents.batched.replay import ReplayBuffer
from jbench.agents.batched.rollout import Rollout
from jbench.agents.batched.rule import make_rule
from jbench.agents.batched.team import Team
from jbench.agents.batched.tensors import Tensors
from jbench.agents.batched.updates import Updates
from jbench.agents.generators import Generators
from jbench.settings.algorithms import ALGORITHMS, algorithm_settings
from jbench.settings.bases import SCRIPT
from tests.agents.small_rules import REDQ, TQC
from tests.agents.test_batched_engine import FEW, MANY

GPU = torch.device("meta")
SEEDS, SIZE = 2, 16
PAGE = Path(__file__).parents[2] / "docs" / "speed.md"
ALLOCATING = ("empty", "empty_like", "empty_strided", "new_empty")


class Region(TorchDispatchMode):
    """Checks the operations of a region and counts the kernels that they launch.

    Attributes:
        kernels: number of kernels.
    """

    def __init__(self):
        super().__init__()
        self.kernels = 0

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        result = function(*args, **(kwargs or {}))
        for leaf in tree_leaves((args, kwargs, result)):
            if isinstance(leaf, torch.Tensor):
                assert leaf.device == GPU, f"{function} on the {leaf.device}"
        assert torch.Tag.nondeterministic_seeded not in function.tags, f"{function} is random"
        self.kernels += kernels_of(function, args, kwargs or {})
        return result


def kernels_of(function, args, kwargs):
    """The number of kernels that an operation launches."""
    name = function.__name__.split(".")[0]
    if function.is_view or name in ALLOCATING:
        return 0
    # The bias is copied to the output first, to which the product of a stack is added.
    return 2 if name == "baddbmm" and kwargs.get("out") is not args[0] else 1


def kernels_in(function, argument, tensors):
    """The number of kernels of the second call; the first call makes the buffers."""
    function(argument)
    before = len(tensors._scratch), len(tensors.saved)
    with Region() as region:
        function(argument)
    assert (len(tensors._scratch), len(tensors.saved)) == before
    return region.kernels


def regions_of(
    algo,
    *,
    base="published",
    changes=None,
    ofe=None,
    precision="float32",
    limit=None,
):
    """The number of kernels of each recorded function of an algorithm."""
    if isinstance(algo, str):
        settings = algorithm_settings(algo, base, changes or {})
        rule = LEARNERS[algo] if ofe is None else partial(ON_FEATURES[algo], ofe=ofe)
    else:
        settings = algo.Settings()
        rule = partial(AutogradLearner, rule=make_rule(algo, settings, SIZE))
    tensors = Tensors(SEEDS, torch.float32, GPU, low_precision=precision == "bfloat16")
    generators = [Generators(seed, 1) for seed in range(SEEDS)]
    team = Team(partial(rule, settings, SIZE, 1), generators, tensors, stacked=True)
    (group,) = team.groups
    if algo == "ppo":
        epochs = Epochs(settings, group, Rollout(SEEDS, 8, 16, SIZE, 1))
        found = {"update": kernels_in(epochs._update_once, settings.batch_size, tensors)}
        methods = [(engine.act, 1), (PPO.explore, 2), (PPO.value, 1)]
    else:
        replay = ReplayBuffer(SEEDS, 1, 100, SIZE, 1, flush_every=1, device=GPU)
        updates = Updates(settings, group, replay, limit or "bootstrap")
        found = {
            name: kernels_in(updates._update_some, (delayed,), tensors)
            for name, delayed in (("update", True), ("update without the actor", False))
        }
        three = kernels_in(updates._update_some, (True,) * 3, tensors)
        assert three == 3 * found["update"]
        if ofe is not None:
            found["pretraining"] = kernels_in(updates._pretrain_once, None, tensors)
        methods = [(engine.act, 1)]
        if group.learner.is_stochastic:
            methods.append((off_policy._explore, 2))
    for method, count in methods:
        key = (method, *[(SEEDS, 1, SIZE), (SEEDS, 1, 1)][:count])
        team._inputs[key] = [(torch.empty(0), torch.empty(s, device=GPU)) for s in key[1:]]
        found[method.__name__.strip("_")] = kernels_in(team._run_stack, key, tensors)
    return found


def documented(algo, precision):
    """Kernels of an update in the table of docs/speed.md: one number, or two as for TD3."""
    row = re.search(rf"^\| `--precision {precision}` \|(.*)\|$", PAGE.read_text(), re.MULTILINE)
    cells = dict(zip(("ddpg", "td3", "sac", "ppo"), row[1].split("|"), strict=True))
    return [int(number) for number in re.findall("[0-9]+", cells[algo])]


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
@pytest.mark.parametrize("algo", ALGORITHMS)
def test_recorded_updates_launch_documented_kernels_on_gpu(algo, precision):
    if (algo, precision) == ("ppo", "bfloat16"):
        pytest.skip("PPO is refused in bfloat16")
    found = regions_of(algo, precision=precision)
    counts = [found["update"]]
    if algo == "td3":
        counts.append(found["update without the actor"])
    assert counts == documented(algo, precision)


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *((algo, {"base": "script"}) for algo in SCRIPT),
        ("ddpg", {"base": "script", "precision": "bfloat16"}),
        ("td3", {"limit": "terminal"}),
        ("sac", {"changes": {"ent_coef": 0.1, "target_update_interval": 2}}),
        ("ppo", {"changes": {"clip_range_vf": None, "normalize_advantage": False}}),
        ("ddpg", {"ofe": FEW, "precision": "bfloat16"}),
        ("td3", {"ofe": MANY}),
        ("sac", {"ofe": MANY}),
    ],
)
def test_other_settings_stay_on_gpu(algo, options):
    assert min(regions_of(algo, **options).values()) > 0


class Transfers(TorchDispatchMode):
    """Notes each operation that copies from the CPU to the device, for which a GPU may wait."""

    def __init__(self, seen):
        super().__init__()
        self.seen = seen

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        result = function(*args, **(kwargs or {}))
        leaves = tree_leaves((args, kwargs, result))
        if len({leaf.device for leaf in leaves if isinstance(leaf, torch.Tensor)}) > 1:
            self.seen.append("transfer")
        return result


def test_ppo_copies_nothing_to_device_between_updates():
    settings, seen = algorithm_settings("ppo"), []
    generators = [Generators(seed, 1) for seed in range(SEEDS)]
    tensors = Tensors(SEEDS, device=GPU)
    team = Team(partial(PPO, settings, SIZE, 1), generators, tensors, stacked=True)
    rollout = Rollout(SEEDS, 1, 2 * settings.batch_size, SIZE, 1)
    epochs = Epochs(settings, team.groups[0], rollout)
    epochs._update = lambda *_: seen.append("update")
    with Transfers(seen):
        epochs.run()
    assert seen == ["transfer"] * 2 + ["update"] * (2 * settings.n_epochs)


@pytest.mark.parametrize("rule", [TQC, REDQ])
def test_rules_of_other_packages_stay_on_gpu(rule):
    assert min(regions_of(rule).values()) > 0


@pytest.mark.parametrize(
    "mistake",
    [
        lambda gpu: gpu + torch.zeros(3),
        lambda gpu: gpu.sum().item(),
        lambda gpu: gpu[gpu > 0],
        lambda gpu: torch.ones(3).sum(),
        lambda gpu: gpu.normal_(),
    ],
    ids=["two devices", "read by the host", "shape of data", "on the CPU", "random"],
)
def test_invalid_operation_in_region_is_detected(mistake):
    gpu = torch.zeros(3, device=GPU)
    with Region(), pytest.raises((RuntimeError, AssertionError)):
        mistake(gpu)
