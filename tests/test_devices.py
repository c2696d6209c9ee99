"""Tests of `find_device`, which resolves the name of a device."""

import pytest
import torch

from jbench.devices import find_device
from jbench.errors import RequestError


@pytest.fixture
def gpus(monkeypatch):
    """Returns a function that fakes a number of GPUs."""

    def pretend(count):
        monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
        monkeypatch.setattr(torch.cuda, "device_count", lambda: count)

    return pretend


def test_auto_is_gpu_if_available(gpus):
    gpus(0)
    assert find_device("auto") == find_device("cpu") == torch.device("cpu")
    gpus(1)
    assert find_device("auto") == find_device("cuda") == torch.device("cuda")
    assert find_device("cpu") == torch.device("cpu")
    gpus(2)
    assert find_device("cuda:1") == torch.device("cuda", 1)


@pytest.mark.parametrize(
    ("count", "name", "sentence"),
    [
        (0, "cuda", "There is no CUDA device here that torch can use; type --device cpu."),
        (0, "cuda:1", "There is no CUDA device here that torch can use; type --device cpu."),
        (1, "cuda:1", "There is no device cuda:1 here; type --device cuda:0."),
        (3, "cuda:12", "There is no device cuda:12 here; type --device cuda:0, cuda:1 or cuda:2."),
        (1, "cuda:-1", "Unknown device 'cuda:-1'; choose auto, cpu, cuda or cuda:1."),
        (1, "gpu", "Unknown device 'gpu'; choose auto, cpu, cuda or cuda:1."),
    ],
)
def test_missing_or_unknown_device_is_refused(gpus, count, name, sentence):
    gpus(count)
    with pytest.raises(RequestError) as caught:
        find_device(name)
    assert str(caught.value) == sentence
