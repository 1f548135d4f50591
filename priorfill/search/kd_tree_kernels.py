"""Compiled loops that build a kd-tree. Arrays in, arrays out: no options, no checks, no I/O.

A *leaf* holds `WIDTH` poses, a *node* as many leaves or nodes: number i of a level belongs to node
i // `WIDTH` of the next, so that no pointers are kept. Only the last of a level may hold fewer.
The coordinates of a leaf's poses along some axes, and the boxes of a node's children, are bytes:
steps of 1/255 of the box around them all. The bytes of a child's box enclose it; how far the bytes
of a leaf's poses are from these is stored for each leaf.

Functions compile on first use, while the user waits. ``min`` and ``max``, which would be compiled
as functions of their own, are therefore avoided. Work arrays are passed in.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled
from priorfill.search.neighbour_kernels import FAST_MATH, ROUND_UP

__all__ = [
    "AXES",
    "BINS",
    "LOCAL_LEAVES",
    "MAX_DIVISIONS",
    "WIDTH",
    "divide",
    "enclose_nodes",
]

Float32Array = NDArray[np.float32]
IndexArray = NDArray[np.int64]
RowArray = NDArray[np.int32]
ByteArray = NDArray[np.uint8]

AXES = 16
"""Axes along which poses are divided and bounded. They hold 98 % of the variance of poses; with 12,
two to four times as many poses are measured."""

WIDTH = 32
"""Poses of a leaf, and children of a node. Leaves of 64 poses take a tenth less time to build and a
tenth more to search."""

LOCAL_LEAVES = 128
"""Leaves whose poses are copied next to each other before they are divided further: they stay in
the cache."""

AXIS_SAMPLE = 16
"""Poses, up to twice as many, by which the axis of a division is chosen."""

BINS = 256
"""Bins of the histogram that finds where to divide."""

MIN_BINNED = 48
"""Keys from which bins take less time than exchanging keys."""

STEPS = np.float32(255.0)
"""Steps of a byte."""

TINY = np.float32(1e-20)
"""mm. Smaller ranges are not divided into bins or steps."""

MAX_DIVISIONS = 64
"""Ranges of leaves that wait to be divided: one for each halving of up to 2**31 poses."""


@compiled()
def _select(values: Float32Array, count: int, place: int) -> np.float32:
    """Return the value at a place of ascending order; reorders the values."""
    begin, end = 0, count - 1
    while begin < end:
        pivot = values[(begin + end) // 2]
        i, j = begin, end
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                other = values[i]
                values[i] = values[j]
                values[j] = other
                i += 1
                j -= 1
        if place <= j:
            end = j
        elif place >= i:
            begin = i
        else:
            break
    return np.float32(values[place])


@compiled(fastmath=FAST_MATH)
def _widest_axis(
    projection: Float32Array, rows: RowArray, begin: int, end: int, sums: Float32Array
) -> int:
    """Return the axis along which a sample of the rows varies most."""
    step = (end - begin) // AXIS_SAMPLE
    if step < 1:
        step = 1
    for axis in range(2 * AXES):
        sums[axis] = np.float32(0.0)
    origin = rows[begin]
    count = np.float32(0.0)
    for at in range(begin, end, step):
        row = rows[at]
        count += np.float32(1.0)
        for axis in range(AXES):
            away = projection[row, axis] - projection[origin, axis]
            sums[axis] += away
            sums[AXES + axis] += away * away
    largest, widest = np.float32(-1.0), 0
    for axis in range(AXES):
        variance = sums[AXES + axis] - sums[axis] * sums[axis] / count
        if variance > largest:
            largest, widest = variance, axis
    return widest


@compiled(fastmath=FAST_MATH)
def _range(values: Float32Array, count: int) -> tuple[np.float32, np.float32]:
    """Return the least and the largest of some values."""
    low = high = values[0]
    for i in range(count):
        low = values[i] if values[i] < low else low
        high = values[i] if values[i] > high else high
    return low, high


@compiled()
def _value_at(
    keys: Float32Array, count: int, place: int, work: Float32Array, bins: RowArray
) -> np.float32:
    """Return the key at a place of ascending order, without reordering the keys."""
    low, high = _range(keys, count)
    extent = high - low
    if count < MIN_BINNED or extent < TINY:
        for i in range(count):
            work[i] = keys[i]
        return _select(work, count, place)
    used = BINS if count > BINS else BINS // 4
    scale = (np.float32(used) - np.float32(0.01)) / extent
    for i in range(used):
        bins[i] = 0
    for i in range(count):
        bins[np.int32((keys[i] - low) * scale)] += 1
    below, chosen = 0, 0
    while below + bins[chosen] <= place:
        below += bins[chosen]
        chosen += 1
    found = 0
    for i in range(count):
        work[found] = keys[i]
        found += 1 if np.int32((keys[i] - low) * scale) == chosen else 0
    return _select(work, found, place - below)


@compiled()
def _split(
    projection: Float32Array,
    rows: RowArray,
    begin: int,
    middle: int,
    end: int,
    keys: Float32Array,
    work: Float32Array,
    spare: RowArray,
    bins: RowArray,
) -> None:
    """Divide a range of rows at a place, by their coordinate along their widest axis.

    Both parts keep the order of their rows, so that these mostly follow each other in memory.
    """
    axis = _widest_axis(projection, rows, begin, end, work)
    count = end - begin
    for i in range(count):
        keys[i] = projection[rows[begin + i], axis]
    value = _value_at(keys, count, middle - begin, work, bins)
    equal = middle - begin  # how many of the rows at the value belong to the first part
    for i in range(count):
        equal -= 1 if keys[i] < value else 0
    first, second = begin, 0
    for i in range(count):
        # no branches: they could not be predicted
        row, key = rows[begin + i], keys[i]
        is_equal = key == value
        is_first = (key < value) | (is_equal & (equal > 0))
        equal -= 1 if is_equal else 0
        rows[first] = row
        spare[second] = row
        first += 1 if is_first else 0
        second += 0 if is_first else 1
    for i in range(second):
        rows[first + i] = spare[i]


@compiled()
def _half(leaves: int) -> int:
    """Return how many leaves the first half of a range has: whole nodes, the largest there are."""
    unit = 1
    while unit * WIDTH < leaves:
        unit *= WIDTH
    return (-(-leaves // unit) // 2) * unit


@compiled(fastmath=FAST_MATH)
def _enclose_leaf(
    local: Float32Array,
    rows: RowArray,
    begin: int,
    count: int,
    leaf: int,
    boxes: Float32Array,
    scales: Float32Array,
    places: ByteArray,
    errors: Float32Array,
    columns: Float32Array,
) -> None:
    """Compute the box of a leaf and the bytes of its poses; see `divide`."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(WIDTH):
        row = rows[begin + (i if i < count else count - 1)]
        for axis in range(AXES):
            columns[axis, i] = local[row, axis]
        columns[AXES, i] = zero
    for axis in range(AXES):
        low = high = columns[axis, 0]
        for i in range(WIDTH):
            place = columns[axis, i]
            low = place if place < low else low
            high = place if place > high else high
        step = (high - low) * (one / STEPS)
        per_step = one / step if step > TINY else zero
        boxes[leaf, 0, axis], boxes[leaf, 1, axis] = low, high
        scales[leaf, 0, axis], scales[leaf, 1, axis] = low, step
        for i in range(WIDTH):
            above = columns[axis, i] - low
            byte = np.int32(above * per_step + np.float32(0.5))
            byte = byte if byte < 255 else np.int32(255)
            places[leaf, axis, i] = byte
            error = above - step * np.float32(byte)
            columns[AXES, i] += error * error
    largest = zero
    for i in range(WIDTH):
        largest = columns[AXES, i] if columns[AXES, i] > largest else largest
    errors[leaf] = math.sqrt(largest) * ROUND_UP


@compiled()
def divide(
    projection: Float32Array,
    rows: RowArray,
    first: int,
    leaves: int,
    undivided: int,
    keys: Float32Array,
    work: Float32Array,
    spare: RowArray,
    bins: RowArray,
    waiting: IndexArray,
    local: Float32Array,
    local_rows: RowArray,
    columns: Float32Array,
    boxes: Float32Array,
    scales: Float32Array,
    places: ByteArray,
    errors: Float32Array,
) -> None:
    """Divide a range of rows among leaves, by halves along the widest axis, and enclose the leaves.

    Parameters
    ----------
    projection : ndarray [shape=(poses, AXES), mm]
        Coordinates of the poses along the axes.
    rows : ndarray of int [shape=(poses,)]
        The rows of the poses; reordered within the range, so that those of leaf i begin at
        i * WIDTH.
    first, leaves : int
        The range of leaves.
    undivided : int
        Ranges of up to this many leaves are left to other calls; 0 if there are none.
    keys, work, spare : ndarray [shape=(leaves * WIDTH,)]
        Work arrays, the last of int.
    bins : ndarray of int [shape=(BINS,)]
        Work array.
    waiting : ndarray of int [shape=(MAX_DIVISIONS, 2)]
        Work array: ranges of leaves that are not divided yet.
    local : ndarray [shape=(LOCAL_LEAVES * WIDTH, AXES)]
        Work array, with ``local_rows`` of int.
    columns : ndarray [shape=(AXES + 1, WIDTH)]
        Work array: coordinates of the poses of a leaf, and their squared errors.
    boxes : ndarray [shape=(leaves, 2, AXES), mm]
        Output: the least and the largest coordinates of each leaf.
    scales : ndarray [shape=(leaves, 2, AXES), mm]
        Output: the least coordinates of each leaf, and the steps of its bytes.
    places : ndarray of bytes [shape=(leaves, AXES, WIDTH)]
        Output: the coordinates of each pose of a leaf in steps.
    errors : ndarray [shape=(leaves,), mm]
        Output: how far a pose of each leaf is at most from its place in bytes.
    """
    waiting[0, 0], waiting[0, 1] = first, leaves
    depth = 1
    while depth > 0:
        depth -= 1
        first, leaves = waiting[depth, 0], waiting[depth, 1]
        if leaves <= undivided:
            continue
        begin, end = first * WIDTH, (first + leaves) * WIDTH
        if end > rows.size:
            end = rows.size
        if leaves > LOCAL_LEAVES:
            half = _half(leaves)
            _split(projection, rows, begin, begin + half * WIDTH, end, keys, work, spare, bins)
            waiting[depth, 0], waiting[depth, 1] = first, half
            waiting[depth + 1, 0], waiting[depth + 1, 1] = first + half, leaves - half
            depth += 2
            continue
        count = end - begin
        for i in range(count):
            local_rows[i] = i
            for axis in range(AXES):
                local[i, axis] = projection[rows[begin + i], axis]
        bottom = depth
        waiting[depth, 0], waiting[depth, 1] = 0, leaves
        depth += 1
        while depth > bottom:
            depth -= 1
            leaf, part = waiting[depth, 0], waiting[depth, 1]
            if part == 1:
                continue
            half = _half(part)
            middle, last = (leaf + half) * WIDTH, (leaf + part) * WIDTH
            if last > count:
                last = count
            _split(local, local_rows, leaf * WIDTH, middle, last, keys, work, spare, bins)
            waiting[depth, 0], waiting[depth, 1] = leaf, half
            waiting[depth + 1, 0], waiting[depth + 1, 1] = leaf + half, part - half
            depth += 2
        for i in range(count):
            spare[i] = rows[begin + local_rows[i]]
        for i in range(count):
            rows[begin + i] = spare[i]
        for leaf in range(leaves):
            at = leaf * WIDTH
            width = count - at if count - at < WIDTH else WIDTH
            _enclose_leaf(
                local,
                local_rows,
                at,
                width,
                first + leaf,
                boxes,
                scales,
                places,
                errors,
                columns,
            )


@compiled()
def enclose_nodes(
    children: Float32Array,
    boxes: Float32Array,
    scales: Float32Array,
    lows: ByteArray,
    highs: ByteArray,
) -> None:
    """Enclose the nodes of a level.

    Parameters
    ----------
    children : ndarray [shape=(children, 2, AXES), mm]
        The boxes of the level below.
    boxes, scales : ndarray [shape=(nodes, 2, AXES), mm]
        Outputs, as of `divide`.
    lows, highs : ndarray of bytes [shape=(nodes, AXES, WIDTH)]
        Outputs: the box of each child in steps, rounded down and up.
    """
    for node in range(boxes.shape[0]):
        begin = node * WIDTH
        count = children.shape[0] - begin
        if count > WIDTH:
            count = WIDTH
        for axis in range(AXES):
            low, high = children[begin, 0, axis], children[begin, 1, axis]
            for child in range(begin + 1, begin + count):
                place = children[child, 0, axis]
                low = place if place < low else low
                place = children[child, 1, axis]
                high = place if place > high else high
            step = (high - low) / STEPS
            boxes[node, 0, axis], boxes[node, 1, axis] = low, high
            scales[node, 0, axis], scales[node, 1, axis] = low, step
            for i in range(WIDTH):
                child = begin + (i if i < count else count - 1)
                down, up = 0, 0
                if step > 0.0:
                    down = int((children[child, 0, axis] - low) / step)
                    up = int((children[child, 1, axis] - low) / step) + 1
                lows[node, axis, i] = down if down < 255 else 255
                highs[node, axis, i] = up if up < 255 else 255
