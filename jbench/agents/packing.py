"""Nested state of an agent as named tensors and JSON, and back."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from jbench.errors import WorkError

_SEQUENCES = {"list": list, "tuple": tuple}


def pack(value: Any, tensors: dict[str, Tensor], where: str = "state()") -> Any:
    """Returns a value as JSON; adds copies of its tensors and arrays to `tensors`.

    Args:
        value: dictionaries, lists and tuples of tensors, arrays, numbers, texts, booleans and None.
        tensors: by name, on the CPU.
        where: name of the value in errors.

    Raises:
        WorkError: if it contains anything else.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float) and not isinstance(value, np.generic):
        return value if math.isfinite(value) else {"float": str(value)}
    if isinstance(value, Mapping):
        pairs = [
            [pack(k, tensors, where), pack(v, tensors, f"{where}[{k!r}]")] for k, v in value.items()
        ]
        return {"dict": pairs}
    if isinstance(value, list | tuple):
        kind = "list" if isinstance(value, list) else "tuple"
        return {kind: [pack(one, tensors, f"{where}[{i}]") for i, one in enumerate(value)]}
    name = str(len(tensors))
    if isinstance(value, Tensor):
        tensors[name] = value.detach().cpu().clone().contiguous()
        return {"tensor": name}
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
        tensors[name] = torch.from_numpy(np.array(value, order="C"))
        return {"array" if isinstance(value, np.ndarray) else "number": name}
    raise WorkError(
        f"{where} of the agent is a {type(value).__name__}, which can't be saved: return tensors, "
        "arrays, numbers, texts, lists and dictionaries."
    )


def unpack(node: Any, tensors: Mapping[str, Tensor]) -> Any:
    """Returns the value that `pack` was given."""
    if not isinstance(node, dict):
        return node
    ((kind, content),) = node.items()
    if kind == "float":
        return float(content)
    if kind == "dict":
        return {unpack(k, tensors): unpack(v, tensors) for k, v in content}
    if kind in _SEQUENCES:
        return _SEQUENCES[kind](unpack(one, tensors) for one in content)
    tensor = tensors[content].clone()
    if kind == "tensor":
        return tensor
    array = tensor.numpy()
    return array if kind == "array" else array[()]
