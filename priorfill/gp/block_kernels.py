"""Compiled loops for residuals of held-out blocks. Arrays in, arrays out: no options, no checks.

The inverse of a block's matrix is the conditional covariance of its samples, given all others. A
block has a few dozen samples at most, and a process a dozen blocks: calls of LAPACK would take
longer than the loops, and hold the interpreter lock. Sums run along rows in a fixed order, so
that the result is the same whatever vector instructions the compiler chooses.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled

__all__ = ["hold_out_blocks"]

_Floats = NDArray[np.float64]
_Indices = NDArray[np.intp]

ROWS = 4
"""Rows that are added to a matrix at a time, so that it is read and written less often."""


@compiled()
def _add_squares(columns: _Floats, rows: int, size: int, matrix: _Floats) -> None:
    """Add C'C to a matrix; the rows of C are padded with zeros.

    The lower triangle is not skipped: inner loops of one length are faster.
    """
    for k in range(0, rows, ROWS):
        for i in range(size):
            a, b, c, d = columns[k, i], columns[k + 1, i], columns[k + 2, i], columns[k + 3, i]
            for j in range(size):
                matrix[i, j] += (
                    a * columns[k, j]
                    + b * columns[k + 1, j]
                    + c * columns[k + 2, j]
                    + d * columns[k + 3, j]
                )


@compiled()
def _eliminate(system: _Floats, size: int, width: int) -> bool:
    """Bring [G | w | 1] into the form [U | inv(U)' w | inv(U)'], where G = U'U.

    Returns whether G is positive definite.
    """
    for j in range(size):
        if not system[j, j] > 0.0:
            return False
        pivot = math.sqrt(system[j, j])
        for c in range(width):
            system[j, c] /= pivot
        for i in range(j + 1, size):
            factor = system[j, i]
            for c in range(width):
                system[i, c] -= factor * system[j, c]
    return True


@compiled()
def hold_out_blocks(
    transposed_root: _Floats,
    weights: _Floats,
    basis: tuple[_Floats, _Floats],
    samples: _Indices,
    edges: _Indices,
    work: tuple[_Floats, _Floats],
    residuals: _Floats,
    variance: _Floats,
) -> None:
    """Write the residuals of held-out blocks, and their variances.

    Parameters
    ----------
    transposed_root : ndarray [shape=(all samples, all samples)]
        R', upper triangular, where R'R is the inverse covariance G of all samples.
    weights : ndarray [shape=(all samples, outputs)]
        G y.
    basis : tuple of ndarray [shapes=(all samples, functions)]
        P and Q, where P Q' is subtracted from G.
    samples : ndarray of int [shape=(held-out samples,)]
        The samples of each block, one block after the other.
    edges : ndarray of int [shape=(blocks + 1,)]
        Where in `samples` each block starts, and the end.
    work : tuple of ndarray [shapes=(all samples + 3, longest), (longest, 2 * longest + outputs)]
        Overwritten.
    residuals : ndarray [shape=(held-out samples, outputs)]
    variance : ndarray [shape=(held-out samples,)]
        NaN in blocks whose matrix is not positive definite.
    """
    columns, system = work
    count, outputs = weights.shape
    for block in range(len(edges) - 1):
        start = edges[block]
        size = edges[block + 1] - start
        first = count
        for i in range(size):
            if samples[start + i] < first:
                first = samples[start + i]
        for i in range(size):
            sample = samples[start + i]
            for k in range(first, count):
                columns[k - first, i] = transposed_root[sample, k]
            for k in range(count - first, count - first + ROWS - 1):
                columns[k, i] = 0.0
            for j in range(size):
                system[i, j] = 0.0
                system[i, size + outputs + j] = 0.0
                for f in range(basis[0].shape[1]):
                    system[i, j] -= basis[0][sample, f] * basis[1][samples[start + j], f]
            system[i, size + outputs + i] = 1.0
            for o in range(outputs):
                system[i, size + o] = weights[sample, o]
        _add_squares(columns, count - first, size, system)
        definite = _eliminate(system, size, 2 * size + outputs)
        for i in range(size):
            total = 0.0 if definite else np.nan
            for o in range(outputs):
                residuals[start + i, o] = 0.0
            for k in range(i, size):
                factor = system[k, size + outputs + i]
                total += factor * factor
                for o in range(outputs):
                    residuals[start + i, o] += factor * system[k, size + o]
            variance[start + i] = total
