"""Exact k nearest neighbours by comparing all poses: for few of them, where nothing else pays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["nearest_by_brute_force"]

PAIRS = 2**20
"""Squared distances held at a time: 8 MB."""

ROUNDING, OPERATIONS = 2.0**-53, 8
"""Relative error of an operation of double precision, and how many for each dimension squares
by the matrix product are off by, at most. What it cannot tell apart is measured."""


def nearest_by_brute_force(
    poses: NDArray[np.float32], queries: NDArray[np.float32], k: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Find the k nearest poses of each query, the nearest first, equally near ones by row.

    Parameters
    ----------
    poses : ndarray [shape=(poses, dimensions), mm]
        The poses to search among.
    queries : ndarray [shape=(queries, dimensions), mm]
        None missing.
    k : int
        How many neighbours, at most the number of poses.

    Returns
    -------
    square : ndarray [shape=(queries, k), mm²]
        Squared distances, summed in the order of the dimensions.
    rows : ndarray of int [shape=(queries, k)]
        Of the poses.
    """
    square = np.empty((len(queries), k))
    rows = np.empty((len(queries), k), dtype=np.int64)
    among = poses.astype(np.float64)
    norms = np.einsum("pd,pd->p", among, among)
    lost = OPERATIONS * (poses.shape[1] + 4) * ROUNDING
    step = max(1, PAIRS // len(poses))
    for at in range(0, len(queries), step):
        asked = queries[at : at + step].astype(np.float64)
        nearly = asked @ (-2.0 * among.T)
        nearly += norms
        limit = np.partition(nearly, k - 1, axis=1)[:, k - 1]
        limit += lost * (norms.max() + np.einsum("qd,qd->q", asked, asked))
        query, row = np.nonzero(nearly <= limit[:, None])
        away = np.zeros(len(row))
        for d in range(poses.shape[1]):
            away += (among[row, d] - asked[query, d]) ** 2
        order = np.lexsort((row, away, query))
        first = np.searchsorted(query, np.arange(len(asked)))  # `query` ascends
        chosen = order[first[:, None] + np.arange(k)]
        square[at : at + step], rows[at : at + step] = away[chosen], row[chosen]
    return square, rows
