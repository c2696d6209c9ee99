"""The layers of kept policies, which are applied with numpy, or with torch to export them."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from jbench.array_types import Float32Array
from jbench.arrays import Array, namespace


@dataclass(frozen=True, eq=False)
class SavedLayer(ABC):
    """A layer of a kept policy; its fields are arrays and numbers, which are kept by their names.

    Attributes:
        kind: name of the class in the files of policies.
    """

    kind: ClassVar[str]

    @abstractmethod
    def after(self, results: Sequence[Array]) -> Array:
        """Returns the layer's result, an array (..., units).

        Args:
            results: the observations (..., size), then the result of each layer before this one.
        """

    @property
    def arrays(self) -> dict[str, Float32Array]:
        """The fields that are arrays, by name."""
        return {name: value for name, value in self._values() if isinstance(value, np.ndarray)}

    @property
    def numbers(self) -> dict[str, float]:
        """The fields that are numbers, by name."""
        return {name: value for name, value in self._values() if not isinstance(value, np.ndarray)}

    def _values(self) -> list[tuple[str, Any]]:
        """Returns the name and the value of each field."""
        return [(field.name, getattr(self, field.name)) for field in fields(self)]


class _Function(SavedLayer):
    """A layer that is a function of the result before it, (..., size)."""

    @abstractmethod
    def apply(self, x: Array) -> Array:
        """Returns the layer's result in the library and the precision of `x`."""

    def after(self, results: Sequence[Array]) -> Array:
        """See `SavedLayer.after`."""
        return self.apply(results[-1])


def _constant(values: Float32Array, x: Array) -> Array:
    """Returns an array of a layer in the library of the array that the layer is applied to."""
    return namespace(x).asarray(values)


def _logistic(x: Array) -> Array:
    """Returns 1 / (1 + exp(-x)), without an overflow."""
    return 0.5 + 0.5 * namespace(x).tanh(0.5 * x)


@dataclass(frozen=True, eq=False)
class Linear(_Function):
    """Multiplies by a weight matrix (units, size) and adds a bias (units,)."""

    kind = "linear"
    weight: Float32Array
    bias: Float32Array

    def apply(self, x: Array) -> Array:
        return x @ _constant(self.weight, x).T + _constant(self.bias, x)


@dataclass(frozen=True, eq=False)
class LayerNorm(_Function):
    """Normalizes over the last axis, multiplies by a weight and adds a bias, each (size,)."""

    kind = "layer_norm"
    weight: Float32Array
    bias: Float32Array
    epsilon: float

    def apply(self, x: Array) -> Array:
        centered = x - x.mean(axis=-1, keepdims=True)
        variance = (centered * centered).mean(axis=-1, keepdims=True)
        normalized = centered / namespace(x).sqrt(variance + self.epsilon)
        return normalized * _constant(self.weight, x) + _constant(self.bias, x)


@dataclass(frozen=True, eq=False)
class Scale(_Function):
    """Multiplies by a factor, (size,) or (1,)."""

    kind = "scale"
    factor: Float32Array

    def apply(self, x: Array) -> Array:
        return x * _constant(self.factor, x)


@dataclass(frozen=True, eq=False)
class Shift(_Function):
    """Adds an offset, (size,) or (1,)."""

    kind = "shift"
    offset: Float32Array

    def apply(self, x: Array) -> Array:
        return x + _constant(self.offset, x)


@dataclass(frozen=True, eq=False)
class Divide(_Function):
    """Divides by a divisor (size,)."""

    kind = "divide"
    divisor: Float32Array

    def apply(self, x: Array) -> Array:
        return x / _constant(self.divisor, x)


@dataclass(frozen=True, eq=False)
class Columns(_Function):
    """Leaves out the columns before the one whose index is `first`."""

    kind = "columns"
    first: int

    def apply(self, x: Array) -> Array:
        return x[..., int(self.first) :]


@dataclass(frozen=True, eq=False)
class Clip(_Function):
    """Clips to [low, high]."""

    kind = "clip"
    low: float
    high: float

    def apply(self, x: Array) -> Array:
        return x.clip(self.low, self.high)


@dataclass(frozen=True, eq=False)
class Relu(_Function):
    """The rectified linear unit, max(x, 0)."""

    kind = "relu"

    def apply(self, x: Array) -> Array:
        return x.clip(0)


@dataclass(frozen=True, eq=False)
class Tanh(_Function):
    """The hyperbolic tangent."""

    kind = "tanh"

    def apply(self, x: Array) -> Array:
        return namespace(x).tanh(x)


@dataclass(frozen=True, eq=False)
class Sigmoid(_Function):
    """The logistic function."""

    kind = "sigmoid"

    def apply(self, x: Array) -> Array:
        return _logistic(x)


@dataclass(frozen=True, eq=False)
class Silu(_Function):
    """The sigmoid linear unit, x times its logistic function."""

    kind = "silu"

    def apply(self, x: Array) -> Array:
        return x * _logistic(x)


@dataclass(frozen=True, eq=False)
class Elu(_Function):
    """The exponential linear unit: x if it is positive, else alpha (exp(x) - 1)."""

    kind = "elu"
    alpha: float

    def apply(self, x: Array) -> Array:
        xp = namespace(x)
        return xp.where(x > 0, x, self.alpha * xp.expm1(x.clip(max=0)))


@dataclass(frozen=True, eq=False)
class LeakyRelu(_Function):
    """The leaky rectified linear unit: x if it is positive, else slope times x."""

    kind = "leaky_relu"
    slope: float

    def apply(self, x: Array) -> Array:
        return namespace(x).where(x > 0, x, self.slope * x)


@dataclass(frozen=True, eq=False)
class Concat(SavedLayer):
    """Puts an earlier result before the last one.

    Attributes:
        earlier: number of layers before that result; 0 for the observation.
    """

    kind = "concat"
    earlier: int

    def after(self, results: Sequence[Array]) -> Array:
        """See `SavedLayer.after`."""
        last = results[-1]
        return namespace(last).concat([results[int(self.earlier)], last], axis=-1)


_CLASSES: tuple[type[SavedLayer], ...] = (
    Linear,
    LayerNorm,
    Scale,
    Shift,
    Divide,
    Columns,
    Clip,
    Relu,
    Tanh,
    Sigmoid,
    Silu,
    Elu,
    LeakyRelu,
    Concat,
)

LAYERS = {layer.kind: layer for layer in _CLASSES}
"""The class of each kind of layer."""
