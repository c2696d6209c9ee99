"""Policies of other packages: entry points of the group `jbench.policies`, and MODULE:NAME.

A policy is a function from observations (n, size) to actions (n, action_size), a torch module, a
stable-baselines3 model, or an object with `act` and optionally `reset(robots)`. A class is called
with the name of the task, and its object is the policy.
"""

import re
from collections.abc import Callable
from importlib.metadata import EntryPoint
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench import plugins
from jbench.errors import RequestError, WorkError
from jbench.names import POLICIES, REFERENCE
from jbench.policies.acting import acting
from jbench.policies.sb3_zip import is_sb3_zip, sha256_start
from jbench.simulation import find_task

GROUP = "jbench.policies"
_NAME = re.compile(r"[a-z][a-z0-9-]*")
_OURS = (*POLICIES, REFERENCE)


def installed_policies() -> dict[str, EntryPoint]:
    """Returns the entry points of the installed policies by name."""
    return dict(sorted(plugins.offered(GROUP, _NAME, _OURS).items()))


def is_imported_policy(name: str) -> bool:
    """Returns whether a name is that of an installed policy, or of the form MODULE:NAME."""
    of_ours = name.partition(":")[0] in _OURS
    return not of_ours and (plugins.is_imported(name) or name in installed_policies())


def policy_code(name: str) -> str | None:
    """Returns what identifies the code or file of a policy; None for policies of jbench.

    Returns:
        Name and version of its package, or the first 16 digits of the SHA-256 of its file.
    """
    if is_sb3_zip(name):
        return sha256_start(name)
    if not is_imported_policy(name):
        return None
    made_with = plugins.provenance("policy", name, installed_policies())
    checksum = made_with.get("source_sha256")
    return checksum[:16] if checksum else made_with.get("package")


class ImportedPolicy:
    """A policy of another package; its actions are checked."""

    def __init__(self, name: str, task: str) -> None:
        """Imports the policy, and lets it act once.

        Raises:
            RequestError: if it does not exist, or its actions are wrong.
            WorkError: if its module or its class raises an error.
        """
        self._name, sizes = name, find_task(task)
        self._action_size = sizes.action_size
        if plugins.is_imported(name):
            found = plugins.imported("policy", name)
        else:
            found = plugins.load("policy", installed_policies()[name])
        if isinstance(found, type):
            found = self._attempt(found, task)
        self._reset: Callable[[int], object] = getattr(found, "reset", lambda robots: None)
        self._actor = getattr(found, "act", found)
        self.reset(1)
        self.act(np.zeros((1, sizes.observation_size), np.float32))

    def reset(self, robots: int) -> None:
        """Starts new episodes of this many robots."""
        self._attempt(self._reset, robots)

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns actions (robots, action_size) for observations (robots, dim(O)).

        Raises:
            RequestError: if they have the wrong shape or are not finite.
            WorkError: if the policy raises an error.
        """
        with acting(self._actor, self._action_size) as act:
            actions: NDArray[np.floating] = self._attempt(act, observations)
        return actions.clip(-1, 1)

    def _attempt(self, function: Callable[..., Any], argument: object) -> Any:
        try:
            return function(argument)
        except (RequestError, WorkError):
            raise
        except Exception as error:
            raise WorkError(
                f"The policy {self._name} failed ({type(error).__name__}: {error})."
            ) from error
