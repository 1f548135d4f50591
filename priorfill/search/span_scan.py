"""Exact k nearest neighbours among the poses of recordings by bounds of all poses.

Consecutive poses of a recording are similar. The distances from a few of them, the vertices, and
how far the poses between two vertices are from the chord joining these, bound the distances of all
poses from below, and one pass over the poses finds both. Most bounds are computed in the few
directions in which poses differ most, and first for groups of queries together, preferably
consecutive frames. Poses that no bound excludes are measured. The loops are in
`priorfill.search.kernels`.

The spans are found in one pass, sooner than a kd-tree is built; a search in them takes longer.
"""

from __future__ import annotations

from typing import NamedTuple

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

__all__ = ["SpanScan"]

MAX_SPAN_POSES = 4
"""Poses per span. With 8 there are 4 % fewer spans, which take a fifth longer to construct."""

MAX_CHORD_ERROR = 5.0
"""mm per coordinate. Largest chord error of a span of several poses: 36 mm in 54 dimensions, little
next to neighbours at 150 mm and more. 3 to 5 mm take much the same time. Spans of a fixed number of
poses have chord errors of 91 mm and more where movements are fast, and exclude nothing there."""

DIRECTIONS = 16
"""Directions in which most bounds are computed. They hold 98 % of the variance of poses; computing
bounds in more of them costs more than the measurements it saves."""

QUERIES_PER_GROUP = 16
"""Queries bounded together by one query segment; 16 frames at 120 Hz are similar enough."""

MIN_SEED_SPANS = 512
"""Spans whose poses are measured first, to find how far the neighbours may be."""

CANDIDATES_PER_SEED = 4
"""Bounds examined per seed span when estimating the cut-off among all bounds."""

GROUPS_PER_PASS = 8
"""Groups of queries bounded in one pass over all vertices, which is limited by memory bandwidth."""

SPANS_PER_BATCH = 2**15
"""Spans measured at a time: their bounds for all queries of a group take 2 MB."""

MAX_PCA_POSES = 20_000
"""Poses from which the directions are computed. Any directions give the same neighbours."""

CHUNK_POSES = 8192
"""Poses over which spans are laid at a time: they stay in the cache."""

PAIRS_PER_THREAD = 2**24
"""Pairs of pose and query for which another thread pays in a search."""


class _SpanData(NamedTuple):
    """Data of spans from which `bound_spans` computes bounds."""

    projection: NDArray[np.float32]
    connected: NDArray[np.bool_]
    squared_length: NDArray[np.float32]
    chord_error: NDArray[np.float32]


class _Chunk(NamedTuple):
    """Spans over `CHUNK_POSES` poses: outputs of `lay_spans`, and projections of the vertices."""

    vertices: NDArray[np.int64]
    connected: NDArray[np.bool_]
    chord_error: NDArray[np.float32]
    projection: NDArray[np.float32]
    largest_norm: float


class _Queries(NamedTuple):
    """A group of queries, with the arrays that hold their neighbours."""

    coordinates: NDArray[np.float32]
    projection: NDArray[np.float32]
    squares: NDArray[np.float64]
    rows: NDArray[np.int64]

    def part(self, part: slice) -> _Queries:
        """Return some of the queries; the arrays are views."""
        return _Queries(
            self.coordinates[part], self.projection[part], self.squares[part], self.rows[part]
        )


class SpanScan:
    """The spans of all poses, which are all bounded in every search; a `NearestPoses`.

    Parameters
    ----------
    poses : ndarray of float32 [shape=(poses, dimensions), mm]
        At least one, without missing values. Not copied.
    ends : ndarray of int [shape=(recordings + 1,)]
        Rows at which recordings start, and the number of poses. Affects only the speed.

    See Also
    --------
    priorfill.search.kd_tree.KdTree : Searches a part of the poses.
    """

    def __init__(self, poses: NDArray[np.float32], ends: NDArray[np.int64]) -> None:
        self._poses = poses
        self._rounding = rounding_of_squares(poses.shape[1])
        sample = poses[:: -(-len(poses) // MAX_PCA_POSES)]
        self._centre = sample.mean(axis=0)
        self._axes = principal_axes(sample, DIRECTIONS)

        def lay(begin: int, end: int) -> list[_Chunk]:
            return [self._lay_chunk(ends, chunk) for chunk in range(begin, end)]

        ranges = split_range(-(-len(poses) // CHUNK_POSES), len(poses) // POSES_PER_THREAD)
        chunks = [chunk for part in run_in_threads(lay, ranges) for chunk in part]
        self._vertices = np.concatenate([chunk.vertices for chunk in chunks])
        connected = np.concatenate([chunk.connected for chunk in chunks])
        projection = np.concatenate([chunk.projection for chunk in chunks])
        squared_length = np.zeros(len(self._vertices), dtype=np.float32)
        for at in range(0, len(self._vertices), CHUNK_POSES):
            step = np.diff(projection[at : at + CHUNK_POSES + 1], axis=0)
            squared_length[at : at + len(step)] = np.einsum("kd,kd->k", step, step)
        squared_length[~connected] = 0.0
        chord_error = np.concatenate([chunk.chord_error for chunk in chunks])
        self._data = _SpanData(projection, connected, squared_length, chord_error)
        self._largest_norm = max(chunk.largest_norm for chunk in chunks)

    def _lay_chunk(self, ends: NDArray[np.int64], chunk: int) -> _Chunk:
        """Lay spans over one chunk of `CHUNK_POSES` poses."""
        from priorfill.search.kernels import lay_spans

        begin, end = chunk * CHUNK_POSES, min((chunk + 1) * CHUNK_POSES, len(self._poses))
        vertices = np.empty(end - begin, dtype=np.int64)
        connected = np.empty(end - begin, dtype=np.bool_)
        chord_error = np.empty(end - begin, dtype=np.float32)
        recording = int(np.searchsorted(ends, begin, side="right"))
        count = lay_spans(
            self._poses,
            ends,
            recording,
            begin,
            end,
            MAX_SPAN_POSES,
            MAX_CHORD_ERROR * self._poses.shape[1] ** 0.5,
            self._rounding,
            vertices,
            connected,
            chord_error,
        )
        projection, largest_norm = self._project(self._poses[vertices[:count]])
        # copies, so that the unused rest of the arrays is freed
        return _Chunk(
            vertices[:count].copy(),
            connected[:count].copy(),
            chord_error[:count].copy(),
            projection,
            largest_norm,
        )

    def _project(self, poses: NDArray[np.float32]) -> tuple[NDArray[np.float32], float]:
        """Return poses along the directions [shape=(poses, directions)], and the largest norm."""
        centred = poses - self._centre
        largest_square = float(np.einsum("pd,pd->p", centred, centred).max())
        return centred @ self._axes.T, largest_square**0.5

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def nbytes(self) -> int:
        """Memory in bytes, without the poses."""
        return self._vertices.nbytes + sum(array.nbytes for array in self._data)

    def nearest(
        self, queries: NDArray[np.float32], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Find the nearest poses of queries; see `NearestPoses`."""
        squares = np.empty((len(queries), k))
        rows = np.empty((len(queries), k), dtype=np.int64)
        projection, largest_norm = self._project(queries)
        # rounding of a pose's projection onto directions of unit length
        bound_error = (queries.shape[1] + 4) * FLOAT32_ROUNDING * len(self._axes) ** 0.5
        bound_error = TINY_ERROR + bound_error * (self._largest_norm + largest_norm)

        everything = _Queries(queries, projection, squares, rows)

        def search(begin: int, end: int) -> None:
            step = QUERIES_PER_GROUP * GROUPS_PER_PASS
            for at in range(begin, end, step):
                self._search_groups(everything.part(slice(at, min(at + step, end))), bound_error)

        pairs = len(self._poses) * len(queries)
        run_in_threads(search, split_range(len(queries), pairs // PAIRS_PER_THREAD))
        return squares, rows

    def _search_groups(self, queries: _Queries, bound_error: float) -> None:
        """Find the nearest poses of up to `GROUPS_PER_PASS` groups of queries."""
        groups = [
            queries.part(slice(at, at + QUERIES_PER_GROUP))
            for at in range(0, len(queries.coordinates), QUERIES_PER_GROUP)
        ]
        segments, offsets = zip(
            *(_query_segment(group.projection) for group in groups), strict=True
        )
        bounds, block_minima = _bounds(self._data, np.array(segments), self._rounding)
        for i, group in enumerate(groups):
            self._search_group(group, bounds[i], block_minima[i], offsets[i], bound_error)

    def _search_group(
        self,
        queries: _Queries,
        bounds: NDArray[np.float32],
        block_minima: NDArray[np.float32],
        offset: float,
        bound_error: float,
    ) -> None:
        """Find the nearest poses of a group, given the bounds of its query segment.

        ``offset`` is the largest distance (mm) of a query from the segment.
        """
        from priorfill.search.neighbour_kernels import FAR_SQUARE, ROUND_UP

        squares, rows = queries.squares, queries.rows
        # a span has at least one pose, so this many contain k poses
        seeds = min(max(MIN_SEED_SPANS, squares.shape[1]), len(self._vertices))
        squares[:], rows[:] = FAR_SQUARE, len(self._poses)
        cutoff = _kth_least(bounds, block_minima, seeds)
        self._measure(_spans_within(bounds, block_minima, cutoff), queries, bound_error)
        kth_square = squares[:, :1].copy()  # the farthest of the k is first in the heap
        squares[:], rows[:] = kth_square, len(self._poses)
        radius = (float(kth_square.max()) ** 0.5 + offset + bound_error) * ROUND_UP
        spans = _spans_within(bounds, block_minima, radius)
        for at in range(0, len(spans), SPANS_PER_BATCH):
            self._measure(spans[at : at + SPANS_PER_BATCH], queries, bound_error)
        squares[:], rows[:] = in_order(squares, rows)

    def _measure(self, spans: NDArray[np.intp], queries: _Queries, bound_error: float) -> None:
        """Measure the poses of some spans, given ascending; see `measure_spans`."""
        from priorfill.search.kernels import measure_spans

        # the vertices of these spans, and where a span ends at a vertex that is not among them,
        # that one as well
        ends_outside = self._data.connected[spans]
        ends_outside[:-1] &= spans[1:] != spans[:-1] + 1
        at = np.flatnonzero(ends_outside)
        vertices = np.insert(spans, at + 1, spans[at] + 1)
        selected = np.ones(len(vertices), dtype=np.bool_)
        selected[at + np.arange(1, len(at) + 1)] = False
        connected = self._data.connected[vertices] & selected
        first = self._vertices[vertices]
        last = first + selected
        np.copyto(last[:-1], first[1:], where=connected[:-1])
        data = _SpanData(
            np.take(self._data.projection, vertices, axis=0),
            connected,
            self._data.squared_length[vertices],
            self._data.chord_error[vertices],
        )
        # every query is a segment of length 0
        segments = np.zeros((len(queries.projection), 2 * DIRECTIONS + 1), dtype=np.float32)
        segments[:, :DIRECTIONS] = queries.projection
        bounds, block_minima = _bounds(data, segments, self._rounding)
        measure_spans(
            self._poses,
            first,
            last,
            bounds,
            block_minima,
            queries.coordinates,
            bound_error,
            self._rounding,
            queries.squares,
            queries.rows,
        )


def _bounds(
    data: _SpanData, segments: NDArray[np.float32], rounding: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Bound the distances of query segments from spans; see `bound_spans`.

    Returns
    -------
    bounds : ndarray [shape=(segments, blocks, BLOCK_SPANS), mm]
        The last block is padded with infinity.
    block_minima : ndarray [shape=(segments, blocks), mm]
        The least bound of each block.
    """
    from priorfill.search.kernels import BLOCK_SPANS, bound_spans

    count, directions = data.projection.shape
    bounds = np.empty((len(segments), -(-count // BLOCK_SPANS), BLOCK_SPANS), dtype=np.float32)
    work = np.zeros((directions + 5, BLOCK_SPANS + 1), dtype=np.float32)
    bound_spans(*data, segments, rounding, work[2:], work[0], work[1], bounds)
    bounds.reshape(len(segments), -1)[:, count:] = np.inf
    return bounds, bounds.min(axis=2)


def _kth_least(bounds: NDArray[np.float32], block_minima: NDArray[np.float32], k: int) -> float:
    """Return the k-th least bound (mm) of a query segment; arguments as from `_bounds`."""
    blocks = min(-(-CANDIDATES_PER_SEED * k // bounds.shape[1]), len(block_minima))
    # the k-th least within the blocks of the least minima is an upper limit for that of all
    candidates = bounds[np.argpartition(block_minima, blocks - 1)[:blocks]]
    limit = np.partition(candidates, k - 1, axis=None)[k - 1]
    near = bounds[block_minima <= limit]
    return float(np.partition(near[near <= limit], k - 1)[k - 1])


def _spans_within(
    bounds: NDArray[np.float32], block_minima: NDArray[np.float32], radius: float
) -> NDArray[np.intp]:
    """Return the spans, ascending, whose bounds (as from `_bounds`) are at most ``radius`` mm."""
    blocks = np.flatnonzero(block_minima <= radius)
    inside = np.flatnonzero(bounds[blocks] <= radius)
    skipped = (blocks - np.arange(len(blocks))) * bounds.shape[1]
    spans: NDArray[np.intp] = inside + skipped[inside // bounds.shape[1]]
    return spans


def _query_segment(points: NDArray[np.float32]) -> tuple[NDArray[np.float32], float]:
    """Return the segment of a straight line that best fits some points, and its largest error (mm).

    The segment is in the form that `bound_spans` takes, from the first point along the line to
    the last.
    """
    from priorfill.search.neighbour_kernels import ROUND_UP

    exact = points.astype(np.float64)
    middle = exact.mean(axis=0)
    centred = exact - middle
    _, axes = np.linalg.eigh(centred.T @ centred)
    direction = axes[:, -1].astype(np.float32).astype(np.float64)
    along = centred @ direction
    middle += 0.5 * (along.min() + along.max()) * direction
    segment = np.concatenate([middle, direction, [0.0]]).astype(np.float32)
    exact -= segment[: len(middle)]
    along = exact @ direction
    segment[-1] = np.abs(along).max() * ROUND_UP
    across = exact - along[:, None] * direction
    return segment, float(np.sqrt((across**2).sum(axis=1).max())) * ROUND_UP
