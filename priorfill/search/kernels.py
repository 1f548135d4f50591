"""Compiled loops of the search. Arrays in, arrays out: no options, no checks, no I/O.

Consecutive poses of a recording are similar, so the few poses between two of them lie near the
chord that joins the two. Some poses are chosen as *vertices*. A *span* is a vertex and the poses up
to the next vertex, and its *chord error* bounds how far any of these poses is from the chord
between the two vertices. The distances of a query from the vertices then bound its distances from
all poses of the span from below. Distances between *projections* onto the few directions in which
poses differ most bound the true distances from below as well. Consecutive queries lie near a
straight line too, their *query segment*.

Bounds are computed in single precision and widened by the largest possible rounding error. Poses
that a bound does not exclude are measured in double precision.

Functions compile on first use, while the user waits, as those of
`priorfill.energy.descent_kernels`. Work arrays are therefore passed in, and ``min`` and ``max``,
which would be compiled as functions of their own, are avoided; one loop bounds both segments and
single queries. Selecting spans and sorting neighbours is as fast in NumPy; see
`priorfill.search.span_scan`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled
from priorfill.search.neighbour_kernels import (
    FAST_MATH,
    ROUND_UP,
    approximate_square,
    exact_square,
    is_after,
    replace_farthest,
)

__all__ = ["BLOCK_SPANS", "bound_spans", "in_root_frames", "lay_spans", "measure_spans"]

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

BLOCK_SPANS = 256
"""Spans bounded at a time: their projections and squared distances stay in the L1 cache."""

DIRECTIONS_PER_PASS = 4
"""Directions summed in one pass; the number of directions is a multiple of it."""

TINY_SQUARE = np.float32(1e-20)
"""mm². Added to squared lengths before dividing by them, negligible unless the length is 0; and to
limits of squares, as those below 1e-38 lose digits in single precision."""


@compiled()
def in_root_frames(
    positions: Float32Array,
    rows: IndexArray,
    begin: int,
    end: int,
    root: IndexArray,
    shape: Float64Array,
    columns: IndexArray,
    local: Float32Array,
) -> None:
    """Transform poses into root frames by position and heading.

    Parameters
    ----------
    positions : ndarray [shape=(poses, markers, 3), mm]
        All poses.
    rows : ndarray of int [shape=(rows,)]
        The poses to transform.
    begin, end : int
        The range of ``rows`` to process.
    root : ndarray of int [shape=(group,)]
        The markers of the root group.
    shape : ndarray [shape=(group, 3), mm]
        Their template, centred at 0.
    columns : ndarray of int [shape=(columns,)]
        The markers to transform.
    local : ndarray [shape=(rows, 3 * columns), mm]
        Output.
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


@compiled(fastmath=FAST_MATH)
def _chord_error(poses: Float32Array, first: int, last: int, rounding: float) -> float:
    """Bound how far the poses between two vertices are from the chord that joins these."""
    length = np.float64(approximate_square(poses, first, poses, last))
    largest = 0.0
    for row in range(first + 1, last):
        before = np.float64(approximate_square(poses, row, poses, first))
        after = np.float64(approximate_square(poses, row, poses, last))
        # any point of the chord gives a bound; its distance follows from Stewart's theorem
        share = 0.0
        if length > 0.0:
            share = 0.5 + (before - after) / (2.0 * length)
            if share < 0.0:
                share = 0.0
            elif share > 1.0:
                share = 1.0
        square = (1.0 - share) * before + share * after - share * (1.0 - share) * length
        square += rounding * (after if after > before else before)
        if square > largest:
            largest = square
    return math.sqrt(largest) * ROUND_UP


@compiled()
def lay_spans(
    poses: Float32Array,
    ends: IndexArray,
    recording: int,
    begin: int,
    end: int,
    max_length: int,
    max_chord_error: float,
    rounding: float,
    vertices: IndexArray,
    connected: BoolArray,
    chord_error: Float32Array,
) -> int:
    """Cut a range of poses into spans, each as long as its chord error allows.

    Parameters
    ----------
    poses : ndarray [shape=(poses, dimensions), mm]
        All poses.
    ends : ndarray of int [shape=(recordings + 1,)]
        Rows at which recordings start, ascending, and the number of poses.
    recording : int
        Index into ``ends`` of the first one after ``begin``.
    begin, end : int
        The range of poses; a span begins at either.
    max_length : int
        Maximum number of poses per span.
    max_chord_error : float
        mm. Largest chord error of a span of more than one pose.
    rounding : float
        Relative rounding error of a square.
    vertices : ndarray of int
        Output, from its start: the rows of the vertices.
    connected : ndarray of bool
        Output: whether a vertex's span reaches to the next vertex; otherwise it is a single pose.
    chord_error : ndarray [mm]
        Output: chord error of each span.

    Returns
    -------
    int
        Number of vertices.
    """
    count = 0
    row = begin
    length = max_length
    while row < end:
        while ends[recording] <= row:
            recording += 1
        last = min(end, ends[recording] - 1)
        length = min(2 * length, max_length)
        error = 0.0
        while length > 1:
            # near the end of a recording, single poses are as good as a span
            to = min(row + length, last)
            error = _chord_error(poses, row, to, rounding) if to > row + 1 else 0.0
            if error <= max_chord_error:
                break
            length //= 2
        to = min(row + length, last)
        vertices[count] = row
        connected[count] = to > row + 1
        chord_error[count] = error if connected[count] else 0.0
        count += 1
        row = max(to, row + 1)
    return count


@compiled(fastmath=FAST_MATH)
def bound_spans(
    projection: Float32Array,
    connected: BoolArray,
    squared_length: Float32Array,
    chord_error: Float32Array,
    segments: Float32Array,
    rounding: float,
    block_data: Float32Array,
    squares: Float32Array,
    along: Float32Array,
    bounds: Float32Array,
) -> None:
    """Bound the distances of query segments from the poses of all spans from below.

    Parameters
    ----------
    projection : ndarray [shape=(vertices, directions), mm]
        Coordinates of the vertices in some orthonormal directions.
    connected : ndarray of bool [shape=(vertices,)]
        As in `lay_spans`.
    squared_length : ndarray [shape=(vertices,), mm²]
        Squared length of each span's chord in these directions; 0 for a single pose.
    chord_error : ndarray [shape=(vertices,), mm]
        As in `lay_spans`.
    segments : ndarray [shape=(segments, 2 * directions + 1), mm]
        Query segments: the middle of each, its unit direction, and half its length. A single query
        has length 0 and any direction. Several segments are bounded in one pass over the vertices,
        which is limited by memory bandwidth.
    rounding : float
        Relative rounding error of a square.
    block_data : ndarray [shape=(directions + 3, BLOCK_SPANS + 1)]
        Work array, finite: the data of a block's vertices.
    squares, along : ndarray [shape=(BLOCK_SPANS + 1,)]
        Work arrays: squared distances of the vertices from a segment's middle, and their
        coordinates along its direction.
    bounds : ndarray [shape=(segments, vertices / BLOCK_SPANS rounded up, BLOCK_SPANS), mm]
        Output. Bounds may be negative, and have a few single-precision rounding errors. Entries
        after the last vertex are meaningless.
    """
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    relative_error = np.float32(rounding)
    vertices, directions = projection.shape
    for block in range(bounds.shape[1]):
        # in the last block, remains of the block before it fill the work array and are bounded too
        begin = block * BLOCK_SPANS
        width = vertices - begin
        if width > BLOCK_SPANS + 1:
            width = BLOCK_SPANS + 1
        for i in range(width):
            for d in range(directions):
                block_data[d, i] = projection[begin + i, d]
            block_data[directions, i] = squared_length[begin + i]
            block_data[directions + 1, i] = chord_error[begin + i]
            block_data[directions + 2, i] = zero if connected[begin + i] else one
        for segment in range(segments.shape[0]):
            half_length = segments[segment, 2 * directions]
            for i in range(BLOCK_SPANS + 1):
                squares[i] = along[i] = zero
            for d in range(0, directions, DIRECTIONS_PER_PASS):
                p, q = segments[segment, d], segments[segment, d + 1]
                r, s = segments[segment, d + 2], segments[segment, d + 3]
                for i in range(BLOCK_SPANS + 1):
                    u, v = block_data[d, i] - p, block_data[d + 1, i] - q
                    w, x = block_data[d + 2, i] - r, block_data[d + 3, i] - s
                    squares[i] += (u * u + v * v) + (w * w + x * x)
                if half_length > zero:
                    to = directions + d
                    e, f = segments[segment, to], segments[segment, to + 1]
                    g, h = segments[segment, to + 2], segments[segment, to + 3]
                    for i in range(BLOCK_SPANS + 1):
                        u, v = block_data[d, i] - p, block_data[d + 1, i] - q
                        w, x = block_data[d + 2, i] - r, block_data[d + 3, i] - s
                        along[i] += (u * e + v * f) + (w * g + x * h)
            for i in range(BLOCK_SPANS):
                single = block_data[directions + 2, i] > zero
                first, here = squares[i], along[i]
                last = first if single else squares[i + 1]
                there = here if single else along[i + 1]
                # distance across the segment's direction, from the squares at the chord's ends
                step = there - here
                a, b = first - here * here, last - there * there
                chord = block_data[directions, i] - step * step
                chord = chord if chord > zero else zero
                share = half + half * (a - b) / (chord + TINY_SQUARE)
                share = share if share > zero else zero
                share = share if share < one else one
                rest = one - share
                square = rest * a + share * b - share * rest * chord
                square -= relative_error * (first + last)
                # and along it, where the complete chord lies beyond one of the segment's ends
                low = here if here < there else there
                high = there if here < there else here
                past_end, past_start = low - half_length, -half_length - high
                outside = past_end if past_end > past_start else past_start
                outside = outside if outside > zero else zero
                square += outside * outside
                square = square if square > zero else zero
                bounds[segment, block, i] = (
                    np.float32(math.sqrt(square)) - block_data[directions + 1, i]
                )


@compiled()
def measure_spans(
    poses: Float32Array,
    first: IndexArray,
    last: IndexArray,
    bounds: Float32Array,
    block_minima: Float32Array,
    queries: Float32Array,
    bound_error: float,
    rounding: float,
    squares: Float64Array,
    rows: IndexArray,
) -> None:
    """Find the k nearest poses of each query among some spans.

    Parameters
    ----------
    poses, rounding
        As in `lay_spans`.
    first, last : ndarray of int [shape=(spans,)]
        The rows of each span, ``first <= row < last``.
    bounds : ndarray [shape=(queries, blocks, BLOCK_SPANS), mm]
        Bounds of the queries and these spans, from `bound_spans`.
    block_minima : ndarray [shape=(queries, blocks), mm]
        The least bound of each block.
    queries : ndarray [shape=(queries, dimensions), mm]
        The queries.
    bound_error : float
        mm. Largest rounding error of a bound.
    squares : ndarray [shape=(queries, k), mm²]
        Replaced by the squared distances: a heap with the farthest one first. On entry every
        element of a row is a square above which neighbours are of no interest.
    rows : ndarray of int [shape=(queries, k)]
        Replaced by the rows of the poses. On entry the number of poses or more.
    """
    for query in range(queries.shape[0]):
        radius = (math.sqrt(squares[query, 0]) + bound_error) * ROUND_UP
        for block in range(block_minima.shape[1]):
            if block_minima[query, block] > radius:
                continue
            for i in range(BLOCK_SPANS):
                if bounds[query, block, i] > radius:
                    continue
                span = block * BLOCK_SPANS + i
                for row in range(first[span], last[span]):
                    most = squares[query, 0] * (1.0 + rounding) + TINY_SQUARE
                    if approximate_square(poses, row, queries, query) > most:
                        continue
                    exact = exact_square(poses, row, queries, query)
                    if is_after(squares[query, 0], rows[query, 0], exact, row):
                        replace_farthest(squares, rows, query, exact, row)
                        radius = (math.sqrt(squares[query, 0]) + bound_error) * ROUND_UP
