"""Update rules with small networks, and helpers of their tests."""

from functools import partial

import torch

from jbench.agents.batched.autograd import AutogradLearner
from jbench.agents.batched.rule import make_rule
from jbench.agents.batched.tensors import Tensors
from jbench.rules import TD3
from tests.agents.batched_oracle import SIZE
from tests.agents.test_batched_engine import short_engine
from tests.documentation import code_of

SMALL = {"hidden_layers": (24, 20), "batch_size": 16, "learning_rate": 1e-3, "buffer_size": 50}
SCHEDULE = {"train_freq": 10, "gradient_steps": 5, "learning_starts": 20}
TD3_SETTINGS = TD3.Settings(**SMALL, **SCHEDULE)

documented = {}
exec(code_of("your-own-rule.md", "python", "class TQC"), documented)  # noqa: S102
TQC = documented["TQC"]
TQC_SETTINGS = TQC.Settings(**SMALL, **SCHEDULE, critics=3, quantiles=5, dropped=1)


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


def build_engine(rule, settings, seeds, task="face_direction", **options):
    return short_engine(rule, settings, task, seeds, **options)
