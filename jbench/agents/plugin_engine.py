"""The engine of an agent of another package, for one seed."""

import contextlib
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from jbench.agents.divergence import divergent_loss
from jbench.agents.environments import Environments, SeedState, StepResult
from jbench.agents.packing import pack, unpack
from jbench.agents.plugin import Agent, EnvironmentSpec, Transition, is_resumable
from jbench.agents.training_loop import CPU, TrainingLoop
from jbench.errors import ERRORS_OF_OTHERS, RequestError, WorkError, sentence_of_failure
from jbench.names import TimeLimit
from jbench.policies.answers import read_actions
from jbench.policies.copied_modules import copy_module
from jbench.policies.network import SavedNetwork
from jbench.settings.base import Settings
from jbench.store import schema


class PluginEngine(TrainingLoop):
    """Trains one agent of another package, which itself decides when it learns."""

    replay = None

    def __init__(
        self,
        name: str,
        kind: type[Agent],
        settings: Settings,
        environments: Environments,
        *,
        time_limit: TimeLimit = "bootstrap",
        device: torch.device = CPU,
    ) -> None:
        """Makes an untrained agent for environments of one seed.

        Raises:
            UnsupportedPolicyError: if its policy can't be saved.
            WorkError: if its own code raises an error, or returns actions of a wrong shape, or
                losses that are no dictionary of numbers or have no column, here and below.
        """
        self._name = name
        self._time_limit = time_limit
        super().__init__(environments)
        self._device = device
        self._is_resumable = is_resumable(kind)
        self._losses: dict[str, float] = {}
        size = environments.size
        action_size = environments.action_size
        count = environments.observations.shape[1]
        seed = environments.generators[0].seed
        spec = EnvironmentSpec(size, action_size, count, environments.episode_steps)
        torch.manual_seed(seed)
        np.random.seed(seed)  # noqa: NPY002 - agents of others may use it
        random.seed(seed)
        self._agent: Agent = self._call(kind, settings, spec, seed, device)
        # A policy that can't be saved is refused now, not after the training.
        self.policy(0)

    def policy(self, seed: int) -> SavedNetwork | None:
        """See `Engine.policy`; None if the agent does not offer it."""
        module = self._module()
        sizes = self.environments.size, self.environments.action_size
        return None if module is None else copy_module(module, *sizes)

    def losses(self, seed: int) -> dict[str, float]:
        """See `Engine.losses`."""
        return dict(self._losses)

    def check_weights(self) -> None:
        """Records a divergence if a parameter of the policy is not finite."""
        module = self._module()
        parameters = module.parameters() if isinstance(module, nn.Module) else ()
        if not all(bool(parameter.isfinite().all()) for parameter in parameters):
            self._record_divergence(0, "weights")

    def state(self, seed: int) -> SeedState | None:
        """See `Engine.state`; the agent's may contain something that can't be saved: WorkError."""
        if not self._is_resumable:
            return None

        tensors: dict[str, Tensor] = {}
        robots = self.environments.state(0)
        scalars = {
            "control_steps": self.control_steps,
            **robots.scalars,
            "losses": pack(self._losses, tensors),
            "generators": pack(_generators(self._device), tensors),
            "agent": pack(self._call(self._agent.state), tensors),
        }
        return SeedState(tensors | robots.tensors, scalars)

    def restore(self, states: Sequence[SeedState]) -> None:
        """See `Engine.restore`."""
        (state,) = states
        tensors = state.tensors
        scalars = state.scalars
        self.environments.restore(0, state)
        self.control_steps = scalars["control_steps"]
        self._losses = unpack(scalars["losses"], tensors)
        self._call(self._agent.restore, unpack(scalars["agent"], tensors))
        _restore_generators(unpack(scalars["generators"], tensors), self._device)
        self._truncate_unlike()

    def _act(self, inputs: Tensor) -> NDArray[np.floating]:
        """See `TrainingLoop._act`; the agent's generators are as they were afterwards."""
        with torch.no_grad(), _kept_generators(self._device):
            return self._checked_actions(self._actions(self._agent.act, inputs[0].numpy()))

    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        """Returns the agent's actions with exploration (1, environments, action_size)."""
        return self._actions(self._agent.explore, observations[0].numpy().copy())

    def _store(self, observations: Tensor, actions: NDArray[np.floating], step: StepResult) -> None:
        """Hands the transition to the agent, and lets it learn."""
        if self.diverged:
            return

        ended = np.zeros(actions.shape[1], bool)
        terminated = ended
        if step.ends is not None:
            ended = step.ends.ended[0]
            terminated = step.ends.terminated[0]
            if self._time_limit == "terminal":
                terminated = ended

        # Copies: an agent may change its arrays, and these are also saved in checkpoints.
        transition = Transition(
            observations[0].numpy().copy(),
            actions[0],
            step.rewards[0].astype(np.float32),
            step.observations[0].numpy().copy(),
            terminated.copy(),
            ended & ~terminated,
        )
        numbers = self._numbers(self._call(self._agent.learn, transition))
        self._losses |= numbers
        divergent = divergent_loss(numbers)
        if divergent is not None:
            self._record_divergence(0, divergent)

    def _numbers(self, losses: Any) -> dict[str, float]:
        """Returns the losses that `learn` returned by column, or a WorkError."""
        said = f"learn of the agent {self._name} returned"
        if not isinstance(losses, Mapping):
            raise WorkError(
                f"{said} a {type(losses).__name__}; it must return a dictionary of losses, {{}} if "
                "there are none."
            )

        unknown = sorted(map(str, losses.keys() - schema.LOSSES))
        if unknown:
            raise WorkError(
                f"{said} the loss {', '.join(unknown)}; there are columns for "
                f"{', '.join(schema.LOSSES)}."
            )

        numbers = dict[str, float]()
        for name, value in losses.items():
            try:
                numbers[name] = float(value)
            except ERRORS_OF_OTHERS:
                kind = type(value).__name__
                raise WorkError(f"{said} a {kind} as {name}; a loss must be one number.") from None
        return numbers

    def _truncate(self, step: StepResult) -> None:
        """Tells the agent, which has learned from the last transitions already."""
        assert step.ends is not None
        self._call(self._agent.truncate, step.ends.ended[0].copy())

    def _module(self) -> nn.Module | None:
        """Returns the agent's policy; a new module draws its initial weights."""
        with _kept_generators(self._device):
            module: nn.Module | None = self._call(self._agent.policy)
            return module

    def _call(self, method: Callable[..., Any], *arguments: object) -> Any:
        """Calls a method of the agent; its errors are WorkErrors that name the method."""
        try:
            return method(*arguments)
        except (RequestError, WorkError):
            raise
        except ERRORS_OF_OTHERS as error:
            reason = sentence_of_failure(error)
            raise WorkError(
                f"{_name(method)} of the agent {self._name} failed ({reason})."
            ) from error

    def _actions(
        self, method: Callable[..., Any], observations: NDArray[np.float32]
    ) -> NDArray[np.float64]:
        """Returns actions (1, n, action_size) of the agent, of which the shape is checked."""
        wanted = (len(observations), self.environments.action_size)
        answer = self._call(method, observations)
        if isinstance(answer, Tensor):
            answer = answer.detach().to("cpu", torch.float64).numpy()

        try:
            return read_actions(answer, wanted)[None]
        except ValueError as returned:
            raise WorkError(
                f"{_name(method)} of the agent {self._name} returned {returned} for observations "
                f"{observations.shape}; it must return actions {wanted}."
            ) from None


def _name(method: Callable[..., Any]) -> str:
    """Returns the name of a method in errors."""
    return getattr(method, "__name__", type(method).__name__)


@contextlib.contextmanager
def _kept_generators(device: torch.device) -> Iterator[None]:
    """Keeps the global generators: a checkpoint or an evaluation must not change the training."""
    states = _generators(device)
    yield
    _restore_generators(states, device)


def _generators(device: torch.device) -> dict[str, Any]:
    """Returns the states of all global generators of random numbers."""
    legacy = np.random.get_state(legacy=False)  # noqa: NPY002
    states = {"torch": torch.get_rng_state(), "numpy": legacy, "python": random.getstate()}
    if device.type == "cuda":
        states["cuda"] = torch.cuda.get_rng_state(device)
    return states


def _restore_generators(states: Mapping[str, Any], device: torch.device) -> None:
    """Sets the states that `_generators` returned."""
    torch.set_rng_state(states["torch"])
    if device.type == "cuda" and "cuda" in states:  # the run may have been on a CPU
        torch.cuda.set_rng_state(states["cuda"], device)
    np.random.set_state(states["numpy"])  # noqa: NPY002
    random.setstate(states["python"])
