"""What a search for the nearest poses offers, whichever way it finds them."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["NearestPoses"]


class NearestPoses(Protocol):
    """Poses that can be searched; its length is their number.

    All searches find the same, bit by bit: `BruteForce`, `SpanScan` and `KdTree`.
    """

    def __len__(self) -> int: ...

    @property
    def nbytes(self) -> int:
        """Memory in bytes, without the poses."""

    def nearest(
        self, queries: NDArray[np.float32], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Find the k nearest poses of each query, in ascending order of distance, then of row.

        Parameters
        ----------
        queries : ndarray of float32 [shape=(queries, dimensions), mm]
            At least one, without missing values.
        k : int
            Number of neighbours, at least 1 and at most the number of poses.

        Returns
        -------
        squares : ndarray [shape=(queries, k), mm²]
            Squared distances, summed in double precision in the order of the dimensions.
        rows : ndarray of int [shape=(queries, k)]
            Rows of the poses.
        """
