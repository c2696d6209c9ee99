"""Tests of reading datasets by parts in any order, and of invalid rows."""

import tracemalloc

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from jbench.datasets import Dataset
from jbench.errors import RequestError, WorkError
from jbench.store import Results, schema

TASK = "move_to_pose"


@pytest.fixture(scope="module")
def tables(six_episodes):
    """The rows of the first file: episodes 0 and 1."""
    return {
        table: six_episodes.read_part(six_episodes.parts(table)[0], columns)
        for table, columns in (
            ("steps", schema.STEPS),
            ("dataset_episodes", schema.DATASET_EPISODES),
        )
    }


@pytest.fixture
def altered(tmp_path, tables):
    """Returns a function that makes a dataset of these tables, some of them replaced."""

    def make(**changed):
        record = Results(tmp_path).create("dataset", "random/a", {})
        record.append({**tables, **changed})
        record.finish({}, join=False)
        return Dataset(record)

    return make


def with_value(table, column, row, value):
    """Returns the table with another value in one cell."""
    values = table[column].to_pylist()
    values[row] = value
    index = table.column_names.index(column)
    kind = table.schema.field(column).type
    return table.set_column(index, column, pa.array(values, kind, from_pandas=False))


def test_parts_are_episodes_of_each_file(dataset):
    assert dataset.parts == (range(0, 2), range(2, 4), range(4, 6))
    assert dataset.episodes == 6


@pytest.mark.parametrize("parts", [[2, 0], [1], [], iter([0, 1]), [1, 1]])
def test_parts_are_read_in_requested_order(dataset, parts):
    parts = list(parts)
    everything = list(dataset.blocks(TASK))
    found = list(dataset.blocks(TASK, parts=iter(parts)))
    assert len(found) == len(parts)
    for number, block in zip(parts, found, strict=True):
        for ours, theirs in zip(everything[number], block, strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_unknown_task_is_refused(dataset):
    for read in (lambda task: next(dataset.blocks(task)), dataset.observations):
        with pytest.raises(RequestError, match="Unknown task 'face_directoin'; did you mean face_"):
            read("face_directoin")


def test_only_one_file_is_in_memory_at_a_time(dataset):
    # Observations, actions and rewards of two episodes.
    block = 4 * 2 * (1001 * 19 + 1000 + 1000)
    for _ in dataset.blocks(TASK):  # one-time allocations
        pass
    tracemalloc.start()
    for _ in dataset.blocks(TASK, parts=[0, 1, 2] * 5):
        pass
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10 * block  # 15 blocks are read; one needs less than this


ALTERATIONS = {
    "NaN": ("steps", "velocity_x", 7, np.nan, "infinite values in the column velocity_x;"),
    "infinite": ("steps", "action", 3, np.inf, "infinite values in the column action;"),
    "no number": ("steps", "position_z", 5, None, "holds empty cells in the column position_z"),
    "no target": ("dataset_episodes", f"{TASK}_target_yaw", 0, None, f"column {TASK}_target_yaw"),
    "no action": ("steps", "action", 999, None, "holds a state without its action"),
    "an action too many": ("steps", "action", 1000, 0.5, "or an action after the last state"),
    "another step": ("steps", "step", 10, 11, "holds other rows than those of whole episodes"),
    "another's target": ("dataset_episodes", "episode", 0, 4, "holds other rows than those"),
}


@pytest.mark.parametrize("alteration", ALTERATIONS.values(), ids=ALTERATIONS)
def test_invalid_rows_are_refused(altered, tables, alteration):
    table, column, row, value, message = alteration
    found = altered(**{table: with_value(tables[table], column, row, value)})
    for read in (lambda: list(found.blocks(TASK)), lambda: found.observations(TASK)):
        with pytest.raises(WorkError) as error:
            read()
        assert message in str(error.value)
        assert str(error.value).startswith(f"{found.record.parts('steps')[0].name} of the dataset")
        assert str(error.value).endswith(f"; collect it again after deleting {found.record.path}.")


def test_incomplete_episode_or_missing_file_is_refused(altered, tables):
    found = altered(steps=tables["steps"].slice(0, 1500))
    with pytest.raises(WorkError, match="holds other rows than those of whole episodes"):
        found.observations(TASK)
    found = altered(steps=tables["steps"].slice(0, 0))
    with pytest.raises(WorkError, match="The manifest of the dataset random/a lacks files"):
        list(found.blocks(TASK))


def test_column_of_wrong_type_is_refused(altered, tables):
    words = pc.cast(tables["steps"]["position_x"], pa.string())
    words = pc.replace_substring(words, "0", "o")
    found = altered(steps=tables["steps"].set_column(2, "position_x", words))
    with pytest.raises(WorkError, match=r"random/a/.* is damaged"):
        list(found.blocks(TASK))
