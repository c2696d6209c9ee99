"""Trains the update rules of other packages, which autograd differentiates.

A seed has a copy of the rule whose parameters are views of the tensors of the engine. In a stack, a
loss is a function of parameters and batch (`torch.func.functional_call`) that is mapped over the
seeds (`torch.func.vmap`) and differentiated. A seed alone does without these: they take longer than
the products of small matrices.
"""

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Generator, Tensor
from torch.func import functional_call, vmap

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.replay import Batch
from jbench.agents.batched.rule import Rule, make_rule, mean_actor, parameter_names, phases
from jbench.agents.batched.tensors import Tensors, flat_parts, flat_size
from jbench.policies.copied_modules import copy_module
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import OffPolicySettings
from jbench.store.schema import LOSSES


class AutogradLearner(OffPolicyLearner[OffPolicySettings]):
    """An update rule of another package, for one seed or for a stack."""

    def __init__(
        self,
        settings: OffPolicySettings,
        observation_size: int,
        action_size: int,
        view: Tensors,
        *,
        rule: Rule,
    ) -> None:
        """See `Learner`; the parameters of the given rule are not used."""
        self.losses = tuple(name for name in rule.losses if name in LOSSES)
        self.noise_per_transition = rule.noise_per_transition
        self.is_stochastic = type(rule).explore is not Rule.explore
        super().__init__(settings, observation_size, action_size, view)
        # Of each attribute: the flat parameters (..., count), and views of them by name.
        self._flat: dict[str, Tensor] = {}
        self._views: dict[str, dict[str, Tensor]] = {}
        # Of those that are trained: views of the gradient, and the optimizer.
        self._gradients: dict[str, list[Tensor]] = {}
        self._adams: dict[str, Adam] = {}
        for attribute, names in parameter_names(rule).items():
            shapes = [rule.get_parameter(name).shape for name in names]
            saved = f"rule.{attribute}"
            flat = view.state(saved, flat_size(shapes))
            self._flat[attribute] = flat
            self._views[attribute] = dict(zip(names, flat_parts(flat, shapes), strict=True))
            if attribute in rule.losses.values():
                gradient = view.scratch(f"{saved}.gradient", flat.shape[-1])
                self._gradients[attribute] = flat_parts(gradient, shapes)
                self._adams[attribute] = Adam(view, saved, flat, gradient, settings.learning_rate)

        self._phases = phases(rule)
        self._parameters: dict[str, Tensor] = {}
        for views in self._views.values():
            self._parameters.update(views)

        self.rule = copy.deepcopy(rule).to(view.device, self._loss_sums.dtype)
        self.rule.requires_grad_(False)
        if not view.is_stack:
            for name, values in self._parameters.items():
                self.rule.get_parameter(name).data = values

    def initialize(self, generator: Generator) -> None:
        """Draws the initial parameters of one seed."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(generator.initial_seed())
            drawn = make_rule(
                type(self.rule), self.settings, self.rule.observation_size, self.action_size
            )
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
        return copy_module(mean_actor(self.rule), self.rule.observation_size, self.action_size)

    def load_policy(self, policy: SavedNetwork) -> None:
        """See `Learner.load_policy`."""
        arrays = [array for layer in policy.layers for array in layer.arrays.values()]
        actor: Any = self.rule.actor
        # None for what a layer lacks, such as its bias: the policy has a constant array there.
        *inner, weight, bias = (
            parameter for module in actor.modules() for parameter in module._parameters.values()
        )
        parameters = [*inner, weight[: self.action_size], bias[: self.action_size]]
        for parameter, array in zip(parameters, arrays, strict=True):
            if parameter is not None:
                parameter.copy_(torch.from_numpy(np.array(array)))

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """See `OffPolicyLearner.is_delayed_update`."""
        return self.rule.is_delayed_update(update, update_of_call)

    def reset_losses(self, delayed: Sequence[bool]) -> None:
        """See `Learner.reset_losses`; the loss of a delayed update is kept until the next one."""
        for name in self.losses:
            if any(delayed) or self.rule.losses[name] not in self.rule.delayed:
                self._sums_by_name[name].zero_()

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """See `OffPolicyLearner.update`."""
        rule = self.rule
        for losses in self._phases:
            updated = [loss for loss in losses if delayed or rule.losses[loss] not in rule.delayed]
            for loss in updated:
                name = rule.losses[loss]
                value, gradients = self._differentiate(loss, self._views[name], batch)
                torch._foreach_copy_(self._gradients[name], gradients)
                if loss in self.losses:
                    # One number of each seed; a rule may return it as a vector.
                    seeds = value.shape[:1] if self.view.is_stack else ()
                    self._record_loss(loss, value.reshape(*seeds, 1, 1))
            for loss in updated:
                self._adams[rule.losses[loss]].step()
        for name in rule.targets:
            target = f"{name}_target"
            if delayed or target not in rule.delayed:
                self._flat[target].lerp_(self._flat[name], self.settings.tau)

    def _differentiate(
        self, loss: str, trained: Mapping[str, Tensor], batch: Batch
    ) -> tuple[Tensor, list[Tensor]]:
        """Returns a loss (...,) and its gradient by the parameters that it trains."""
        rule = self.rule
        if not self.view.is_stack:
            leaves = [rule.get_parameter(name).requires_grad_() for name in trained]
            value = rule(loss, batch)
            gradients = torch.autograd.grad(value, leaves, materialize_grads=True)
            rule.requires_grad_(False)
            return value.detach(), list(gradients)

        def seed_loss(trained: dict[str, Tensor], others: dict[str, Tensor], *numbers: Any) -> Any:
            """Returns the loss of one seed as a function of the parameters that it trains."""
            rows, next_rows, discounts, noise = numbers
            seed_batch = Batch(rows, next_rows, discounts, noise, rule.action_size)
            return functional_call(rule, {**others, **trained}, (loss, seed_batch))

        others = {name: values for name, values in self._parameters.items() if name not in trained}
        numbers = batch.rows, batch.next_rows, batch.discounts, batch.noise
        stacked = {name: values.detach().requires_grad_() for name, values in trained.items()}
        value = vmap(seed_loss)(stacked, others, *numbers)
        # A seed's loss depends on its own parameters alone.
        gradients = torch.autograd.grad(value.sum(), list(stacked.values()), materialize_grads=True)
        return value.detach(), list(gradients)

    @torch.no_grad()
    def _call(self, method: str, *inputs: Tensor) -> Tensor:
        """Returns what a method of the rule returns, for one seed or mapped over the seeds."""
        if not self.view.is_stack:
            return self.rule.forward(method, *inputs)
        call_seed = vmap(lambda weights, *x: functional_call(self.rule, weights, (method, *x)))
        actions: Tensor = call_seed(self._parameters, *inputs)
        return actions
