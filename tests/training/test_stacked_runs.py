"""Tests of which runs share a process: on a GPU all seeds of a configuration are one stack."""

from itertools import chain

import pytest

from jbench.policies.saved import WEIGHTS
from jbench.settings.records import OFESettings
from jbench.simulation import find_task
from jbench.store import Results
from jbench.sweeps.executors import batches
from jbench.training import batched_run
from jbench.training.batched_run import run_batch
from tests.agents.test_batched_engine import TanhEncoder
from tests.training.small_runs import EPISODE, rows
from tests.training.test_batched_run import settings

FEATURES = {"representation": "ofe6", "ofe": OFESettings(units=6, layers=2)}
ENCODED = {"representation": "dae5", "encoder": "face_direction/dae5-00000000"}


class OtherEncoder(TanhEncoder):
    """A nonlinear encoder with as many latents."""

    def encode(self, batch):
        return -0.5 * super().encode(batch)


@pytest.mark.usefixtures("short_episodes")
def test_run_among_runs_with_other_encoders_equals_run_alone(tmp_path, monkeypatch):
    together, alone = Results(tmp_path / "together"), Results(tmp_path / "alone")
    runs = [settings("td3", seed, **ENCODED) for seed in (0, 3)]
    encoders = {0: TanhEncoder(), 3: OtherEncoder()}
    monkeypatch.setattr(batched_run, "load_run_encoder", lambda run, _: encoders[run.seed])
    assert run_batch(runs, together) == {}
    assert run_batch(runs[1:], alone) == {}
    found, expected = (results.find("run", runs[1].id) for results in (together, alone))
    assert rows(found) == rows(expected)
    assert found.read_file(WEIGHTS) == expected.read_file(WEIGHTS)


def test_seeds_of_configuration_share_process_on_gpu_and_are_divided_on_cpu():
    kinds = (
        {"task": "face_direction"},
        {"task": "move_from_origin"},
        ENCODED,
        FEATURES,
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


@pytest.mark.usefixtures("short_episodes")
def test_missing_encoder_fails_only_its_runs(tmp_path):
    runs = [settings("ddpg", 0, steps=EPISODE), settings("ddpg", 3, steps=EPISODE, **ENCODED)]
    assert list(run_batch(runs, Results(tmp_path))) == [runs[1].id]
    assert Results(tmp_path).find("run", runs[0].id).status == "finished"
