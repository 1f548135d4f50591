"""Compiled residuals of held-out blocks. Arrays in, arrays out: no options, no checks.

The inverse of a block's matrix is the conditional covariance of its samples, given all others. A
block has a few dozen samples at most, and a process a dozen blocks: from Python, the calls of BLAS
and LAPACK would take longer than what they compute.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.triangular_kernels import add_square, factor, invert, whiten_twice
from priorfill.runtime.compiled import compiled

__all__ = ["hold_out_blocks"]

_Floats = NDArray[np.float64]
_Indices = NDArray[np.intp]
_Work = NDArray[np.int64]


@compiled()
def hold_out_blocks(
    transposed_root: _Floats,
    weights: _Floats,
    basis: tuple[_Floats, _Floats],
    blocks: tuple[_Indices, _Indices],
    work: tuple[_Floats, _Floats, _Work],
    residuals: _Floats,
    variance: _Floats,
) -> None:
    """Write the residuals of held-out blocks, and their variances.

    With G_BB = U'U the inverse covariance of a block, they are inv(G_BB) w = inv(U) inv(U)' w, and
    the sums of squares of the rows of inv(U).

    Parameters
    ----------
    transposed_root : ndarray [shape=(all samples, all samples)]
        R', upper triangular, where R'R is the inverse covariance G of all samples.
    weights : ndarray [shape=(all samples, outputs)]
        G y.
    basis : tuple of ndarray [shapes=(all samples, functions)]
        P and Q, where P Q' is subtracted from G.
    blocks : tuple of ndarray of int
        The samples of each block, one block after the other, and where each starts, and the end.
    work : tuple of ndarray [shapes=(longest, all samples), (longest, longest)]
        Overwritten; and `priorfill.gp.triangular_kernels.blas_work`.
    residuals : ndarray [shape=(held-out samples, outputs)]
    variance : ndarray [shape=(held-out samples,)]
        NaN in blocks whose matrix is not positive definite.
    """
    samples, edges = blocks
    rows, system, blas = work
    count, outputs = weights.shape
    for block in range(len(edges) - 1):
        start, stop = edges[block], edges[block + 1]
        size = stop - start
        first = count
        for i in range(start, stop):
            first = samples[i] if samples[i] < first else first
        for i in range(size):
            for k in range(first, count):
                rows[i, k - first] = transposed_root[samples[start + i], k]
            for j in range(i, size):
                system[i, j] = 0.0
                for f in range(basis[0].shape[1]):
                    p, q = basis[0][samples[start + i], f], basis[1][samples[start + j], f]
                    system[i, j] -= p * q
            for o in range(outputs):
                residuals[start + i, o] = weights[samples[start + i], o]
        add_square(rows, (size, count - first), system, blas)
        if not (factor(system, size, blas) and invert(system, size, blas)):
            variance[start:stop] = np.nan
            continue
        whiten_twice(system, residuals[start:stop], blas)
        for i in range(size):
            total = 0.0
            for k in range(i, size):
                total += system[i, k] * system[i, k]
            variance[start + i] = total
