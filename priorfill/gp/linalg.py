"""What Gaussian processes share: distances, inverses, blocks left out, shares in a mixture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["explained", "inverse_root", "left_out_residuals", "shares", "squared_distances"]

ROWS_AT_ONCE = 64
"""Rows of a triangular matrix multiplied together: of fewer, more is spent on the way than is
saved."""

MORE_NOISE = (1e-14, 1e-12, 1e-10, 1e-8)
"""Parts of a covariance matrix's mean variance that are added in turn to its diagonal, where
rounding has left it not positive definite."""


def squared_distances(
    product: NDArray[np.float64], one: NDArray[np.float64], other: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return squared distances of features, none below 0 by rounding [shape=(a, b)].

    Parameters
    ----------
    product : ndarray [shape=(a, b)]
        Inner products of the features.
    one, other : ndarray [shapes=(a,), (b,)]
        Inner product of each with itself.
    """
    square: NDArray[np.float64] = np.maximum(one[:, None] + other - 2.0 * product, 0.0)
    return square


def shares(error: NDArray[np.float64], power: float) -> NDArray[np.float64]:
    """Return how much each of several ways to predict counts in their mixture.

    Parameters
    ----------
    error : ndarray [shape=(ways, ...)]
        Of each, above 0.
    power : float
        They count as (least error / own error) to this: between the mean of all (0) and the
        best alone (infinite).

    Returns
    -------
    ndarray [shape as given]
        Sum 1 over the ways.
    """
    share: NDArray[np.float64] = (error.min(axis=0) / error) ** power
    share /= share.sum(axis=0)
    return share


def inverse_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lower triangular R with R'R = the inverse of a covariance matrix.

    It says all that the inverse does, and takes a third of the time.

    Parameters
    ----------
    covariance : ndarray [shape=(rows, rows)]
        Positive definite, but perhaps for the last bit.

    Returns
    -------
    ndarray [shape=(rows, rows)]
        In the order of Fortran.
    """
    from scipy.linalg.lapack import dpotrf, dtrtri  # slow to import

    factor, failed = dpotrf(covariance, lower=True, clean=True)
    for more in MORE_NOISE:
        if not failed:
            break
        noise = more * np.trace(covariance) / len(covariance)
        factor, failed = dpotrf(covariance + noise * np.eye(len(covariance)), lower=True)
    root, singular = dtrtri(factor, lower=True, overwrite_c=True)
    if failed or singular:
        raise np.linalg.LinAlgError("a covariance matrix is not positive definite")
    inverse: NDArray[np.float64] = root
    return inverse


def explained(root: NDArray[np.float64], cross: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how much of their variance rows explain of queries: c' inv(C) c [shape=(queries,)].

    Parameters
    ----------
    root : ndarray [shape=(rows, rows)]
        `inverse_root` of the rows' covariance C.
    cross : ndarray [shape=(queries, rows)]
        Covariance of the queries with the rows, c of each.
    """
    share = np.zeros(len(cross))
    # The root is triangular: parts of its rows need so many columns only. BLAS has a product for
    # that, but the way to it from Python lets no other thread work meanwhile.
    for start in range(0, len(root), ROWS_AT_ONCE):
        stop = min(start + ROWS_AT_ONCE, len(root))
        turned = cross[:, :stop] @ root[start:stop, :stop].T  # (queries, some rows)
        share += np.einsum("qr,qr->q", turned, turned)
    return share


def left_out_residuals(
    root: NDArray[np.float64],
    weights: NDArray[np.float64],
    blocks: Sequence[NDArray[np.intp]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Residuals of a Gaussian process when blocks of rows are left out, in closed form.

    Parameters
    ----------
    root : ndarray [shape=(rows, rows)]
        `inverse_root` of the rows' covariance with noise.
    weights : ndarray [shape=(rows, outputs)]
        The inverse times what the rows should be predicted as.
    blocks : sequence of ndarray of int
        Rows of each block, ascending.

    Returns
    -------
    residuals : ndarray [shape=(rows, outputs)]
        Target minus prediction from all rows outside the row's block; NaN outside all blocks.
    variance : ndarray [shape=(rows,)]
        Predicted variance of each residual, noise included, in units of the kernel.
    """
    residuals = np.full_like(weights, np.nan)
    variance = np.full(len(weights), np.nan)
    by_length: dict[int, list[NDArray[np.intp]]] = {}
    for block in blocks:
        by_length.setdefault(len(block), []).append(block)
    for alike in by_length.values():
        rows = np.stack(alike)  # (blocks, rows of each)
        own = root.T[rows]  # (blocks, rows of each, rows)
        covariance = np.linalg.inv(own @ np.swapaxes(own, 1, 2))
        residuals[rows] = covariance @ weights[rows]
        variance[rows] = np.diagonal(covariance, axis1=1, axis2=2)
    return residuals, variance
