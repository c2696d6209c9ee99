"""Trains the update rules of other packages, which autograd differentiates.

A seed has a copy of the rule whose parameters are views of the tensors of the engine. In a stack, a
loss is a function of parameters and batch (`torch.func.functional_call`) that is differentiated and
mapped over the seeds (`grad_and_value`, `vmap`). A seed alone does without these: they take longer
than the products of small matrices.
"""

import copy
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Generator, Tensor
from torch.func import functional_call, grad_and_value, vmap

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.batch import Batch
from jbench.agents.batched.learner import OTHER_LAYERS, OffPolicyLearner
from jbench.agents.batched.rule import Rule, make_rule, mean_actor, parameter_names
from jbench.agents.batched.tensors import SeedView, flat_parts, flat_size
from jbench.policies.copied import copy_module
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import OffPolicySettings
from jbench.store.schema import LOSSES


class AutogradLearner(OffPolicyLearner):
    """An update rule of another package, for one seed or for a stack."""

    def __init__(
        self,
        settings: OffPolicySettings,
        observation_size: int,
        action_size: int,
        view: SeedView,
        *,
        rule: Rule,
    ) -> None:
        """See `Learner`; the parameters of the given rule are not used."""
        self.losses = tuple(name for name in rule.losses if name in LOSSES)
        self.noise_per_transition = rule.noise_per_transition
        self.is_stochastic = type(rule).explore is not Rule.explore
        super().__init__(settings, observation_size, action_size, view)
        self._settings = settings
        trained = set(rule.losses.values())
        self._groups = {
            name: _Group(view, name, {each: rule.get_parameter(each).shape for each in parameters})
            for name, parameters in parameter_names(rule).items()
        }
        self._parameters = {
            name: values for group in self._groups.values() for name, values in group.values.items()
        }
        self._rule = copy.deepcopy(rule).to(view.device, self._loss_sums.dtype)
        self._rule.requires_grad_(False)
        if not view.is_stack:
            for name, values in self._parameters.items():
                self._rule.get_parameter(name).data = values
        self._adams = {
            name: Adam(view, group.name, group.flat, group.flat_gradient, settings.learning_rate)
            for name, group in self._groups.items()
            if name in trained
        }

    def initialize(self, generator: Generator) -> None:
        """Draws the initial parameters of one seed."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(generator.initial_seed())
            sizes = self._rule.observation_size, self.action_size
            drawn = make_rule(type(self._rule), self._settings, *sizes)
        for name, values in self._parameters.items():
            values.copy_(drawn.get_parameter(name).detach())

    def act(self, observations: Tensor) -> Tensor:
        """See `Learner.act`."""
        return self._call("act", observations)

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """See `OffPolicyLearner.explore`."""
        return self._call("explore", observations, noise)

    def policy(self) -> SavedNetwork:
        """See `Learner.policy`."""
        sizes = self._rule.observation_size, self.action_size
        return copy_module(mean_actor(self._rule), *sizes)

    def load_policy(self, policy: SavedNetwork) -> None:
        """See `Learner.load_policy`."""
        arrays = [array for layer in policy.layers for array in layer.arrays.values()]
        actor: Any = self._rule.actor
        # None for what a layer lacks, such as its bias: the policy has a constant array there.
        *inner, weight, bias = (
            one for each in actor.modules() for one in each._parameters.values()
        )
        mean = weight[: self.action_size], bias[: self.action_size]
        pairs = list(itertools.zip_longest([*inner, *mean], arrays))
        if len(arrays) != len(inner) + 2 or any(
            one is not None and one.shape != array.shape for one, array in pairs
        ):
            raise ValueError(OTHER_LAYERS)
        for one, array in pairs:
            if one is not None:
                one.copy_(torch.from_numpy(np.array(array)))

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """See `OffPolicyLearner.is_delayed_update`."""
        return self._rule.is_delayed_update(update, update_of_call)

    def reset_losses(self, delayed: Sequence[bool]) -> None:
        """See `Learner.reset_losses`; the loss of a delayed update is kept until the next one."""
        for name in self.losses:
            if any(delayed) or self._rule.losses[name] not in self._rule.delayed:
                self._sums_by_name[name].zero_()

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """See `OffPolicyLearner.update`."""
        rule = self._rule
        for loss, name in rule.losses.items():
            if name in rule.delayed and not delayed:
                continue
            group = self._groups[name]
            value, gradients = self._differentiate(loss, group.values, batch)
            torch._foreach_copy_(list(group.gradients.values()), gradients)
            self._adams[name].step()
            if loss in self.losses:
                self._record_loss(loss, value[..., None, None])
        for name in rule.targets:
            target = f"{name}_target"
            if delayed or target not in rule.delayed:
                self._groups[target].flat.lerp_(self._groups[name].flat, self._settings.tau)

    def _differentiate(
        self, loss: str, trained: Mapping[str, Tensor], batch: Batch
    ) -> tuple[Tensor, list[Tensor]]:
        """Returns a loss (...,) and its gradient by the parameters that it trains."""
        if self.view.is_stack:
            others = {name: each for name, each in self._parameters.items() if name not in trained}
            return differentiate_stack(self._rule, loss, trained, others, batch)
        leaves = [self._rule.get_parameter(name).requires_grad_() for name in trained]
        value = self._rule(loss, batch)
        gradients = torch.autograd.grad(value, leaves, materialize_grads=True)
        self._rule.requires_grad_(False)
        return value.detach(), list(gradients)

    @torch.no_grad()
    def _call(self, method: str, *inputs: Tensor) -> Tensor:
        """Returns what a method of the rule makes of inputs (..., N, any)."""
        if not self.view.is_stack:
            alone: Tensor = self._rule(method, *inputs)
            return alone
        return call_stack(self._rule, method, self._parameters, *inputs)


def differentiate_stack(
    rule: Rule,
    loss: str,
    trained: Mapping[str, Tensor],
    others: Mapping[str, Tensor],
    batch: Batch,
) -> tuple[Tensor, list[Tensor]]:
    """Returns a loss (seeds,) and its gradient by the parameters that it trains.

    Args:
        trained: (seeds, ...) by name.
        others: the other parameters, (seeds, ...) by name.
        batch: of all seeds.
    """

    def of_seed(
        own: dict[str, Tensor],
        others: dict[str, Tensor],
        rows: Tensor,
        next_rows: Tensor,
        discounts: Tensor,
        noise: Tensor,
    ) -> Tensor:
        its_batch = Batch(rows, next_rows, discounts, noise, rule.action_size)
        value: Tensor = functional_call(rule, {**others, **own}, (loss, its_batch))
        return value

    numbers = batch.rows, batch.next_rows, batch.discounts, batch.noise
    gradients, value = vmap(grad_and_value(of_seed))(dict(trained), dict(others), *numbers)
    return value, list(gradients.values())


def call_stack(
    rule: Rule, method: str, parameters: Mapping[str, Tensor], *inputs: Tensor
) -> Tensor:
    """Returns what a method makes of inputs (seeds, N, any) with parameters (seeds, ...)."""

    def of_seed(parameters: dict[str, Tensor], *own: Tensor) -> Tensor:
        result: Tensor = functional_call(rule, parameters, (method, *own))
        return result

    outputs: Tensor = vmap(of_seed)(dict(parameters), *inputs)
    return outputs


class _Group:
    """The parameters of an attribute of a rule, as views of one flat tensor.

    Attributes:
        name: prefix of the saved tensors.
        flat: (..., count).
        flat_gradient: (..., count).
        values: (..., *shape) views of `flat` by the name of the parameter in the rule.
        gradients: (..., *shape) views of `flat_gradient`.
    """

    def __init__(self, view: SeedView, name: str, shapes: Mapping[str, torch.Size]) -> None:
        self.name = f"rule.{name}"
        count = flat_size(shapes.values())
        self.flat = view.saved(self.name, count)
        self.flat_gradient = view.scratch(f"{self.name}.gradient", count)
        self.values, self.gradients = (
            dict(zip(shapes, flat_parts(flat, shapes.values()), strict=True))
            for flat in (self.flat, self.flat_gradient)
        )
