"""Gaussian-process regression against scikit-learn and against fitting again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process import kernels as sk

from priorfill.gp.kernels import RBF, Constant, Linear, Matern52, Pairs
from priorfill.gp.process import FittedGP, GaussianProcess

KERNEL = Constant() + 0.3 * Linear() + 2.0 * RBF(0.8)
NOISE = 0.05


def reference(x: np.ndarray, y: np.ndarray, noise: np.ndarray | float) -> GaussianProcessRegressor:
    kernel = sk.ConstantKernel(1.0, "fixed") + sk.ConstantKernel(0.3, "fixed") * sk.DotProduct(
        0.0, "fixed"
    )
    kernel += sk.ConstantKernel(2.0, "fixed") * sk.RBF(0.8, "fixed")
    return GaussianProcessRegressor(kernel, alpha=noise, optimizer=None).fit(x, y)


def samples(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 2)), rng.normal(size=(count, 3))


def fit(x: np.ndarray, y: np.ndarray, noise: np.ndarray | None = None) -> FittedGP:
    return GaussianProcess(KERNEL, NOISE).fit(Pairs.of_features(x, x), y, noise_variance=noise)


@pytest.mark.parametrize("each", [False, True], ids=["one noise", "a noise for each sample"])
def test_predictions(each: bool) -> None:
    x, y = samples(0, 20)
    noise = np.linspace(0.01, 0.3, 20) if each else None
    queries = samples(1, 6)[0]
    mean, variance = fit(x, y, noise).predict(Pairs.of_features(queries, x))
    process = reference(x, y, NOISE if noise is None else noise)
    expected, std = process.predict(queries, return_std=True)
    np.testing.assert_allclose(mean, expected, rtol=1e-8)
    np.testing.assert_allclose(variance, std[:, 0] ** 2, rtol=1e-8)


@given(st.integers(0, 2**31), st.integers(5, 20))
def test_held_out_blocks(seed: int, count: int) -> None:
    x, y = samples(seed, count)
    blocks = np.array_split(np.arange(count), 3)[1:]
    residuals, variance = fit(x, y).leave_blocks_out(blocks)
    assert np.isnan(variance[: blocks[0][0]]).all()
    assert np.isnan(residuals[: blocks[0][0]]).all()
    for block in blocks:
        rest = np.setdiff1d(np.arange(count), block)
        mean, std = reference(x[rest], y[rest], NOISE).predict(x[block], return_std=True)
        np.testing.assert_allclose(residuals[block], y[block] - mean, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(variance[block], std[:, 0] ** 2 + NOISE, rtol=1e-6)


def test_held_out_neighbours_may_overlap() -> None:
    x, y = samples(2, 12)
    points = np.array([3, 4, 9])
    neighbours = [np.arange(point - 2, point + 3) for point in points]
    residuals, variance = fit(x, y).leave_neighbours_out(points, neighbours)
    for place, (point, block) in enumerate(zip(points, neighbours, strict=True)):
        expected = fit(x, y).leave_blocks_out([block])
        np.testing.assert_array_equal(residuals[place], expected[0][point])
        assert variance[place] == expected[1][point]


def kriging(t: np.ndarray, y: np.ndarray, queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Universal kriging with a line, by Lagrange multipliers."""
    reference = sk.Matern(0.3, nu=2.5)
    count = len(t)
    system = np.zeros((count + 2, count + 2))
    system[:count, :count] = reference(t[:, None]) + NOISE * np.eye(count)
    system[:count, count:] = np.stack([np.ones(count), t], axis=1)
    system[count:, :count] = system[:count, count:].T
    right = np.concatenate(
        [reference(queries[:, None], t[:, None]), np.stack([np.ones(len(queries)), queries], 1)], 1
    )
    solved = np.linalg.solve(system, right.T).T
    return solved[:, :count] @ y, 1.0 - (solved * right).sum(axis=1)


def line(t: np.ndarray) -> np.ndarray:
    return np.stack([np.ones_like(t), t], axis=1)


def test_free_basis_functions() -> None:
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(size=10))
    y = 5.0 + 100.0 * t[:, None] + rng.normal(size=(10, 2))
    queries = np.linspace(-0.5, 1.5, 7)
    process = GaussianProcess(Matern52(0.3), NOISE)
    fitted = process.fit(Pairs.of_times(t, t), y, basis=line(t))
    mean, variance = fitted.predict(Pairs.of_times(queries, t), basis=line(queries))
    expected = kriging(t, y, queries)
    np.testing.assert_allclose(mean, expected[0], rtol=1e-7)
    np.testing.assert_allclose(variance, expected[1], rtol=1e-6)

    weights, _ = process.fit(Pairs.of_times(t, t), np.eye(10), basis=line(t)).predict(
        Pairs.of_times(queries, t), basis=line(queries)
    )
    np.testing.assert_allclose(weights @ y, mean, rtol=1e-7)

    blocks = [np.arange(3), np.arange(5, 7), np.arange(7, 10)]
    residuals, held_out = fitted.leave_blocks_out(blocks)
    for block in blocks:
        rest = np.setdiff1d(np.arange(10), block)
        expected = kriging(t[rest], y[rest], t[block])
        np.testing.assert_allclose(residuals[block], y[block] - expected[0], rtol=1e-6)
        np.testing.assert_allclose(held_out[block], expected[1] + NOISE, rtol=1e-6)


def test_scale_is_the_restricted_maximum_of_the_likelihood() -> None:
    rng = np.random.default_rng(4)
    t = np.linspace(0.0, 1.0, 12)
    covariance = sk.Matern(0.3, nu=2.5)(t[:, None]) + NOISE * np.eye(12)
    y = rng.normal(size=(12, 2)) * [1.0, 9.0]
    fitted = GaussianProcess(Matern52(0.3), NOISE).fit(Pairs.of_times(t, t), y, basis=line(t))
    # contrasts: combinations of the samples without a line
    contrasts = np.linalg.svd(line(t))[0][:, 2:]
    whitened = np.linalg.solve(
        np.linalg.cholesky(contrasts.T @ covariance @ contrasts), contrasts.T @ y
    )
    assert fitted.scale is not None
    np.testing.assert_allclose(fitted.scale, (whitened**2).mean(axis=0), rtol=1e-8)


def test_a_basis_is_needed_at_the_queries_too() -> None:
    t = np.arange(4.0)
    fitted = GaussianProcess(Matern52(1.0), NOISE).fit(
        Pairs.of_times(t, t), t[:, None], basis=line(t)
    )
    with pytest.raises(ValueError, match="give them here"):
        fitted.predict(Pairs.of_times(t, t))
