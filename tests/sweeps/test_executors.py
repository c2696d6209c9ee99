"""Tests of which runs share a process: on a GPU all seeds of a configuration are one stack."""

from itertools import chain

from jbench.settings.records import OFESettings
from jbench.simulation import find_task
from jbench.sweeps.executors import batches
from tests.training.test_batched_run import ENCODED, settings


def test_seeds_of_configuration_share_process_on_gpu_and_are_divided_on_cpu():
    kinds = (
        {"task": "face_direction"},
        {"task": "move_from_origin"},
        ENCODED,
        {"representation": "ofe6", "ofe": OFESettings(units=6, layers=2)},
        {"precision": "bfloat16"},
        {"augment": 1},
        {"task": "dmc:cheetah-run", "specs": find_task("dmc:cheetah-run").specs},
    )
    configurations = [[settings("td3", seed, **kind) for seed in (0, 3, 4)] for kind in kinds]
    others = [[settings("td3", seed, engine="sb3")] for seed in (0, 3)]
    runs = list(chain(*configurations, *others))
    for jobs, device in ((1, "cuda"), (4, "cuda"), (1, "cpu")):
        assert batches(runs, jobs, device) == [*configurations, *others]
    halves = [part for seeds in configurations for part in (seeds[:2], seeds[2:])]
    assert batches(runs, 2, "cpu") == [*halves, *others]
