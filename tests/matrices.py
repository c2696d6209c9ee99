"""Matrices of parameters: fast tests try a diagonal of one, slow tests the other combinations."""

from itertools import product

import pytest


def diagonal(*axes):
    """Returns all combinations of a value of each axis; those off the diagonal are slow.

    The diagonal has one combination for each value of the longest axis, and has each value of the
    others with as many values of the rest as there are such combinations.
    """
    longest = max(axes, key=len)
    fast = {_indices(number, axes, longest) for number in range(len(longest))}
    combinations = zip(product(*(range(len(axis)) for axis in axes)), product(*axes), strict=True)
    return [
        pytest.param(*values, marks=() if indices in fast else pytest.mark.slow)
        for indices, values in combinations
    ]


def _indices(number, axes, longest):
    """Returns the place in each axis of a combination of the diagonal."""
    indices = []
    repeats = 1
    for axis in axes:
        if axis is longest:
            indices.append(number)
            continue
        indices.append(number // repeats % len(axis))
        repeats *= len(axis)
    return tuple(indices)
