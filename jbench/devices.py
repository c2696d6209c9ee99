"""Choice of the device that trains agents or encoders."""

import re
from typing import TYPE_CHECKING

from jbench.errors import RequestError
from jbench.names import DEVICES, Precision, in_prose

if TYPE_CHECKING:
    import torch


def find_device(name: str) -> "torch.device":
    """Returns the device "cpu", "cuda", "cuda:N" (one of several GPUs) or "auto" (a GPU, if any).

    Raises a RequestError if the name is unknown, or there is no such device.
    """
    import torch

    number = re.fullmatch(r"cuda:(\d{1,9})", name)
    if number is None and name not in DEVICES:
        raise RequestError(f"Unknown device {name!r}; choose {in_prose((*DEVICES, 'cuda:1'))}.")
    if name == "cpu" or (name == "auto" and not torch.cuda.is_available()):
        return torch.device("cpu")
    if not torch.cuda.is_available():
        raise RequestError("There is no CUDA device here that torch can use; type --device cpu.")
    if number is None:
        return torch.device("cuda")

    index = int(number[1])
    count = torch.cuda.device_count()
    if index >= count:
        there = in_prose([f"cuda:{i}" for i in range(count)])
        raise RequestError(f"There is no device {name} here; type --device {there}.")

    return torch.device("cuda", index)


def check_precision(precision: Precision, device: str) -> None:
    """Raises a RequestError if a device, such as cpu or cuda:1, does not have a precision."""
    if precision == "tf32" and device == "cpu":
        raise RequestError("Only a GPU has the precision tf32; type float32 or bfloat16.")
