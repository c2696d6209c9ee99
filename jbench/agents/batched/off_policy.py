"""Training loop of DDPG, TD3 and SAC: act, store transitions, update from a replay buffer."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.engine import BatchedEngine, act
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.pair_buffer import buffer_class
from jbench.agents.batched.replay import ReplayBuffer, Sizes
from jbench.agents.batched.updates import Updates
from jbench.agents.environments import Ends, Environments, Generators, StepResult
from jbench.encoders.wrapper import input_mirror
from jbench.settings.algorithms import OffPolicySettings


class OffPolicyEngine(BatchedEngine[OffPolicyLearner[Any]]):
    """Agents that learn from one replay buffer each; `replay` has those of all seeds."""

    _settings: OffPolicySettings
    replay: ReplayBuffer

    def _make_buffers(self) -> None:
        """Makes the replay buffers, and the updates of each group."""
        settings = self._settings
        environments = self.environments
        tensors = self.tensors
        seeds, count = environments.observations.shape[:2]
        rollout_steps, self._updates_per_rollout = settings.schedule(count)
        self._noise = ActionNoise(settings, (seeds, count, environments.action_size))

        sizes = Sizes(
            seeds, count, settings.buffer_size, environments.size, environments.action_size
        )
        self.replay = buffer_class(ends_early=not environments.has_one_length)(
            sizes,
            flush_every=rollout_steps,
            episode_steps=environments.episode_steps,
            ends_are_terminal=self._time_limit == "terminal",
            dtype=tensors.dtype,
            device=tensors.device,
        )

        mirror = None
        if settings.mirror:
            mirror = _row_mirror(environments).to(tensors.device, tensors.dtype)
        self.group_updates = [
            Updates(
                settings,
                group,
                self.replay,
                mirror=mirror,
                statistics=self._statistics,
            )
            for group in self.groups
        ]
        self.replay.begin(environments.observations)

    def repeat(
        self, episodes: int, before: Sequence[Tensor], row: int, actions: NDArray[np.float32]
    ) -> None:
        """Fills the replay buffers of a new engine with what actions of earlier training made.

        Args:
            episodes: number of episodes of each environment that are left out.
            before: of each seed, rows (environments, rows, width) before number `row`.
            row: number of the first row of the next episode.
            actions: (steps, seeds, environments, action_size) of the agents, from there on.
        """
        environments = self.environments
        environments.skip(episodes)
        for seed, rows in enumerate(before):
            self.replay.restore(seed, rows, row)
        self.replay.begin(environments.observations)
        for step, made in enumerate(actions, start=1):
            observations = environments.observations
            self._store(observations, made, environments.step(made))
            if step % self._rollout_steps == 0:
                self.replay.flush()

    def _explore(self, observations: Tensor) -> NDArray[np.floating]:
        """See `BatchedEngine._explore`."""
        settings = self._settings
        shape = self._noise.previous.shape[1:]
        generators = self.environments.generators
        if settings.uniform_warmup and self.control_steps < settings.learning_starts:
            actions = np.stack([seed.actions.uniform(-1, 1, shape) for seed in generators])
        elif self.learners[0].is_stochastic:
            actions = self._run(explore, observations, self._draw_normal(shape)).numpy()
        else:
            actions = self._run(act, observations).numpy()
        noisy_actions = actions + self._noise.draw(generators)
        return np.clip(noisy_actions, -1, 1).astype(np.float32)

    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: StepResult) -> None:
        """Adds the transitions to the replay buffers."""
        self.replay.add(actions, step.rewards, step.observations)
        if step.ends is not None:
            nothing_follows = step.ends.terminated
            if self._time_limit == "terminal":
                nothing_follows = step.ends.ended
            self.replay.end(nothing_follows)
            self._begin_episodes(step.ends)

    def _begin_episodes(self, ends: Ends) -> None:
        """Starts noise and rows of the episodes that follow others."""
        self._noise.reset(ends.ended)
        self.replay.begin(self.environments.observations)

    def _truncate(self, step: StepResult) -> None:
        """See `TrainingLoop._truncate`."""
        # The value of the last observation stands for the missing rewards anyway.
        assert step.ends is not None
        self._begin_episodes(step.ends)

    def _update(self) -> None:
        """See `BatchedEngine._update`."""
        self.replay.flush()
        if self.control_steps <= self._settings.learning_starts:
            return
        if self.updates == 0:
            self.pretrain(round(self.learners[0].pretraining * self.control_steps))

        first = self.updates + 1
        self.updates += self._updates_per_rollout
        for updates in self.group_updates:
            if self._still_learning(updates.group):
                updates.prepare(first, self._updates_per_rollout)
                updates.run()

    def pretrain(self, updates: int) -> None:
        """Makes updates of the features of all seeds alone, before the first of the agents."""
        for group_updates in self.group_updates:
            if self._still_learning(group_updates.group):
                group_updates.pretrain(updates)

    def _loop_state(self, seed: int) -> dict[str, Tensor]:
        """See `BatchedEngine._loop_state`."""
        return {"noise": torch.from_numpy(self._noise.previous[seed])}

    def _restore_loop(self, seed: int, tensors: dict[str, Tensor]) -> None:
        """See `BatchedEngine._restore_loop`."""
        previous = self._noise.previous[seed]
        # Older versions saved the noise of an only action as (environments,).
        previous[:] = tensors["noise"].numpy().reshape(previous.shape)
        self.replay.begin(self.environments.observations)


def explore(learner: OffPolicyLearner[Any], observations: Tensor, noise: Tensor) -> Tensor:
    """Returns actions of a stochastic policy, as an output of `BatchedEngine._run`."""
    return learner.explore(observations, noise)


class ActionNoise:
    """Normal or Ornstein-Uhlenbeck noise, whose state is `previous`, for each robot."""

    def __init__(self, settings: OffPolicySettings, shape: tuple[int, int, int]) -> None:
        """Starts the processes at 0; the shape is (seeds, environments, action_size)."""
        self._kind = settings.action_noise
        self._mean = settings.noise_mean
        self._sigma = settings.noise_sigma
        self._pull = settings.noise_theta * settings.noise_dt
        self._step = settings.noise_sigma * math.sqrt(settings.noise_dt)
        self.previous = np.zeros(shape)

    def reset(self, begun: NDArray[np.bool_]) -> None:
        """Restarts the processes where an episode begins, (seeds, environments)."""
        self.previous[begun] = 0

    def draw(self, generators: Sequence[Generators]) -> NDArray[np.float64] | float:
        """Returns the next noise (seeds, environments, action_size); 0 if there is none."""
        if self._kind == "none":
            return 0.0
        shape = self.previous.shape[1:]
        normal = np.stack([seed.actions.standard_normal(shape) for seed in generators])
        if self._kind == "normal":
            return self._mean + self._sigma * normal
        self.previous += self._pull * (self._mean - self.previous) + self._step * normal
        return self.previous


def _row_mirror(environments: Environments) -> Tensor:
    """Returns gain and offset (2, seeds, width) of mirrored rows of the replay buffers."""
    width = environments.size + environments.action_size + 1
    gain = torch.ones(len(environments.encoders), width, dtype=torch.float64)
    offset = torch.zeros_like(gain)
    gain[:, environments.size : -1] = -1  # of actions; a reward has no mirror image
    for seed, encoder in enumerate(environments.encoders):
        mirror = input_mirror(environments.task, encoder)
        gain[seed, : environments.size] = torch.from_numpy(mirror.gain)
        offset[seed, : environments.size] = torch.from_numpy(mirror.offset)
    return torch.stack([gain, offset])
