"""The training loop of an agent of another package, for one seed, and its complete state."""

import contextlib
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from jbench.agents.batched.engine import WORLD, Engine, SeedState, under
from jbench.agents.batched.environments import Augment, Cell, Environments
from jbench.agents.batched.generators import Generators
from jbench.agents.divergence import Divergence, divergent_loss
from jbench.agents.packing import pack, unpack
from jbench.agents.plugin import Agent, EnvironmentSpec, Transition, is_resumable
from jbench.closing import Closing
from jbench.encoders import Encoder
from jbench.errors import RequestError, WorkError, sentence_of_failure
from jbench.names import EPISODE_STEPS, TimeLimit
from jbench.policies.copied import copy_module
from jbench.policies.network import SavedNetwork
from jbench.settings.base import Settings
from jbench.store import schema


class PluginEngine(Closing):
    """Trains one agent of another package, with the interface of the batched `Engine`.

    Attributes:
        control_steps: over all environments.
        diverged: what diverged, at index 0.
        is_resumable: whether the agent has `state` and `restore`.
        keeps_policy_exactly: see `Engine`; the copy of an agent's policy may round differently.
    """

    updates: int | None = None
    keeps_policy_exactly = False

    def __init__(
        self,
        name: str,
        kind: type[Agent],
        settings: Settings,
        task: str,
        seed: int,
        *,
        environments: int = 1,
        time_limit: TimeLimit = "bootstrap",
        encoder: Encoder | None = None,
        augment: Augment = lambda episode: None,
        device: torch.device | None = None,
        episode_steps: int = EPISODE_STEPS,
    ) -> None:
        """Makes an untrained agent and its robots.

        Args:
            name: of the agent, in errors.
            settings: an object of the agent's class of settings.
            augment: the robot of each episode.
            episode_steps: control steps in an episode; tests use short episodes.

        Raises:
            UnsupportedPolicyError: if its policy can't be saved.
            WorkError: if its own code raises an error, here and below.
        """
        self._name, self._time_limit = name, time_limit
        self._generators = Generators(seed, environments)
        self.environments = Environments(
            [Cell(task, [self._generators.environments], encoder)],
            augment=augment,
            episode_steps=episode_steps,
        )
        self.control_steps = 0
        self.diverged: dict[int, Divergence] = {}
        self.is_resumable = is_resumable(kind)
        self._losses: dict[str, float] = {}
        sizes = self.environments.size, self.environments.action_size
        spec = EnvironmentSpec(*sizes, environments, episode_steps)
        torch.manual_seed(seed)
        np.random.seed(seed)  # noqa: NPY002 - agents of others may use it
        random.seed(seed)
        self._device = device or torch.device("cpu")
        self._agent: Agent = self._call(kind, settings, spec, seed, self._device)
        # A policy that can't be saved is refused now, not after the training.
        self.policy(0)

    def close(self) -> None:
        """Ends the threads of the robots."""
        self.environments.close()

    def has_made(self, steps: int) -> bool:
        """Returns whether `learn` makes no more control steps."""
        return self.control_steps >= steps

    def learn(self, steps: int) -> Iterator[NDArray[np.float64] | None]:
        """Trains until `steps` control steps are made; see `Engine.learn`.

        Raises:
            WorkError: if the agent returns actions of a wrong shape, or losses that are no
                dictionary or have no column.
        """
        while self.control_steps < steps and not self.diverged:
            # Copies: an agent may change its arrays, and these are also saved in checkpoints.
            observations = self.environments.observations[0].numpy().copy()
            actions = self._actions(self._agent.explore, observations)
            if self.diverged:
                yield None
                return
            step = self.environments.step(actions[None])
            self.control_steps += len(actions)
            ends = step.episode_returns is not None
            terminated = np.full(len(actions), ends and self._time_limit == "terminal")
            truncated = np.full(len(actions), ends and self._time_limit == "bootstrap")
            next_observations = step.observations[0].numpy().copy()
            rewards = step.rewards[0].astype(np.float32)
            transition = Transition(
                observations, actions, rewards, next_observations, terminated, truncated
            )
            self._note_losses(self._call(self._agent.learn, transition))
            yield step.episode_returns

    def begin_updates(self) -> bool:
        """Returns False: the agent itself decides when it learns; see `Engine.begin_updates`."""
        return False

    def act(self, observations: NDArray[np.float32], first: int = 0) -> NDArray[np.floating]:
        """Returns deterministic actions (1, N, dim(A)) for observations (1, N, dim(O))."""
        seen = torch.from_numpy(observations)
        inputs = self.environments.encode(seen)[0].numpy()
        with torch.no_grad(), _kept_generators(self._device):
            actions = self._actions(self._agent.act, inputs)[None]
        return actions * self.environments.action_signs(seen)

    def policy(self, seed: int) -> SavedNetwork | None:
        """Returns a copy of the policy, or None if the agent does not offer it.

        Raises:
            UnsupportedPolicyError: if it is not a sequence of supported layers.
        """
        module = self._module()
        sizes = self.environments.size, self.environments.action_size
        return None if module is None else copy_module(module, *sizes)

    def losses(self, seed: int) -> dict[str, float]:
        """Returns the last losses by database name; empty before the first."""
        return dict(self._losses)

    def check_weights(self) -> None:
        """Records a divergence if a parameter of the policy is not finite."""
        module = self._module()
        parameters = module.parameters() if isinstance(module, nn.Module) else ()
        if not all(bool(parameter.isfinite().all()) for parameter in parameters):
            self._record_divergence("weights")

    def state(self, seed: int) -> SeedState:
        """Returns the state of the agent, of its robots, and of all random generators.

        Raises:
            WorkError: if the agent's state contains something that can't be saved.
        """
        tensors: dict[str, torch.Tensor] = {}
        scalars = {
            "control_steps": self.control_steps,
            "episodes": self.environments.episodes,
            "episode_steps": self.environments.steps,
            "streams": self._generators.state(),
            "losses": pack(self._losses, tensors),
            "generators": pack(_generators(self._device), tensors),
            "agent": pack(self._call(self._agent.state), tensors),
        }
        world = self.environments.state(0)
        tensors |= {WORLD + name: torch.from_numpy(value) for name, value in world.items()}
        return SeedState(tensors, scalars)

    def restore(self, states: Sequence[SeedState]) -> None:
        """Restores what `state` returned, so that training continues with the same numbers."""
        ((tensors, scalars),) = states
        world = {name: tensor.numpy() for name, tensor in under(WORLD, tensors).items()}
        self.environments.restore(0, world, scalars["episodes"], scalars["episode_steps"])
        self._generators.restore(scalars["streams"])
        self.control_steps = scalars["control_steps"]
        self._losses = unpack(scalars["losses"], tensors)
        self._call(self._agent.restore, unpack(scalars["agent"], tensors))
        _restore_generators(unpack(scalars["generators"], tensors), self._device)

    def _module(self) -> nn.Module | None:
        """Returns the agent's policy; a new module draws its initial weights."""
        with _kept_generators(self._device):
            module: nn.Module | None = self._call(self._agent.policy)
            return module

    def _call(self, method: Callable[..., Any], *arguments: object) -> Any:
        """Returns what the agent's own code returns; its errors are a WorkError with a cause."""
        try:
            return method(*arguments)
        except (RequestError, WorkError):
            raise
        except Exception as error:
            reason = sentence_of_failure(error)
            raise WorkError(
                f"{_name_of(method)} of the agent {self._name} failed ({reason})."
            ) from error

    def _actions(
        self, method: Callable[..., Any], observations: NDArray[np.float32]
    ) -> NDArray[np.float64]:
        """Returns actions (n, dim(A)); records a divergence and returns 0 if one is not finite."""
        wanted = (len(observations), self.environments.action_size)
        actions = self._call(method, observations)
        if isinstance(actions, torch.Tensor):
            actions = actions.detach().cpu().numpy()
        if np.shape(actions) != wanted:
            raise WorkError(
                f"{_name_of(method)} of the agent {self._name} returned the shape "
                f"{np.shape(actions)} for observations {observations.shape}; it must return "
                f"actions {wanted}."
            )
        checked: NDArray[np.float64] = np.asarray(actions, np.float64)
        if np.isfinite(checked).all():
            return checked
        self._record_divergence("actions")
        return np.zeros(wanted)

    def _note_losses(self, losses: Mapping[str, float]) -> None:
        if not isinstance(losses, Mapping):
            raise WorkError(
                f"learn of the agent {self._name} returned a {type(losses).__name__}; it must "
                "return a dictionary of losses, {} if there are none."
            )
        numbers = {name: float(value) for name, value in losses.items()}
        if unknown := sorted(numbers.keys() - schema.LOSSES):
            raise WorkError(
                f"learn of the agent {self._name} returned the loss {', '.join(unknown)}; there "
                f"are columns for {', '.join(schema.LOSSES)}."
            )
        self._losses |= numbers
        if (name := divergent_loss(numbers)) is not None:
            self._record_divergence(name)

    def _record_divergence(self, what: str) -> None:
        self.diverged.setdefault(0, Divergence(None, self.control_steps, what))


def _name_of(method: Callable[..., Any]) -> str:
    return getattr(method, "__name__", type(method).__name__)


Trainer = Engine | PluginEngine
"""What trains the agents of a batch of runs."""


@contextlib.contextmanager
def _kept_generators(device: torch.device) -> Iterator[None]:
    """Leaves the global random generators as they were before the block.

    A checkpoint, whose time is arbitrary, and an evaluation must not change the training.
    """
    states = _generators(device)
    yield
    _restore_generators(states, device)


def _generators(device: torch.device) -> dict[str, Any]:
    """Returns the states of the global random generators, with that of an agent's GPU."""
    legacy = np.random.get_state(legacy=False)  # noqa: NPY002
    states = {"torch": torch.get_rng_state(), "numpy": legacy, "python": random.getstate()}
    if device.type == "cuda":
        states["cuda"] = torch.cuda.get_rng_state(device)
    return states


def _restore_generators(states: Mapping[str, Any], device: torch.device) -> None:
    torch.set_rng_state(states["torch"])
    if device.type == "cuda" and "cuda" in states:  # the run may have been on a CPU
        torch.cuda.set_rng_state(states["cuda"], device)
    np.random.set_state(states["numpy"])  # noqa: NPY002
    random.setstate(states["python"])
