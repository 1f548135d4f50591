"""Compiled calls of BLAS and LAPACK for triangular matrices. Arrays in, arrays out.

BLAS and LAPACK read arrays in Fortran order, where a matrix in C order is transposed. The matrices
here are upper triangular, R' in terms of the lower triangular R of `priorfill.gp.linalg`.

All arguments of the routines are addresses. Those of numbers and letters are kept in an array
(`blas_work`): taken from arrays in a compiled function, they would lengthen its compilation, for
which the user waits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled
from priorfill.runtime.lapack import DGEMM, DPOTRF, DSYRK, DTRMM, DTRTRI

__all__ = [
    "add_square",
    "blas_work",
    "factor",
    "invert",
    "multiply",
    "whiten",
    "whiten_twice",
]

_Floats = NDArray[np.float64]
_Work = NDArray[np.int64]

BLOCK = 64
"""Rows of the blocks by which a matrix is inverted: LAPACK inverts matrices of a few hundred rows
with blocks that are too small for fast products."""

LARGE = 400
"""From this order on, LAPACK's inverse is as fast."""

SLOTS = 4
"""How many numbers a call passes; they are at the start of the array."""

AT_0, AT_1, AT_2, AT_3 = range(SLOTS, 2 * SLOTS)
"""Where the addresses of these numbers are in the array."""

LEFT, RIGHT, PLAIN, TRANSPOSED, ONE, MINUS_ONE, ZERO = range(2 * SLOTS, 2 * SLOTS + 7)
"""Where the addresses of letters and factors are; ``L`` is left or lower."""

LOWER = LEFT

CONSTANTS = (
    *(np.frombuffer(letter, dtype=np.uint8) for letter in (b"L", b"R", b"N", b"T")),
    *(np.array([factor]) for factor in (1.0, -1.0, 0.0)),
)


def blas_work() -> _Work:
    """Return the array that the functions need; each thread has its own. It must not be copied."""
    work = np.zeros(2 * SLOTS + len(CONSTANTS), dtype=np.int64)
    work[SLOTS : 2 * SLOTS] = work.ctypes.data + work.itemsize * np.arange(SLOTS)
    work[2 * SLOTS :] = [constant.ctypes.data for constant in CONSTANTS]
    return work


@compiled()
def factor(matrix: _Floats, size: int, work: _Work) -> bool:
    """Replace the upper triangle of a matrix C by U, where U'U = C; the rest is not used.

    The matrix is the first rows and columns of the given one. Returns whether C is positive
    definite.
    """
    work[0], work[1], work[2] = size, matrix.shape[1], 0
    DPOTRF(work[LOWER], work[AT_0], matrix.ctypes.data, work[AT_1], work[AT_2])
    return bool(work[2] == 0)


@compiled()
def invert(matrix: _Floats, size: int, work: _Work) -> bool:
    """Replace an upper triangular matrix by its inverse; the rest is not used.

    The inverse of [[A, B], [0, C]] is [[inv(A), -inv(A) B inv(C)], [0, inv(C)]]. The last block is
    inverted first. The matrix is the first rows and columns of the given one.

    Returns whether it has an inverse.
    """
    block = BLOCK if size < LARGE else size
    start = (max(size, 1) - 1) // block * block
    work[0] = matrix.shape[1]
    stop = size
    address = matrix.ctypes.data
    while start >= 0:
        work[1], work[2], work[3] = stop - start, size - stop, 0
        corner = address + 8 * (start * work[0] + start)
        DTRTRI(work[LOWER], work[PLAIN], work[AT_1], corner, work[AT_0], work[AT_3])
        if work[3] != 0:
            return False
        if stop < size:
            right = corner + 8 * (stop - start)
            for side in (LEFT, RIGHT):
                after = side == LEFT
                DTRMM(
                    work[side],
                    work[LOWER],
                    work[PLAIN],
                    work[PLAIN],
                    work[AT_2],
                    work[AT_1],
                    work[MINUS_ONE if after else ONE],
                    address + 8 * (stop * work[0] + stop) if after else corner,
                    work[AT_0],
                    right,
                    work[AT_0],
                )
        stop = start
        start -= block
    return True


@compiled()
def add_square(rows: _Floats, shape: tuple[int, int], matrix: _Floats, work: _Work) -> None:
    """Add A A' to the upper triangle of a matrix; A has the first rows and columns of ``rows``."""
    work[0], work[1] = shape
    work[2], work[3] = rows.shape[1], matrix.shape[1]
    DSYRK(
        work[LOWER],
        work[TRANSPOSED],
        work[AT_0],
        work[AT_1],
        work[ONE],
        rows.ctypes.data,
        work[AT_2],
        work[ONE],
        matrix.ctypes.data,
        work[AT_3],
    )


@compiled()
def whiten(root: _Floats, rows: _Floats, work: _Work) -> None:
    """Replace each row x [shape=(points, samples)] by R x, where ``root`` is R'."""
    work[0], work[1] = root.shape[0], rows.shape[0]
    DTRMM(
        work[LEFT],
        work[LOWER],
        work[PLAIN],
        work[PLAIN],
        work[AT_0],
        work[AT_1],
        work[ONE],
        root.ctypes.data,
        work[AT_0],
        rows.ctypes.data,
        work[AT_0],
    )


@compiled()
def whiten_twice(root: _Floats, columns: _Floats, work: _Work) -> None:
    """Replace each column x [shape=(samples, outputs)] by R'R x.

    The first rows and columns of ``root`` are R'.
    """
    work[0], work[1], work[2] = columns.shape[0], columns.shape[1], root.shape[1]
    for transposed in (TRANSPOSED, PLAIN):
        DTRMM(
            work[RIGHT],
            work[LOWER],
            work[transposed],
            work[PLAIN],
            work[AT_1],
            work[AT_0],
            work[ONE],
            root.ctypes.data,
            work[AT_2],
            columns.ctypes.data,
            work[AT_1],
        )


@compiled()
def multiply(one: _Floats, other: _Floats, product: _Floats, work: _Work) -> None:
    """Write the product of two matrices [shapes=(a, b), (b, c), (a, c)]."""
    work[0], work[1], work[2] = other.shape[1], one.shape[0], one.shape[1]
    DGEMM(
        work[PLAIN],
        work[PLAIN],
        work[AT_0],
        work[AT_1],
        work[AT_2],
        work[ONE],
        other.ctypes.data,
        work[AT_0],
        one.ctypes.data,
        work[AT_2],
        work[ZERO],
        product.ctypes.data,
        work[AT_0],
    )
