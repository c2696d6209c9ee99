"""What an agent returns as its state, as JSON and named tensors, and back."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from jbench.errors import WorkError


def pack(value: Any, tensors: dict[str, Tensor], where: str = "state()") -> Any:
    """Returns a value as JSON; adds copies of its tensors and arrays to `tensors`, on the CPU.

    What `Agent.state` may not return is a WorkError, which names it as `where`.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float) and not isinstance(value, np.generic):
        return value if math.isfinite(value) else {"float": str(value)}

    if isinstance(value, Mapping):
        pairs = [
            [pack(key, tensors, where), pack(item, tensors, f"{where}[{key!r}]")]
            for key, item in value.items()
        ]
        return {"dict": pairs}

    if isinstance(value, list | tuple):
        kind = "list" if isinstance(value, list) else "tuple"
        return {kind: [pack(item, tensors, f"{where}[{i}]") for i, item in enumerate(value)]}

    name = str(len(tensors))
    if isinstance(value, Tensor):
        tensors[name] = value.detach().cpu().clone().contiguous()
        return {"tensor": name}
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
        tensors[name] = torch.from_numpy(np.array(value, order="C"))
        return {"array" if isinstance(value, np.ndarray) else "number": name}

    raise WorkError(
        f"{where} of the agent is of the type {type(value).__name__}, which can't be saved: return "
        "tensors, arrays, numbers, texts, lists and dictionaries."
    )


def unpack(node: Any, tensors: Mapping[str, Tensor]) -> Any:
    """Returns the value that `pack` was given."""
    if not isinstance(node, dict):
        return node

    ((kind, content),) = node.items()
    if kind == "float":
        return float(content)
    if kind == "dict":
        return {unpack(key, tensors): unpack(item, tensors) for key, item in content}
    if kind in ("list", "tuple"):
        items = [unpack(item, tensors) for item in content]
        return items if kind == "list" else tuple(items)

    tensor = tensors[content].clone()
    if kind == "tensor":
        return tensor

    array = tensor.numpy()
    return array if kind == "array" else array[()]
