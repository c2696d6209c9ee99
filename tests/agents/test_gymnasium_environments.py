"""Transitions and updates on environments of Gymnasium, against those of stable-baselines3."""

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3.common.buffers import ReplayBuffer, RolloutBuffer

from jbench.agents.batched.make import make_batched_engine
from jbench.agents.batched.on_policy import write_advantages
from jbench.agents.batched.ppo import Transitions
from jbench.agents.batched.replay import Batch
from jbench.agents.ending_environments import environments_class
from jbench.agents.environments import Generators
from jbench.agents.sb3 import Spaces
from jbench.settings.algorithms import algorithm_settings
from tests.agents.batched_oracle import (
    build_learner,
    build_oracle,
    build_settings,
    copy_initial_parameters,
    largest_difference,
    parameters,
)

STEPS = 450
"""Of each environment: Pendulum truncates after 200, Reacher after 50, and Hopper falls."""


def collected(algo, task, seed):
    """Returns the replay buffer of an engine that has not learned yet."""
    changes = {"learning_starts": 10_000, "buffer_size": STEPS}
    settings = algorithm_settings(algo, "suite", changes)
    with make_batched_engine(algo, settings, environments_class(task)(task, [seed], 1)) as engine:
        for _ in engine.learn(STEPS):
            pass
        return engine.replay


def repeated(task, seed, actions):
    """Returns the buffer of a loop over the environment itself, and the numbers of both ends."""
    env = gymnasium.make(task.removeprefix("gym:"))
    space = env.action_space
    (size,) = env.observation_space.shape
    spaces = Spaces(size, len(space.low))
    buffer = ReplayBuffer(
        STEPS,
        spaces.observation_space,
        spaces.action_space,
        device="cpu",
        handle_timeout_termination=True,
    )
    buffer.to_torch = lambda array, copy=True: torch.tensor(array, dtype=torch.float64)
    (seeds,) = Generators(seed, 1).environments

    ends = np.zeros(2, int)
    observation, _ = env.reset(seed=int(seeds.integers(2**32)))
    for action in actions:
        command = space.low + (action.astype(float) + 1) / 2 * (space.high - space.low)
        following, reward, terminated, truncated, _ = env.step(command.astype(space.dtype))
        is_cut = truncated and not terminated
        done = np.array([terminated or truncated])
        info = {"TimeLimit.truncated": is_cut}
        buffer.add(observation, following, action, np.array([reward]), done, [info])
        observation = following
        ends += terminated, is_cut
        if done[0]:
            observation, _ = env.reset(seed=int(seeds.integers(2**32)))
    return buffer, ends


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("algo", "task"),
    [
        ("td3", "gym:Hopper-v5"),
        ("sac", "gym:Reacher-v5"),
        *(
            pytest.param(algo, task, marks=pytest.mark.slow)
            for algo, task in (
                ("sac", "gym:Hopper-v5"),
                ("td3", "gym:Reacher-v5"),
                ("td3", "gym:Pendulum-v1"),
                ("sac", "gym:Pendulum-v1"),
            )
        ),
    ],
)
def test_transitions_and_an_update_equal_those_of_stable_baselines3(algo, task, seed, monkeypatch):
    ours = collected(algo, task, seed)
    stored = ours.seed_rows(range(1))
    action_size = len(gymnasium.make(task.removeprefix("gym:")).action_space.low)
    size = stored.shape[1] - action_size - 1  # the last is the reward
    actions = stored.view(-1, 2, stored.shape[1])[:STEPS, 0, size : size + action_size]
    theirs, (falls, cuts) = repeated(task, seed, actions.numpy())
    assert (falls > 5, cuts > 1) == ("Hopper" in task, "Hopper" not in task)

    drawn = ours.sample(np.random.default_rng(seed), 1, 256)
    rows, next_rows, terminal = (part[0] for part in drawn)
    known = theirs._get_samples(rows // 2)
    width = size + action_size
    assert torch.equal(stored[rows, :size].double(), known.observations)
    assert torch.equal(stored[rows, size:width].double(), known.actions)
    assert torch.equal(stored[rows, width, None].double(), known.rewards)
    assert torch.equal(stored[next_rows, :size].double(), known.next_observations)
    assert torch.equal(torch.from_numpy(terminal), known.dones[:, 0] == 1)

    settings = build_settings(algo)
    agent = build_oracle(algo, settings, torch.float64, monkeypatch, action_size, size)
    _, learner = build_learner(algo, settings, torch.float64, action_size, size)
    copy_initial_parameters(algo, agent, learner)
    torch.manual_seed(3)
    shape = len(rows), action_size
    draws = learner.noise_per_transition // action_size
    noise = [torch.empty(shape, dtype=torch.float64).normal_() for _ in range(draws)]
    torch.manual_seed(3)
    agent.replay_buffer.sample = lambda *_, **__: known
    agent.train(gradient_steps=1, batch_size=len(rows))
    observed = torch.cat([known.observations, known.actions, known.rewards], dim=1)
    following = torch.cat([known.next_observations, torch.zeros(len(rows), action_size + 1)], dim=1)
    discounts = settings.gamma * (1 - torch.from_numpy(terminal)[:, None].double())
    batch = Batch(observed, following, discounts, torch.cat(noise, dim=1), action_size)
    learner.update(batch, learner.is_delayed_update(1, 0))
    assert largest_difference(parameters(algo, agent, learner).values()) < 1e-10


def rollout_of_stable_baselines3(task, seed, actions, agent):
    """Returns its buffer after a loop like that of its PPO, with these actions (steps, size)."""
    env = gymnasium.make(task.removeprefix("gym:"))
    space = env.action_space
    buffer = RolloutBuffer(
        STEPS,
        agent.observation_space,
        agent.action_space,
        gae_lambda=agent.gae_lambda,
        gamma=agent.gamma,
    )
    (seeds,) = Generators(seed, 1).environments

    def value(observation):
        with torch.no_grad():
            return agent.policy.predict_values(torch.as_tensor(observation[None]).float())[0]

    observation, _ = env.reset(seed=int(seeds.integers(2**32)))
    begins = np.ones(1)
    for action in actions:
        command = space.low + (np.clip(action, -1, 1) + 1) / 2 * (space.high - space.low)
        following, reward, terminated, truncated, _ = env.step(command.astype(space.dtype))
        if truncated and not terminated:
            reward += agent.gamma * float(value(following))
        buffer.add(
            observation,
            action,
            np.array([reward]),
            begins,
            value(observation),
            torch.zeros(1),
        )
        begins = np.array([terminated or truncated])
        observation = following
        if begins[0]:
            observation, _ = env.reset(seed=int(seeds.integers(2**32)))
    buffer.compute_returns_and_advantage(value(observation), begins)
    return buffer


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "task",
    [
        "gym:Hopper-v5",
        *(pytest.param(t, marks=pytest.mark.slow) for t in ("gym:Reacher-v5", "gym:Pendulum-v1")),
    ],
)
def test_advantages_of_a_rollout_equal_those_of_stable_baselines3(task, seed, monkeypatch):
    """In float32, of rewards of the order of 10, and returns of up to 1000."""
    steps = {"n_envs": 1, "n_steps": STEPS, "batch_size": STEPS}
    settings = build_settings("ppo", **steps)
    with make_batched_engine("ppo", settings, environments_class(task)(task, [seed], 1)) as engine:
        observed, action_size = engine.environments.size, engine.environments.action_size
        agent = build_oracle("ppo", settings, torch.float32, monkeypatch, action_size, observed)
        for ours, theirs in parameters("ppo", agent, engine.learners[0]).values():
            ours.copy_(theirs)
        for _ in engine.learn(STEPS):
            if engine.control_steps == STEPS:  # before the update
                break
        state = engine.state(0).tensors
        last = torch.as_tensor(engine.environments.observations[0])

    rollout = Transitions(state["loop/rollout"][None], action_size)
    actions = rollout.actions[0, 0].double().numpy()
    buffer = rollout_of_stable_baselines3(task, seed, actions, agent)
    with torch.no_grad():
        last_values = agent.policy.predict_values(last)[None, :, 0]
    write_advantages(rollout, state["loop/ends"][None].numpy(), last_values, settings)
    for ours, theirs in (
        (rollout.observations[0, 0], buffer.observations[:, 0]),
        (rollout.values[0, 0, :, 0], buffer.values[:, 0]),
        (rollout.rewards[0, 0, :, 0], buffer.rewards[:, 0]),
        (rollout.advantages[0, 0, :, 0], buffer.advantages[:, 0]),
        (rollout.returns[0, 0, :, 0], buffer.returns[:, 0]),
    ):
        np.testing.assert_allclose(ours.numpy(), theirs, rtol=1e-4, atol=1e-4)
