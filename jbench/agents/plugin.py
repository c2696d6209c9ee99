"""Base class of the agents of other packages; `docs/your-own-agent.md` has an example.

A package registers an agent by an entry point of the group `jbench.agents`, named as in
`jbench train --algo`, and whose value is its class.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from jbench.settings.base import Settings


class AgentSettings(Settings):
    """Base class of an agent's settings: the names and defaults of `--set`.

    All of them are recorded, and are part of a run's id.
    """


class EnvironmentSpec(NamedTuple):
    """What an agent needs to know of its environments.

    Attributes:
        observation_size: size of an (encoded) observation.
        action_size: numbers in an action, each in [-1, 1]; 1 for the Jitterbug.
        environments: number of parallel environments; those of tasks whose episodes may end early
            begin each its next episode when its own has ended.
        episode_steps: control steps in an episode, or in the longest one.
    """

    observation_size: int
    action_size: int
    environments: int
    episode_steps: int


class Transition(NamedTuple):
    """A control step of all environments.

    Attributes:
        observations: (environments, observation_size), float32.
        actions: (environments, action_size) that `explore` returned, as float64 on the CPU.
        rewards: (environments,), float32; in [0, 1] but for environments of Gymnasium.
        next_observations: (environments, observation_size) after the step, also at the end of an
            episode, float32.
        terminated: (environments,) whether the value of the next observation is 0: where the
            environment says so, and with `--time-limit terminal` at the end of any episode.
        truncated: (environments,) whether the episode ends, but its last value is bootstrapped.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.float64]
    rewards: NDArray[np.float32]
    next_observations: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


class Agent(ABC):
    """An agent that jbench trains, with the class of its settings.

    torch's, numpy's and Python's global random generators are seeded before it is made, and are
    part of a checkpoint; what `act` and `policy` draw from them is drawn again in training.
    """

    Settings: ClassVar[type[AgentSettings]] = AgentSettings

    @abstractmethod
    def __init__(
        self, settings: Any, environment: EnvironmentSpec, seed: int, device: torch.device
    ) -> None:
        """Makes an untrained agent.

        Args:
            settings: an object of `Settings`.
            environment: sizes.
            seed: of its own random generators, in [0, 2^32).
            device: for its networks.
        """

    @abstractmethod
    def explore(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns actions (environments, action_size) for the next control step."""

    @abstractmethod
    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns deterministic actions (n, action_size) for observations (n, size), any n."""

    @abstractmethod
    def learn(self, transition: Transition) -> Mapping[str, float]:
        """Called after each control step; learns whenever it is time.

        Returns:
            The new losses, by columns of the table `episodes` such as critic_loss and actor_loss;
            empty if there are none.
        """

    def truncate(self, truncated: NDArray[np.bool_]) -> None:  # noqa: B027 - optional
        """Called after `restore` if some episodes could not be repeated, and were truncated there.

        What `learn` was called with last was then the end of these episodes, and their last value
        is bootstrapped; the next transition is the first one of others. An agent overrides this if
        it keeps something from one transition of an episode to the next, such as the return so far.

        Args:
            truncated: (environments,) whose episodes these are.
        """

    def policy(self) -> nn.Module | None:
        """Returns the deterministic policy as a module from observations (n, size) to actions.

        It is saved with the run. It applies layers such as Linear and Tanh one after another; see
        `jbench.policies.copied_modules`. None: the run is saved without its policy.
        """
        return None

    def state(self) -> Mapping[str, Any]:
        """Returns everything that changes in training, from which `restore` continues.

        An agent with `state` and `restore` is resumed bit for bit; another one starts over.

        Returns:
            Dictionaries, lists and tuples of tensors, arrays, numbers, texts, booleans and None,
            such as the `state_dict` of a module or an optimizer. A named tuple is restored as a
            tuple.
        """
        raise NotImplementedError

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores what `state` returned."""
        raise NotImplementedError


def is_resumable(kind: type[Agent]) -> bool:
    """Returns whether a class of agents has `state` and `restore`."""
    return kind.state is not Agent.state and kind.restore is not Agent.restore
