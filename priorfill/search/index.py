"""Exact k nearest neighbours among the poses of recordings.

Poses of a recording follow each other closely. So every `SPAN`-th pose, and how far those between
two of these are from the line that joins them, bound the distances of all poses from below, and it
takes one pass over the poses to find out: there is no tree to be built. Most bounds are computed
in the few directions in which the poses differ most, and first for several queries together, which
are best consecutive frames. What the bounds let through is measured. The loops are in
`priorfill.search.kernels`.

Poses are of one root group: in other root frames they need another index.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.search.comparing import nearest_by_comparing
from priorfill.threads import thread_count

__all__ = ["PoseIndex"]

FEW = 2**14
"""Up to so many poses all are compared. That takes a few times as long, hundredths of a second,
but spares the seconds in which the index is compiled when it is first used."""

SPAN = 3
"""Poses a span. At 30 Hz, 2 to 4 take much the same time, 8 twice and 16 three times as long; at
lower rates, too, 2 to 4 are best."""

DIRECTIONS = 16
"""In how many directions most bounds are computed: they hold 98 % of the variance of poses, and
more of them cost more than they keep from being measured."""

TOGETHER = 16
"""Queries that are bounded together first; 16 frames at 120 Hz are alike enough."""

SEEDS = 2
"""So many times the spans that hold k poses are measured first."""

GROUPS = 4
"""So many groups of queries are bounded in one pass over all knots, which the memory slows down."""

SAMPLE = 20_000
"""Poses, at most, that the directions are found from: any directions give the same neighbours."""

BLOCK = 8192
"""Knots whose shadow is computed at a time: some megabytes."""

ROUNDING = 2.0**-24
"""Relative error of an operation of single precision."""

OPERATIONS = 8
"""Bounds are off by so many times the dimensions times `ROUNDING`, relatively, at most: a square is
a sum over the dimensions, and a distance from a line is made of three of them."""

LARGEST = 1e15
"""mm. Squares of coordinates beyond would not fit into single precision."""

POSES_A_THREAD, PAIRS_A_THREAD = 2**17, 2**24
"""Poses, and poses times queries, for which another thread pays: some ten milliseconds of work."""


class PoseIndex:
    """Finds the poses nearest to others.

    Parameters
    ----------
    coordinates : ndarray of float32 [shape=(poses, dimensions), mm]
        The poses to search among, at least one, none missing. Kept, not copied.
    starts : ndarray of int [shape=(recordings,)], optional
        Rows at which recordings start, ascending: what is on either side need not be alike. The
        neighbours do not depend on it. By default all poses are of one recording.
    few : int, optional
        Up to so many poses all are compared; the neighbours do not depend on it either.
    """

    def __init__(
        self,
        coordinates: NDArray[np.float32],
        starts: NDArray[np.intp] | None = None,
        few: int = FEW,
    ) -> None:
        self._poses = np.ascontiguousarray(coordinates, dtype=np.float32)
        poses = len(self._poses)
        starts = np.zeros(1, dtype=np.intp) if starts is None else starts
        ends = np.append(starts, poses)
        if ends[0] != 0 or (np.diff(ends) <= 0).any():
            raise ValueError(f"starts are {starts} of {poses} poses; let them ascend from 0")
        self._spans = None if poses <= few else _Spans(self._poses, ends.astype(np.int64))

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def nbytes(self) -> int:
        """Memory that it takes, the poses included."""
        return self._poses.nbytes + (self._spans.nbytes if self._spans is not None else 0)

    def nearest(
        self, queries: NDArray[np.floating], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Find the k nearest poses of each query.

        Parameters
        ----------
        queries : ndarray [shape=(queries, dimensions), mm]
            None missing. They are rounded to single precision, as the poses are.
        k : int
            How many neighbours; fewer are returned where there are fewer poses.

        Returns
        -------
        distances : ndarray [shape=(queries, min(k, poses)), mm]
            Euclidean, ascending.
        indices : ndarray of int [shape=(queries, min(k, poses))]
            Rows of the poses; of equally near ones the first.

        Raises
        ------
        ValueError
            Where a coordinate is missing, infinite or beyond `LARGEST`.
        """
        asked = np.ascontiguousarray(queries, dtype=np.float32)
        if not np.abs(asked).max(initial=0.0) < LARGEST:  # so too where it is no number
            raise ValueError(f"coordinates are missing, or of {LARGEST:g} mm; search by others")
        k = min(k, len(self))
        if not len(asked) or not k:
            return np.empty((len(asked), k)), np.empty((len(asked), k), dtype=np.intp)
        if self._spans is None:
            square, rows = nearest_by_comparing(self._poses, asked, k)
        else:
            square, rows = self._spans.nearest(asked, k)
        return np.sqrt(square), rows.astype(np.intp, copy=False)


class _Spans:
    """The spans of poses, see `priorfill.search.kernels`.

    Parameters
    ----------
    poses : ndarray [shape=(poses, dimensions), mm]
        Kept, not copied.
    ends : ndarray of int [shape=(recordings + 1,)]
        Where recordings start, and the number of poses.
    """

    def __init__(self, poses: NDArray[np.float32], ends: NDArray[np.int64]) -> None:
        from priorfill.search.kernels import bend_spans

        self._poses = poses
        self._knots, self._joined = _layout(ends)
        dimensions = poses.shape[1]
        self._slack = OPERATIONS * (dimensions + 4) * ROUNDING
        self._bend = np.empty(len(self._knots), dtype=np.float32)
        parts = _parts(len(self._knots), len(poses) // POSES_A_THREAD)

        def bend(begin: int, end: int) -> None:
            bend_spans(self._poses, self._knots, self._joined, begin, end, self._slack, self._bend)

        _in_threads(bend, parts)
        sample = self._poses[self._knots[:: -(-len(self._knots) // SAMPLE)]]
        self._centre = sample.mean(axis=0)
        sample -= self._centre
        # ascending eigenvalues: the last axes are those along which the poses differ most
        _, axes = np.linalg.eigh((sample.T @ sample).astype(np.float64))
        self._axes = np.ascontiguousarray(axes[:, ::-1][:, :DIRECTIONS].T, dtype=np.float32)
        self._shadow = np.empty((len(self._axes), len(self._knots)), dtype=np.float32)
        self._length = np.zeros(len(self._knots), dtype=np.float32)
        farthest = [0.0]

        def project(begin: int, end: int) -> None:
            for at in range(begin, end, BLOCK):
                some = slice(at, min(at + BLOCK, end))
                shadow, far = self._project(self._poses[self._knots[some]])
                self._shadow[:, some] = shadow
                farthest.append(far)

        _in_threads(project, parts)
        self._farthest = max(farthest)
        for line in self._shadow:
            self._length[:-1] += np.diff(line) ** 2
        self._length[~self._joined] = 0.0

    def _project(self, poses: NDArray[np.float32]) -> tuple[NDArray[np.float32], float]:
        """Return poses along the directions [shape=(directions, poses)], and the largest norm."""
        centred = poses - self._centre
        far = float(np.einsum("pd,pd->p", centred, centred).max())
        return self._axes @ centred.T, far**0.5

    @property
    def nbytes(self) -> int:
        """Memory that it takes beside the poses."""
        arrays = (self._knots, self._joined, self._bend, self._shadow, self._length)
        return sum(array.nbytes for array in arrays)

    def nearest(
        self, asked: NDArray[np.float32], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Find the nearest poses of queries; see `nearest_by_comparing`."""
        far = np.empty((len(asked), k))
        rows = np.empty((len(asked), k), dtype=np.int64)
        shadow, farthest = self._project(asked)
        points = np.ascontiguousarray(shadow.T)
        # rounding of a pose along the directions, which are of length 1
        blur = (asked.shape[1] + 4) * ROUNDING * len(self._axes) ** 0.5
        blur *= self._farthest + farthest

        def search(begin: int, end: int) -> None:
            for at in range(begin, end, TOGETHER * GROUPS):
                some = slice(at, min(at + TOGETHER * GROUPS, end))
                self._search(asked[some], points[some], blur, far[some], rows[some])

        pairs = len(self._poses) * len(asked)
        _in_threads(search, _parts(len(asked), pairs // PAIRS_A_THREAD))
        return far, rows

    def _search(
        self,
        queries: NDArray[np.float32],
        points: NDArray[np.float32],
        blur: float,
        far: NDArray[np.float64],
        rows: NDArray[np.int64],
    ) -> None:
        """Find the nearest poses of up to `GROUPS` groups of queries; see `measure_spans`."""
        from priorfill.search.kernels import bound_spans, choose_spans, measure_spans

        starts = np.arange(0, len(queries), TOGETHER)
        # any query of a group does for its centre: one in the middle
        centres = (starts + np.minimum(starts + TOGETHER, len(queries))) // 2
        bounds = np.empty((len(starts), len(self._knots)), dtype=np.float32)
        bound_spans(self._shadow, self._joined, self._length, points, centres, self._slack, bounds)
        seeds = SEEDS * -(-far.shape[1] // SPAN)
        reach = np.empty(len(queries))
        columns = np.empty(len(self._knots), dtype=np.int64)
        spans = (self._poses, self._knots, self._joined, self._bend)
        for start, centre, bound in zip(starts, centres, bounds, strict=True):
            some = slice(start, start + TOGETHER)
            asked = (queries[some], points[some])
            found = (far[some], rows[some])
            count = choose_spans(
                *spans, *asked, centre - start, blur, self._slack, bound, seeds, *found,
                reach[some], columns,
            )  # fmt: skip
            near = (columns[:count], self._shadow, self._length)
            measure_spans(*spans, *near, *asked, blur, self._slack, reach[some], *found)


def _layout(ends: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Lay out the knots of recordings.

    Parameters
    ----------
    ends : ndarray of int [shape=(recordings + 1,)]
        Where they start, and the number of poses.

    Returns
    -------
    knots : ndarray of int [shape=(knots,)]
        Rows, ascending: every `SPAN`-th of a recording, and its last one.
    joined : ndarray of bool [shape=(knots,)]
        Whether the next knot is of the same recording.
    """
    first, last = ends[:-1], ends[1:] - 1
    counts = 1 - (first - last) // SPAN  # rounded up
    recording = np.repeat(np.arange(len(first)), counts)
    number = np.arange(len(recording)) - np.repeat(np.cumsum(counts) - counts, counts)
    knots = np.minimum(first[recording] + SPAN * number, last[recording])
    return knots, knots < last[recording]


def _parts(count: int, worth: int) -> list[tuple[int, int]]:
    """Cut a range into parts for so many threads as are worth it and allowed."""
    threads = max(1, min(worth, thread_count(), count))
    at = np.linspace(0, count, threads + 1).astype(int)
    return [(int(begin), int(end)) for begin, end in pairwise(at)]


def _in_threads(work: Callable[[int, int], None], parts: list[tuple[int, int]]) -> None:
    """Do the parts of some work at the same time; none writes where another does."""
    if len(parts) == 1:
        work(*parts[0])
        return
    with ThreadPoolExecutor(max_workers=len(parts)) as pool:
        list(pool.map(work, *zip(*parts, strict=True)))
