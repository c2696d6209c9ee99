"""Tests that the log of a run keeps the paths of its first and its latest evaluation."""

import numpy as np
import pytest

from jbench.simulation.rollout import Path
from jbench.store import Results
from jbench.training.log import Position, RunLog


@pytest.fixture
def record(tmp_path):
    return Results(tmp_path).create("run", "r", {"task": "move_to_pose"})


def evaluate(log, number):
    """Adds an evaluation whose path has two points."""
    start = np.array([0, 0, number], np.float32)
    path = Path(np.stack([start, start + 0.5]), {"x": 0.25, "yaw": float(number)})
    log.evaluation(1000 * (number + 1), [1.0], path)


def numbers(record):
    return record.read("paths")["evaluation"].to_pylist()


def test_latest_path_replaces_previous_one(record):
    log = RunLog(record)
    for number, kept in enumerate(([0, 0], [0, 0, 1, 1], [0, 0, 2, 2])):
        evaluate(log, number)
        log.commit()
        assert numbers(record) == kept
        assert len(record.parts("paths")) == 1
    log.commit()
    assert numbers(record) == [0, 0, 2, 2]
    assert record.rows("evaluations") == 3
    last = record.read("paths").to_pylist()[-1]
    assert last == {
        **{"run": "r", "evaluation": 2, "control_steps": 3000, "time": np.float32(0.2)},
        **{"x": 0.5, "y": 0.5, "heading": 2.5},
        **{"target_x": 0.25, "target_y": None, "target_yaw": 2.0},
    }


def test_paths_after_resumed_checkpoint_are_dropped(record):
    log = RunLog(record)
    for number in range(3):
        evaluate(log, number)
    log.commit()
    resumed = RunLog(record, Position(evaluations=2))
    resumed.commit()
    assert numbers(record) == [0, 0]
    evaluate(resumed, 2)
    resumed.commit()
    assert numbers(record) == [0, 0, 2, 2]
    # Nothing is dropped, and the path of the last evaluation is kept.
    RunLog(record, Position(evaluations=3)).commit()
    assert numbers(record) == [0, 0, 2, 2]


def test_resumed_older_run_has_path_of_last_evaluation_only(record):
    log = RunLog(record)
    log.evaluation(1000, [1.0])
    log.commit()
    assert record.parts("paths") == []
    resumed = RunLog(record, Position(evaluations=1))
    for number in (1, 2):
        evaluate(resumed, number)
        resumed.commit()
    assert numbers(record) == [2, 2]
