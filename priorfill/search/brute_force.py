"""Exact k nearest neighbours by comparing all poses.

The neighbours are those of `priorfill.search.index`, the y_i of Eqs. (1)-(4) of Baumann et al.
2011. For few poses this is faster than compiled loops, which have to be compiled first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["BruteForce", "nearest_by_brute_force"]

PAIRS_PER_BATCH = 2**20
"""Squared distances held at a time: 8 MB."""

FLOAT64_ROUNDING = 2.0**-53
"""Relative rounding error of a double-precision operation."""

ROUNDINGS_PER_DIMENSION = 8
"""Upper limit of the rounding errors in a square from the matrix product, per dimension. Poses that
it cannot distinguish are measured directly."""


def nearest_by_brute_force(
    poses: NDArray[np.float32], queries: NDArray[np.float32], k: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Find the k nearest poses of each query, in ascending order of distance, then of row.

    Parameters
    ----------
    poses : ndarray [shape=(poses, dimensions), mm]
        The poses to search.
    queries : ndarray [shape=(queries, dimensions), mm]
        Without missing values.
    k : int
        Number of neighbours, at most the number of poses.

    Returns
    -------
    squares : ndarray [shape=(queries, k), mm²]
        Squared distances, summed in the order of the dimensions.
    rows : ndarray of int [shape=(queries, k)]
        Rows of the poses.

    See Also
    --------
    PoseIndex : The same for many poses.

    Examples
    --------
    >>> poses = np.array([[0.0], [10.0], [20.0]], dtype=np.float32)
    >>> nearest_by_brute_force(poses, poses[1:2] + 2, k=2)
    (array([[ 4., 64.]]), array([[1, 2]]))
    """
    squares = np.empty((len(queries), k))
    rows = np.empty((len(queries), k), dtype=np.int64)
    double_poses = poses.astype(np.float64)
    pose_norms = np.einsum("pd,pd->p", double_poses, double_poses)
    rounding = ROUNDINGS_PER_DIMENSION * (poses.shape[1] + 4) * FLOAT64_ROUNDING
    batch_size = max(1, PAIRS_PER_BATCH // len(poses))
    for at in range(0, len(queries), batch_size):
        batch = queries[at : at + batch_size].astype(np.float64)
        # |p - q|² - |q|², up to rounding
        approximate = batch @ (-2.0 * double_poses.T)
        approximate += pose_norms
        limit = np.partition(approximate, k - 1, axis=1)[:, k - 1]
        limit += rounding * (pose_norms.max() + np.einsum("qd,qd->q", batch, batch))
        query, row = np.nonzero(approximate <= limit[:, None])
        exact = np.zeros(len(row))
        for d in range(poses.shape[1]):
            exact += (double_poses[row, d] - batch[query, d]) ** 2
        order = np.lexsort((row, exact, query))
        first = np.searchsorted(query, np.arange(len(batch)))  # `query` ascends
        nearest = order[first[:, None] + np.arange(k)]
        squares[at : at + batch_size], rows[at : at + batch_size] = exact[nearest], row[nearest]
    return squares, rows


class BruteForce:
    """Poses that are all compared in every search; a `NearestPoses`.

    Parameters
    ----------
    poses : ndarray of float32 [shape=(poses, dimensions), mm]
        At least one, without missing values. Not copied.
    """

    nbytes = 0

    def __init__(self, poses: NDArray[np.float32]) -> None:
        self._poses = poses

    def __len__(self) -> int:
        return len(self._poses)

    def nearest(
        self, queries: NDArray[np.float32], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Find the nearest poses of queries; see `NearestPoses`."""
        return nearest_by_brute_force(self._poses, queries, k)
