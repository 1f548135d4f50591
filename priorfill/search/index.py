"""Exact k nearest neighbours among the poses of recordings.

They are the y_i of [B11]_: the k database poses nearest to a frame of the clip, by its viable
markers in root frames, over which Eqs. (2)-(4), and so the energy of Eq. (1), sum. [B11]_ finds
them with one kd-tree per clip and resolution. Here the viable markers and the root frames depend on
the gap, so that a tree would often be searched for one gap only. There are therefore three ways to
find the same neighbours: all poses are compared, which needs no preparation; all are bounded, for
which one pass over them suffices (`SpanScan`); or a kd-tree is built (`KdTree`). The choice is by
the predicted time.

The poses of an index are in the root frames of one root group; other root frames need another
index.

References
----------
.. [B11] Baumann, Krüger, Zinke and Weber, Data-driven completion of motion capture data,
   VRIPHYS 2011, section 4.1.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from priorfill.search.brute_force import BruteForce
from priorfill.search.kd_tree import KdTree
from priorfill.search.nearest_poses import NearestPoses
from priorfill.search.span_scan import SpanScan

__all__ = ["MAX_BRUTE_FORCE_POSES", "WAYS", "PoseIndex", "Way", "choose_way"]

Way = Literal["brute force", "scan", "kd-tree"]

WAYS: tuple[Way, ...] = ("brute force", "scan", "kd-tree")
"""Ways to find the same neighbours."""

MAX_BRUTE_FORCE_POSES = 2**14
"""Up to this many poses all are compared. That takes a few times as long, hundredths of a second,
but spares the seconds in which loops compile on first use."""

SCAN_BUILT, TREE_BUILT = 0.11, 0.25
"""µs per pose. CPU time to prepare a scan, and to build a kd-tree."""

SCAN_QUERY, SCAN_QUERY_POSE = 95.0, 0.0004
"""µs, and µs per pose. CPU time of a query in a scan."""

TREE_QUERY = 1.8
"""µs. CPU time of a query in a kd-tree, divided by the cube root of the number of poses: neighbours
are as much nearer among more poses, and the tree hardly deeper."""

REPEATS = 2
"""Queries that are expected, relative to those asked for so far: a marker that is missing once is
often missing again, with the same viable markers."""

POSES_PER_BATCH = 2**14
"""Poses that are measured at a time without an index, so that differences stay in the cache."""

MAX_COORDINATE = 1e15
"""mm. Squares of larger coordinates would not fit into single precision."""


def choose_way(poses: int, queries: int, asked: int, built: Way | None) -> Way:
    """Return how poses are expected to be searched in the least time.

    Parameters
    ----------
    poses : int
        Number of poses.
    queries, asked : int
        Number of queries to search for, and of earlier ones.
    built : str or None
        How the earlier ones were searched for.

    Examples
    --------
    >>> choose_way(1_000_000, 20, 0, None), choose_way(1_000_000, 20, 1000, "scan")
    ('scan', 'kd-tree')
    """
    if built == "kd-tree":
        return "kd-tree"
    if poses <= MAX_BRUTE_FORCE_POSES:
        return "brute force"
    expected = REPEATS * (queries + asked)
    scan = (SCAN_QUERY + SCAN_QUERY_POSE * poses) * expected
    if built != "scan":
        scan += SCAN_BUILT * poses
    tree = TREE_BUILT * poses + TREE_QUERY * poses ** (1 / 3) * expected
    return "kd-tree" if tree < scan else "scan"


class PoseIndex:
    """Index for the exact k nearest neighbours among poses.

    Parameters
    ----------
    coordinates : ndarray of float32 [shape=(poses, dimensions), mm]
        The poses to search, at least one, without missing values. Not copied if contiguous.
    starts : ndarray of int [shape=(recordings,)], optional
        Rows at which recordings start, ascending: poses on either side need not be similar. By
        default all poses are of one recording. Affects only the speed.
    way : str, optional
        How they are searched, one of `WAYS`; by default as is expected to be fastest, see
        `choose_way`. Affects only the speed.

    Raises
    ------
    ValueError
        If ``starts`` do not ascend from 0, or reach beyond the poses.

    See Also
    --------
    PoseBank : An index over the poses of takes, in root frames.

    Examples
    --------
    >>> index = PoseIndex(np.array([[0.0], [10.0], [20.0]], dtype=np.float32))
    >>> distances, rows = index.nearest(np.array([[12.0]]), k=2)
    >>> distances, rows
    (array([[2., 8.]]), array([[1, 2]]))
    """

    def __init__(
        self,
        coordinates: NDArray[np.float32],
        starts: NDArray[np.intp] | None = None,
        way: Way | None = None,
    ) -> None:
        self._poses = np.ascontiguousarray(coordinates, dtype=np.float32)
        poses = len(self._poses)
        starts = np.zeros(1, dtype=np.intp) if starts is None else starts
        ends = np.append(starts, poses)
        if ends[0] != 0 or (np.diff(ends) <= 0).any():
            raise ValueError(f"starts are {starts} of {poses} poses; let them ascend from 0")
        self._ends = ends.astype(np.int64)
        self._way = way
        self._asked = 0
        self._made: tuple[Way, NearestPoses] | None = None

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def nbytes(self) -> int:
        """Memory in bytes, including the poses."""
        return self._poses.nbytes + (self._made[1].nbytes if self._made is not None else 0)

    def _searched(self, queries: int) -> NearestPoses:
        """Return what searches the poses for some more queries; built if it is not there yet."""
        made = self._made
        way = self._way
        if way is None:
            way = choose_way(len(self), queries, self._asked, made[0] if made else None)
        self._asked += queries
        if made is None or made[0] != way:
            made = (way, self._make(way))
            self._made = made
        return made[1]

    def _make(self, way: Way) -> NearestPoses:
        if way == "brute force":
            return BruteForce(self._poses)
        if way == "scan":
            return SpanScan(self._poses, self._ends)
        return KdTree(self._poses)

    def nearest(
        self, queries: NDArray[np.floating], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Find the k nearest poses of each query.

        Parameters
        ----------
        queries : ndarray [shape=(queries, dimensions), mm]
            Without missing values. Rounded to single precision, as the poses are.
        k : int
            Number of neighbours; fewer are returned if there are fewer poses.

        Returns
        -------
        distances : ndarray [shape=(queries, min(k, poses)), mm]
            Euclidean, ascending.
        indices : ndarray of int [shape=(queries, min(k, poses))]
            Rows of the poses; equally near ones in ascending order.

        Raises
        ------
        ValueError
            If a coordinate is missing, infinite or beyond `MAX_COORDINATE`.
        """
        single = np.ascontiguousarray(queries, dtype=np.float32)
        if not np.abs(single).max(initial=0.0) < MAX_COORDINATE:  # also true for NaN
            raise ValueError(
                f"coordinates are missing, or {MAX_COORDINATE:g} mm and more; "
                "search by markers that are valid"
            )
        k = min(k, len(self))
        if not len(single) or not k:
            return np.empty((len(single), k)), np.empty((len(single), k), dtype=np.intp)
        squares, rows = self._searched(len(single)).nearest(single, k)
        return np.sqrt(squares), rows.astype(np.intp, copy=False)

    def squared_distances(self, query: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the squared distance of one query from every pose [shape=(poses,), mm²].

        Parameters
        ----------
        query : ndarray [shape=(dimensions,), mm]
            Without missing values. Rounded to single precision, as the poses are.

        See Also
        --------
        nearest : The nearest poses alone, in less time.
        """
        single = np.asarray(query, dtype=np.float32)
        squares = np.empty(len(self), dtype=np.float32)
        for at in range(0, len(self), POSES_PER_BATCH):
            away = self._poses[at : at + POSES_PER_BATCH] - single
            squares[at : at + POSES_PER_BATCH] = np.einsum("pd,pd->p", away, away)
        return squares
