"""Compiled loops that search a kd-tree. Arrays in, arrays out: no options, no checks, no I/O.

The tree is that of `priorfill.search.kd_tree_kernels`. The distances of a query from the `WIDTH`
poses of a leaf, or boxes of a node, are computed in one loop over their bytes, by vector
instructions, which costs little more than the distance from one of them. These distances bound the
true ones from below, as the largest possible rounding error is allowed for. Poses that no bound
excludes are measured in double precision.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled
from priorfill.search.kd_tree_kernels import AXES, WIDTH
from priorfill.search.neighbour_kernels import (
    FAR_SQUARE,
    FAST_MATH,
    ROUND_UP,
    approximate_square,
    exact_square,
    is_after,
    replace_farthest,
)

__all__ = ["MAX_WAITING", "search_tree"]

Float64Array = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IndexArray = NDArray[np.int64]
RowArray = NDArray[np.int32]
ByteArray = NDArray[np.uint8]

TINY_SQUARE = 1e-20
"""mm². Added to limits of squares: those below 1e-38 lose digits in single precision."""

MAX_WAITING = 8 * WIDTH
"""Nodes that wait to be searched: the children of a node on each of up to seven levels."""


@compiled(fastmath=FAST_MATH)
def _squares_from_boxes(
    scales: Float32Array,
    node: int,
    lows: ByteArray,
    highs: ByteArray,
    at: int,
    points: Float32Array,
    query: int,
    squares: Float32Array,
) -> None:
    """Compute the squared distances of a query from the `WIDTH` boxes of a node, in bytes."""
    zero = np.float32(0.0)
    for i in range(WIDTH):
        squares[i] = zero
    for axis in range(AXES):
        step = scales[node, 1, axis]
        place = points[query, axis] - scales[node, 0, axis]
        for i in range(WIDTH):
            below = step * np.float32(lows[at, axis, i]) - place
            above = place - step * np.float32(highs[at, axis, i])
            outside = below if below > above else above
            outside = outside if outside > zero else zero
            squares[i] += outside * outside


@compiled()
def _square_within(radius: float, rounding: float) -> np.float32:
    """Return the largest square in single precision of a distance within a radius."""
    return np.float32(radius * radius * (1.0 + rounding))


@compiled()
def search_tree(
    poses: Float32Array,
    tree_rows: RowArray,
    levels: IndexArray,
    scales: Float32Array,
    places: ByteArray,
    errors: Float32Array,
    lows: ByteArray,
    highs: ByteArray,
    queries: Float32Array,
    points: Float32Array,
    bound_errors: Float64Array,
    rounding: float,
    nodes: IndexArray,
    bounds: Float32Array,
    from_boxes: Float32Array,
    squares: Float64Array,
    rows: IndexArray,
) -> None:
    """Find the k nearest poses of each query, depth first.

    The neighbours of a query bound the distances of the next one's, so that few nodes are searched
    where queries follow a path.

    Parameters
    ----------
    poses : ndarray [shape=(poses, dimensions), mm]
        The poses.
    tree_rows : ndarray of int [shape=(poses,)]
        Their rows in the order of the leaves.
    levels : ndarray of int [shape=(levels,)]
        Number of the first leaf (0) and of the first node of each level; the last has one node.
    scales, places, errors, lows, highs
        As of `kd_tree_kernels.divide` and `enclose_nodes`, of all leaves and nodes, level by level.
    queries : ndarray [shape=(queries, dimensions), mm]
        The queries.
    points : ndarray [shape=(queries, AXES), mm]
        Their coordinates along the axes.
    bound_errors : ndarray [shape=(queries,), mm]
        Largest rounding error of a distance along the axes.
    rounding : float
        Relative rounding error of a square.
    nodes : ndarray of int [shape=(MAX_WAITING, 2)]
        Work array: level and number of the nodes that wait to be searched.
    bounds : ndarray [shape=(MAX_WAITING,), mm²]
        Work array: the squared distances of their boxes.
    from_boxes : ndarray [shape=(WIDTH,), mm²]
        Work array.
    squares : ndarray [shape=(queries, k), mm²]
        Output: squared distances, as a heap with the farthest one first.
    rows : ndarray of int [shape=(queries, k)]
        Output: the rows of the poses.
    """
    leaves = places.shape[0]
    for query in range(queries.shape[0]):
        farthest = 0.0 if query > 0 else FAR_SQUARE
        if query > 0:
            for i in range(rows.shape[1]):
                exact = exact_square(poses, rows[query - 1, i], queries, query)
                farthest = exact if exact > farthest else farthest
        for i in range(rows.shape[1]):
            squares[query, i], rows[query, i] = farthest, tree_rows.size
        radius = (math.sqrt(farthest) + bound_errors[query]) * ROUND_UP
        limit = _square_within(radius, rounding)
        nodes[0, 0], nodes[0, 1] = levels.size - 1, 0
        bounds[0] = np.float32(0.0)
        depth = 1
        while depth > 0:
            depth -= 1
            if bounds[depth] > limit:
                continue
            level, at = nodes[depth, 0], nodes[depth, 1]
            if level > 0:
                node = levels[level] + at
                _squares_from_boxes(
                    scales, node, lows, highs, node - leaves, points, query, from_boxes
                )
                begin = at * WIDTH
                count = levels[level] - levels[level - 1] - begin
                if count > WIDTH:
                    count = WIDTH
                bottom = depth
                for i in range(count):
                    if from_boxes[i] > limit:
                        continue
                    to = depth  # the nearest last, to be searched first
                    while to > bottom and bounds[to - 1] < from_boxes[i]:
                        bounds[to] = bounds[to - 1]
                        nodes[to, 0], nodes[to, 1] = nodes[to - 1, 0], nodes[to - 1, 1]
                        to -= 1
                    bounds[to] = from_boxes[i]
                    nodes[to, 0], nodes[to, 1] = level - 1, begin + i
                    depth += 1
                continue
            _squares_from_boxes(scales, at, places, places, at, points, query, from_boxes)
            leaf_limit = _square_within(radius + errors[at], rounding)
            count = tree_rows.size - at * WIDTH
            if count > WIDTH:
                count = WIDTH
            for i in range(count):
                if from_boxes[i] > leaf_limit:
                    continue
                row = tree_rows[at * WIDTH + i]
                most = squares[query, 0] * (1.0 + rounding) + TINY_SQUARE
                if approximate_square(poses, row, queries, query) > most:
                    continue
                exact = exact_square(poses, row, queries, query)
                if is_after(squares[query, 0], rows[query, 0], exact, row):
                    replace_farthest(squares, rows, query, exact, row)
                    radius = (math.sqrt(squares[query, 0]) + bound_errors[query]) * ROUND_UP
                    limit = _square_within(radius, rounding)
                    leaf_limit = _square_within(radius + errors[at], rounding)
