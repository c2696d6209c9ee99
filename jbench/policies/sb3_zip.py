"""Policies of models that stable-baselines3 saved, `model.save("td3.zip")`.

Only the weights and the readable part of the settings are read. Neither stable-baselines3 nor the
pickled objects in the file are loaded, so no code in the file runs.
"""

import io
import json
import re
import warnings
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from jbench.array_types import Float32Array
from jbench.errors import RequestError, WorkWarning
from jbench.names import TASKS
from jbench.policies.copied_modules import UnsupportedPolicyError, float32_array, module_layers
from jbench.policies.layers import Linear, SavedLayer, Tanh
from jbench.policies.network import SavedNetwork
from jbench.policies.unit_actions import ActionBounds, to_unit_actions
from jbench.tasks.find import find_task
from jbench.wording import counted


@dataclass(frozen=True)
class _ActorForm:
    """How stable-baselines3 names the weights of an actor, and what it does between them.

    Attributes:
        last: beginning of the names of the last weights, or of all.
        hidden: beginning of the names of those before them, if they have another.
        activation: of the hidden layers, by torch's name, unless the file names another.
        output: layers that are applied to the last linear one.
        is_scaled: whether stable-baselines3 scales what the layers return, in [-1, 1], to the
            bounds of the actions; else it is the action, which is clipped to the bounds.
    """

    last: str
    hidden: str
    activation: str
    output: Sequence[SavedLayer] = ()
    is_scaled: bool = False


_DETERMINISTIC = _ActorForm("actor.mu.", "actor.latent_pi.", "ReLU", [Tanh()], is_scaled=True)
"""Of SAC and TQC; DDPG and TD3 have all weights in the last ones."""

_STOCHASTIC = _ActorForm("action_net.", "mlp_extractor.policy_net.", "Tanh")
"""Of PPO, A2C and TRPO."""

_NORMALIZED = "_last_original_obs"
"""What PPO and the like record with a VecNormalize alone; DDPG, TD3 and SAC always do."""

_LONGEST = 96  # characters of a name without .zip in an id

_FORMS = (_DETERMINISTIC, _STOCHASTIC)

_ACTIVATIONS = {
    type(module).__name__: module_layers(module)[0]
    for module in (nn.ReLU(), nn.Tanh(), nn.Sigmoid(), nn.SiLU(), nn.ELU(), nn.LeakyReLU())
}
"""Layers by torch's name, with the defaults with which stable-baselines3 makes them."""


def is_sb3_zip(name: str) -> bool:
    """Returns whether a policy is the file of a model."""
    return name.endswith(".zip")


def recorded_name(path: str) -> str:
    """Returns the name of a file as records have it, whose ids lack spaces and other characters."""
    name = Path(path).name.removesuffix(".zip")
    stem = re.sub(r"[^\w.,:=-]", "-", name, flags=re.ASCII).lstrip("_.,:=-")
    return f"{stem[:_LONGEST] or 'model'}.zip"


def zip_content(path: str) -> bytes:
    """Returns the content of a file, or raises a RequestError."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise RequestError(f"{path} can't be read ({error.strerror}).") from None


def read_sb3_zip(path: str, task: str) -> SavedNetwork:
    """Returns the deterministic policy of a saved model, whose actions are in [-1, 1].

    Raises a RequestError if there is none, or the model's actions mean something else than those
    of the task.
    """
    content = zip_content(path)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as file:
            data: dict[str, Any] = json.loads(file.read("data"))
            weights = _weights(file.read("policy.pth"))
        form = _find_form(data, weights)
        layers = _layers(form, data, weights)
        network = SavedNetwork(layers)
        sizes = network.sizes
        with np.errstate(all="ignore"):
            network.act(np.zeros((1, sizes[0]), np.float32))  # fails if layers don't fit together
        bounds = _action_bounds(data)
    except UnsupportedPolicyError as error:
        raise RequestError(
            f"{path}: {error.why}; load the model in a module of yours and type MODULE:NAME."
        ) from None
    except Exception as error:  # a damaged file may raise almost any
        reason = str(error) or type(error).__name__
        raise RequestError(f"{path} is no saved model of stable-baselines3 ({reason}).") from None

    arrays = (array for layer in layers for array in layer.arrays.values())
    if not all(np.isfinite(array).all() for array in arrays):
        raise RequestError(
            f"{path} has weights that are not finite, as of a training that diverged; name a model "
            "that was saved before that."
        )

    inputs, outputs = sizes
    wanted = find_task(task)
    if sizes == (wanted.observation_size, wanted.action_size):
        if form is _STOCHASTIC and data.get(_NORMALIZED) is not None:
            _warn_of_normalization(path)
        return SavedNetwork([*layers, *to_unit_actions(path, bounds, form.is_scaled, wanted)])

    advice = "name its task with --task"
    fitting = [name for name in TASKS if (find_task(name).observation_size, 1) == sizes]
    if fitting:
        advice = f"use --task {' or '.join(fitting)}"

    raise RequestError(
        f"{path} has {counted(inputs, 'input')} and {counted(outputs, 'output')}, but {task} has "
        f"observations of {wanted.observation_size} numbers and actions of {wanted.action_size}; "
        f"{advice}."
    )


def _warn_of_normalization(path: str) -> None:
    """Warns that the file of a model lacks how its observations were normalized, if they were."""
    warnings.warn(
        f"{path} is of a training with a VecNormalize, whose statistics are not in the file: if it "
        "normalized observations, load both in a module of yours and type MODULE:NAME.",
        WorkWarning,
        stacklevel=3,
    )


def _action_bounds(data: dict[str, Any]) -> ActionBounds | None:
    """Returns the bounds of a model's actions, if its file has them in digits.

    They are recorded as the text [-2. -0.4], in which more than 1000 numbers are abbreviated.
    Raises an UnsupportedPolicyError if its actions are no real numbers.
    """
    space: dict[str, Any] = data.get("action_space") or {}
    kind = str(space.get(":type:", "Box")).rpartition(".")[2].strip("'>")
    if kind != "Box":
        raise UnsupportedPolicyError(f"its actions are {kind}, no real numbers")

    texts = [str(space.get(name, "")) for name in ("low", "high")]
    minimum, maximum = (text.replace("[", " ").replace("]", " ").split() for text in texts)
    if not minimum or len(minimum) != len(maximum) or "..." in minimum:
        return None
    return np.array([minimum, maximum], np.float64)


def _layers(
    form: _ActorForm, data: dict[str, Any], weights: dict[str, Float32Array]
) -> list[SavedLayer]:
    """Returns the layers of an actor from a file of sb3's weights."""
    # It is recorded as <class 'torch.nn.modules.activation.ELU'>.
    typed = (data.get("policy_kwargs") or {}).get("activation_fn") or form.activation
    name = str(typed).rpartition(".")[2].strip("'>")
    if name not in _ACTIVATIONS:
        raise UnsupportedPolicyError(f"its activation {name} is not known")

    first, *others = [*_linear(form.hidden, weights), *_linear(form.last, weights)]
    layers: list[SavedLayer] = [first]
    for linear in (first, *others):
        if linear.weight.ndim != 2:
            raise UnsupportedPolicyError("it has other layers than linear ones")

    for linear in others:
        layers += [_ACTIVATIONS[name], linear]

    return [*layers, *form.output]


def _find_form(data: dict[str, Any], weights: dict[str, Float32Array]) -> _ActorForm:
    """Returns the form whose names the weights have, or raises an UnsupportedPolicyError."""
    if data.get("use_sde"):
        raise UnsupportedPolicyError("it explores with gSDE")
    if any("features_extractor." in name or "shared_net." in name for name in weights):
        raise UnsupportedPolicyError("it has a features extractor of its own")

    for form in _FORMS:
        if any(name.startswith(form.last) for name in weights):
            return form

    raise UnsupportedPolicyError("its actor is not that of DDPG, TD3, SAC, PPO or the like")


def _linear(prefix: str, weights: dict[str, Float32Array]) -> list[Linear]:
    """Returns the linear layers whose names have a prefix, in the order of their numbers."""
    names = sorted(
        {name.rpartition(".")[0] for name in weights if name.startswith(prefix)},
        key=lambda name: int(f"{name}.".removeprefix(prefix).strip(".") or 0),
    )
    return [
        Linear(weight=weights[f"{name}.weight"], bias=weights[f"{name}.bias"]) for name in names
    ]


def _weights(content: bytes) -> dict[str, Float32Array]:
    """Returns the arrays of a state dictionary; other objects are refused, not unpickled."""
    try:
        weights = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
        if not all(isinstance(tensor, torch.Tensor) for tensor in weights.values()):
            raise TypeError("a value is no tensor")

        return {name: float32_array(tensor) for name, tensor in weights.items()}
    except Exception as error:
        raise ValueError("policy.pth holds other objects than weights") from error
