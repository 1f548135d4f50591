"""Exact k nearest neighbours among the poses of recordings.

Poses of a recording follow each other closely. So distances from some of them, and how far the
poses between two of these are from the line that joins the two, bound the distances of all poses
from below, and it takes one pass over the poses to find out: there is no tree to be built. Most
bounds are computed in the few directions in which the poses differ most, and first for several
queries together, which are best consecutive frames. What the bounds let through is measured. The
loops are in `priorfill.search.kernels`.

Poses are of one root group: in other root frames they need another index.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.threads import in_threads, parts
from priorfill.search.brute_force import nearest_by_brute_force

__all__ = ["FEW", "POSES_A_THREAD", "PoseIndex"]

FEW = 2**14
"""Up to so many poses all are compared. That takes a few times as long, hundredths of a second,
but spares the seconds in which the index is compiled when it is first used."""

LONGEST, BEND = 4, 5.0
"""Poses a span at most, and how far (mm) they may be beside its line, a coordinate: 36 mm in 54
dimensions, little beside neighbours at 150 and more. 3 to 5 mm take much the same time; spans of a
fixed number of poses bend by 91 mm and more where movements are fast, and let them all through. Up
to 8 poses there are 4 % fewer spans, which take a fifth longer to be laid."""

DIRECTIONS = 16
"""In how many directions most bounds are computed: they hold 98 % of the variance of poses, and
more of them cost more than they keep from being measured."""

TOGETHER = 16
"""Queries that are bounded together first; 16 frames at 120 Hz are alike enough."""

FIRST = 512
"""Spans at least whose poses are measured first: they say how far the neighbours may be."""

SOME = 4
"""Bounds looked at first, for each of those that are wanted: to know which others may be less."""

BEYOND = 1e37
"""mm². Where no neighbour is: more than any square, and single precision can still double it."""

GROUPS = 8
"""So many groups of queries are bounded in one pass over all knots, which the memory slows down."""

SPANS = 2**15
"""Spans measured at a time: what is bounded of them for each of the queries takes 2 MB."""

SAMPLE = 20_000
"""Poses, at most, that the directions are found from: any directions give the same neighbours."""

PIECE = 8192
"""Poses that spans are laid over at a time: what is read of them stays in a cache."""

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
            square, rows = nearest_by_brute_force(self._poses, asked, k)
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
        self._poses = poses
        dimensions = poses.shape[1]
        self._slack = OPERATIONS * (dimensions + 4) * ROUNDING
        sample = poses[:: -(-len(poses) // SAMPLE)]
        self._centre = sample.mean(axis=0)
        sample = sample - self._centre
        # ascending eigenvalues: the last axes are those along which the poses differ most
        _, axes = np.linalg.eigh((sample.T @ sample).astype(np.float64))
        self._axes = np.zeros((DIRECTIONS, dimensions), dtype=np.float32)
        self._axes[:dimensions] = axes[:, ::-1][:, :DIRECTIONS].T

        def lay(begin: int, end: int) -> list[_Laid]:
            return [self._lay(ends, piece) for piece in range(begin, end)]

        pieces = parts(-(-len(poses) // PIECE), len(poses) // POSES_A_THREAD)
        laid = [piece for part in in_threads(lay, pieces) for piece in part]
        self._knots = np.concatenate([piece.knots for piece in laid])
        self._joined = np.concatenate([piece.joined for piece in laid])
        self._bend = np.concatenate([piece.bend for piece in laid])
        self._shadow = np.concatenate([piece.shadow for piece in laid])
        self._farthest = max(piece.farthest for piece in laid)
        self._length = np.zeros(len(self._knots), dtype=np.float32)
        for at in range(0, len(self._knots), PIECE):
            step = np.diff(self._shadow[at : at + PIECE + 1], axis=0)
            self._length[at : at + len(step)] = np.einsum("kd,kd->k", step, step)
        self._length[~self._joined] = 0.0

    def _lay(self, ends: NDArray[np.int64], piece: int) -> _Laid:
        """Lay spans over one of the pieces of `PIECE` poses."""
        from priorfill.search.kernels import lay_spans

        begin, end = piece * PIECE, min((piece + 1) * PIECE, len(self._poses))
        knots = np.empty(end - begin, dtype=np.int64)
        joined = np.empty(end - begin, dtype=np.bool_)
        bend = np.empty(end - begin, dtype=np.float32)
        most_bend = BEND * self._poses.shape[1] ** 0.5
        recording = int(np.searchsorted(ends, begin, side="right"))
        span = (LONGEST, most_bend, self._slack)
        count = lay_spans(self._poses, ends, recording, begin, end, *span, knots, joined, bend)
        shadow, farthest = self._project(self._poses[knots[:count]])
        # copies: what was not written must not be kept
        return _Laid(
            knots[:count].copy(), joined[:count].copy(), bend[:count].copy(), shadow, farthest
        )

    def _project(self, poses: NDArray[np.float32]) -> tuple[NDArray[np.float32], float]:
        """Return poses along the directions [shape=(poses, directions)], and the largest norm."""
        centred = poses - self._centre
        far = float(np.einsum("pd,pd->p", centred, centred).max())
        return centred @ self._axes.T, far**0.5

    @property
    def nbytes(self) -> int:
        """Memory that it takes beside the poses."""
        arrays = (self._knots, self._joined, self._bend, self._shadow, self._length)
        return sum(array.nbytes for array in arrays)

    def nearest(
        self, asked: NDArray[np.float32], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Find the nearest poses of queries; see `nearest_by_brute_force`."""
        far = np.empty((len(asked), k))
        rows = np.empty((len(asked), k), dtype=np.int64)
        points, farthest = self._project(asked)
        # rounding of a pose along the directions, which are of length 1
        blur = (asked.shape[1] + 4) * ROUNDING * len(self._axes) ** 0.5
        blur *= self._farthest + farthest

        def search(begin: int, end: int) -> None:
            for at in range(begin, end, TOGETHER * GROUPS):
                some = slice(at, min(at + TOGETHER * GROUPS, end))
                self._search(asked[some], points[some], blur, far[some], rows[some])

        pairs = len(self._poses) * len(asked)
        in_threads(search, parts(len(asked), pairs // PAIRS_A_THREAD))
        return far, rows

    def _search(
        self,
        queries: NDArray[np.float32],
        points: NDArray[np.float32],
        blur: float,
        far: NDArray[np.float64],
        rows: NDArray[np.int64],
    ) -> None:
        """Find the nearest poses of up to `GROUPS` groups of queries; see `nearest`."""
        from priorfill.search.kernels import UP

        groups = [slice(at, at + TOGETHER) for at in range(0, len(queries), TOGETHER)]
        paths, beside = zip(*(_path(points[some]) for some in groups), strict=True)
        knots = (self._shadow, self._joined, self._length, self._bend)
        bounds, least = _bounds(*knots, np.array(paths), self._slack)
        count = min(max(FIRST, far.shape[1]), len(self._knots))  # a span has at least one pose
        far[:] = BEYOND
        for group, some in enumerate(groups):
            known = (bounds[group], least[group])
            asked = (queries[some], points[some], blur, far[some], rows[some])
            rows[some] = len(self._poses)  # beyond all
            self._measure(_chosen(*known, _least_of(*known, count)), *asked)
            reach = far[some, :1].copy()  # the farthest
            far[some], rows[some] = reach, len(self._poses)
            within = float(reach.max()) ** 0.5 + beside[group] + blur
            spans = _chosen(*known, within * UP)
            for at in range(0, len(spans), SPANS):
                self._measure(spans[at : at + SPANS], *asked)
            order = np.lexsort((rows[some], far[some]))
            far[some] = np.take_along_axis(far[some], order, axis=1)
            rows[some] = np.take_along_axis(rows[some], order, axis=1)

    def _measure(
        self,
        spans: NDArray[np.intp],
        queries: NDArray[np.float32],
        points: NDArray[np.float32],
        blur: float,
        far: NDArray[np.float64],
        rows: NDArray[np.int64],
    ) -> None:
        """Measure the poses of some spans, given ascending; see `measure_spans`."""
        from priorfill.search.kernels import measure_spans

        # the knots, and where the next knot is not one of them, that one, which ends the span
        ending = self._joined[spans]
        ending[:-1] &= spans[1:] != spans[:-1] + 1
        at = np.flatnonzero(ending)
        columns = np.insert(spans, at + 1, spans[at] + 1)
        chosen = np.ones(len(columns), dtype=np.bool_)
        chosen[at + np.arange(1, len(at) + 1)] = False
        joined = self._joined[columns] & chosen
        first = self._knots[columns]
        last = first + chosen
        np.copyto(last[:-1], first[1:], where=joined[:-1])
        paths = np.zeros((len(points), 2 * DIRECTIONS + 1), dtype=np.float32)
        paths[:, :DIRECTIONS] = points
        near = (
            np.take(self._shadow, columns, axis=0),
            joined,
            self._length[columns],
            self._bend[columns],
        )
        known = _bounds(*near, paths, self._slack)
        measure_spans(self._poses, first, last, *known, queries, blur, self._slack, far, rows)


class _Laid(NamedTuple):
    """Spans over some of the poses; arrays are as `lay_spans` and `_Spans._project` give them."""

    knots: NDArray[np.int64]
    joined: NDArray[np.bool_]
    bend: NDArray[np.float32]
    shadow: NDArray[np.float32]
    farthest: float


def _bounds(
    shadow: NDArray[np.float32],
    joined: NDArray[np.bool_],
    length: NDArray[np.float32],
    bend: NDArray[np.float32],
    paths: NDArray[np.float32],
    slack: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Bound the distances of paths from spans; see `bound_spans`.

    Returns the bounds, and infinite ones that make the last block whole [shape=(paths, blocks,
    BLOCK), mm], and the least of each block [shape=(paths, blocks), mm].
    """
    from priorfill.search.kernels import BLOCK, bound_spans

    count, directions = shadow.shape
    bounds = np.empty((len(paths), -(-count // BLOCK), BLOCK), dtype=np.float32)
    room = np.zeros((directions + 5, BLOCK + 1), dtype=np.float32)
    near = (shadow, joined, length, bend, paths, slack)
    bound_spans(*near, room[2:], room[0], room[1], bounds)
    bounds.reshape(len(paths), -1)[:, count:] = np.inf
    return bounds, bounds.min(axis=2)


def _least_of(bounds: NDArray[np.float32], least: NDArray[np.float32], count: int) -> float:
    """Return the greatest of the ``count`` least bounds (mm) of a path, given as by `_bounds`."""
    blocks = min(-(-SOME * count // bounds.shape[1]), len(least))
    # that of some good blocks is not less
    good = bounds[np.argpartition(least, blocks - 1)[:blocks]]
    limit = np.partition(good, count - 1, axis=None)[count - 1]
    near = bounds[least <= limit]
    return float(np.partition(near[near <= limit], count - 1)[count - 1])


def _chosen(
    bounds: NDArray[np.float32], least: NDArray[np.float32], radius: float
) -> NDArray[np.intp]:
    """Return the spans, ascending, whose bounds are at most so much (mm), as in `_least_of`."""
    blocks = np.flatnonzero(least <= radius)
    inside = np.flatnonzero(bounds[blocks] <= radius)
    skipped = (blocks - np.arange(len(blocks))) * bounds.shape[1]
    spans: NDArray[np.intp] = inside + skipped[inside // bounds.shape[1]]
    return spans


def _path(points: NDArray[np.float32]) -> tuple[NDArray[np.float32], float]:
    """Return the straight path along which some points lie, and how far beside it (mm) at most.

    The path is as `bound_spans` wants it, from the first point along the path to the last.
    """
    from priorfill.search.kernels import UP

    exact = points.astype(np.float64)
    middle = exact.mean(axis=0)
    _, axes = np.linalg.eigh((exact - middle).T @ (exact - middle))
    direction = axes[:, -1].astype(np.float32).astype(np.float64)
    along = (exact - middle) @ direction
    middle += 0.5 * (along.min() + along.max()) * direction
    path = np.concatenate([middle, direction, [0.0]]).astype(np.float32)
    exact -= path[: len(middle)]
    along = exact @ direction
    path[-1] = np.abs(along).max() * UP
    beside = exact - along[:, None] * direction
    return path, float(np.sqrt((beside**2).sum(axis=1).max())) * UP
