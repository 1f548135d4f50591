"""Compiled loops of the search. Arrays in, arrays out: no options, no checks, no I/O.

Poses of a recording follow each other closely, so the few between two of them lie near the line
that joins the two. A *span* is a *knot*, which is a pose, and the poses between it and the next
knot; its *bend* bounds how far any of these is from the line between the two knots. A query's
distances from the knots then bound those from the whole span from below. Distances in the few
directions in which poses differ most bound the true ones from below too: the knots' coordinates
there are their *shadow*.

Bounds are of single precision and widened by what rounding may take; the poses that they let
through are measured with double precision.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["bend_spans", "bound_spans", "choose_spans", "measure_spans"]

Singles = NDArray[np.float32]
Reals = NDArray[np.float64]
Places = NDArray[np.int64]
Flags = NDArray[np.bool_]

FAST = {"reassoc", "contract", "nsz", "nnan", "ninf"}
"""What the compiler may do with bounds: finite, and widened for any order of their sums."""

HELPER: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
"""Of functions that only compiled ones call: without a way in from Python they compile faster."""

BLOCK = 512
"""Spans bounded at a time: their shadow and squares stay in the processor's first cache."""

NEAR_BLOCK = 128
"""Spans bounded at a time whose poses are measured next: these stay in the second cache."""

NOTHING = np.float32(1e-20)
"""mm². Added to a length that is divided by: too little to matter where there is one."""

UP = 1.0 + 2.0**-20
"""Rounds a bound up, to single precision and after a few operations of double precision."""


@njit(**HELPER, fastmath=FAST)
def _apart(poses: Singles, row: int, other: Singles, other_row: int) -> np.float32:
    """Return the squared distance of two rows, nearly."""
    total = np.float32(0.0)
    for d in range(poses.shape[1]):
        step = poses[row, d] - other[other_row, d]
        total += step * step
    return total


@njit(**HELPER)
def _exactly_apart(poses: Singles, row: int, other: Singles, other_row: int) -> float:
    """Return the squared distance of two rows, summed in the order of the dimensions."""
    total = 0.0
    for d in range(poses.shape[1]):
        step = np.float64(poses[row, d]) - np.float64(other[other_row, d])
        total += step * step
    return total


@njit(cache=True, nogil=True, fastmath=FAST)
def bend_spans(
    poses: Singles, knots: Places, joined: Flags, begin: int, end: int, slack: float, bend: Singles
) -> None:
    """Bound how far the poses of some spans are from their lines.

    Parameters
    ----------
    poses : ndarray [shape=(poses, dimensions), mm]
        All of them.
    knots : ndarray of int [shape=(knots,)]
        Their rows, ascending.
    joined : ndarray of bool [shape=(knots,)]
        Whether a knot's span leads to the next knot; else it is the knot alone.
    begin, end : int
        The spans to look at, as a range of knots.
    slack : float
        Part of a square that rounding may take.
    bend : ndarray [shape=(knots,), mm]
        Written where there is a span to look at.
    """
    for knot in range(begin, end):
        if not joined[knot]:
            bend[knot] = 0.0
            continue
        first, last = knots[knot], knots[knot + 1]
        length = np.float64(_apart(poses, first, poses, last))
        most = 0.0
        for row in range(first + 1, last):
            before = np.float64(_apart(poses, row, poses, first))
            after = np.float64(_apart(poses, row, poses, last))
            # any point of the line will do for a bound; its distance is by Stewart's theorem
            share = 0.0
            if length > 0.0:
                share = min(max(0.5 + (before - after) / (2.0 * length), 0.0), 1.0)
            off = (1.0 - share) * before + share * after - share * (1.0 - share) * length
            most = max(most, off + slack * max(before, after))
        bend[knot] = math.sqrt(most) * UP


@njit(**HELPER)
def _after(far: float, row: int, other_far: float, other_row: int) -> bool:
    """Say whether one neighbour comes after another: the farther, then that of the later row."""
    return far > other_far or (far == other_far and row > other_row)


@njit(**HELPER)
def _sink(far: Reals, rows: Places, size: int) -> None:
    """Put the top of a heap where it belongs; the last of all neighbours is on top."""
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size:
            break
        if child + 1 < size and _after(far[child + 1], rows[child + 1], far[child], rows[child]):
            child += 1
        if not _after(far[child], rows[child], far[at], rows[at]):
            break
        far[at], far[child] = far[child], far[at]
        rows[at], rows[child] = rows[child], rows[at]
        at = child


@njit(**HELPER)
def _keep(far: Reals, rows: Places, size: int, new_far: float, new_row: int) -> int:
    """Offer a neighbour to a heap of the best ones; return how many there are."""
    if size < far.size:
        at = size
        far[at], rows[at] = new_far, new_row
        while at > 0:
            parent = (at - 1) // 2
            if not _after(far[at], rows[at], far[parent], rows[parent]):
                break
            far[at], far[parent] = far[parent], far[at]
            rows[at], rows[parent] = rows[parent], rows[at]
            at = parent
        return size + 1
    if _after(far[0], rows[0], new_far, new_row):
        far[0], rows[0] = new_far, new_row
        _sink(far, rows, size)
    return size


@njit(**HELPER)
def _sort(far: Reals, rows: Places) -> None:
    """Sort a full heap, the nearest first."""
    for rest in range(far.size - 1, 0, -1):
        far[0], far[rest] = far[rest], far[0]
        rows[0], rows[rest] = rows[rest], rows[0]
        _sink(far, rows, rest)


@njit(**HELPER, fastmath=FAST)
def _bound_block(
    shadow: Singles,
    joined: Flags,
    length: Singles,
    begin: int,
    end: int,
    points: Singles,
    point: int,
    slack: float,
    squares: Singles,
    bounds: Singles,
) -> None:
    """Bound the squared distances of a point from the lines of a range of spans, from below.

    ``shadow`` has a row for each direction; its columns, ``joined`` and ``length`` (squared) are
    of the knots. ``squares`` and ``bounds`` are written from their start.
    """
    zero, half, one, thin = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(slack)
    count = end - begin
    wide = min(count + 1, shadow.shape[1] - begin)
    for i in range(count + 1):
        squares[i] = zero
    for d in range(shadow.shape[0]):
        line = shadow[d, begin : begin + wide]
        at = points[point, d]
        for i in range(wide):
            step = line[i] - at
            squares[i] += step * step
    lengths = length[begin:end]
    leads = joined[begin:end]
    for i in range(count):
        first = squares[i]
        last = squares[i + 1] if leads[i] else first
        whole = lengths[i]
        # a length of 0 has a share of 1/2 of two equal squares
        share = half + half * (first - last) / (whole + NOTHING)
        share = min(max(share, zero), one)
        rest = one - share
        bounds[i] = rest * first + share * last - share * rest * whole - thin * max(first, last)


@njit(**HELPER)
def _measure(
    poses: Singles,
    begin: int,
    end: int,
    queries: Singles,
    query: int,
    slack: float,
    reach: float,
    far: Reals,
    rows: Places,
    size: int,
) -> int:
    """Offer a range of poses to a query's heap; return how many it then holds.

    No pose farther than ``reach`` (mm²) is of interest.
    """
    limit = reach if size < far.size else min(reach, far[0])
    for row in range(begin, end):
        if _apart(poses, row, queries, query) > limit * (1.0 + slack):
            continue
        exact = _exactly_apart(poses, row, queries, query)
        if exact <= limit:
            size = _keep(far, rows, size, exact, row)
            if size == far.size:
                limit = min(reach, far[0])
    return size


@njit(cache=True, nogil=True)
def bound_spans(
    shadow: Singles,
    joined: Flags,
    length: Singles,
    points: Singles,
    centres: Places,
    slack: float,
    bounds: Singles,
) -> None:
    """Bound the squared distances of some points from the lines of all spans, from below.

    Parameters
    ----------
    shadow : ndarray [shape=(directions, knots), mm]
        The knots' coordinates in some orthonormal directions.
    joined : ndarray of bool [shape=(knots,)]
        As in `bend_spans`.
    length : ndarray [shape=(knots,), mm²]
        Squared length of the lines of the spans, in these directions; 0 for a knot alone.
    points : ndarray [shape=(queries, directions), mm]
        The queries' coordinates there.
    centres : ndarray of int [shape=(centres,)]
        Which of them. Several at a time, as passing over all knots is bound by the memory.
    slack : float
        Part of a square that rounding may take.
    bounds : ndarray [shape=(centres, knots), mm²]
        Written.
    """
    squares = np.empty(BLOCK + 1, dtype=np.float32)
    for begin in range(0, joined.size, BLOCK):
        end = min(begin + BLOCK, joined.size)
        for i in range(centres.size):
            _bound_block(
                shadow, joined, length, begin, end, points, centres[i], slack, squares,
                bounds[i, begin:end],
            )  # fmt: skip


@njit(cache=True, nogil=True)
def choose_spans(
    poses: Singles,
    knots: Places,
    joined: Flags,
    bend: Singles,
    queries: Singles,
    points: Singles,
    centre: int,
    blur: float,
    slack: float,
    bounds: Singles,
    seeds: int,
    far: Reals,
    rows: Places,
    reach: Reals,
    columns: Places,
) -> int:
    """Choose the spans that may hold one of the k nearest poses of some queries.

    Parameters
    ----------
    poses : ndarray [shape=(poses, dimensions), mm]
        To search among.
    knots, joined, bend, slack
        As in `bend_spans`.
    queries, points : ndarray [shape=(queries, dimensions), (queries, directions), mm]
        The queries, and their coordinates in the directions.
    centre : int
        One of them.
    blur : float
        mm; bound on how far rounding moves a knot and a point there, together.
    bounds : ndarray [shape=(knots,), mm²]
        Of the centre's squared distances from the spans' lines, see `bound_spans`.
    seeds : int
        The poses of so many spans, the nearest ones, say how far the neighbours may be.
    far, rows : ndarray [shape=(queries, k)]
        Overwritten. k is at most the number of poses.
    reach : ndarray [shape=(queries,), mm²]
        Written: the k-th neighbour is not farther; infinite where the seeds have fewer poses.
    columns : ndarray of int [shape=(knots,)]
        Written from its start: the spans, ascending, and as -1 - knot those knots that only end
        one of them.

    Returns
    -------
    int
        How many columns there are.
    """
    k = far.shape[1]
    seed_bounds = np.empty(min(seeds, bounds.size))
    seed = np.empty(seed_bounds.size, dtype=np.int64)
    none: Any = np.int64(0)  # of a literal 0 the helpers would be compiled once more
    size: int = none
    for span in range(bounds.size):
        if size < seed.size or bounds[span] < seed_bounds[0]:
            size = _keep(seed_bounds, seed, size, np.float64(bounds[span]), span)
    apart, most = 0.0, 0.0
    for query in range(queries.shape[0]):
        size = none
        for near in seed:
            last = knots[near + 1] if joined[near] else knots[near] + 1
            size = _measure(
                poses, knots[near], last, queries, query, slack, np.inf,
                far[query], rows[query], size,
            )  # fmt: skip
        reach[query] = far[query, 0] if size == k else np.inf
        most = max(most, reach[query])
        apart = max(apart, np.float64(_apart(points, centre, points, query)))
    radius = (math.sqrt(apart * (1.0 + slack)) + math.sqrt(most) + blur) * UP
    count = 0
    end = -1
    for span in range(bounds.size):
        wide = radius + bend[span]
        inside = bounds[span] <= wide * wide
        if inside:
            columns[count] = span
            count += 1
        elif span == end:
            columns[count] = -1 - span
            count += 1
        if inside and joined[span]:
            end = span + 1
    return count


@njit(cache=True, nogil=True)
def measure_spans(
    poses: Singles,
    knots: Places,
    joined: Flags,
    bend: Singles,
    columns: Places,
    shadow: Singles,
    length: Singles,
    queries: Singles,
    points: Singles,
    blur: float,
    slack: float,
    reach: Reals,
    far: Reals,
    rows: Places,
) -> int:
    """Find the k nearest poses of each query among some spans, nearest first, then by row.

    Parameters
    ----------
    poses, knots, joined, bend, queries, points, blur, slack, reach
        As in `choose_spans`.
    columns : ndarray of int [shape=(columns,)]
        What `choose_spans` has written.
    shadow, length
        As in `bound_spans`.
    far : ndarray [shape=(queries, k), mm²]
        Written: squared distances.
    rows : ndarray of int [shape=(queries, k)]
        Written: rows of the poses.

    Returns
    -------
    int
        How many poses were measured.
    """
    count, k = far.shape
    directions = shadow.shape[0]
    # those of some columns and the one after them, side by side
    near_shadow = np.empty((directions, NEAR_BLOCK + 1), dtype=np.float32)
    near_joined = np.empty(NEAR_BLOCK, dtype=np.bool_)
    near_length = np.empty(NEAR_BLOCK, dtype=np.float32)
    squares = np.empty(NEAR_BLOCK + 1, dtype=np.float32)
    bounds = np.empty(NEAR_BLOCK, dtype=np.float32)
    size = np.empty(count, dtype=np.int64)
    radius = np.empty(count)
    for query in range(count):
        size[query] = 0
        radius[query] = (math.sqrt(reach[query]) + blur) * UP
    measured = 0
    for begin in range(0, columns.size, NEAR_BLOCK):
        end = min(begin + NEAR_BLOCK, columns.size)
        for d in range(directions):
            for i in range(begin, min(end + 1, columns.size)):
                span = columns[i]
                near_shadow[d, i - begin] = shadow[d, span if span >= 0 else -1 - span]
        for i in range(begin, end):
            span = columns[i]
            near_joined[i - begin] = span >= 0 and joined[span]
            near_length[i - begin] = length[span] if near_joined[i - begin] else 0.0
        for query in range(count):
            _bound_block(
                near_shadow, near_joined, near_length, 0, end - begin, points, query, slack,
                squares, bounds,
            )  # fmt: skip
            for i in range(begin, end):
                span = columns[i]
                if span < 0:
                    continue
                wide = radius[query] + bend[span]
                if bounds[i - begin] > wide * wide:
                    continue
                first = knots[span]
                last = knots[span + 1] if joined[span] else first + 1
                measured += last - first
                size[query] = _measure(
                    poses, first, last, queries, query, slack, reach[query],
                    far[query], rows[query], size[query],
                )  # fmt: skip
                if size[query] == k:
                    radius[query] = (math.sqrt(min(reach[query], far[query, 0])) + blur) * UP
    for query in range(count):
        _sort(far[query], rows[query])
    return measured
