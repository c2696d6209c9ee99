"""Update rules with small networks, and helpers of their tests."""

from functools import partial

import pytest
import torch
from torch import nn

from benchmarks.rules import TD3, mlp
from jbench.agents.batched.autograd import AutogradLearner
from jbench.agents.batched.rule import make_rule
from jbench.agents.batched.tensors import Tensors
from tests.agents.batched_oracle import SIZE
from tests.agents.test_batched_engine import short_engine
from tests.documentation import code_of

SMALL = {"hidden_layers": (24, 20), "batch_size": 16, "learning_rate": 1e-3, "buffer_size": 50}
SCHEDULE = {"train_freq": 10, "gradient_steps": 5, "learning_starts": 20}
TD3_SETTINGS = TD3.Settings(**SMALL, **SCHEDULE)


def documented_rule():
    names = {}
    exec(code_of("your-own-rule.md", "python"), names)  # noqa: S102
    return names["TQC"]


TQC = documented_rule()


class REDQ(TD3):
    """TD3 whose targets use a random subset of critics, and whose actor uses all critics."""

    delayed = ()

    def __init__(self, settings, observation_size, action_size):
        super().__init__(settings, observation_size, action_size)
        inputs = observation_size + action_size
        self.critics = nn.ModuleList(mlp(inputs, 8, 1) for _ in range(4))
        self.noise_per_transition = len(self.critics)

    def values(self, critics, observations, actions):
        inputs = torch.cat([observations, actions], dim=-1)
        return torch.stack([critic(inputs) for critic in critics])

    def critic_loss(self, batch):
        following = batch.next_observations, self.actor_target(batch.next_observations).tanh()
        subset = batch.noise[0].argsort()[:2]
        next_values = self.values(self.critics_target, *following)[subset].amin(dim=0)
        targets = batch.rewards + batch.discounts * next_values
        values = self.values(self.critics, batch.observations, batch.actions)
        return (values - targets).square().mean(dim=1).sum()

    def actor_loss(self, batch):
        return -self.values(self.critics, batch.observations, self.act(batch.observations)).mean()


TQC_SETTINGS = TQC.Settings(**SMALL, **SCHEDULE, critics=3, quantiles=5, dropped=1)
RULES = pytest.mark.parametrize(
    ("rule", "settings"), [(TD3, TD3_SETTINGS), (TQC, TQC_SETTINGS)], ids=["td3", "tqc"]
)


def learners(rule, settings, dtype=torch.float32, seeds=1, actions=1):
    """Returns the tensors of some seeds, a learner per seed, and a learner of the stack."""
    tensors = Tensors(seeds, dtype)
    views = [tensors, *(tensors.select(seed) for seed in range(seeds))]
    made = make_rule(rule, settings, SIZE, actions)
    make = partial(AutogradLearner, settings, SIZE, actions, rule=made)
    stack, *each = (make(view) for view in views)
    for seed, learner in enumerate(each):
        learner.initialize(torch.Generator().manual_seed(seed))
    return tensors, each, stack


def batches(learner, count, dtype=torch.float64, seeds=()):
    """Random numbers of minibatches."""
    random = torch.Generator().manual_seed(1)
    for _ in range(count):
        width = SIZE + learner.action_size + 1
        widths = (width, width, 1, learner.noise_per_transition)
        yield [torch.randn(*seeds, 32, width, generator=random, dtype=dtype) for width in widths]


def build_engine(rule, settings, seeds, **options):
    return short_engine(rule, settings, "face_direction", seeds, **options)
