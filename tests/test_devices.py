"""Tests of the choice of a device, and of what is said of a precision that it is slow in."""

import pytest
import torch

from jbench.commands import run_checks
from jbench.devices import find_device, slowdown_of_bfloat16
from jbench.errors import RequestError
from tests.training.small_runs import small_run


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


@pytest.mark.parametrize(
    ("slowdown", "precision", "is_warned"),
    [(18.0, "bfloat16", True), (0.4, "bfloat16", False), (18.0, "float32", False)],
)
def test_bfloat16_on_a_processor_without_it_is_warned_of(
    slowdown, precision, is_warned, capsys, monkeypatch
):
    monkeypatch.setattr(run_checks, "slowdown_of_bfloat16", lambda: slowdown)
    lengths = {"steps": 10_000, "evaluate_every": 5_000, "evaluate_episodes": 1}
    run = small_run("td3", {}, precision=precision, **lengths)
    run_checks.check_runs([run], "no", "cpu")
    said = "Warning: this processor multiplies in bfloat16 18.0 times as slowly as in float32"
    assert (said in capsys.readouterr().err) is is_warned


def test_slowdown_of_bfloat16_is_measured():
    assert slowdown_of_bfloat16() > 0
