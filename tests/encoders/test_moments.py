"""Tests of scaling, moments and closed-form encoders, against numpy and hand-computed values."""

from functools import reduce
from types import SimpleNamespace

import numpy as np
import pytest

from jbench.encoders.kinds.linear import PrincipalComponents, RandomProjection
from jbench.encoders.scaling import Moments, Scaling

OBSERVATIONS = np.array([[0, 5, -1], [4, 5, 1], [1, 5, 3]], np.float32)


def correlated(rows=4000, size=6, seed=0):
    random = np.random.default_rng(seed)
    return random.normal(size=(rows, size)) @ random.normal(size=(size, size)) + 3.0


def fitted(kind, rows, latents, seed=0):
    """The weights of a kind that uses only the moments of the states."""
    states = SimpleNamespace(learned=Moments.of(rows), size=rows.shape[1], seed=seed)
    return kind.fit(states, latents)


def errors(kind, weights, rows):
    return np.mean((kind.decode(weights, kind.encode(weights, rows)) - rows) ** 2, axis=0)


def test_scaling_maps_extremes_to_one_and_constants_to_zero():
    gain, offset = Scaling.of(OBSERVATIONS).gain_and_offset()
    np.testing.assert_array_equal(gain, [0.5, 0, 0.5])
    np.testing.assert_array_equal(offset, [-1, 0, 0 - 0.5])
    np.testing.assert_array_equal(
        gain * OBSERVATIONS + offset, [[-1, 0, -1], [1, 0, 0], [-0.5, 0, 1]]
    )


@pytest.mark.parametrize("shift", [0, 1e6])
@pytest.mark.parametrize("cuts", [(), (1,), (10, 10, 2500), (3999,)])
def test_moments_of_blocks_equal_those_of_all_rows(cuts, shift):
    rows = correlated() + shift
    found = reduce(Moments.merged, map(Moments.of, np.split(rows, cuts)))
    assert found.rows == 4000
    np.testing.assert_allclose(found.mean, rows.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.covariance, np.cov(rows.T, bias=True), rtol=1e-7)


@pytest.mark.parametrize("latents", [1, 3, 6])
def test_principal_components_equal_singular_value_decomposition(latents):
    rows = correlated()
    weights = fitted(PrincipalComponents(), rows, latents)
    _, singular, directions = np.linalg.svd(rows - rows.mean(axis=0), full_matrices=False)
    aligned = np.abs(np.sum(weights["components"] * directions[:latents], axis=1))
    np.testing.assert_allclose(aligned, 1, atol=1e-9)
    left = errors(PrincipalComponents(), weights, rows).sum()
    assert left == pytest.approx((singular[latents:] ** 2).sum() / len(rows), abs=1e-9)
    latent = PrincipalComponents().encode(weights, rows)
    assert latent.shape == (4000, latents)
    np.testing.assert_allclose(latent.var(axis=0), singular[:latents] ** 2 / 4000, rtol=1e-9)


@pytest.mark.parametrize("latents", [1, 3, 6])
def test_random_projection_is_orthonormal_with_least_squares_decoder(latents):
    rows = correlated()
    weights = fitted(RandomProjection(), rows, latents, seed=5)
    projection = weights["projection"]
    np.testing.assert_allclose(projection @ projection.T, np.eye(latents), atol=1e-12)
    seen = np.c_[rows @ projection.T, np.ones(len(rows))]
    solved, *_ = np.linalg.lstsq(seen, rows, rcond=None)
    expected = np.mean((seen @ solved - rows) ** 2, axis=0)
    np.testing.assert_allclose(errors(RandomProjection(), weights, rows), expected, atol=1e-9)


def test_random_projection_depends_only_on_seed():
    drawn = [
        fitted(RandomProjection(), correlated(seed=data), latents, seed)["projection"]
        for data, latents, seed in ((0, 3, 7), (1, 3, 7), (0, 5, 7), (0, 3, 8))
    ]
    np.testing.assert_array_equal(drawn[0], drawn[1])
    np.testing.assert_array_equal(drawn[0], drawn[2][:3])
    assert not np.allclose(drawn[0], drawn[3])


def test_random_directions_are_uniform():
    rows = correlated()
    # The trace of a rotation drawn uniformly has mean 0 and variance 1.
    drawn = (fitted(RandomProjection(), rows, 6, seed)["projection"] for seed in range(400))
    traces = [np.trace(projection) for projection in drawn]
    assert np.mean(traces) == pytest.approx(0, abs=4 / np.sqrt(400))
    assert np.var(traces) == pytest.approx(1, abs=0.3)


@pytest.mark.parametrize("kind", [PrincipalComponents(), RandomProjection()])
def test_constant_column_is_reconstructed(kind):
    rows = correlated() * [1, 1, 0, 1, 1, 1]
    for latents in (1, 5, 6):
        weights = fitted(kind, rows, latents)
        left = errors(kind, weights, rows)
        assert np.isfinite(left).all()
        assert left[2] == pytest.approx(0, abs=1e-12)
    assert left.sum() == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("units", [(1, 1, 1), (180, 1, 1e-5), (1e6, 1, 1e-6)])
def test_regression_does_not_depend_on_the_units_of_its_inputs(units):
    inputs = np.random.default_rng(0).normal(size=(500, 3)) + 2
    targets = inputs @ [[1.0], [-2.0], [3.0]] + 5
    slopes, offset = Moments.of(np.hstack([inputs * units, targets])).regression(3)
    np.testing.assert_allclose(slopes[:, 0] * units, [1, -2, 3], rtol=1e-6)
    np.testing.assert_allclose(offset, 5, rtol=1e-6)


def test_constant_inputs_have_no_slope_and_equal_ones_share_it():
    varying = np.random.default_rng(0).normal(size=(500, 1))
    constant = np.full((500, 1), np.float32(0.1))
    rounded = constant + np.float32(1e-9) * varying  # below the rounding of float32
    rows = np.hstack([varying, constant, rounded, varying, 3 * varying + 1])
    slopes, offset = Moments.of(rows).regression(4)
    np.testing.assert_allclose(slopes[:, 0], [1.5, 0, 0, 1.5], atol=1e-9)
    np.testing.assert_allclose(offset, 1)
