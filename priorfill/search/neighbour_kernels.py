"""Compiled loops that all searches share: distances, and the k nearest neighbours in a heap.

The heap of a query is a row of squared distances and a row of the rows of the poses, with the
farthest neighbour first; of equally far ones, that of the last row.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled

__all__ = [
    "FAR_SQUARE",
    "FAST_MATH",
    "ROUND_UP",
    "approximate_square",
    "exact_square",
    "is_after",
    "replace_farthest",
]

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

FAST_MATH = {"reassoc", "contract", "nsz", "nnan", "ninf"}
"""Liberties of the compiler with bounds, which are finite and widened for any order of their
sums."""

FAR_SQUARE = 1e37
"""mm². Initial squared distance of a neighbour: above any square, and twice it still fits into
single precision."""

ROUND_UP = 1.0 + 2.0**-20
"""Factor that rounds a bound up, both to single precision and after a few double-precision
operations."""


@compiled(fastmath=FAST_MATH)
def approximate_square(
    poses: Float32Array, row: int, other: Float32Array, other_row: int
) -> np.float32:
    """Return the squared distance of two rows in single precision."""
    total = np.float32(0.0)
    for d in range(poses.shape[1]):
        difference = poses[row, d] - other[other_row, d]
        total += difference * difference
    return total


@compiled()
def exact_square(poses: Float32Array, row: int, other: Float32Array, other_row: int) -> float:
    """Return the squared distance of two rows, summed in the order of the dimensions."""
    total = 0.0
    for d in range(poses.shape[1]):
        difference = np.float64(poses[row, d]) - np.float64(other[other_row, d])
        total += difference * difference
    return total


@compiled()
def is_after(square: float, row: int, other_square: float, other_row: int) -> bool:
    """Return whether a neighbour is farther than another one, or as far and of a later row."""
    return square > other_square or (square == other_square and row > other_row)


@compiled()
def replace_farthest(
    squares: Float64Array, rows: IndexArray, query: int, new_square: float, new_row: int
) -> None:
    """Replace the farthest neighbour of a query, which is at the top of its heap."""
    at = 0
    child = 1
    while child < squares.shape[1]:
        other = child + 1
        if other < squares.shape[1] and is_after(
            squares[query, other], rows[query, other], squares[query, child], rows[query, child]
        ):
            child = other
        if not is_after(squares[query, child], rows[query, child], new_square, new_row):
            break
        squares[query, at] = squares[query, child]
        rows[query, at] = rows[query, child]
        at = child
        child = 2 * at + 1
    squares[query, at] = new_square
    rows[query, at] = new_row
