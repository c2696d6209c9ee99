"""Torch modules as policies that are saved as data and evaluated without torch."""

import operator
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, fx, nn
from torch.nn import functional

from jbench.errors import RequestError
from jbench.policies.acting import acting
from jbench.policies.network import SavedLayer, SavedNetwork, linear_layer
from jbench.wording import counted

_TOLERANCE = 1e-4  # of actions; float32 sums in another order differ by less
_CHECKED = 16  # random observations

_PLAIN: dict[Any, str] = {
    **dict.fromkeys((nn.ReLU, functional.relu, torch.relu, torch.relu_, "relu", "relu_"), "relu"),
    **dict.fromkeys((nn.Tanh, functional.tanh, torch.tanh, "tanh", "tanh_"), "tanh"),
    **dict.fromkeys((nn.Sigmoid, functional.sigmoid, torch.sigmoid, "sigmoid"), "sigmoid"),
    **dict.fromkeys((nn.SiLU, functional.silu), "silu"),
}
"""Layers without parameters by the module, the function or the method that applies them."""

_IDENTITY = (nn.Identity, nn.Dropout, nn.Flatten, "contiguous", "float")
_CLAMPS = (torch.clamp, torch.clip, functional.hardtanh, "clamp", "clip")
_ARITHMETIC: dict[Any, str] = {
    **dict.fromkeys((operator.add, torch.add, operator.iadd), "add"),
    **dict.fromkeys((operator.sub, torch.sub, operator.isub), "sub"),
    **dict.fromkeys((operator.mul, torch.mul, operator.imul), "mul"),
    **dict.fromkeys((operator.truediv, torch.div, operator.itruediv), "div"),
}


class UnsupportedPolicyError(RequestError):
    """A policy is not a sequence of layers that jbench can save."""

    def __init__(self, why: str) -> None:
        """Makes the error; `why` is a clause."""
        self.why = why
        super().__init__(
            f"This policy can't be kept: {why}; pass a module that applies Linear, LayerNorm, "
            "ReLU, tanh and the like one after another, such as nn.Sequential, and returns the "
            "action."
        )


def copy_module(module: object, inputs: int, outputs: int) -> SavedNetwork:
    """Returns a copy of a module as a policy.

    The computation is traced (`torch.fx`), and the result is compared with the module on random
    observations.

    Args:
        module: takes observations (n, inputs) and returns actions (n, outputs).
        inputs: size of an (encoded) observation.
        outputs: size of an action.

    Raises:
        UnsupportedPolicyError: if it is not a sequence of supported layers.
    """
    if not isinstance(module, nn.Module):
        raise UnsupportedPolicyError(f"its type is {type(module).__name__}, no torch module")
    # The module that torch.compile wraps, and a Sequential since a root module is traced into.
    module = nn.Sequential(getattr(module, "_orig_mod", module))
    try:
        graph = fx.Tracer().trace(module)
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UnsupportedPolicyError(f"its computation can't be traced ({reason})") from None
    network = SavedNetwork(_Chain(module, graph).layers())
    _check(network, module, inputs, outputs)
    return network


class _Chain:
    """Reads the layers of a traced module, each of which takes the result of the one before."""

    def __init__(self, module: nn.Module, graph: fx.Graph) -> None:
        self._module, self._graph = module, graph

    def layers(self) -> list[SavedLayer]:
        """Returns the layers, found backwards from the action to the observation.

        Raises:
            UnsupportedPolicyError: if one is not supported, or takes several results.
        """
        layers: list[SavedLayer] = []
        node = next(node for node in self._graph.nodes if node.op == "output").args[0]
        while True:
            if not isinstance(node, fx.Node):
                raise UnsupportedPolicyError(
                    "it returns something else than one tensor, the action"
                )
            if node.op == "placeholder":
                return layers
            before = [given for given in node.all_input_nodes if given.op != "get_attr"]
            if len(before) != 1:
                raise UnsupportedPolicyError(f"{node.name} takes {len(before)} results, not one")
            layers = [*self._node_layers(node, before[0]), *layers]
            node = before[0]

    def _node_layers(self, node: fx.Node, before: fx.Node) -> list[SavedLayer]:
        """Returns the layers of a node that takes the result of one other node."""
        if node.op == "call_module":
            return module_layers(self._module.get_submodule(str(node.target)))
        target: Any = node.target
        if target in _PLAIN:
            return [SavedLayer(_PLAIN[target])]
        if target in _IDENTITY:
            return []
        arguments = [None if value is before else self._value(value) for value in node.args]
        if target in _CLAMPS:
            return [_clamp(arguments[1:], node.kwargs)]
        if target in _ARITHMETIC and len(arguments) == 2 and not node.kwargs:
            return _arithmetic(_ARITHMETIC[target], arguments)
        raise UnsupportedPolicyError(f"{node.name} is not supported")

    def _value(self, argument: Any) -> Any:
        """Returns a number, or the parameter or buffer that an argument stands for."""
        if not isinstance(argument, fx.Node):
            return argument
        return operator.attrgetter(str(argument.target))(self._module)


def module_layers(module: nn.Module) -> list[SavedLayer]:
    """Returns the layers of a module of torch.

    Raises:
        UnsupportedPolicyError: if it is not supported.
    """
    kind = type(module)
    if kind in _PLAIN:
        return [SavedLayer(_PLAIN[kind])]
    if kind in _IDENTITY:
        return []
    if isinstance(module, nn.Linear):
        bias = torch.zeros(module.out_features) if module.bias is None else module.bias
        return [linear_layer(float32_array(module.weight), float32_array(bias))]
    if isinstance(module, nn.LayerNorm) and len(module.normalized_shape) == 1:
        size = module.normalized_shape
        weight = torch.ones(size) if module.weight is None else module.weight
        bias = torch.zeros(size) if module.bias is None else module.bias
        arrays = {"weight": float32_array(weight), "bias": float32_array(bias)}
        return [SavedLayer("layer_norm", arrays, {"epsilon": module.eps})]
    if isinstance(module, nn.ELU):
        return [SavedLayer("elu", numbers={"alpha": module.alpha})]
    if isinstance(module, nn.LeakyReLU):
        return [SavedLayer("leaky_relu", numbers={"slope": module.negative_slope})]
    if isinstance(module, nn.Hardtanh):
        return [SavedLayer("clip", numbers={"low": module.min_val, "high": module.max_val})]
    raise UnsupportedPolicyError(f"the layer {kind.__name__} is not supported")


def _clamp(arguments: Sequence[Any], named: Mapping[str, Any]) -> SavedLayer:
    """Returns the layer of torch.clamp or functional.hardtanh."""
    bounds = [*arguments, *named.values()]
    if len(bounds) != 2 or not all(isinstance(bound, int | float) for bound in bounds):
        raise UnsupportedPolicyError("a clamp has no two numbers as its bounds")
    return SavedLayer("clip", numbers={"low": float(min(bounds)), "high": float(max(bounds))})


def _arithmetic(name: str, arguments: Sequence[Any]) -> list[SavedLayer]:
    """Returns the layers of an operation of the value so far (None) and a constant."""
    value_first = arguments[0] is None
    constant = float32_array(arguments[1 if value_first else 0])
    if constant.ndim > 1 and constant.shape[:-1] != (1,) * (constant.ndim - 1):
        raise UnsupportedPolicyError("a constant is a matrix")
    constant = constant.reshape(-1)
    if name == "add":
        return [SavedLayer("shift", {"offset": constant})]
    if name == "mul":
        return [SavedLayer("scale", {"factor": constant})]
    if name == "sub" and value_first:
        return [SavedLayer("shift", {"offset": -constant})]
    if name == "sub":
        minus = np.array([-1], np.float32)
        return [SavedLayer("scale", {"factor": minus}), SavedLayer("shift", {"offset": constant})]
    if name == "div" and value_first:
        return [SavedLayer("scale", {"factor": np.reciprocal(constant)})]
    raise UnsupportedPolicyError("it divides by its inputs")


def float32_array(value: Any) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Returns a copy of a tensor or a number as float32."""
    if isinstance(value, Tensor):
        value = value.detach().to("cpu", torch.float32).numpy()
    return np.array(value, np.float32)


def _check(network: SavedNetwork, module: nn.Module, inputs: int, outputs: int) -> None:
    """Compares a policy with the module that it was made from."""
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
