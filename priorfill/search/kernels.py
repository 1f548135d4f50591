"""Compiled loops of the search. Arrays in, arrays out: no options, no checks, no I/O.

Poses of a recording follow each other closely, so the few between two of them lie near the line
that joins the two. A *span* is a *knot*, which is a pose, and the poses between it and the next
knot; its *bend* bounds how far any of these is from the line between the two knots. A query's
distances from the knots then bound those from the whole span from below. Distances in the few
directions in which poses differ most bound the true ones from below too: the knots' coordinates
there are their *shadow*. Queries that follow each other lie near a line as well, their *path*.

Bounds are of single precision and widened by what rounding may take; the poses that they let
through are measured with double precision.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "bound_of",
    "bound_spans",
    "choose_spans",
    "in_root_frames",
    "lay_spans",
    "measure_spans",
]

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

LOOP: dict[str, Any] = {**HELPER, "fastmath": FAST, "error_model": "numpy"}
"""Of loops that are to work on several numbers at once: nothing is raised at a division by 0."""

BLOCK = 256
"""Spans bounded at a time: their shadow and squares stay in the processor's first cache."""

AT_ONCE = 4
"""Directions that are summed in one pass; there are a multiple of so many."""

NOTHING = np.float32(1e-20)
"""mm². Added to a length that is divided by: too little to matter where there is one."""

MOST = np.float32(3e38)
"""More than any square that is compared. Not infinite, see `FAST`."""

UP = 1.0 + 2.0**-20
"""Rounds a bound up, to single precision and after a few operations of double precision."""


@njit(cache=True, nogil=True)
def in_root_frames(
    positions: Singles,
    rows: Places,
    begin: int,
    end: int,
    root: Places,
    shape: Reals,
    columns: Places,
    local: Singles,
) -> None:
    """Bring poses into root frames by position and heading.

    Parameters
    ----------
    positions : ndarray [shape=(poses, markers, 3), mm]
        All poses.
    rows : ndarray of int [shape=(rows,)]
        Those that are wanted.
    begin, end : int
        The rows to look at.
    root : ndarray of int [shape=(group,)]
        The root group's markers.
    shape : ndarray [shape=(group, 3), mm]
        Their template, its centre at 0.
    columns : ndarray of int [shape=(columns,)]
        The markers that are wanted.
    local : ndarray [shape=(rows, 3 * columns), mm]
        Written.
    """
    for i in range(begin, end):
        pose = positions[rows[i]]
        x, y, z = 0.0, 0.0, 0.0
        for marker in root:
            x += pose[marker, 0]
            y += pose[marker, 1]
            z += pose[marker, 2]
        x, y, z = x / root.size, y / root.size, z / root.size
        sine, cosine = 0.0, 0.0
        for m in range(root.size):
            across, ahead = pose[root[m], 0] - x, pose[root[m], 1] - y
            sine += ahead * shape[m, 0] - across * shape[m, 1]
            cosine += across * shape[m, 0] + ahead * shape[m, 1]
        size = math.sqrt(sine * sine + cosine * cosine)
        if size > 0.0:
            sine, cosine = sine / size, cosine / size
        else:
            sine, cosine = 0.0, 1.0
        for c in range(columns.size):
            marker = columns[c]
            across, ahead = pose[marker, 0] - x, pose[marker, 1] - y
            local[i, 3 * c] = across * cosine + ahead * sine
            local[i, 3 * c + 1] = ahead * cosine - across * sine
            local[i, 3 * c + 2] = pose[marker, 2] - z


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


@njit(**HELPER, fastmath=FAST)
def _bend(poses: Singles, first: int, last: int, slack: float) -> float:
    """Bound how far the poses between two are from the line that joins these."""
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
    return math.sqrt(most) * UP


@njit(cache=True, nogil=True)
def lay_spans(
    poses: Singles,
    ends: Places,
    recording: int,
    begin: int,
    end: int,
    longest: int,
    least: float,
    slack: float,
    knots: Places,
    joined: Flags,
    bend: Singles,
) -> int:
    """Lay spans over a range of poses: as long as the poses in them are near their lines.

    Parameters
    ----------
    poses : ndarray [shape=(poses, dimensions), mm]
        All of them.
    ends : ndarray of int [shape=(recordings + 1,)]
        Where recordings start, ascending, and the number of poses.
    recording : int
        Of these ends, the first one after ``begin``.
    begin, end : int
        The poses to look at; a span begins at either.
    longest : int
        So many poses a span at most.
    least : float
        mm; a span of more than one pose does not bend by more.
    slack : float
        Part of a square that rounding may take.
    knots : ndarray of int
        Written from its start: the rows of the knots.
    joined : ndarray of bool
        Written: whether a knot's span leads to the next knot; else it is the knot alone.
    bend : ndarray [mm]
        Written: how far the poses of each span are from its line at most.

    Returns
    -------
    int
        How many knots there are.
    """
    count = 0
    row = begin
    length = longest
    while row < end:
        while ends[recording] <= row:
            recording += 1
        last = min(end, ends[recording] - 1)
        length = min(2 * length, longest)
        far = 0.0
        while length > 1:
            # the poses themselves are as good as a span that ends with the recording
            to = min(row + length, last)
            far = _bend(poses, row, to, slack) if to > row + 1 else 0.0
            if far <= least:
                break
            length //= 2
        to = min(row + length, last)
        knots[count] = row
        joined[count] = to > row + 1
        bend[count] = far if joined[count] else 0.0
        count += 1
        row = max(to, row + 1)
    return count


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


@njit(**LOOP)
def _from_line(first: np.float32, last: np.float32, whole: np.float32) -> np.float32:
    """Return the squared distance from a line between two points, by those from its ends.

    ``whole`` is its squared length. Of a length of 0 both distances are the same.
    """
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    share = min(max(half + half * (first - last) / (whole + NOTHING), zero), one)
    rest = one - share
    return rest * first + share * last - share * rest * whole


@njit(**LOOP)
def _add_squares(
    shadow: Singles, begin: int, end: int, points: Singles, point: int, squares: Singles
) -> None:
    """Write squared distances of a point from the knots of a range of columns."""
    squares[: end - begin] = np.float32(0.0)
    for d in range(0, shadow.shape[0], AT_ONCE):
        a, b = shadow[d, begin:end], shadow[d + 1, begin:end]
        e, f = shadow[d + 2, begin:end], shadow[d + 3, begin:end]
        p, q = points[point, d], points[point, d + 1]
        r, s = points[point, d + 2], points[point, d + 3]
        for i in range(end - begin):
            u, v, w, x = a[i] - p, b[i] - q, e[i] - r, f[i] - s
            squares[i] += (u * u + v * v) + (w * w + x * x)


@njit(**LOOP)
def _add_along(
    shadow: Singles, begin: int, end: int, paths: Singles, path: int, along: Singles
) -> None:
    """Write how far along a path, from its middle, the knots of a range of columns are."""
    directions = shadow.shape[0]
    along[: end - begin] = np.float32(0.0)
    for d in range(0, directions, AT_ONCE):
        a, b = shadow[d, begin:end], shadow[d + 1, begin:end]
        e, f = shadow[d + 2, begin:end], shadow[d + 3, begin:end]
        p, q, r, s = paths[path, d], paths[path, d + 1], paths[path, d + 2], paths[path, d + 3]
        to = directions + d
        u, v, w, x = paths[path, to], paths[path, to + 1], paths[path, to + 2], paths[path, to + 3]
        for i in range(end - begin):
            along[i] += (a[i] - p) * u + (b[i] - q) * v + ((e[i] - r) * w + (f[i] - s) * x)


@njit(**LOOP)
def _bound_by_point(
    squares: Singles, joined: Flags, length: Singles, slack: float, bounds: Singles
) -> None:
    """Bound the squared distances of a point from the lines of some spans, from below.

    By its squared distances from the knots and the one after them. ``joined`` and ``length``, which
    is squared, are of the knots; ``bounds`` is written from its start.
    """
    thin = np.float32(slack)
    for i in range(joined.size):
        first = squares[i]
        last = squares[i + 1] if joined[i] else first
        bounds[i] = _from_line(first, last, length[i]) - thin * (first + last)


@njit(**LOOP)
def _bound_by_path(
    squares: Singles,
    along: Singles,
    joined: Flags,
    length: Singles,
    half: np.float32,
    slack: float,
    bounds: Singles,
) -> np.float32:
    """Bound the squared distances of a path from the lines of some spans, as `_bound_by_point`.

    By how far the knots are from its middle, and along it; ``half`` is half its length. Returns
    the least of the bounds.
    """
    zero, thin = np.float32(0.0), np.float32(slack)
    least = MOST
    for i in range(joined.size):
        first, here = squares[i], along[i]
        last = squares[i + 1] if joined[i] else first
        there = along[i + 1] if joined[i] else here
        # across the path's direction, and along it where the whole span is beyond an end
        step = there - here
        across = _from_line(
            first - here * here, last - there * there, max(length[i] - step * step, zero)
        )
        beyond = max(max(min(here, there) - half, -half - max(here, there)), zero)
        bounds[i] = across + beyond * beyond - thin * (first + last)
        least = min(least, bounds[i])
    return least


@njit(**LOOP)
def _least_excess(bounds: Singles, bend: Singles, radius: float, count: int) -> np.float32:
    """Return by how much at least the first bounds exceed what is of interest, in squares."""
    least, reach = MOST, np.float32(radius)
    for i in range(count):
        wide = reach + bend[i]
        least = min(least, bounds[i] - wide * wide)
    return least


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
    paths: Singles,
    slack: float,
    bounds: Singles,
    least: Singles,
) -> None:
    """Bound the squared distances of some paths from the lines of all spans, from below.

    Parameters
    ----------
    shadow : ndarray [shape=(directions, knots), mm]
        The knots' coordinates in some orthonormal directions.
    joined : ndarray of bool [shape=(knots,)]
        As in `lay_spans`.
    length : ndarray [shape=(knots,), mm²]
        Squared length of the lines of the spans, in these directions; 0 for a knot alone.
    paths : ndarray [shape=(paths, 2 * directions + 1), mm]
        Straight ones: the middle of each, its direction, of length 1, and half its length. Several
        at a time, as passing over all knots is bound by the memory.
    slack : float
        Part of a square that rounding may take.
    bounds : ndarray [shape=(paths, knots), mm²]
        Written.
    least : ndarray [shape=(paths, knots / BLOCK, rounded up), mm²]
        Written: the least of each `BLOCK` of them.
    """
    squares = np.empty(BLOCK + 1, dtype=np.float32)
    along = np.empty(BLOCK + 1, dtype=np.float32)
    for block in range(least.shape[1]):
        begin = block * BLOCK
        end = min(begin + BLOCK, joined.size)
        for path in range(paths.shape[0]):
            wide = min(end + 1, joined.size)
            _add_squares(shadow, begin, wide, paths, path, squares)
            _add_along(shadow, begin, wide, paths, path, along)
            least[path, block] = _bound_by_path(
                squares, along, joined[begin:end], length[begin:end], paths[path, -1], slack,
                bounds[path, begin:end],
            )  # fmt: skip


@njit(cache=True, nogil=True)
def bound_of(bounds: Singles, least: Singles, count: int) -> float:
    """Return the greatest of the ``count`` least bounds (mm²).

    ``bounds`` and ``least`` are those of a path that `bound_spans` has written.
    """
    kept = np.empty(min(count, bounds.size))
    spans = np.empty(kept.size, dtype=np.int64)
    none: Any = np.int64(0)  # of a literal 0 the helpers would be compiled once more
    size: int = none
    for block in range(least.size):
        if size == kept.size and least[block] >= kept[0]:
            continue
        for span in range(block * BLOCK, min((block + 1) * BLOCK, bounds.size)):
            if size < kept.size or bounds[span] < kept[0]:
                size = _keep(kept, spans, size, np.float64(bounds[span]), span)
    return float(kept[0])


@njit(cache=True, nogil=True)
def choose_spans(
    joined: Flags,
    bend: Singles,
    radius: float,
    most: float,
    bounds: Singles,
    least: Singles,
    columns: Places,
) -> int:
    """Choose the spans that may come within some distance of a path.

    Parameters
    ----------
    joined, bend
        As `lay_spans` has written them.
    radius : float
        mm; the distance.
    most : float
        mm; the most that a span bends.
    bounds, least
        Those of the path that `bound_spans` has written.
    columns : ndarray of int [shape=(knots,)]
        Written from its start: the spans, ascending, and as -1 - knot those knots that only end
        one of them.

    Returns
    -------
    int
        How many columns there are.
    """
    count = 0
    end = -1
    widest = (radius + most) * (radius + most) * UP
    for block in range(least.size):
        begin = block * BLOCK
        if least[block] > widest and end != begin:
            continue
        for span in range(begin, min(begin + BLOCK, bounds.size)):
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
    poses, knots, joined, bend, slack
        As in `lay_spans`.
    columns : ndarray of int [shape=(columns,)]
        What `choose_spans` has written.
    shadow, length
        As in `bound_spans`.
    queries, points : ndarray [shape=(queries, dimensions), (queries, directions), mm]
        The queries, and their coordinates in the directions.
    blur : float
        mm; bound on how far rounding moves a knot and a point there, together.
    reach : ndarray [shape=(queries,), mm²]
        No neighbour is farther.
    far : ndarray [shape=(queries, k), mm²]
        Written: squared distances. The spans have at least k poses that are not farther.
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
    near_shadow = np.empty((directions, BLOCK + 1), dtype=np.float32)
    near_joined = np.empty(BLOCK, dtype=np.bool_)
    near_length = np.empty(BLOCK, dtype=np.float32)
    near_bend = np.empty(BLOCK, dtype=np.float32)
    squares = np.empty(BLOCK + 1, dtype=np.float32)
    bounds = np.empty(BLOCK, dtype=np.float32)
    size = np.empty(count, dtype=np.int64)
    radius = np.empty(count)
    for query in range(count):
        size[query] = 0
        radius[query] = (math.sqrt(reach[query]) + blur) * UP
    measured = 0
    for begin in range(0, columns.size, BLOCK):
        some = min(BLOCK, columns.size - begin)
        wide = min(some + 1, columns.size - begin)
        for i in range(wide):
            span = columns[begin + i]
            knot = span if span >= 0 else -1 - span
            for d in range(directions):
                near_shadow[d, i] = shadow[d, knot]
        for i in range(some):
            span = columns[begin + i]
            near_joined[i] = span >= 0 and joined[span]
            near_length[i] = length[span] if near_joined[i] else 0.0
            near_bend[i] = bend[span] if near_joined[i] else 0.0
        for query in range(count):
            _add_squares(near_shadow, 0, wide, points, query, squares)
            _bound_by_point(squares, near_joined[:some], near_length[:some], slack, bounds)
            if _least_excess(bounds, near_bend, radius[query] * UP, some) > 0.0:
                continue
            for i in range(some):
                span = columns[begin + i]
                within = radius[query] + near_bend[i]
                if span < 0 or bounds[i] > within * within:
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
