"""Choice of the device that trains agents or encoders."""

import re
import time
from typing import TYPE_CHECKING

from jbench.cores import one_thread
from jbench.errors import RequestError
from jbench.names import DEVICES, Precision
from jbench.wording import in_prose

if TYPE_CHECKING:
    import torch

_MEASURED_SECONDS = 0.1  # of matrix products, for each precision


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


def slowdown_of_bfloat16() -> float:
    """Returns how many times as long matrix products take in bfloat16 as in float32, measured here.

    A processor without instructions for bfloat16 (AMX, AVX-512 BF16) converts each number, and
    takes many times as long. The products are those of a hidden layer of 350 and 250 units, in one
    thread, as agents are trained.
    """
    import torch

    with one_thread():
        return _seconds_of_product(torch.bfloat16) / _seconds_of_product(torch.float32)


def _seconds_of_product(dtype: "torch.dtype") -> float:
    """Returns the seconds that a product of a minibatch and a layer takes, in this thread."""
    import torch

    inputs = torch.ones(256, 350, dtype=dtype)
    weights = torch.ones(350, 250, dtype=dtype)
    taken: list[float] = []
    while sum(taken) < _MEASURED_SECONDS:
        began = time.perf_counter()  # the time of a thread is coarse on Windows
        torch.mm(inputs, weights)
        taken.append(time.perf_counter() - began)

    # Other work on the machine only adds to a time.
    return min(taken)
