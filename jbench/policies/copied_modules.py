"""Copies of torch modules as layers, which are saved as data and evaluated without torch."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from jbench.array_types import Float32Array
from jbench.errors import ERRORS_OF_OTHERS, RequestError
from jbench.policies.actors import acting
from jbench.policies.layers import (
    Clip,
    Elu,
    LayerNorm,
    LeakyRelu,
    Linear,
    Relu,
    SavedLayer,
    Scale,
    Shift,
    Sigmoid,
    Silu,
    Tanh,
)
from jbench.policies.network import SavedNetwork
from jbench.wording import counted

_TOLERANCE = 1e-4  # of actions; float32 sums in another order differ by less


class UnsupportedPolicyError(RequestError):
    """A policy is not a sequence of layers that jbench can save."""

    def __init__(self, why: str) -> None:
        """Says why a policy can't be kept, and which can."""
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
    if not network.linear_layers():
        raise UnsupportedPolicyError("it has no Linear layer")

    if network.sizes != (inputs, outputs):
        its_inputs, its_outputs = network.sizes
        raise UnsupportedPolicyError(
            f"it has {counted(its_inputs, 'input')} and {counted(its_outputs, 'output')}, not "
            f"{inputs} and {outputs}"
        )

    observations = np.random.default_rng(0).normal(size=(16, inputs)).astype(np.float32)
    try:
        with acting(wrapped, outputs) as act:
            wanted = np.clip(act(observations), -1, 1)
    except RequestError as error:
        raise UnsupportedPolicyError(f"it can't act ({str(error).rstrip('.')})") from None

    if not np.abs(network.act(observations) - wanted).max() < _TOLERANCE:
        raise UnsupportedPolicyError("its layers do not reproduce its actions")

    return network


def module_layers(module: nn.Module) -> list[SavedLayer]:
    """Returns the layers that a module applies to a value, or an UnsupportedPolicyError."""
    try:
        result = module(_value([]))
    except UnsupportedPolicyError:
        raise
    except ERRORS_OF_OTHERS as error:
        reason = next(iter(str(error).splitlines()), type(error).__name__)
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
        name = func.__name__.strip("_")
        named = dict(kwargs or {})
        values = [argument for argument in args if isinstance(argument, cls)]
        if name not in _LAYERS or not values:
            raise UnsupportedPolicyError(f"{name} is not supported")
        if len(values) > 1:
            raise UnsupportedPolicyError(f"{name} takes {len(values)} results, not one")

        named.pop("inplace", None)
        return _value([*values[0].layers, *_LAYERS[name](*args, **named)])


def _value(layers: list[SavedLayer]) -> _Value:
    """Returns a traced value that some layers lead to."""
    value = torch.empty(0).as_subclass(_Value)
    value.layers = layers
    return value


def float32_array(value: Any) -> Float32Array:
    """Returns a copy of a tensor or a number as float32."""
    if isinstance(value, Tensor):
        value = value.detach().to("cpu", torch.float32).numpy()
    return np.array(value, np.float32)


def _linear(x: _Value, weight: Tensor, bias: Tensor | None = None) -> list[SavedLayer]:
    """The layer of `nn.functional.linear`."""
    if bias is None:
        bias = torch.zeros(len(weight))
    return [Linear(weight=float32_array(weight), bias=float32_array(bias))]


def _layer_norm(
    x: _Value, shape: Sequence[int], weight: Any, bias: Any, eps: float
) -> list[SavedLayer]:
    """The layer of `nn.functional.layer_norm`."""
    if weight is None:
        weight = torch.ones(*shape)
    if bias is None:
        bias = torch.zeros(*shape)

    return [LayerNorm(weight=float32_array(weight), bias=float32_array(bias), epsilon=eps)]


def _clip(x: _Value, *bounds: Any, **named: Any) -> list[SavedLayer]:
    """The layer of `clamp` with two numbers."""
    numbers = [*bounds, *named.values()]
    if len(numbers) != 2 or not all(isinstance(number, int | float) for number in numbers):
        raise UnsupportedPolicyError("a clamp has no two numbers as its bounds")
    return [Clip(low=float(min(numbers)), high=float(max(numbers)))]


def _arithmetic(operator: str, x: Any, y: Any) -> list[SavedLayer]:
    """Returns the layers of an operation on a `_Value` and a number or a vector."""
    value_first = isinstance(x, _Value)
    operand = x
    if value_first:
        operand = y

    constant = float32_array(operand)
    if constant.ndim and constant.size > constant.shape[-1]:
        raise UnsupportedPolicyError("a constant is a matrix")

    constant = constant.reshape(-1)
    if operator == "div" and not value_first:
        raise UnsupportedPolicyError("it divides by its inputs")
    if operator == "mul":
        return [Scale(factor=constant)]
    if operator == "div":
        return [Scale(factor=np.reciprocal(constant))]
    if operator == "add":
        return [Shift(offset=constant)]
    if not value_first:
        return [*_arithmetic("mul", x=-1, y=y), *_arithmetic("add", x, y)]

    return [Shift(offset=-constant)]


_LAYERS: dict[str, Callable[..., list[SavedLayer]]] = {
    "relu": lambda x: [Relu()],
    "tanh": lambda x: [Tanh()],
    "sigmoid": lambda x: [Sigmoid()],
    "silu": lambda x: [Silu()],
    **dict.fromkeys(("dropout", "flatten", "contiguous", "float"), lambda x, *_, **__: []),
    **dict.fromkeys(("clamp", "clip", "hardtanh"), _clip),
    "elu": lambda x, alpha: [Elu(alpha=alpha)],
    "leaky_relu": lambda x, negative_slope: [LeakyRelu(slope=negative_slope)],
    "linear": _linear,
    "layer_norm": _layer_norm,
    **{operator: partial(_arithmetic, operator) for operator in ("add", "sub", "mul", "div")},
    "rsub": lambda x, y: _arithmetic("sub", y, x),
}
"""The layers of torch's functions by name; the arguments are those of the functions."""
