"""Training loop of DDPG, TD3 and SAC: act, store transitions, update from a replay buffer."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.engine import Engine, act
from jbench.agents.batched.environments import Environments, Step
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.noise import ActionNoise
from jbench.agents.batched.padding import with_padding, without_padding
from jbench.agents.batched.replay import ReplayBuffer
from jbench.agents.batched.team import Team
from jbench.agents.batched.updates import Updates
from jbench.encoders.mirror import input_mirror
from jbench.names import TimeLimit
from jbench.settings.algorithms import OffPolicySettings


class OffPolicyEngine(Engine):
    """Agents that learn from one replay buffer each."""

    def __init__(
        self,
        settings: OffPolicySettings,
        team: Team[Any],
        environments: Environments,
        *,
        time_limit: TimeLimit = "bootstrap",
    ) -> None:
        """Starts with untrained agents and empty replay buffers.

        Args:
            time_limit: "bootstrap" from an episode's last state, or treat it as "terminal".

        Raises:
            RequestError: if the number of environments does not divide the training interval, or
                `settings.mirror` is not for the encoder of a seed.
        """
        seeds, count = environments.observations.shape[:2]
        rollout_steps, self._due = settings.schedule(count)
        super().__init__(team, environments, rollout_steps)
        self._settings = settings
        shape = seeds, count, environments.action_size
        self._noise = ActionNoise(settings, shape)
        tensors = team.tensors
        self.replay = ReplayBuffer(
            seeds,
            count,
            settings.buffer_size,
            environments.size,
            environments.action_size,
            flush_every=rollout_steps,
            dtype=tensors.dtype,
            device=tensors.device,
            episode_steps=environments.episode_steps,
        )
        mirror = None
        if settings.mirror:
            mirror = _row_mirror(environments).to(tensors.device, tensors.dtype)
        self._groups = [
            Updates(settings, group, self.replay, time_limit, self._due, mirror=mirror)
            for group in team.groups
        ]
        self.replay.begin(environments.observations)

    def replay_rows(self, seed: int, first: int = 0) -> Tensor:
        """Returns a seed's replay rows (environments, rows, own width), without `replay.row`.

        Args:
            first: number of the first row; expired rows are left out.
        """
        rows = self.replay.rows_since(seed, first)
        return without_padding(rows, self.environments.padding(seed))

    def restore_rows(self, seed: int, rows: Tensor, row: int) -> None:
        """Restores the replay rows of a seed; `restore` of all seeds must follow.

        Args:
            rows: as from `replay_rows`, up to row number `row` - 1.
            row: the saved `replay.row`, the same for all seeds.
        """
        if rows.numel():
            rows = with_padding(rows, self.environments.padding(seed))
        self.replay.restore(seed, rows, row)

    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        settings, shape = self._settings, self._noise.previous.shape[1:]
        if settings.uniform_warmup and self.control_steps < settings.learning_starts:
            actions = np.stack([each.actions.uniform(-1, 1, shape) for each in self._generators])
        else:
            actions = self._policy_actions(observations).numpy()
        noisy_actions = actions + self._noise.draw(self._generators)
        return np.clip(noisy_actions, -1, 1).astype(np.float32)

    def _policy_actions(self, observations: Tensor) -> Tensor:
        """Returns actions (seeds, environments, action_size) of the policies, without noise."""
        if not self._team.each[0].is_stochastic:
            return self._team.run(act, observations)
        shape = self._noise.previous.shape[1:]
        noise = np.stack([each.actions.standard_normal(shape) for each in self._generators])
        return self._team.run(_explore, observations, torch.from_numpy(noise))

    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: Step) -> None:
        self.replay.add(actions, step.rewards, step.observations)
        if step.episode_returns is not None:
            self._noise.reset()
            self.replay.begin(self.environments.observations)

    def _learn(self) -> None:
        self.replay.flush()
        if self.control_steps <= self._settings.learning_starts:
            return
        first = self.updates + 1
        self.updates += self._due
        for updates in self._groups:
            if self._still_learning(updates.seeds):
                if first == 1:
                    updates.pretrain(self.control_steps)
                updates.prepare(first, self._due)
                updates.run()

    def _loop_state(self, seed: int) -> dict[str, Tensor]:
        return {"noise": torch.from_numpy(self._noise.previous[seed])}

    def _restore_loop(self, seed: int, tensors: dict[str, Tensor]) -> None:
        previous = self._noise.previous[seed]
        # Older versions saved the noise of an only action as (environments,).
        previous[:] = tensors["noise"].numpy().reshape(previous.shape)
        self.replay.begin(self.environments.observations)


def _explore(agent: OffPolicyLearner, observations: Tensor, noise: Tensor) -> Tensor:
    return agent.explore(observations, noise)


def _row_mirror(environments: Environments) -> Tensor:
    """Returns gain and offset (2, seeds, width) of mirrored rows of the replay buffers."""
    gain, offset = [], []
    for cell in environments.cells:
        inputs = input_mirror(cell.task, cell.encoder)
        padding = environments.size - cell.size
        actions = environments.action_size
        gain += [[*inputs.gain, *[1] * padding, *[-1] * actions, 1]] * len(cell.generators)
        offset += [[*inputs.offset, *[0] * (padding + actions), 0]] * len(cell.generators)
    return torch.tensor([gain, offset], dtype=torch.float64)
