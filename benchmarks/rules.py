"""Measures what autograd costs: TD3 of `jbench.rules`, and jbench's own.

`python benchmarks/rules.py` makes the updates of both with the published networks and minibatches,
alternately and without robots, so that other work on the machine affects them equally. Times are of
the processor in this thread. The tests compare the parameters of the two.
"""

import argparse
import time
from statistics import median

import torch

from jbench.agents.batched.make import make_batched_engine
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.rule import Rule
from jbench.agents.batched.updates import Updates
from jbench.agents.environments import Environments
from jbench.rules import TD3
from jbench.settings.algorithms import TD3Settings

BURST = 20  # updates at a time
TRANSITIONS = 10_000


def updates_of(algo: str | type[Rule]) -> Updates:
    """Returns the updates of a seed whose replay buffer is full of random numbers."""
    settings = TD3Settings(buffer_size=TRANSITIONS)
    engine = make_batched_engine(algo, settings, Environments("face_direction", [0]))
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
