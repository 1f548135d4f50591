"""A kd-tree of poses: exact k nearest neighbours from a small part of the poses.

[B11]_ searches its y_i with one kd-tree per clip and resolution. Here the viable markers and the
root frames depend on the gap, and so does the tree. It is built over the coordinates of the poses
along the `AXES` principal axes along which they differ most. Poses are divided by halves, each time
along the axis along which they then differ most, into leaves of 32 poses; the division is kept
every five halvings, so that each node has 32 children. Boxes around the coordinates bound the
distances of a query from all poses inside from below. Queries are searched for depth first, with
the k nearest poses found so far in a heap; consecutive queries are similar, so those of the query
before it say how far its neighbours may be.

The loops are in `priorfill.search.kd_tree_kernels` and `priorfill.search.kd_tree_search_kernels`.

References
----------
.. [B11] Baumann, Krüger, Zinke and Weber, Data-driven completion of motion capture data,
   VRIPHYS 2011, section 4.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.threads import run_in_threads, split_range
from priorfill.search.bounds import (
    FLOAT32_ROUNDING,
    POSES_PER_THREAD,
    TINY_ERROR,
    in_order,
    principal_axes,
    rounding_of_squares,
)

__all__ = ["KdTree"]

MAX_PCA_POSES = 4000
"""Poses from which the axes are computed. Any axes give the same neighbours."""

CHUNK_POSES = 4096
"""Poses projected at a time, so that they stay in the cache."""

QUERIES_PER_THREAD = 64
"""Queries for which another thread pays: some ten milliseconds."""

ROUNDINGS_OF_BYTES = 12
"""Upper limit of the rounding errors of a coordinate in bytes, relative to the largest norm."""


class KdTree:
    """A kd-tree for the exact k nearest neighbours among poses; a `NearestPoses`.

    Parameters
    ----------
    poses : ndarray of float32 [shape=(poses, dimensions), mm]
        At least one and less than 2**31, without missing values. Not copied.

    See Also
    --------
    priorfill.search.span_scan.SpanScan : The same by bounds of all poses.
    """

    def __init__(self, poses: NDArray[np.float32]) -> None:
        from priorfill.search.kd_tree_kernels import AXES, WIDTH, enclose_nodes

        self._poses = poses
        self._axes = principal_axes(poses[:: -(-len(poses) // MAX_PCA_POSES)], AXES)
        projection, self._largest_norm = self._projection()
        counts = [-(-len(poses) // WIDTH)]
        while counts[-1] > 1:
            counts.append(-(-counts[-1] // WIDTH))
        levels = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        leaves, total = counts[0], int(levels[-1])
        boxes = np.empty((total, 2, AXES), dtype=np.float32)
        self._scales = np.empty_like(boxes)
        self._places = np.empty((leaves, AXES, WIDTH), dtype=np.uint8)
        self._errors = np.empty(leaves, dtype=np.float32)
        self._rows = np.arange(len(poses), dtype=np.int32)
        self._divide(projection, boxes)
        self._lows = np.empty((total - leaves, AXES, WIDTH), dtype=np.uint8)
        self._highs = np.empty_like(self._lows)
        for level in range(1, len(counts)):
            nodes = slice(levels[level], levels[level + 1])
            inner = slice(nodes.start - leaves, nodes.stop - leaves)
            enclose_nodes(
                boxes[levels[level - 1] : nodes.start],
                boxes[nodes],
                self._scales[nodes],
                self._lows[inner],
                self._highs[inner],
            )
        self._levels = levels[:-1]

    def _projection(self) -> tuple[NDArray[np.float32], float]:
        """Return the poses along the axes [shape=(poses, AXES)], and a bound of their norms."""
        poses = self._poses
        projection = np.empty((len(poses), len(self._axes)), dtype=np.float32)

        def project(begin: int, end: int) -> float:
            largest = 0.0
            for at in range(begin, end, CHUNK_POSES):
                chunk = slice(at, min(at + CHUNK_POSES, end))
                np.matmul(poses[chunk], self._axes.T, out=projection[chunk])
                largest = max(largest, float(poses[chunk].max()), -float(poses[chunk].min()))
            return largest

        parts = split_range(len(poses), len(poses) // POSES_PER_THREAD)
        largest = max(run_in_threads(project, parts))
        return projection, largest * poses.shape[1] ** 0.5

    def _divide(self, projection: NDArray[np.float32], boxes: NDArray[np.float32]) -> None:
        """Divide the poses among the leaves, and enclose these."""
        from priorfill.search import kd_tree_kernels as kernels

        width, axes, local = kernels.WIDTH, kernels.AXES, kernels.LOCAL_LEAVES

        leaves = len(self._places)

        def work(first: int, end: int, undivided: int) -> None:
            size = (end - first) * width
            kernels.divide(
                projection,
                self._rows,
                first,
                end - first,
                undivided,
                np.empty(size, dtype=np.float32),
                np.empty(size, dtype=np.float32),
                np.empty(size, dtype=np.int32),
                np.empty(kernels.BINS, dtype=np.int32),
                np.empty((kernels.MAX_DIVISIONS, 2), dtype=np.int64),
                np.empty((local * width, axes), dtype=np.float32),
                np.empty(local * width, dtype=np.int32),
                np.empty((axes + 1, width), dtype=np.float32),
                boxes,
                self._scales,
                self._places,
                self._errors,
            )

        child = 1  # leaves of a child of the root; threads share the children
        while child * width < leaves:
            child *= width
        if child > local:
            work(0, leaves, child)
        else:
            child = leaves

        def complete(begin: int, end: int) -> None:
            for at in range(begin, end):
                work(at * child, min((at + 1) * child, leaves), 0)

        run_in_threads(
            complete, split_range(-(-leaves // child), len(projection) // POSES_PER_THREAD)
        )

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def nbytes(self) -> int:
        """Memory in bytes, without the poses."""
        return sum(
            array.nbytes
            for array in (
                self._rows,
                self._scales,
                self._places,
                self._errors,
                self._lows,
                self._highs,
            )
        )

    def nearest(
        self, queries: NDArray[np.float32], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Find the nearest poses of queries; see `NearestPoses`."""
        from priorfill.search.kd_tree_kernels import WIDTH
        from priorfill.search.kd_tree_search_kernels import MAX_WAITING, search_tree

        squares = np.empty((len(queries), k))
        rows = np.empty((len(queries), k), dtype=np.int64)
        points = np.ascontiguousarray(queries @ self._axes.T)
        norms = np.sqrt(np.einsum("qd,qd->q", queries, queries, dtype=np.float64))
        dimensions = queries.shape[1]
        # of a coordinate along an axis of unit length, and of its bytes
        bound_errors = TINY_ERROR + (norms + self._largest_norm) * (
            (dimensions + ROUNDINGS_OF_BYTES) * FLOAT32_ROUNDING * len(self._axes) ** 0.5
        )

        def search(begin: int, end: int) -> None:
            search_tree(
                self._poses,
                self._rows,
                self._levels,
                self._scales,
                self._places,
                self._errors,
                self._lows,
                self._highs,
                queries[begin:end],
                points[begin:end],
                bound_errors[begin:end],
                rounding_of_squares(dimensions),
                np.empty((MAX_WAITING, 2), dtype=np.int64),
                np.empty(MAX_WAITING, dtype=np.float32),
                np.empty(WIDTH, dtype=np.float32),
                squares[begin:end],
                rows[begin:end],
            )

        run_in_threads(search, split_range(len(queries), len(queries) // QUERIES_PER_THREAD))
        return in_order(squares, rows)
