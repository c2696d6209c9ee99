"""Tests of stacks of runs from several cells: their results, and which runs may share a stack."""

from itertools import chain

import pytest
import safetensors.torch
import torch

from jbench.policies.saved import WEIGHTS
from jbench.settings.records import OFESettings
from jbench.simulation import find_task
from jbench.store import Results
from jbench.sweeps.executors import batches
from jbench.training.batched_run import run_batch
from jbench.training.environment import load_encoders_of
from jbench.training.memory import memory_sentence, stacks_for_memory
from tests.agents.killed_run import stack_seeds
from tests.agents.test_batched_engine import TanhEncoder
from tests.training.small_runs import EPISODE, paths, resumed, rows
from tests.training.test_batched_run import settings
from tests.training.test_memory import run as large_run

ENCODER = TanhEncoder()
FEATURES = {"representation": "ofe6", "ofe": OFESettings(units=6, layers=2)}
ROBOTS = ("dmc:cheetah-run", "dmc:walker-run", "dmc:hopper-hop")  # 6, 6 and 4 motors
ENCODED = {"representation": "dae5", "encoder": "face_direction/dae5-00000000"}


def cells_of(algo, **changes):
    """Three cells of two seeds each."""
    kinds = {}, {"task": "move_from_origin"}, ENCODED
    return [[settings(algo, seed, **kind, **changes) for seed in (0, 3)] for kind in kinds]


def assert_close(found, expected):
    """Compares the rows of two records up to rounding, because a stack sums in another order."""
    assert len(rows(found)) == len(rows(expected)) > 0
    for row, its_row in zip(rows(found), rows(expected), strict=True):
        assert row.keys() == its_row.keys()
        for name, value in its_row.items():
            near = pytest.approx(value, rel=1e-3) if isinstance(value, float) else value
            assert row[name] == near, name
    assert paths(found) == paths(expected)


def flat(cells):
    return list(chain(*cells))


@pytest.mark.usefixtures("short_episodes")
@pytest.mark.parametrize("algo", ["ddpg", pytest.param("ppo", marks=pytest.mark.slow)])
def test_runs_resume_across_stacks_of_different_cells(algo, tmp_path, monkeypatch):
    changes = {"steps": 3 * EPISODE, "evaluate_episodes": 1, "parallel": 1}
    first, second, third = cells_of(algo, **changes)
    cells = [first[:1], second[1:], third[:1]]
    runs, encoders = flat(cells), [None, None, ENCODER]
    moved, whole, events = Results(tmp_path / "moved"), Results(tmp_path / "whole"), []

    def together(**options):
        with monkeypatch.context() as patch:
            stack_seeds(patch.setattr)
            failures = run_batch(runs, moved, encoders, report=events.append, **options)
            assert failures == {}

    together(until=EPISODE)
    assert [moved.find("run", run.id).rows("episodes") for run in runs] == [1] * 3
    for cell, encoder in zip(cells, encoders, strict=True):
        assert run_batch(cell, moved, encoder, until=2 * EPISODE) == {}
        assert run_batch(cell, whole, encoder) == {}
    together()
    assert resumed(events, runs) == [(run.seed, 2 * EPISODE, "") for run in runs]
    for run, size in zip(runs, (16, 15, 5), strict=True):
        record = moved.find("run", run.id)
        assert (record.status, record.manifest.summary["together"]) == ("finished", 3)
        assert_close(record, whole.find("run", run.id))
        tensors = safetensors.torch.load(record.read_file(WEIGHTS))
        assert (8, size) in [tuple(tensor.shape) for tensor in tensors.values()]


def ids(parts):
    return [[run.id for run in part] for part in parts]


def test_gpu_trains_all_cells_of_algorithm_together():
    td3, ddpg = cells_of("td3"), cells_of("ddpg")
    apart = [
        [settings("td3", seed, **kind) for seed in (0, 3)]
        for kind in (
            {"precision": "bfloat16"},
            FEATURES,
            {**FEATURES, "task": "move_from_origin"},
            {"augment": 1},
            {"augment": 1, "task": "move_from_origin"},
            *({"task": task, "specs": find_task(task).specs} for task in ROBOTS),
            {"engine": "sb3"},
        )
    ]
    cells = [*td3, *ddpg, *apart]
    runs = flat(cells)
    alone = [[run] for run in apart[-1]]
    assert ids(batches(runs, 1, "cuda")) == ids([flat(td3), flat(ddpg), *apart[:-1], *alone])
    # Two processes never split a cell.
    halves = [[*td3[0], *td3[1]], td3[2]]
    assert ids(batches(flat(td3), 2, "cuda")) == ids(halves)
    assert ids(batches(runs, 1, "cpu")) == ids([*cells[:-1], *alone])


def test_networks_without_hidden_layers_are_not_stacked_across_cells():
    cells = cells_of("ppo")
    linear = [
        [
            run.model_copy(update={"hyperparameters": {**run.hyperparameters, "hidden_layers": []}})
            for run in cell
        ]
        for cell in cells
    ]
    assert ids(batches(flat(linear), 1, "cuda")) == ids(linear)


@pytest.fixture
def gpu_of_4_gb(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (4_000_000_000, 9))


@pytest.mark.usefixtures("gpu_of_4_gb")
def test_cells_that_exceed_gpu_memory_are_several_stacks():
    # 48 runs with a million rows of 19 + 2 numbers, 84 MB each, need 4.03 GB; 3.2 GB fit.
    tasks = ("move_from_origin", "face_direction", "move_in_direction", "move_to_pose")
    cells = [[large_run(task=task, seed=seed) for seed in range(12)] for task in tasks]
    runs = flat(cells)
    assert stacks_for_memory(runs, "cuda") == 2
    assert ids(batches(runs, 1, "cuda")) == ids([flat(cells[:2]), flat(cells[2:])])
    assert stacks_for_memory(runs, "cuda", jobs=2) == 3
    assert stacks_for_memory(runs[:12], "cuda") == 1
    assert "of 48 runs will take up to 4.0 GB of the GPU's memory" in memory_sentence(runs, "cuda")


def test_process_has_at_most_500_runs_of_several_cells():
    tasks = ("move_from_origin", "face_direction", "move_in_direction")
    cells = [[large_run("ppo", task=task, seed=seed) for seed in range(200)] for task in tasks]
    assert [len(part) for part in batches(flat(cells), 1, "cuda")] == [400, 200]


def test_missing_encoder_fails_only_runs_of_its_cell(tmp_path):
    full, _, encoded = cells_of("td3")
    encoders, failures = load_encoders_of([*full, *encoded], Results(tmp_path))
    assert encoders == {None: None}
    assert list(failures) == [run.id for run in encoded]
