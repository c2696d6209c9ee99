"""Measures what autograd costs: TD3 as an update rule of another package, and jbench's own.

`python benchmarks/rules.py` makes the updates of both with the published networks and minibatches,
alternately and without robots, so that other work on the machine affects them equally. Times are of
the processor in this thread. The tests compare the parameters of the two.
"""

import argparse
import itertools
import time
from statistics import median
from typing import ClassVar

import torch
from torch import Tensor, nn

from jbench.agents.batched.make import make_engine
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.replay import Batch
from jbench.agents.batched.rule import Rule
from jbench.agents.batched.updates import Updates
from jbench.agents.environments import Environments
from jbench.settings.algorithms import TD3Settings

BURST = 20  # updates at a time
TRANSITIONS = 10_000


class TD3(Rule):
    """TD3 (Fujimoto et al., 2018, Algorithm 1)."""

    Settings: ClassVar[type[TD3Settings]] = TD3Settings
    losses: ClassVar[dict[str, str]] = {"critic_loss": "critics", "actor_loss": "actor"}
    targets = ("actor", "critics")
    delayed = ("actor", "actor_target", "critics_target")

    def __init__(self, settings: TD3Settings, observation_size: int, action_size: int = 1) -> None:
        """See `Rule`."""
        super().__init__(settings, observation_size, action_size)
        self.noise_per_transition = action_size
        hidden, inputs = settings.hidden_layers, observation_size + action_size
        self.actor = mlp(observation_size, *hidden, action_size)
        self.critics = nn.ModuleList(mlp(inputs, *hidden, 1) for _ in range(2))

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """See `Rule`."""
        delay: int = self.settings.policy_delay
        return update % delay == 0

    def critic_loss(self, batch: Batch) -> Tensor:
        """Returns the sum of both critics' mean squared errors."""
        settings = self.settings
        clip = settings.target_noise_clip
        noise = (settings.target_policy_noise * batch.noise).clamp(-clip, clip)
        next_actions = (self.actor_target(batch.next_observations).tanh() + noise).clamp(-1, 1)
        inputs = torch.cat([batch.next_observations, next_actions], dim=-1)
        next_values = torch.minimum(*(critic(inputs) for critic in self.critics_target))
        targets = batch.rewards + batch.discounts * next_values
        values = torch.stack([critic(batch.state_actions) for critic in self.critics])
        return (values - targets).square().mean(dim=1).sum()

    def actor_loss(self, batch: Batch) -> Tensor:
        """Returns minus the mean value of the policy's actions."""
        actions = self.act(batch.observations)
        return -self.critics[0](torch.cat([batch.observations, actions], dim=-1)).mean()


def mlp(*sizes: int) -> nn.Sequential:
    """Returns linear layers with ReLU between them."""
    layers: list[nn.Module] = []
    for inputs, units in itertools.pairwise(sizes):
        layers += [nn.Linear(inputs, units), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def updates_of(algo: str | type[Rule]) -> Updates:
    """Returns the updates of a seed whose replay buffer is full of random numbers."""
    settings = TD3Settings(buffer_size=TRANSITIONS)
    engine = make_engine(algo, settings, Environments("face_direction", [0]))
    assert isinstance(engine, OffPolicyEngine)
    engine.replay.restore(0, torch.randn(1, TRANSITIONS, engine.environments.size + 2), TRANSITIONS)
    (updates,) = engine.group_updates
    return updates


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=60)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    contenders = [updates_of("td3"), updates_of(TD3)]
    rounds = []
    for number in range(arguments.rounds + 1):
        times = []
        for updates in contenders:
            updates.prepare(1 + number * BURST, BURST)
            began = time.thread_time()
            updates.run()
            times.append(1e3 * (time.thread_time() - began) / BURST)
        rounds.append(times)
    measured = rounds[1:]  # the first one allocates memory
    by_hand, by_rule = (median(times) for times in zip(*measured, strict=True))
    ratio = median(rule / hand for hand, rule in measured)
    print(f"TD3 by hand {by_hand:.2f} ms, as a rule {by_rule:.2f} ms an update; ratio {ratio:.2f}")


if __name__ == "__main__":
    main()
