"""Kinds that predict: the next state, the actions in between, or which state follows."""

from abc import abstractmethod
from functools import reduce

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from jbench.arrays import Array
from jbench.encoders.kind import Learned
from jbench.encoders.networks import Weights, affine, layers, tanh
from jbench.encoders.pairs import StatePairs, state_pairs
from jbench.encoders.scaling import Moments, inverse
from jbench.encoders.states import MAX_HORIZON, States
from jbench.tasks.find import find_task


class Predictive(Learned):
    """Learns latents from which the future can be predicted; its subclasses differ in the loss.

    The encoder is one tanh layer, as in the denoising autoencoder. A hidden tanh layer sees the
    latents of a state and the actions of the next `horizon` control steps. A linear decoder
    reconstructs the state, without influence on the latents.
    """

    uses_actions = True

    hidden: int = Field(default=64, ge=1, description="units of the predictor; ours")
    horizon: int = Field(
        default=1, ge=1, lt=MAX_HORIZON, description="control steps ahead of the future; ours"
    )

    @abstractmethod
    def heads(self, size: int, latents: int, actions: int) -> dict[str, tuple[int, int]]:
        """Returns (outputs, inputs) of the layers in between, hidden first; `actions` is a size."""

    def initial(
        self, size: int, latents: int, random: torch.Generator, action_size: int = 1
    ) -> dict[str, Tensor]:
        """Glorot's initialization of the encoder, its decoder and the heads."""
        heads = self.heads(size, latents, self.horizon * action_size)
        return layers({"encoder": (latents, size), **heads, "decoder": (size, latents)}, random)

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """One layer and tanh."""
        return tanh(affine(weights, "encoder", scaled))

    def decode(self, weights: Weights, latents: Array) -> Array:
        """One layer, whose error does not train the encoder."""
        return affine(weights, "decoder", latents)

    @abstractmethod
    def prediction_loss(self, weights: Weights, latents: Tensor, batch: StatePairs) -> Tensor:
        """Returns what the latents (rows, latents) of `batch.now` are trained to minimize."""

    def loss(self, weights: Weights, batch: StatePairs) -> Tensor:
        """Returns the prediction's loss plus the mean squared error of the reconstruction."""
        latents = self.encode(weights, batch.now)
        loss = self.prediction_loss(weights, latents, batch)
        rebuilt = self.decode(weights, latents.detach())  # so no gradient reaches the latents
        return loss + torch.nn.functional.mse_loss(rebuilt, batch.now)


class ForwardModel(Predictive):
    """Predicts the change of the state over `horizon` control steps and the mean reward.

    Every target is scaled to unit variance, so that features of large variance do not dominate the
    loss. Source: the task "predict the difference of states" of Lange et al. (arXiv:2310.04241),
    with the reward.
    """

    def heads(self, size: int, latents: int, actions: int) -> dict[str, tuple[int, int]]:
        """Predict the change of the state and the reward from latents and actions."""
        units = self.hidden
        return {"hidden": (units, latents + actions), "change": (size, units), "reward": (1, units)}

    def constants(self, states: States) -> dict[str, Tensor]:
        """The scales of changes and rewards, and the periods of angles."""
        periods = angle_periods(states).to(states.device)
        changes = list[Moments]()
        rewards = list[Moments]()
        for batch in state_pairs(states.learn(), self.horizon, with_actions=True):
            changes.append(Moments.of(state_changes(batch, periods).cpu().numpy()))
            rewards.append(Moments.of(batch.rewards.mean(1, True).cpu().numpy()))

        constants = {"change.turn": periods}
        for name, parts in (("change.scale", changes), ("reward.scale", rewards)):
            sd = np.sqrt(np.diag(reduce(Moments.merged, parts).covariance))
            scale = inverse(np.where(sd > 1e-9, sd, 0))  # 0 for a constant column
            constants[name] = torch.from_numpy(scale.astype(np.float32)).to(states.device)

        return constants

    def prediction_loss(self, weights: Weights, latents: Tensor, batch: StatePairs) -> Tensor:
        """The errors of the scaled change and of the scaled mean reward."""
        hidden = tanh(affine(weights, "hidden", torch.cat([latents, batch.actions], 1)))
        changes = state_changes(batch, weights["change.turn"]) * weights["change.scale"]
        rewards = batch.rewards.mean(1, keepdim=True) * weights["reward.scale"]
        mse = torch.nn.functional.mse_loss
        change_error = mse(affine(weights, "change", hidden), changes)
        return change_error + mse(affine(weights, "reward", hidden), rewards)


class InverseModel(Predictive):
    """Predicts the actions of `horizon` control steps from the latents before and after them.

    Source: the inverse dynamics of Agrawal et al. (arXiv:1606.07419) and Pathak et al.
    (arXiv:1705.05363), which keep what the agent controls.
    """

    def heads(self, size: int, latents: int, actions: int) -> dict[str, tuple[int, int]]:
        """Predict the actions from the latents of two states."""
        return {"hidden": (self.hidden, 2 * latents), "action": (actions, self.hidden)}

    def prediction_loss(self, weights: Weights, latents: Tensor, batch: StatePairs) -> Tensor:
        """The mean squared error of the actions."""
        pair = torch.cat([latents, self.encode(weights, batch.later)], 1)
        actions = affine(weights, "action", tanh(affine(weights, "hidden", pair)))
        return torch.nn.functional.mse_loss(actions, batch.actions)


class Contrastive(Predictive):
    """Distinguishes a state's future from the futures of others: minimizes InfoNCE.

    Latents and actions are mapped to a query. Its product with the latents of the state `horizon`
    control steps later must be larger than its products with the later states of all other rows of
    the batch. Source: InfoNCE (van den Oord, Li and Vinyals, arXiv:1807.03748) with the actions in
    between, as in the temporal contrastive learning of Yang and Nachum (arXiv:2102.05815).
    """

    epochs: int = Field(
        default=50, ge=1, description="passes over the states; ours, since a batch has few rows"
    )
    batch: int = Field(default=512, ge=2, description="rows in a step; ours")
    horizon: int = Field(
        default=5, ge=1, lt=MAX_HORIZON, description="control steps ahead of the future; ours"
    )

    def heads(self, size: int, latents: int, actions: int) -> dict[str, tuple[int, int]]:
        """Predict the latents of the future from latents and actions."""
        return {"hidden": (self.hidden, latents + actions), "query": (latents, self.hidden)}

    def prediction_loss(self, weights: Weights, latents: Tensor, batch: StatePairs) -> Tensor:
        """Returns the InfoNCE loss (nats)."""
        hidden = tanh(affine(weights, "hidden", torch.cat([latents, batch.actions], 1)))
        queries = affine(weights, "query", hidden)
        products = queries @ self.encode(weights, batch.later).T
        labels = torch.arange(len(products), device=products.device)
        return torch.nn.functional.cross_entropy(products, labels)


def state_changes(batch: StatePairs, periods: Tensor) -> Tensor:
    """Returns the (rows, size) changes of the scaled features; angles change the shorter way."""
    change = batch.later - batch.now
    return change - periods * torch.where(periods > 0, change / periods, 0).round()


def angle_periods(states: States) -> Tensor:
    """Returns the (size,) scaled periods of the features: a full turn of an angle, otherwise 0.

    Which features of another robot are angles is not known.
    """
    task = find_task(states.task)
    if task.units is None or task.observed_range is None:
        return torch.zeros(states.size)
    observed = zip(task.units, task.observed_range[1], strict=True)
    is_angle = np.array([pair == ("rad", np.pi) for pair in observed])
    periods = np.where(is_angle[states.columns], 2, 0).astype(np.float32)
    return torch.from_numpy(periods * states.scaling.gain_and_offset()[0])
