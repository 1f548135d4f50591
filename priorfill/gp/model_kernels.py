"""Compiled loops that fit the models of one alignment, and predict with them.

Arrays in, arrays out: no options, no checks. Models are Gaussian processes with the covariance of
`priorfill.gp.pose_process.PoseProcess`. A gap has dozens of them, and a clip hundreds of gaps: one
by one, the calls would take longer than the matrices, and threads would wait for each other's.

A tuple of arrays is passed where they describe one thing. Terms of a model are its linear and its
squared exponential variance, minus half of the inverse squared length scale, and its noise
variance; its places are the numbers of its features, its factor, and what is added.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.block_kernels import hold_out_blocks
from priorfill.gp.triangular_kernels import factor, invert, multiply, whiten, whiten_twice
from priorfill.runtime.compiled import compiled
from priorfill.runtime.elementary_kernels import exponentials

__all__ = ["covariances", "fit_models", "predict_models"]

_Floats = NDArray[np.float64]
_Indices = NDArray[np.intp]
_Work = NDArray[np.int64]

LINEAR, RBF, EXPONENT, NOISE = range(4)
"""Terms of a model, by their places."""

FEATURES, FACTOR, ADDED = range(3)
"""Places of a model."""


@compiled()
def _similarities(
    product: _Floats,
    norms: tuple[_Floats, _Floats],
    exponent: float,
    upper: bool,
    line: _Floats,
    similarity: _Floats,
) -> None:
    """Write the squared exponential of each pair of poses, or of the upper triangle alone."""
    one, other = norms
    count = product.shape[1]
    for i in range(product.shape[0]):
        first = i if upper else 0
        for j in range(first, count):
            square = one[i] + other[j] - 2.0 * product[i, j]
            line[j] = exponent * (square if square > 0.0 else 0.0)
        exponentials(line[first:], similarity[i, first:])


@compiled()
def covariances(
    features: tuple[_Floats, _Floats, _Floats],
    shared: tuple[_Floats, _Floats],
    models: tuple[_Floats, _Indices],
    upper: bool,
    work: tuple[_Floats, _Floats],
    result: _Floats,
) -> None:
    """Write the covariances of poses a with training poses b by each model.

    Parameters
    ----------
    features : tuple of ndarray [shapes=(lags, a, b), (lags, a), (lags, b)]
        Inner products of the poses' features, and squared norms.
    shared : tuple of ndarray [shapes=(factors, a, b), (added, a, b)]
        What the covariances of poses are multiplied by, and what is added to them.
    models : tuple of ndarray [shapes=(models, 4), (models, 3)]
        Terms and places. Exponentials that neighbouring models have in common are computed once.
    upper : bool
        For the training poses themselves: the upper triangle alone, with noise, and zeros below.
    work : tuple of ndarray [shapes=(a, b), (b,)]
        Overwritten; finite.
    result : ndarray [shape=(models, a, b)]
        Written.
    """
    terms, places = models
    similarity, line = work
    count = result.shape[2]
    computed, exponent = -1, 0.0
    for model in range(len(terms)):
        own = places[model, FEATURES]
        linear, rbf = terms[model, LINEAR], terms[model, RBF]
        product = features[0][own]
        if rbf > 0.0 and (computed != own or exponent != terms[model, EXPONENT]):
            computed, exponent = own, terms[model, EXPONENT]
            norms = features[1][own], features[2][own]
            _similarities(product, norms, exponent, upper, line, similarity)
        by, added = shared[0][places[model, FACTOR]], shared[1][places[model, ADDED]]
        covariance = result[model]
        for i in range(len(product)):
            first = i if upper else 0
            for j in range(first):
                covariance[i, j] = 0.0
            for j in range(first, count):
                of_poses = 1.0 + linear * product[i, j] + rbf * similarity[i, j]
                covariance[i, j] = of_poses * by[i, j] + added[i, j]
            if upper:
                covariance[i, i] += terms[model, NOISE]


@compiled()
def _squared_norm(x: _Floats) -> float:
    """Return the sum of squares: four sums, as each addition waits for the one before."""
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for j in range(0, len(x) - 3, 4):
        a += x[j] * x[j]
        b += x[j + 1] * x[j + 1]
        c += x[j + 2] * x[j + 2]
        d += x[j + 3] * x[j + 3]
    for j in range(len(x) // 4 * 4, len(x)):
        a += x[j] * x[j]
    return (a + b) + (c + d)


@compiled()
def fit_models(
    start: int,
    blocks: tuple[_Indices, _Indices],
    work: tuple[_Floats, _Floats, _Work],
    fitted: tuple[_Floats, _Floats],
    left_out: tuple[_Floats, _Floats],
) -> int:
    """Fit models, and predict held-out blocks of training poses from all others.

    Parameters
    ----------
    start : int
        The first model to be fitted.
    blocks : tuple of ndarray of int
        The poses of each block, one block after the other, and where each starts, and the end.
    work : tuple of ndarray
        Of `hold_out_blocks`; overwritten.
    fitted : tuple of ndarray [shapes=(models, poses, poses), (models, poses, outputs)]
        The upper triangles of the covariances and the targets, which are replaced by R', where R'R
        is the inverse covariance, and this inverse times the targets.
    left_out : tuple of ndarray [shapes=(models, held-out poses, outputs), (models, held-out poses)]
        Written: residuals and variances, as of `hold_out_blocks`.

    Returns
    -------
    int
        The first model whose covariance is not positive definite, or their number.
    """
    blas = work[2]
    nothing = fitted[1][0][:, :0]
    for model in range(start, len(fitted[0])):
        root, weights = fitted[0][model], fitted[1][model]
        if not (factor(root, len(root), blas) and invert(root, len(root), blas)):
            return model
        whiten_twice(root, weights, blas)
        hold_out_blocks(
            root,
            weights,
            (nothing, nothing),
            blocks,
            work,
            left_out[0][model],
            left_out[1][model],
        )
    return len(fitted[0])


@compiled()
def predict_models(
    cross: _Floats,
    fitted: tuple[_Floats, _Floats],
    blas: _Work,
    mean: _Floats,
    explained: _Floats,
) -> None:
    """Predict queries.

    Parameters
    ----------
    cross : ndarray [shape=(models, queries, poses)]
        Covariances of the queries with the training poses; overwritten.
    fitted : tuple of ndarray
        As of `fit_models`.
    blas : ndarray of int
        See `priorfill.gp.triangular_kernels.blas_work`.
    mean : ndarray [shape=(models, queries, outputs)]
        Written.
    explained : ndarray [shape=(models, queries)]
        Written: the variances that the training poses explain.
    """
    for model in range(len(cross)):
        multiply(cross[model], fitted[1][model], mean[model], blas)
        whiten(fitted[0][model], cross[model], blas)
        for i in range(cross.shape[1]):
            explained[model, i] = _squared_norm(cross[model, i])
