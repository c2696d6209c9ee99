"""Torch modules as policies that are saved as data and evaluated without torch."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from jbench.errors import RequestError
from jbench.policies.acting import acting
from jbench.policies.network import Float, SavedLayer, SavedNetwork, linear_layer
from jbench.wording import counted

_TOLERANCE = 1e-4  # of actions; float32 sums in another order differ by less
_CHECKED = 16  # random observations
_PLAIN = ("relu", "tanh", "sigmoid", "silu")  # functions and layers without parameters


class UnsupportedPolicyError(RequestError):
    """A policy is not a sequence of layers that jbench can save."""

    def __init__(self, why: str) -> None:
        self.why = why
        super().__init__(
            f"This policy can't be kept: {why}; pass a module that applies Linear, LayerNorm, "
            "ReLU, tanh and the like one after another, such as nn.Sequential, and returns the "
            "action."
        )


def copy_module(module: object, inputs: int, outputs: int) -> SavedNetwork:
    """Returns a copy of a module: actions (n, outputs) for (encoded) observations (n, inputs).

    It is compared with the module on random observations. Raises an UnsupportedPolicyError if it is
    not a sequence of supported layers.
    """
    if not isinstance(module, nn.Module):
        raise UnsupportedPolicyError(f"its type is {type(module).__name__}, no torch module")
    wrapped: Any = getattr(module, "_orig_mod", module)  # by torch.compile
    network = SavedNetwork(module_layers(wrapped))
    _check(network, wrapped, inputs, outputs)
    return network


def module_layers(module: nn.Module) -> list[SavedLayer]:
    """Returns the layers that a module applies to a value, or an UnsupportedPolicyError."""
    try:
        result = module(_value([]))
    except UnsupportedPolicyError:
        raise
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UnsupportedPolicyError(f"its computation can't be traced ({reason})") from None
    if not isinstance(result, _Value):
        raise UnsupportedPolicyError("it returns something else than one tensor, the action")
    return result.layers


class _Value(Tensor):
    """Stands for the observation, or for the result of `layers` that were applied to it."""

    layers: list[SavedLayer]

    @classmethod
    def __torch_function__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Is called in place of functions, methods and operators, such as relu, relu_ or mul."""
        name, named = func.__name__.strip("_"), dict(kwargs or {})
        values = [argument for argument in args if isinstance(argument, cls)]
        if name not in _LAYERS or not values:
            raise UnsupportedPolicyError(f"{name} is not supported")
        if len(values) > 1:
            raise UnsupportedPolicyError(f"{name} takes {len(values)} results, not one")
        named.pop("inplace", None)
        return _value([*values[0].layers, *_LAYERS[name](*args, **named)])


def _value(layers: list[SavedLayer]) -> _Value:
    value = torch.empty(0).as_subclass(_Value)
    value.layers = layers
    return value


def _linear(x: _Value, weight: Tensor, bias: Tensor | None = None) -> list[SavedLayer]:
    bias = torch.zeros(len(weight)) if bias is None else bias
    return [linear_layer(float32_array(weight), float32_array(bias))]


def _layer_norm(
    x: _Value, shape: Sequence[int], weight: Any, bias: Any, eps: float
) -> list[SavedLayer]:
    weight = torch.ones(*shape) if weight is None else weight
    bias = torch.zeros(*shape) if bias is None else bias
    arrays = {"weight": float32_array(weight), "bias": float32_array(bias)}
    return [SavedLayer("layer_norm", arrays, {"epsilon": eps})]


def _clip(x: _Value, *bounds: Any, **named: Any) -> list[SavedLayer]:
    numbers = [*bounds, *named.values()]
    if len(numbers) != 2 or not all(isinstance(number, int | float) for number in numbers):
        raise UnsupportedPolicyError("a clamp has no two numbers as its bounds")
    return [SavedLayer("clip", numbers={"low": float(min(numbers)), "high": float(max(numbers))})]


def _arithmetic(operator: str, x: Any, y: Any) -> list[SavedLayer]:
    """Returns the layers of an operation on a `_Value` and a number or a vector."""
    value_first = isinstance(x, _Value)
    constant = float32_array(y if value_first else x)
    if constant.ndim > 1 and constant.shape[:-1] != (1,) * (constant.ndim - 1):
        raise UnsupportedPolicyError("a constant is a matrix")
    constant = constant.reshape(-1)
    if operator == "div" and not value_first:
        raise UnsupportedPolicyError("it divides by its inputs")
    if operator in ("mul", "div"):
        factor = constant if operator == "mul" else np.reciprocal(constant)
        return [SavedLayer("scale", {"factor": factor})]
    if operator == "sub" and not value_first:
        return [*_arithmetic("mul", x=-1, y=y), *_arithmetic("add", x, y)]
    return [SavedLayer("shift", {"offset": constant if operator == "add" else -constant})]


_LAYERS: dict[str, Callable[..., list[SavedLayer]]] = {
    **{kind: partial(lambda kind, x: [SavedLayer(kind)], kind) for kind in _PLAIN},
    **dict.fromkeys(("dropout", "flatten", "contiguous", "float"), lambda x, *_, **__: []),
    **dict.fromkeys(("clamp", "clip", "hardtanh"), _clip),
    "elu": lambda x, alpha: [SavedLayer("elu", numbers={"alpha": alpha})],
    "leaky_relu": lambda x, negative_slope: [
        SavedLayer("leaky_relu", numbers={"slope": negative_slope})
    ],
    "linear": _linear,
    "layer_norm": _layer_norm,
    **{operator: partial(_arithmetic, operator) for operator in ("add", "sub", "mul", "div")},
    "radd": partial(_arithmetic, "add"),
    "rmul": partial(_arithmetic, "mul"),
    "rsub": lambda x, y: _arithmetic("sub", y, x),
}
"""The layers of torch's functions by name; the arguments are those of the functions."""


def float32_array(value: Any) -> Float:
    """Returns a copy of a tensor or a number as float32."""
    if isinstance(value, Tensor):
        value = value.detach().to("cpu", torch.float32).numpy()
    return np.array(value, np.float32)


def _check(network: SavedNetwork, module: nn.Module, inputs: int, outputs: int) -> None:
    if not any(layer.kind == "linear" for layer in network.layers):
        raise UnsupportedPolicyError("it has no Linear layer")
    if (network.inputs, network.outputs) != (inputs, outputs):
        raise UnsupportedPolicyError(
            f"it has {counted(network.inputs, 'input')} and {counted(network.outputs, 'output')}, "
            f"not {inputs} and {outputs}"
        )
    observations = np.random.default_rng(0).normal(size=(_CHECKED, inputs)).astype(np.float32)
    try:
        with acting(module, outputs) as act:
            wanted = np.clip(act(observations), -1, 1)
    except RequestError as error:
        raise UnsupportedPolicyError(f"it can't act ({str(error).rstrip('.')})") from None
    if not np.abs(network.act(observations) - wanted).max() < _TOLERANCE:
        raise UnsupportedPolicyError("its layers do not reproduce its actions")
