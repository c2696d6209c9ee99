"""Tests of the cache of results by the content of their arguments."""

from functools import partial

import numpy as np
import pytest

from jbench.remembered import content_hash, recall, remembered, remembering
from jbench.report.figure import Style


@pytest.fixture
def total():
    """A function that counts its calls in `total.calls`."""

    def sum_of(values, *, factor=1):
        call.calls += 1
        return factor * np.sum(values)

    sum_of.__qualname__ = "sum_of"
    call = remembered(sum_of)
    call.calls = 0
    return call


def test_equal_arguments_are_computed_once(total):
    with remembering():
        assert [total(np.arange(3.0)), total(np.arange(3.0))] == [3, 3]
        assert total.calls == 1
        assert [total(np.arange(4.0)), total(np.arange(3.0), factor=2)] == [6, 6]
        assert total.calls == 3


def test_results_are_cached_only_within_block(total):
    with remembering():
        total(np.ones(1))
    total(np.ones(1))
    with remembering():
        total(np.ones(1))
    assert total.calls == 3


def test_results_unused_in_last_round_are_dropped(total):
    with remembering() as memory:
        total(np.ones(1))
        total(np.ones(2))
        for _ in range(3):
            memory.next_round()
            total(np.ones(1))
        assert total.calls == 2
        total(np.ones(2))
        assert total.calls == 3


def test_unhashable_arguments_are_computed_each_time():
    made = []
    with remembering():
        for _ in range(2):
            recall(lambda: None, lambda: made.append(1))
    assert made == [1, 1]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("a", "b"), ("ab",)),
        (("a", ("b",)), (("a",), "b")),
        ("1", 1),
        (1, 1.0),
        (1, True),
        (None, "None"),
        (np.zeros(4), np.zeros((2, 2))),
        (np.zeros(4), np.zeros(4, np.int64)),
        (np.zeros(2), np.array([0.0, -0.0])),
        ({"a": 1}, {"a": 2}),
        (Style("red"), Style("red", width=2.0)),
        (partial(max, 1), partial(max, 2)),
        (np.mean, np.sum),
    ],
)
def test_different_contents_have_different_hashes(one, other):
    assert content_hash(one) == content_hash(one)
    assert content_hash(one) != content_hash(other)
