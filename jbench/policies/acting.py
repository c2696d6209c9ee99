"""Actions of whatever a caller or another package trains: torch modules, models, functions.

Other packages offer policies as entry points of the group `jbench.policies`, and modules in the
working directory as MODULE:NAME. A policy is an `Actor`, or an object with `act` and optionally
`reset(robots)`. A class is called with the name of the task, and its object is the policy.
"""

import contextlib
import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from jbench import plugins
from jbench.errors import RequestError, WorkError, sentence_of_failure
from jbench.names import POLICIES, REFERENCE
from jbench.simulation import Act, find_task

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecNormalize

_OURS = (*POLICIES, REFERENCE)

_Function = Callable[[NDArray[np.float32]], Any]

Actor = Any
"""A torch module, a model or policy of stable-baselines3, or a function: actions (n, action_size)
for observations (n, size) as float32 arrays (as tensors for a module). It must be deterministic."""


@dataclass(frozen=True)
class ActingPolicy:
    """A policy: actions (robots, action_size) in [-1, 1] for observations (robots, dim(O)).

    `reset` takes a number of robots, and starts an episode of each.
    """

    act: Act
    reset: Callable[[int], object] = lambda robots: None


@contextlib.contextmanager
def acting(actor: Actor, action_size: int) -> Iterator[Act]:
    """Yields the function that acts, with modules in evaluation mode and without gradients.

    The caller's modules and torch's generator are as before afterwards. Raises a RequestError if it
    can't be called, or its actions have the wrong shape or are not finite.
    """
    modules = list(actor.modules()) if isinstance(actor, nn.Module) else []
    modes = [module.training for module in modules]
    with torch.no_grad(), torch.random.fork_rng(devices=[]):
        try:
            if isinstance(actor, nn.Module):
                actor.eval()
            yield partial(_checked_actions, _function(actor), action_size)
        finally:
            for module, mode in zip(modules, modes, strict=True):
                module.training = mode


def _function(actor: Actor) -> _Function:
    # Also a policy of stable-baselines3, a module whose actions are random when it is called.
    predict = getattr(actor, "predict", None)
    if callable(predict) and "deterministic" in inspect.signature(predict).parameters:
        statistics = normalization(actor)
        seen: Callable[..., Any] = np.asarray if statistics is None else statistics.normalize_obs
        return lambda observations: predict(seen(observations), deterministic=True)[0]
    if isinstance(actor, nn.Module):
        parameter = next(actor.parameters(), torch.empty(0))
        return lambda observations: actor(
            torch.as_tensor(observations, dtype=parameter.dtype, device=parameter.device)
        )
    if callable(actor):
        function: _Function = actor
        return function
    raise RequestError(
        f"A {type(actor).__name__} can't act: pass a torch module, a stable-baselines3 model, or a "
        "function of observations."
    )


def normalization(model: Any) -> "VecNormalize | None":
    """Returns the normalization of observations around the model's environment, if there is one."""
    from stable_baselines3.common.vec_env import VecNormalize

    wrapper = getattr(model, "get_vec_normalize_env", lambda: None)()
    return wrapper if isinstance(wrapper, VecNormalize) and wrapper.norm_obs else None


def _checked_actions(
    function: _Function, action_size: int, observations: NDArray[np.float32]
) -> NDArray[np.floating]:
    answer = function(observations)
    if isinstance(answer, torch.Tensor):
        answer = answer.detach().to("cpu", torch.float32).numpy()
    wanted = (len(observations), action_size)
    if isinstance(answer, tuple) or np.shape(answer) != wanted:
        given = "a tuple" if isinstance(answer, tuple) else f"the shape {np.shape(answer)}"
        raise RequestError(
            f"The actor returned {given} for observations {observations.shape}; it must "
            f"return actions {wanted}."
        )
    actions = np.asarray(answer, np.float64)
    if not np.isfinite(actions).all():
        raise RequestError("The actor returned actions that are not finite.")
    return actions


def installed_policies() -> dict[str, EntryPoint]:
    """Returns the entry points of the installed policies by name."""
    name = re.compile(r"[a-z][a-z0-9-]*")
    return dict(sorted(plugins.offered("jbench.policies", name, _OURS).items()))


def is_imported_policy(name: str) -> bool:
    """Returns whether a name is that of an installed policy, or of the form MODULE:NAME."""
    is_ours = name.partition(":")[0] in _OURS
    return not is_ours and (plugins.is_imported(name) or name in installed_policies())


def imported_policy(name: str, task: str) -> ActingPolicy:
    """Returns a policy of another package, whose actions are checked, after it has acted once.

    Raises a RequestError if it does not exist, or its actions have the wrong shape or are not
    finite; a WorkError if its module, its class or its actions raise an error.
    """
    sizes = find_task(task)

    def attempt(function: Callable[[Any], Any], argument: object) -> Any:
        try:
            return function(argument)
        except (RequestError, WorkError):
            raise
        except Exception as error:
            raise WorkError(f"The policy {name} failed ({sentence_of_failure(error)}).") from error

    if plugins.is_imported(name):
        made = plugins.imported("policy", name)
    else:
        made = plugins.load("policy", installed_policies()[name])
    if isinstance(made, type):
        made = attempt(made, task)
    actor = getattr(made, "act", made)

    def act(observations: NDArray[np.float32]) -> NDArray[np.floating]:
        with acting(actor, sizes.action_size) as checked:
            actions: NDArray[np.floating] = attempt(checked, observations)
        return actions.clip(-1, 1)

    policy = ActingPolicy(act, partial(attempt, getattr(made, "reset", lambda robots: None)))
    policy.reset(1)
    policy.act(np.zeros((1, sizes.observation_size), np.float32))
    return policy
