"""What the scan and the kd-tree share: axes, rounding errors of bounds, order of neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "FLOAT32_ROUNDING",
    "POSES_PER_THREAD",
    "TINY_ERROR",
    "in_order",
    "principal_axes",
    "rounding_of_squares",
]

FLOAT32_ROUNDING = 2.0**-24
"""Relative rounding error of a single-precision operation."""

ROUNDINGS_PER_DIMENSION = 8
"""Upper limit of the single-precision rounding errors in a square or bound, per dimension: a square
is a sum over the dimensions, and the squared distance from a chord is computed from three of
them."""

TINY_ERROR = 1e-9
"""mm. Added to rounding errors: bounds by shorter chords, and squares of smaller distances, have
larger ones."""

POSES_PER_THREAD = 2**17
"""Poses for which another thread pays when they are transformed, or a search is built: some ten
milliseconds of work."""


def rounding_of_squares(dimensions: int) -> float:
    """Return an upper limit of the relative rounding error of a square in single precision."""
    return ROUNDINGS_PER_DIMENSION * (dimensions + 4) * FLOAT32_ROUNDING


def principal_axes(sample: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """Return the axes along which poses differ most [shape=(count, dimensions)].

    Parameters
    ----------
    sample : ndarray of float32 [shape=(poses, dimensions), mm]
        Some of the poses. Any axes give the same neighbours.
    count : int
        Number of axes; those beyond the number of dimensions are 0.
    """
    centred = sample - sample.mean(axis=0)
    # eigenvalues ascend: poses differ most along the last axes
    _, axes = np.linalg.eigh((centred.T @ centred).astype(np.float64))
    leading = np.zeros((count, sample.shape[1]), dtype=np.float32)
    leading[: sample.shape[1]] = axes[:, ::-1][:, :count].T
    return leading


def in_order(
    squares: NDArray[np.float64], rows: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the neighbours of queries in ascending order of distance, then of row.

    Parameters
    ----------
    squares : ndarray [shape=(queries, k), mm²]
    rows : ndarray of int [shape=(queries, k)]
    """
    order = np.lexsort((rows, squares))
    return np.take_along_axis(squares, order, axis=1), np.take_along_axis(rows, order, axis=1)
