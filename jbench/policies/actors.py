"""Actors, which callers and other packages train, and their actions."""

import contextlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from jbench import plugins
from jbench.errors import RequestError
from jbench.policies.answers import read_actions
from jbench.policies.unit_actions import check_unit_actions
from jbench.tasks.task import Act

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecNormalize

Actor = Any
"""A torch module, a model or policy of stable-baselines3, or a function: actions (n, action_size)
for observations (n, size) as float32 arrays (as tensors for a module). It must be deterministic."""


@contextlib.contextmanager
def acting(actor: Actor, action_size: int) -> Iterator[Act]:
    """Yields the function that acts, with modules in evaluation mode and without gradients.

    The caller's modules and torch's generator are as before afterwards. Raises a RequestError if it
    can't be called, or its actions have the wrong shape or are not finite.
    """
    function = _function(actor)

    def act(observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns the actor's actions, which it checks."""
        answer = function(observations)
        if isinstance(answer, Tensor):
            answer = answer.detach().to("cpu", torch.float32).numpy()

        wanted = (len(observations), action_size)
        try:
            actions = read_actions(answer, wanted)
        except ValueError as returned:
            raise RequestError(
                f"The actor returned {returned} for observations {observations.shape}; it must "
                f"return actions {wanted}."
            ) from None

        if not np.isfinite(actions).all():
            raise RequestError("The actor returned actions that are not finite.")

        return actions

    modes = {}
    if isinstance(actor, nn.Module):
        modes = {module: module.training for module in actor.modules()}

    with torch.no_grad(), torch.random.fork_rng(devices=[]):
        try:
            if modes:
                actor.eval()
            yield act
        finally:
            for module, mode in modes.items():
                module.training = mode


def _function(actor: Actor) -> Callable[[NDArray[np.float32]], Any]:
    """Returns what maps observations to actions, deterministically if an actor can do both."""
    # Also a policy of stable-baselines3, a module whose actions are random when it is called.
    predict = getattr(actor, "predict", None)
    if callable(predict) and "deterministic" in (plugins.parameters(predict) or {}):
        check_unit_actions(actor)
        normalized: Callable[..., Any] = np.asarray
        statistics = normalization(actor)
        if statistics is not None:
            normalized = statistics.normalize_obs

        return lambda observations: predict(normalized(observations), deterministic=True)[0]

    if isinstance(actor, nn.Module):
        if type(actor).forward is nn.Module.forward:  # which raises an error
            raise RequestError(
                f"A module {type(actor).__name__} without forward can't act: pass the network in "
                "it that returns the deterministic action, such as agent.actor_mean."
            )

        parameter = next(actor.parameters(), torch.empty(0))
        return lambda observations: actor(
            torch.as_tensor(observations, dtype=parameter.dtype, device=parameter.device)
        )

    if not callable(actor):
        raise RequestError(
            f"A {type(actor).__name__} can't act: pass a torch module, a stable-baselines3 model, "
            "or a function of observations."
        )

    return lambda observations: actor(observations)


def normalization(model: Any) -> "VecNormalize | None":
    """Returns the normalization of observations around the model's environment, if there is one."""
    from stable_baselines3.common.vec_env import VecNormalize

    wrapper = getattr(model, "get_vec_normalize_env", lambda: None)()
    if isinstance(wrapper, VecNormalize) and wrapper.norm_obs:
        return wrapper
    return None
