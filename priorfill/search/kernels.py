"""Compiled loops of the search. Arrays in, arrays out: no options, no checks, no I/O.

Poses of a recording follow each other closely, so the few between two of them lie near the line
that joins the two. A *span* is a *knot*, which is a pose, and the poses between it and the next
knot; its *bend* bounds how far any of these is from the line between the two knots. A query's
distances from the knots then bound those from the whole span from below. Distances in the few
directions in which poses differ most bound the true ones from below too: the knots' coordinates
there are their *shadow*. Queries that follow each other lie near a line as well, their *path*.

Bounds are of single precision and widened by what rounding may take; the poses that they let
through are measured with double precision.

The loops are compiled when many poses are first searched, while somebody waits for it, as those
of `priorfill.energy.descent_kernels`: they are given the room they work in, and compare without
``min`` and
``max``, each of which is a function of its own to be compiled. One loop bounds paths and single
queries. NumPy chooses spans and sorts neighbours as fast: see `priorfill.search.index`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from priorfill.runtime.numba_options import ENTRY, HELPER

__all__ = ["bound_spans", "in_root_frames", "lay_spans", "measure_spans"]

Singles = NDArray[np.float32]
Reals = NDArray[np.float64]
Places = NDArray[np.int64]
Flags = NDArray[np.bool_]

FAST = {"reassoc", "contract", "nsz", "nnan", "ninf"}
"""What the compiler may do with bounds: finite, and widened for any order of their sums."""

BLOCK = 256
"""Spans bounded at a time: their shadow and squares stay in the processor's first cache."""

AT_ONCE = 4
"""Directions that are summed in one pass; there are a multiple of so many."""

NOTHING = np.float32(1e-20)
"""mm². Added to a length that is divided by: too little to matter where there is one."""

UP = 1.0 + 2.0**-20
"""Rounds a bound up, to single precision and after a few operations of double precision."""


@njit(**ENTRY)
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
        row = rows[i]
        x, y, z = 0.0, 0.0, 0.0
        for m in range(root.size):
            marker = root[m]
            x += positions[row, marker, 0]
            y += positions[row, marker, 1]
            z += positions[row, marker, 2]
        x, y, z = x / root.size, y / root.size, z / root.size
        sine, cosine = 0.0, 0.0
        for m in range(root.size):
            marker = root[m]
            across, ahead = positions[row, marker, 0] - x, positions[row, marker, 1] - y
            sine += ahead * shape[m, 0] - across * shape[m, 1]
            cosine += across * shape[m, 0] + ahead * shape[m, 1]
        size = math.sqrt(sine * sine + cosine * cosine)
        if size > 0.0:
            sine, cosine = sine / size, cosine / size
        else:
            sine, cosine = 0.0, 1.0
        for c in range(columns.size):
            marker = columns[c]
            across, ahead = positions[row, marker, 0] - x, positions[row, marker, 1] - y
            local[i, 3 * c] = across * cosine + ahead * sine
            local[i, 3 * c + 1] = ahead * cosine - across * sine
            local[i, 3 * c + 2] = positions[row, marker, 2] - z


@njit(**HELPER, fastmath=FAST)
def _apart(poses: Singles, row: int, other: Singles, other_row: int) -> np.float32:
    """Return the squared distance of two rows, nearly."""
    total = np.float32(0.0)
    for d in range(poses.shape[1]):
        step = poses[row, d] - other[other_row, d]
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
            share = 0.5 + (before - after) / (2.0 * length)
            if share < 0.0:
                share = 0.0
            elif share > 1.0:
                share = 1.0
        off = (1.0 - share) * before + share * after - share * (1.0 - share) * length
        off += slack * (after if after > before else before)
        if off > most:
            most = off
    return math.sqrt(most) * UP


@njit(**ENTRY)
def lay_spans(
    poses: Singles,
    ends: Places,
    recording: int,
    begin: int,
    end: int,
    longest: int,
    most_bend: float,
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
    most_bend : float
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
            if far <= most_bend:
                break
            length //= 2
        to = min(row + length, last)
        knots[count] = row
        joined[count] = to > row + 1
        bend[count] = far if joined[count] else 0.0
        count += 1
        row = max(to, row + 1)
    return count


@njit(**ENTRY, fastmath=FAST)
def bound_spans(
    shadow: Singles,
    joined: Flags,
    length: Singles,
    bend: Singles,
    paths: Singles,
    slack: float,
    near: Singles,
    squares: Singles,
    along: Singles,
    bounds: Singles,
) -> None:
    """Bound the distances of some paths from the poses of all spans, from below.

    Parameters
    ----------
    shadow : ndarray [shape=(knots, directions), mm]
        The knots' coordinates in some orthonormal directions.
    joined : ndarray of bool [shape=(knots,)]
        As in `lay_spans`.
    length : ndarray [shape=(knots,), mm²]
        Squared length of the lines of the spans, in these directions; 0 for a knot alone.
    bend : ndarray [shape=(knots,), mm]
        As in `lay_spans`.
    paths : ndarray [shape=(paths, 2 * directions + 1), mm]
        Straight ones: the middle of each, its direction, of length 1, and half its length. A point
        is a path of length 0, of any direction. Several at a time, as passing over all knots is
        bound by the memory.
    slack : float
        Part of a square that rounding may take.
    near : ndarray [shape=(directions + 3, BLOCK + 1)]
        Room for what is given of the knots of a block; finite.
    squares, along : ndarray [shape=(BLOCK + 1,)]
        Room for how far a path is from them.
    bounds : ndarray [shape=(paths, knots / BLOCK, rounded up, BLOCK), mm]
        Written. They may be below 0, and are off by some roundings of single precision. Those
        after the last of the knots mean nothing.
    """
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    thin = np.float32(slack)
    knots, directions = shadow.shape
    for block in range(bounds.shape[1]):
        # of the last block, what is left in the room of the one before is bounded as well
        begin = block * BLOCK
        wide = knots - begin
        if wide > BLOCK + 1:
            wide = BLOCK + 1
        for i in range(wide):
            for d in range(directions):
                near[d, i] = shadow[begin + i, d]
            near[directions, i] = length[begin + i]
            near[directions + 1, i] = bend[begin + i]
            near[directions + 2, i] = zero if joined[begin + i] else one
        for path in range(paths.shape[0]):
            reach = paths[path, 2 * directions]
            for i in range(BLOCK + 1):
                squares[i] = along[i] = zero
            for d in range(0, directions, AT_ONCE):
                p, q = paths[path, d], paths[path, d + 1]
                r, s = paths[path, d + 2], paths[path, d + 3]
                for i in range(BLOCK + 1):
                    u, v = near[d, i] - p, near[d + 1, i] - q
                    w, x = near[d + 2, i] - r, near[d + 3, i] - s
                    squares[i] += (u * u + v * v) + (w * w + x * x)
                if reach > zero:
                    to = directions + d
                    e, f = paths[path, to], paths[path, to + 1]
                    g, h = paths[path, to + 2], paths[path, to + 3]
                    for i in range(BLOCK + 1):
                        u, v = near[d, i] - p, near[d + 1, i] - q
                        w, x = near[d + 2, i] - r, near[d + 3, i] - s
                        along[i] += (u * e + v * f) + (w * g + x * h)
            for i in range(BLOCK):
                alone = near[directions + 2, i] > zero
                first, here = squares[i], along[i]
                last = first if alone else squares[i + 1]
                there = here if alone else along[i + 1]
                # across the path's direction, by the squared distances from the line's ends
                step = there - here
                a, b = first - here * here, last - there * there
                whole = near[directions, i] - step * step
                whole = whole if whole > zero else zero
                share = half + half * (a - b) / (whole + NOTHING)
                share = share if share > zero else zero
                share = share if share < one else one
                rest = one - share
                square = rest * a + share * b - share * rest * whole - thin * (first + last)
                # and along it where the whole span is beyond an end
                low = here if here < there else there
                high = there if here < there else here
                before, behind = low - reach, -reach - high
                beyond = before if before > behind else behind
                beyond = beyond if beyond > zero else zero
                square += beyond * beyond
                square = square if square > zero else zero
                bounds[path, block, i] = np.float32(math.sqrt(square)) - near[directions + 1, i]


@njit(**HELPER)
def _exactly_apart(poses: Singles, row: int, other: Singles, other_row: int) -> float:
    """Return the squared distance of two rows, summed in the order of the dimensions."""
    total = 0.0
    for d in range(poses.shape[1]):
        step = np.float64(poses[row, d]) - np.float64(other[other_row, d])
        total += step * step
    return total


@njit(**HELPER)
def _after(far: float, row: int, other_far: float, other_row: int) -> bool:
    """Say whether one neighbour comes after another: the farther, then that of the later row."""
    return far > other_far or (far == other_far and row > other_row)


@njit(**HELPER)
def _keep(far: Reals, rows: Places, query: int, new_far: float, new_row: int) -> None:
    """Let a neighbour replace the last of all in a query's heap, which is on top."""
    at = 0
    child = 1
    while child < far.shape[1]:
        other = child + 1
        if other < far.shape[1] and _after(
            far[query, other], rows[query, other], far[query, child], rows[query, child]
        ):
            child = other
        if not _after(far[query, child], rows[query, child], new_far, new_row):
            break
        far[query, at] = far[query, child]
        rows[query, at] = rows[query, child]
        at = child
        child = 2 * at + 1
    far[query, at] = new_far
    rows[query, at] = new_row


@njit(**ENTRY)
def measure_spans(
    poses: Singles,
    first: Places,
    last: Places,
    bounds: Singles,
    least: Singles,
    queries: Singles,
    blur: float,
    slack: float,
    far: Reals,
    rows: Places,
) -> None:
    """Find the k nearest poses of each query among some spans.

    Parameters
    ----------
    poses, slack
        As in `lay_spans`.
    first, last : ndarray of int [shape=(spans,)]
        The rows of each span: from, and up to.
    bounds, least
        Of the queries and these spans, as `bound_spans` has written them.
    queries : ndarray [shape=(queries, dimensions), mm]
        The queries.
    blur : float
        mm; how far off the bounds may be at most.
    far : ndarray [shape=(queries, k), mm²]
        Replaced by the squared distances; the farthest is the first, the others are in no order. On
        entry no neighbour is of interest that is farther than any of a query.
    rows : ndarray of int [shape=(queries, k)]
        Replaced by the rows of the poses; beyond all on entry.
    """
    for query in range(queries.shape[0]):
        radius = (math.sqrt(far[query, 0]) + blur) * UP
        for block in range(least.shape[1]):
            if least[query, block] > radius:
                continue
            for i in range(BLOCK):
                if bounds[query, block, i] > radius:
                    continue
                span = block * BLOCK + i
                for row in range(first[span], last[span]):
                    if _apart(poses, row, queries, query) > far[query, 0] * (1.0 + slack):
                        continue
                    exact = _exactly_apart(poses, row, queries, query)
                    if _after(far[query, 0], rows[query, 0], exact, row):
                        _keep(far, rows, query, exact, row)
                        radius = (math.sqrt(far[query, 0]) + blur) * UP
