"""Numpy computations written down as ONNX nodes.

A `Traced` array is passed to a function in place of a numpy array. Through numpy's protocols
(`__array_ufunc__`, `__array_function__`, `__array_namespace__`) each operation on it adds nodes to
a graph instead of computing numbers. So any function of numpy operations that the graph knows,
such as an encoder of another package, can be exported without code of its own.
"""

from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

import numpy as np
import onnx
from numpy.lib.mixins import NDArrayOperatorsMixin
from onnx import helper, numpy_helper

_LAST = np.array([-1], np.int64)  # the last axis, as an input of a node

_UFUNCS: dict[np.ufunc, str] = {
    np.add: "Add",
    np.subtract: "Sub",
    np.multiply: "Mul",
    np.divide: "Div",
    np.negative: "Neg",
    np.matmul: "MatMul",
    np.maximum: "Max",
    np.minimum: "Min",
    np.absolute: "Abs",
    np.sqrt: "Sqrt",
    np.exp: "Exp",
    np.log: "Log",
    np.tanh: "Tanh",
    np.sin: "Sin",
    np.cos: "Cos",
    np.greater: "Greater",
    np.greater_equal: "GreaterOrEqual",
    np.less: "Less",
    np.less_equal: "LessOrEqual",
    np.logical_and: "And",
    np.logical_or: "Or",
    np.logical_not: "Not",
}
"""Operators of ONNX that equal a function of numpy."""


class Graph:
    """The nodes and constants of a computation in float32."""

    def __init__(self) -> None:
        """Makes an empty graph."""
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def input(self, name: str) -> "Traced":
        """Returns an input of the graph."""
        return Traced(self, name)

    def add(self, operator: str, *inputs: Any, output: str | None = None, **more: Any) -> "Traced":
        """Adds a node; inputs are traced arrays or constants, `more` the operator's attributes."""
        names = [self._name_of(value) for value in inputs]
        name = output or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, names, [name], **more))
        return Traced(self, name)

    def _name_of(self, value: Any) -> str:
        if isinstance(value, Traced):
            return value.name
        array = np.asarray(value)
        if array.dtype not in (np.bool_, np.int64) or not isinstance(value, np.ndarray):
            array = array.astype(np.float32)
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(array, name))
        return name


class Traced(NDArrayOperatorsMixin):
    """A float32 array whose values are not known yet.

    Operations that the graph has no node for raise TypeError or AttributeError.
    """

    dtype = np.dtype(np.float32)

    def __init__(self, graph: Graph, name: str) -> None:
        """Refers to a value of the graph."""
        self.graph, self.name = graph, name

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **more: Any) -> Any:
        if method != "__call__" or more:
            return NotImplemented
        if ufunc is np.square:
            return self.graph.add("Mul", self, self)
        if ufunc is np.expm1:
            return self.graph.add("Sub", self.graph.add("Exp", self), 1.0)
        if ufunc is np.maximum and np.isscalar(inputs[1]) and inputs[1] == 0:
            return self.graph.add("Relu", self)
        if ufunc not in _UFUNCS:
            return NotImplemented
        return self.graph.add(_UFUNCS[ufunc], *inputs)

    def __array_function__(
        self, function: Callable[..., Any], types: Any, args: Any, more: Any
    ) -> Any:
        if function not in _FUNCTIONS:
            return NotImplemented
        return _FUNCTIONS[function](self.graph, *args, **more)

    def __array_namespace__(self, api_version: str | None = None) -> ModuleType:
        return np

    def __getitem__(self, key: Any) -> "Traced":
        if not (isinstance(key, tuple) and len(key) == 2 and key[0] is Ellipsis):
            raise TypeError(f"only the last axis can be indexed, not [{key}]")
        index = key[1]
        if isinstance(index, int):
            return self.graph.add("Gather", self, np.array(index, np.int64), axis=-1)
        if isinstance(index, slice) and index.step in (None, 1):
            end = np.iinfo(np.int64).max if index.stop is None else index.stop
            bounds = (np.array([number], np.int64) for number in (index.start or 0, end))
            return self.graph.add("Slice", self, *bounds, _LAST)
        raise TypeError(f"the last axis can't be indexed by {index}")

    def astype(self, dtype: Any, copy: bool = True) -> "Traced":
        """Returns the array itself: all of the graph is float32."""
        return self

    def mean(self, axis: int, keepdims: bool = False) -> "Traced":
        """Returns the mean over an axis."""
        axes = np.array([axis], np.int64)
        return self.graph.add("ReduceMean", self, axes, keepdims=int(keepdims))


def _clip(graph: Graph, values: Any, low: float, high: float) -> Traced:
    return graph.add("Clip", values, np.float32(low), np.float32(high))


def _where(graph: Graph, condition: Any, if_true: Any, if_false: Any) -> Traced:
    return graph.add("Where", condition, if_true, if_false)


def _concatenate(graph: Graph, arrays: Sequence[Any], axis: int = 0) -> Traced:
    return graph.add("Concat", *arrays, axis=axis)


def _stack(graph: Graph, arrays: Sequence[Any], axis: int = 0) -> Traced:
    axes = np.array([axis], np.int64)
    return graph.add("Concat", *(graph.add("Unsqueeze", one, axes) for one in arrays), axis=axis)


_FUNCTIONS: dict[Callable[..., Any], Callable[..., Traced]] = {
    np.clip: _clip,
    np.where: _where,
    np.concatenate: _concatenate,
    np.stack: _stack,
}
"""Functions of numpy that are not ufuncs."""
