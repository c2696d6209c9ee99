"""Actions of whatever a caller trains: a torch module, a stable-baselines3 model, a function."""

import contextlib
import inspect
from collections.abc import Callable, Collection, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from jbench.errors import RequestError
from jbench.simulation.rollout import Act

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecNormalize

Actor = Any
"""A torch module, a model or policy of stable-baselines3, or a function: actions (n, action_size)
for observations (n, size) as float32 arrays (as tensors for a module). It must be deterministic."""


@contextlib.contextmanager
def acting(actor: Actor, action_size: int) -> Iterator[Act]:
    """Yields the function that acts, with modules in evaluation mode and without gradients.

    The caller's modules and torch's generator are as before afterwards.

    Raises:
        RequestError: if it can't be called, or its actions have the wrong shape or are not finite.
    """
    modules = list(actor.modules()) if isinstance(actor, nn.Module) else []
    modes = [module.training for module in modules]
    with torch.no_grad(), torch.random.fork_rng(devices=[]):
        try:
            if isinstance(actor, nn.Module):
                actor.eval()
            yield _checked(_function(actor), action_size)
        finally:
            for module, mode in zip(modules, modes, strict=True):
                module.training = mode


def _function(actor: Actor) -> Callable[[NDArray[np.float32]], Any]:
    # Also a policy of stable-baselines3, a module whose actions are random when it is called.
    if "deterministic" in _parameters(getattr(actor, "predict", None)):
        return _function_of_model(actor)
    if isinstance(actor, nn.Module):
        parameter = next(actor.parameters(), torch.empty(0))
        return lambda observations: actor(
            torch.as_tensor(observations, dtype=parameter.dtype, device=parameter.device)
        )
    if callable(actor):
        function: Callable[[NDArray[np.float32]], Any] = actor
        return function
    raise RequestError(
        f"A {type(actor).__name__} can't act: pass a torch module, a stable-baselines3 model, or a "
        "function of observations."
    )


def _parameters(function: Any) -> Collection[str]:
    return inspect.signature(function).parameters if callable(function) else ()


def _function_of_model(model: Any) -> Callable[[NDArray[np.float32]], Any]:
    """Returns the deterministic actions of a model for observations as the environment has them."""
    statistics = normalization(model)

    def act(observations: NDArray[np.float32]) -> Any:
        if statistics is not None:
            observations = statistics.normalize_obs(observations)  # type: ignore[assignment]
        return model.predict(observations, deterministic=True)[0]

    return act


def normalization(model: Any) -> "VecNormalize | None":
    """Returns the normalization of observations around the model's environment, if there is one."""
    from stable_baselines3.common.vec_env import VecNormalize

    found = getattr(model, "get_vec_normalize_env", lambda: None)()
    return found if isinstance(found, VecNormalize) and found.norm_obs else None


def _checked(function: Callable[[NDArray[np.float32]], Any], action_size: int) -> Act:
    """Returns the function with its actions as an array of the right shape."""

    def act(observations: NDArray[np.float32]) -> NDArray[np.floating]:
        answer = function(observations)
        if isinstance(answer, torch.Tensor):
            answer = answer.detach().to("cpu", torch.float32).numpy()
        wanted = (len(observations), action_size)
        if isinstance(answer, tuple) or np.shape(answer) != wanted:
            found = "a tuple" if isinstance(answer, tuple) else f"the shape {np.shape(answer)}"
            raise RequestError(
                f"The actor returned {found} for observations {observations.shape}; it must "
                f"return actions {wanted}."
            )
        actions = np.asarray(answer, np.float64)
        if not np.isfinite(actions).all():
            raise RequestError("The actor returned actions that are not finite.")
        return actions

    return act
