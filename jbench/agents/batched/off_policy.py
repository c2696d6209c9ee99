"""The loop of DDPG, TD3 and SAC: act, remember, and learn from memory now and then."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.engine import Engine
from jbench.agents.batched.environments import Environments, Step
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.noise import ActionNoise
from jbench.agents.batched.replay import ReplayBuffer
from jbench.agents.batched.streams import Streams
from jbench.agents.batched.team import Team
from jbench.agents.batched.updates import Updates
from jbench.errors import RequestError
from jbench.names import TimeLimit
from jbench.settings.algorithms import OffPolicySettings


class OffPolicyEngine(Engine):
    """Agents that learn from a replay buffer each.

    Attributes:
        replay: their transitions.
    """

    def __init__(
        self,
        settings: OffPolicySettings,
        team: Team[Any],
        environments: Environments,
        streams: Sequence[Streams],
        *,
        time_limit: TimeLimit = "bootstrap",
    ) -> None:
        """Begins with agents that know nothing, and no transitions.

        Args:
            settings: of the algorithm.
            team: the agents.
            environments: what they learn in.
            streams: of every seed.
            time_limit: whether the value of an episode's last state counts.

        Raises:
            RequestError: if the updates can't be shared out among so many environments.
        """
        seeds, count = environments.observations.shape[:2]
        rollout_steps, self._due = schedule(settings, count)
        super().__init__(team, environments, streams, rollout_steps)
        self._settings = settings
        self._noise = ActionNoise(settings, seeds, count)
        tensors = team.tensors
        self.replay = ReplayBuffer(
            seeds,
            count,
            settings.buffer_size,
            environments.size,
            flush_every=rollout_steps,
            dtype=tensors.dtype,
            device=tensors.device,
            episode_steps=environments.episode_steps,
        )
        self._groups = [
            Updates(settings, group, group.of(streams), self.replay, time_limit)
            for group in team.groups
        ]
        self.replay.begin(environments.observations)

    def replay_rows(self, seed: int, first: int = 0) -> Tensor:
        """Returns a seed's replay rows (environments, rows, size + 2), `replay.row` excluded.

        Args:
            seed: its place.
            first: number of the first row; older ones than count are left out.
        """
        return self.replay.rows_since(seed, first)

    def restore_rows(self, seed: int, rows: Tensor, row: int) -> None:
        """Puts back the replay rows of a seed; `restore` of all must follow.

        Args:
            seed: its place.
            rows: (environments, rows, size + 2), the last of them before `row`.
            row: what `replay.row` was, the same for all seeds.
        """
        self.replay.restore(seed, rows, row)

    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        settings, shape = self._settings, observations.shape[:2]
        if settings.uniform_warmup and self.control_steps < settings.learning_starts:
            chosen = np.stack([each.actions.uniform(-1, 1, shape[1]) for each in self._streams])
        else:
            noise = self._policy_noise(shape)
            chosen = self._team.run(_explore, observations, noise)[..., 0].numpy()
        noisy = chosen + self._noise.draw(self._streams)
        return np.clip(noisy, -1, 1).astype(np.float32)

    def _policy_noise(self, shape: Sequence[int]) -> Tensor:
        """Returns standard normal numbers (seeds, environments, 1), zeros where none are needed."""
        if not self._team.each[0].random_policy:
            return torch.zeros(*shape, 1)
        draws = [each.actions.standard_normal((shape[1], 1)) for each in self._streams]
        return torch.from_numpy(np.stack(draws))

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
        self._noise.previous[seed] = tensors["noise"].numpy()
        self.replay.begin(self.environments.observations)


def schedule(settings: OffPolicySettings, environments: int) -> tuple[int, int]:
    """Returns steps of each environment from one learning to the next, and updates then.

    More environments take fewer steps each; the ratio of updates to control steps is that of the
    settings.
    """
    steps = max(1, settings.train_freq // environments)
    updates, rest = divmod(settings.gradient_steps * steps * environments, settings.train_freq)
    if rest:
        raise RequestError(
            f"{environments} environments can't share {settings.gradient_steps} updates every "
            f"{settings.train_freq} control steps: type a number of environments that divides "
            f"{settings.train_freq}."
        )
    return steps, updates


def _explore(agent: OffPolicyLearner, observations: Tensor, noise: Tensor) -> Tensor:
    return agent.explore(observations, noise)
