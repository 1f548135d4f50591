"""What Gaussian processes share."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from priorfill.gp.linalg import (
    explained,
    inverse_root,
    left_out_residuals,
    shares,
    squared_distances,
)


@given(st.integers(0, 2**31), st.integers(4, 25))
def test_closed_form_equals_leaving_blocks_out(seed: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(rows, 3))
    kernel = features @ features.T + np.eye(rows) * 0.1
    targets = rng.normal(size=(rows, 2))
    blocks = np.array_split(np.arange(rows), min(4, rows))
    found = left_out_residuals(inverse_root(kernel), np.linalg.solve(kernel, targets), blocks)
    expected = naive.left_out_residuals(kernel, targets, blocks)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-6, atol=1e-8)


@given(st.integers(0, 2**31), st.integers(1, 25))
def test_a_root_of_the_inverse(seed: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(rows, rows))
    covariance = features @ features.T + np.eye(rows)
    root = inverse_root(covariance)
    np.testing.assert_array_equal(np.triu(root, 1), 0.0)
    np.testing.assert_allclose(root.T @ root, np.linalg.inv(covariance), rtol=1e-8, atol=1e-10)
    cross = rng.normal(size=(3, rows))
    expected = [c @ np.linalg.inv(covariance) @ c for c in cross]
    np.testing.assert_allclose(explained(root, cross), expected, rtol=1e-8)


def test_rounding_that_leaves_a_covariance_singular_does_no_harm() -> None:
    root = inverse_root(np.ones((3, 3)))
    np.testing.assert_allclose(explained(root, np.ones((1, 3))), 1.0, atol=1e-3)
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


def test_shares() -> None:
    np.testing.assert_allclose(shares(np.array([1.0, 2.0]), 2.0), [0.8, 0.2])
    np.testing.assert_allclose(shares(np.array([1.0, 2.0, 9.0]), 0.0), 1.0 / 3.0)
    error = np.random.default_rng(0).uniform(1.0, 9.0, size=(4, 6))
    share = shares(error, 8.0)
    np.testing.assert_allclose(share.sum(axis=0), 1.0)
    for marker in range(6):
        np.testing.assert_allclose(share[:, marker], shares(error[:, marker], 8.0))
