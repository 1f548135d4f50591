"""Linear algebra of Gaussian processes, and weights of ensembles."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_triangular

from priorfill.gp.linalg import (
    block_residuals,
    explained_variance,
    inverse_root,
    power_weights,
    solve_blocks,
    squared_distances,
)
from priorfill.gp.triangular_kernels import BLOCK, LARGE


@given(st.integers(0, 2**31), st.integers(4, 25))
def test_closed_form_equals_leaving_blocks_out(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(count, 3))
    covariance = features @ features.T + np.eye(count) * 0.1
    targets = rng.normal(size=(count, 2))
    lengths = 1 + rng.permutation(count - 1)[:3]
    blocks = np.split(rng.permutation(count), np.sort(lengths))[1:]  # of several lengths
    found = block_residuals(inverse_root(covariance), np.linalg.solve(covariance, targets), blocks)
    expected = naive.left_out_residuals(covariance, targets, blocks)
    samples = np.concatenate(blocks)
    np.testing.assert_allclose(found[0], expected[0][samples], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found[1], expected[1][samples], rtol=1e-6, atol=1e-8)


def test_blocks_that_rounding_has_made_indefinite_are_solved() -> None:
    root, weights = np.eye(3), np.array([[1.0], [2.0], [3.0]])
    basis = np.array([[0.0], [2.0], [0.0]]), np.array([[0.0], [1.0], [0.0]])
    blocks = [np.array([0]), np.array([1, 2])]
    residuals, variance = block_residuals(root, weights, blocks, basis)
    np.testing.assert_array_equal(residuals, [[1.0], [-2.0], [3.0]])
    np.testing.assert_array_equal(variance, [1.0, -1.0, 1.0])
    root[0, 0] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        block_residuals(root, weights, blocks)


@given(st.integers(0, 2**31), st.integers(1, 25))
def test_inverse_root(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(count, count))
    covariance = features @ features.T + np.eye(count)
    root = inverse_root(covariance)
    np.testing.assert_array_equal(np.triu(root, 1), 0.0)
    np.testing.assert_allclose(root.T @ root, np.linalg.inv(covariance), rtol=1e-8, atol=1e-10)
    cross = rng.normal(size=(3, count))
    expected = [c @ np.linalg.inv(covariance) @ c for c in cross]
    np.testing.assert_allclose(explained_variance(root, cross), expected, rtol=1e-8)


@pytest.mark.parametrize("count", [BLOCK, BLOCK + 1, 257, LARGE - 1, LARGE])
def test_inverse_root_of_large_matrices_by_blocks(count: int) -> None:
    rng = np.random.default_rng(count)
    features = rng.normal(size=(count, 20))
    covariance = features @ features.T + 1e-3 * np.eye(count)
    root = inverse_root(covariance)
    expected = solve_triangular(np.linalg.cholesky(covariance), np.eye(count), lower=True)
    np.testing.assert_array_equal(np.triu(root, 1), 0.0)
    np.testing.assert_allclose(root, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


def test_jitter_makes_a_singular_covariance_positive_definite() -> None:
    root = inverse_root(np.ones((3, 3)))
    np.testing.assert_allclose(explained_variance(root, np.ones((1, 3))), 1.0, atol=1e-3)
    with pytest.raises(np.linalg.LinAlgError):
        inverse_root(-np.eye(3))


def test_squared_distances() -> None:
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(7, 4)), rng.normal(size=(5, 4))
    found = squared_distances(one @ other.T, (one**2).sum(axis=1), (other**2).sum(axis=1))
    for i in range(7):
        for j in range(5):
            assert np.isclose(found[i, j], np.linalg.norm(one[i] - other[j]) ** 2)
    large = 1e6 + rng.normal(size=(6, 4))
    product = large @ large.T
    assert squared_distances(product, np.diag(product), np.diag(product)).min() >= 0.0


def test_power_weights() -> None:
    np.testing.assert_allclose(power_weights(np.array([1.0, 2.0]), 2.0), [0.8, 0.2])
    np.testing.assert_allclose(power_weights(np.array([1.0, 2.0, 9.0]), 0.0), 1.0 / 3.0)
    error = np.random.default_rng(0).uniform(1.0, 9.0, size=(4, 6))
    weight = power_weights(error, 8.0)
    np.testing.assert_allclose(weight.sum(axis=0), 1.0)
    for marker in range(6):
        np.testing.assert_allclose(weight[:, marker], power_weights(error[:, marker], 8.0))


def test_blocks_are_solved_like_single_systems() -> None:
    rng = np.random.default_rng(0)
    for size in (1, 2, 3, 12):
        half = rng.normal(size=(7, size, size + 3))
        matrices = half @ np.swapaxes(half, 1, 2)
        right = rng.normal(size=(7, size, 4))
        found = solve_blocks(matrices, right)
        np.testing.assert_allclose(found, np.linalg.solve(matrices, right), rtol=1e-7, atol=1e-9)


def test_indefinite_and_empty_blocks() -> None:
    indefinite = np.array([[[1.0, 2.0], [2.0, 1.0]]])
    np.testing.assert_allclose(solve_blocks(indefinite, np.array([[[3.0], [3.0]]])), 1.0)
    assert solve_blocks(np.zeros((0, 2, 2)), np.zeros((0, 2, 1))).shape == (0, 2, 1)
    with pytest.raises(np.linalg.LinAlgError):
        solve_blocks(np.zeros((1, 2, 2)), np.ones((1, 2, 1)))


def test_values_that_are_not_finite_stay_in_their_block() -> None:
    right = np.ones((3, 2, 1))
    right[1, 0] = np.nan
    found = solve_blocks(np.tile(np.eye(2), (3, 1, 1)), right)
    assert np.isnan(found).any(axis=(1, 2)).tolist() == [False, True, False]


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_blocks_of_any_scale_are_solved(scale: float) -> None:
    matrices = scale * np.array([[[2.0, 1.0], [1.0, 2.0]], [[4.0, 0.0], [0.0, 1.0]]])
    found = solve_blocks(matrices, scale * np.array([[[3.0], [3.0]], [[4.0], [5.0]]]))
    np.testing.assert_allclose(found[..., 0], [[1.0, 1.0], [1.0, 5.0]])
