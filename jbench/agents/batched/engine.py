"""The engine of update rules: the agents of all seeds, and their complete state."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.learner import LOSS_SUMS, Learner
from jbench.agents.batched.normalize import running_statistics
from jbench.agents.batched.tensors import Tensors
from jbench.agents.divergence import divergent_loss
from jbench.agents.environments import Environments, Generators, SeedState, under
from jbench.agents.training_loop import TrainingLoop
from jbench.names import TimeLimit
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import AlgorithmSettings
from jbench.timing import part

_AGENT = "agent/"
_LOOP = "loop/"
_STATISTICS = "statistics/"


_Learner = TypeVar("_Learner", bound=Learner[Any])


class SeedGroup(NamedTuple, Generic[_Learner]):
    """Seeds whose updates are computed together: one seed, or all of them in a stack."""

    learner: _Learner
    seeds: range
    generators: Sequence[Generators]

    def stack(self, per_seed: Sequence[NDArray[Any]], offset: int = 0) -> Tensor:
        """Stacks draws (count, ...) of each seed to (count, seeds, ...), on the device.

        Those of one seed without a stack remain. Draws of seed i are increased by i times `offset`.
        """
        if not self.learner.view.is_stack:
            return torch.from_numpy(per_seed[0])
        if offset:
            per_seed = [draws + seed * offset for seed, draws in enumerate(per_seed)]
        return torch.from_numpy(np.stack(per_seed, axis=1)).to(self.learner.view.device)


class _Call(NamedTuple):
    """What is computed of the whole stack at once; a recording of it depends on nothing else."""

    output: Callable[..., Tensor]
    shapes: tuple[torch.Size, ...]  # of its inputs


class BatchedEngine(TrainingLoop, Generic[_Learner]):
    """Trains a learner per seed; those of a stack are also one learner on the same tensors."""

    updates: int

    def __init__(
        self,
        settings: AlgorithmSettings,
        make_learner: Callable[[Tensors], _Learner],
        tensors: Tensors,
        environments: Environments,
        *,
        time_limit: TimeLimit,
        stacked: bool,
    ) -> None:
        super().__init__(environments, settings.rollout_steps(environments.observations.shape[1]))
        self.tensors = tensors
        self.updates = 0
        self._saved = tensors.saved
        self._settings = settings
        self._time_limit = time_limit

        generators = environments.generators
        seeds = range(tensors.seeds)
        self.learners = [make_learner(tensors.select(seed)) for seed in seeds]
        self._stack = make_learner(tensors) if stacked else None
        self.groups = [
            SeedGroup(learner, seeds[seed : seed + 1], generators[seed : seed + 1])
            for seed, learner in enumerate(self.learners)
        ]
        if self._stack is not None:
            self.groups = [SeedGroup(self._stack, seeds, generators)]

        self._statistics = running_statistics(
            settings, tensors.seeds, environments.size, tensors.dtype, tensors.device
        )
        self._captured = Captured(tensors.device)
        self._inputs: dict[_Call, list[Tensor]] = {}
        self._outputs: dict[_Call, Tensor] = {}

        for learner, seed_generators in zip(self.learners, generators, strict=True):
            learner.initialize(seed_generators.weights())
        # Tensors that must stay finite; the log temperature of SAC is -inf if ent_coef is 0.
        self._finite = [
            name
            for name, values in self._saved.items()
            if name != LOSS_SUMS and bool(values.isfinite().all())
        ]

        self._make_buffers()

    def policy(self, seed: int) -> SavedNetwork:
        """Returns a copy of the deterministic policy of the seed with this index."""
        policy = self.learners[seed].policy()
        return policy if self._statistics is None else self._statistics.with_layers(seed, policy)

    def load_policy(self, seed: int, policy: SavedNetwork, control_steps: int) -> None:
        """Sets a seed's policy after these control steps, for `act`, bit for bit.

        Raises a ValueError if its layers are not those of the settings.
        """
        if policy.structure() != self.policy(seed).structure():
            raise ValueError("its layers are not those of its settings")
        if self._statistics is not None:
            policy = self._statistics.load_layers(seed, policy, control_steps)
        self.learners[seed].load_policy(policy)
        self.control_steps = control_steps

    def losses(self, seed: int) -> dict[str, float]:
        """See `Engine.losses`."""
        sums, counts = self._saved[LOSS_SUMS][seed].cpu().unbind(dim=-1)
        means = zip(self.learners[seed].losses, counts, (sums / counts).tolist(), strict=True)
        return {name: mean for name, count, mean in means if count}

    def check_weights(self) -> None:
        """See `Engine.check_weights`."""
        for name in self._finite:
            for seed in self._not_finite(name):
                self._record_divergence(seed, "weights")

    def state(self, seed: int) -> SeedState:
        """See `Engine.state`."""
        robots = self.environments.state(seed)
        tensors = {_AGENT + name: values[seed] for name, values in self._saved.items()}
        tensors |= robots.tensors
        tensors |= {_LOOP + name: values for name, values in self._loop_state(seed).items()}
        if self._statistics is not None:
            statistics = self._statistics.state(seed)
            tensors |= {_STATISTICS + name: values for name, values in statistics.items()}
        scalars = {
            "control_steps": self.control_steps,
            "updates": self.updates,
            "collected": self._collected,
            **robots.scalars,
        }
        copies = {name: values.detach().cpu().clone() for name, values in tensors.items()}
        return SeedState(copies, scalars)

    def restore(self, states: Sequence[SeedState]) -> None:
        """See `Engine.restore`; different numbers of control steps are a ValueError."""
        first = states[0].scalars
        if any(state.scalars["control_steps"] != first["control_steps"] for state in states):
            raise ValueError(
                "All seeds of an engine must have made the same number of control steps."
            )
        for seed, state in enumerate(states):
            agent = under(_AGENT, state.tensors)
            for name, values in self._saved.items():
                values[seed] = agent[name]
            self.environments.restore(seed, state)
            if self._statistics is not None:
                self._statistics.restore(seed, under(_STATISTICS, state.tensors))
            self._restore_loop(seed, under(_LOOP, state.tensors))
        self.control_steps = first["control_steps"]
        self.updates = first["updates"]
        self._collected = first["collected"]
        self._truncate_unlike()

    def _draw_normal(self, shape: tuple[int, ...]) -> Tensor:
        """Returns standard normal numbers (seeds, *shape), of each seed's own generator."""
        generators = [seed.actions for seed in self.environments.generators]
        drawn = [generator.standard_normal(shape) for generator in generators]
        return torch.from_numpy(np.stack(drawn))

    def _standardized(self, observations: Tensor) -> Tensor:
        """Returns what the networks see of observations (seeds, N, size)."""
        if self._statistics is None:
            return observations
        return self._statistics.standardization().apply(observations)

    def _run(self, output: Callable[..., Tensor], observations: Tensor, *others: Tensor) -> Tensor:
        """Returns an output of all learners, of its inputs (seeds, N, any), on the CPU.

        `output` is the same function at every call: it takes a learner and the inputs.
        """
        inputs = [self._standardized(observations), *others]
        dtype = self.tensors.dtype
        if self._stack is None:
            inputs_by_seed = zip(*(given.to(dtype) for given in inputs), strict=True)
            pairs = zip(self.learners, inputs_by_seed, strict=True)
            return torch.stack([output(learner, *own) for learner, own in pairs])

        call = _Call(output, tuple(given.shape for given in inputs))
        if call not in self._inputs:
            device = self.tensors.device
            self._inputs[call] = [
                torch.empty_like(given, dtype=dtype, device=device) for given in inputs
            ]
        for buffer, given in zip(self._inputs[call], inputs, strict=True):
            buffer.copy_(given)
        self._captured(self._run_stack, call)
        return self._outputs[call].cpu()

    def _run_stack(self, call: _Call) -> None:
        """Computes an output of the stack from its buffers of inputs."""
        self._outputs[call] = call.output(self._stack, *self._inputs[call])

    def _act(self, inputs: Tensor) -> NDArray[np.floating]:
        """See `TrainingLoop._act`."""
        actions: NDArray[np.float32] = self._run(act, inputs).float().numpy()
        return actions

    def _explore_actions(self, observations: Tensor) -> NDArray[np.floating]:
        """See `TrainingLoop._explore_actions`; the observations are counted for the statistics."""
        if self._statistics is not None:
            self._statistics.add(observations)
        return self._explore(observations)

    def _after_rollout(self) -> None:
        """Makes the updates, and notes which seeds have diverged."""
        if self._statistics is not None:
            self._statistics.send()
        self._update()
        with part("waiting for updates"):
            divergent = self._not_finite(LOSS_SUMS)
        for seed in divergent:
            self._record_divergence(seed, divergent_loss(self.losses(seed)) or "losses")

    def _not_finite(self, name: str) -> list[int]:
        """Returns the seeds of which a saved tensor has a number that is not finite."""
        values = self._saved[name]
        finite = values.isfinite().view(len(values), -1).all(dim=1)
        # Only one small copy from a GPU.
        return [seed for seed, is_finite in enumerate(finite.tolist()) if not is_finite]

    def _still_learning(self, group: SeedGroup[_Learner]) -> bool:
        """Returns whether a seed of a group has not diverged."""
        return not all(seed in self.diverged for seed in group.seeds)

    @abstractmethod
    def _make_buffers(self) -> None:
        """Makes what the updates need."""

    @abstractmethod
    def _explore(self, observations: Tensor) -> NDArray[np.floating]:
        """See `TrainingLoop._explore_actions`; the observations are not standardized."""

    @abstractmethod
    def _update(self) -> None:
        """Makes the updates that are due after a rollout."""

    @abstractmethod
    def _loop_state(self, seed: int) -> dict[str, Tensor]:
        """Returns the state of the loop for one seed."""

    @abstractmethod
    def _restore_loop(self, seed: int, tensors: dict[str, Tensor]) -> None:
        """Restores what `_loop_state` returned."""


def act(learner: Learner[Any], observations: Tensor) -> Tensor:
    """Returns deterministic actions, as an output of `BatchedEngine._run`."""
    return learner.act(observations)
