"""Compiled models of one alignment against single Gaussian processes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.gp.kernels import RBF, Constant, Kernel, Linear, Pairs
from priorfill.gp.linalg import joined_blocks
from priorfill.gp.model_kernels import covariances, fit_models, predict_models
from priorfill.gp.process import GaussianProcess
from priorfill.gp.triangular_kernels import blas_work


@dataclass(frozen=True)
class Given(Kernel):
    """A kernel whose matrices are known."""

    matrices: dict[int, np.ndarray]  # by the number of points of the first set

    def evaluate(self, pairs: Pairs) -> np.ndarray:
        return self.matrices[pairs.shape[0]]

    def variance(self, pairs: Pairs) -> float:
        return 0.0

    __hash__ = object.__hash__


def positive(rng: np.random.Generator, size: int) -> np.ndarray:
    x = rng.normal(size=(size, 4))
    return x @ x.T / 4.0


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**31),
    poses=st.integers(4, 30),
    queries=st.integers(1, 8),
    outputs=st.integers(1, 4),
    simulated=st.booleans(),
)
def test_models_are_single_processes(
    seed: int, poses: int, queries: int, outputs: int, simulated: bool
) -> None:
    rng = np.random.default_rng(seed)
    queries += poses  # so that the sets differ in size
    models, lags = 5, 2
    known, asked = (rng.normal(size=(lags, count, 6)) for count in (poses, queries))
    square = lambda x: (x**2).sum(axis=2)  # noqa: E731
    terms = np.stack(
        [
            rng.uniform(0.1, 30.0, models),
            rng.choice([0.0, 0.5, 3.0], models),
            rng.choice([-0.5, -0.1], models),  # neighbours may share one
            rng.uniform(1e-3, 1e-1, models),
        ],
        axis=1,
    )
    places = np.stack([rng.integers(0, n, models) for n in (lags, 2, 2)], axis=1)
    factor, added = (np.stack([positive(rng, poses) for _ in range(2)]) for _ in range(2))
    factor_of_query, added_to_query = rng.normal(size=(2, 2, queries, poses))
    targets = rng.normal(size=(poses, outputs))
    edges = np.sort(rng.permutation(poses - 1)[:3] + 1)
    blocks = [b for b in np.split(rng.permutation(poses), edges) if len(b)][1:]
    gaps = [np.sort(rng.permutation(poses)[:3])] if simulated else []

    roots, weights = np.empty((models, poses, poses)), np.repeat(targets[None], models, axis=0)
    held_out = [*blocks, *gaps]
    count, longest = sum(map(len, held_out)), max(map(len, held_out))
    residuals, variance = np.empty((models, count, outputs)), np.empty((models, count))
    blas = blas_work()
    features = known @ np.swapaxes(known, 1, 2), square(known), square(known)
    work = np.zeros((poses, poses)), np.empty(poses)
    covariances(features, (factor, added), (terms, places), 1, work, roots)
    fitted = fit_models(
        0,
        joined_blocks(held_out),
        (np.empty((longest, poses)), np.empty((longest, longest)), blas),
        (roots, weights),
        (residuals, variance),
    )
    assert fitted == models
    mean, explained = np.empty((models, queries, outputs)), np.empty((models, queries))
    crossed = np.empty((models, queries, poses))
    features = asked @ np.swapaxes(known, 1, 2), square(asked), square(known)
    work = np.zeros((queries, poses)), np.empty(poses)
    covariances(features, (factor_of_query, added_to_query), (terms, places), 0, work, crossed)
    predict_models(crossed, (roots, weights), blas, mean, explained)

    for model, (lag, by, plus) in enumerate(places):
        linear, rbf, exponent, noise = terms[model]
        kernel = Constant() + linear * Linear() + rbf * RBF(np.sqrt(-0.5 / exponent))
        kernel *= Given({poses: factor[by], queries: factor_of_query[by]})
        kernel += Given({poses: added[plus], queries: added_to_query[plus]})
        train = Pairs.of_features(known[lag], known[lag])
        single = GaussianProcess(kernel, noise).fit(train, targets)
        tolerance = {"rtol": 1e-6, "atol": 1e-6 * max(1.0, np.abs(single.weights).max())}
        np.testing.assert_allclose(weights[model], single.weights, **tolerance)
        rows = np.concatenate(held_out)
        for some, part in ((blocks, slice(0, count - 3 * len(gaps))), (gaps, slice(-3, None))):
            if some:
                expected = single.leave_blocks_out(some)
                found = residuals[model, part], variance[model, part]
                np.testing.assert_allclose(found[0], expected[0][rows[part]], **tolerance)
                np.testing.assert_allclose(found[1], expected[1][rows[part]], **tolerance)
        cross = kernel(Pairs.of_features(asked[lag], known[lag]))
        inverse = single.root.T @ single.root
        np.testing.assert_allclose(mean[model], cross @ single.weights, **tolerance)
        expected = np.einsum("qa,ab,qb->q", cross, inverse, cross)
        np.testing.assert_allclose(explained[model], expected, **tolerance)


def test_the_first_model_that_cannot_be_fitted() -> None:
    roots, weights = np.stack([np.eye(3), np.ones((3, 3)), np.eye(3)]), np.ones((3, 3, 1))
    work = np.empty((1, 3)), np.empty((1, 1)), blas_work()
    left = np.empty((3, 1, 1)), np.empty((3, 1))

    def fit(start: int) -> int:
        blocks = joined_blocks([np.array([1])])
        return fit_models(start, blocks, work, (roots, weights), left)

    assert fit(0) == 1
    roots[1] = 2.0 * np.eye(3)
    assert fit(1) == 3
    np.testing.assert_allclose(weights[:, 0, 0], [1.0, 0.5, 1.0])
    np.testing.assert_allclose(left[1][:, 0], [1.0, 2.0, 1.0])
