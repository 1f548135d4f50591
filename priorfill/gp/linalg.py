"""Linear algebra of Gaussian processes, and weights of ensembles.

References
----------
.. [RW06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime import elementary
from priorfill.runtime.lapack import solve_positive_banded

__all__ = [
    "block_residuals",
    "explained_variance",
    "inverse_root",
    "joined_blocks",
    "positive_definite",
    "power_weights",
    "solve_blocks",
    "solve_indefinite_blocks",
    "squared_distances",
]

JITTER = (1e-14, 1e-12, 1e-10, 1e-8)
"""Fractions of a covariance matrix's mean variance, tried in turn, that are added to its diagonal
where rounding has left it not positive definite."""


def squared_distances(
    product: NDArray[np.float64], one: NDArray[np.float64], other: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the squared distances of points, at least 0 [shape=(a, b)].

    Parameters
    ----------
    product : ndarray [shape=(a, b)]
        Inner products of the points' features.
    one, other : ndarray [shapes=(a,), (b,)]
        Their squared norms.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.array([[0.0, 0.0], [3.0, 4.0]])
    >>> norms = (x**2).sum(axis=1)
    >>> squared_distances(x @ x.T, norms, norms)
    array([[ 0., 25.],
           [25.,  0.]])
    """
    square: NDArray[np.float64] = one[:, None] + other
    square -= 2.0 * product
    return np.maximum(square, 0.0, out=square)


def power_weights(error: NDArray[np.float64], power: float) -> NDArray[np.float64]:
    """Return the weights of an ensemble's models by their errors.

    Parameters
    ----------
    error : ndarray [shape=(models, ...)]
        Of each model, above 0.
    power : float
        A model's weight is proportional to ``error ** -power``: 0 gives the mean of all models,
        infinity the best one alone.

    Returns
    -------
    ndarray [shape as given]
        Weights that sum to 1 over the models.

    Examples
    --------
    >>> import numpy as np
    >>> power_weights(np.array([1.0, 2.0]), power=2.0)
    array([0.8, 0.2])
    """
    weight = elementary.power(error.min(axis=0) / error, power)
    weight /= weight.sum(axis=0)
    return weight


def inverse_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lower triangular R with R'R = the inverse of a covariance matrix.

    It replaces the inverse at a third of the cost. `JITTER` is added to the diagonal where
    rounding has left the matrix not positive definite.

    Parameters
    ----------
    covariance : ndarray [shape=(samples, samples)]
        Positive definite up to rounding.

    Returns
    -------
    ndarray [shape=(samples, samples)]
        In Fortran order.

    Raises
    ------
    numpy.linalg.LinAlgError
        Where the matrix is not positive definite even with the largest jitter.

    Examples
    --------
    >>> import numpy as np
    >>> root = inverse_root(np.diag([4.0, 25.0]))
    >>> root.T @ root
    array([[0.25, 0.  ],
           [0.  , 0.04]])
    """
    # llvmlite is slow to import
    from priorfill.gp.triangular_kernels import blas_work, factor, invert

    blas = blas_work()
    upper = np.array(covariance, dtype=np.float64, order="C")
    if not factor(upper, len(upper), blas):
        upper = positive_definite(covariance)
        factor(upper, len(upper), blas)
    invert(upper, len(upper), blas)
    return np.triu(upper).T


def positive_definite(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a covariance matrix with the least `JITTER` that makes it positive definite.

    Parameters
    ----------
    covariance : ndarray [shape=(samples, samples)]
        Its upper triangle suffices.

    Raises
    ------
    numpy.linalg.LinAlgError
        Where the largest jitter is not enough.

    Examples
    --------
    >>> float(positive_definite(np.ones((2, 2)))[0, 0]) > 1.0
    True
    """
    from priorfill.gp.triangular_kernels import blas_work, factor  # llvmlite is slow to import

    mean = np.trace(covariance) / max(len(covariance), 1)
    for jitter in JITTER:
        larger: NDArray[np.float64] = covariance + jitter * mean * np.eye(len(covariance))
        if factor(larger.copy(), len(larger), blas_work()):
            return larger
    raise np.linalg.LinAlgError("a covariance matrix is not positive definite")


def solve_blocks(matrices: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve systems with symmetric positive definite matrices.

    All systems are one with a block-diagonal matrix, which is banded. Builds of LAPACK for
    different systems agree on banded matrices; on `numpy.linalg.solve` and `inv` they do not.

    Parameters
    ----------
    matrices : ndarray [shape=(systems, n, n)]
        Only the upper triangles are used where the matrices are positive definite.
    right : ndarray [shape=(systems, n, k)]
        Right-hand sides.

    Returns
    -------
    ndarray [shape=(systems, n, k)]

    Raises
    ------
    numpy.linalg.LinAlgError
        If a matrix is singular.

    Examples
    --------
    >>> import numpy as np
    >>> matrices = np.array([[[2.0, 1.0], [1.0, 2.0]], [[4.0, 0.0], [0.0, 1.0]]])
    >>> solve_blocks(matrices, np.array([[[3.0], [3.0]], [[4.0], [5.0]]]))[..., 0]
    array([[1., 1.],
           [1., 5.]])
    """
    systems, size = matrices.shape[:2]
    if not right.size:
        return np.zeros(right.shape)
    row, column = np.triu_indices(size)
    bands = np.zeros((size, systems, size))
    bands[size - 1 + row - column, :, column] = matrices[:, row, column].T
    try:
        solved = solve_positive_banded(bands.reshape(size, -1), right.reshape(systems * size, -1))
    except ValueError:  # rounding has made a matrix indefinite, or a value is not finite
        return np.asarray(np.linalg.solve(matrices, right), dtype=np.float64)
    return solved.reshape(right.shape)


def explained_variance(
    root: NDArray[np.float64], cross: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the variance that samples explain of other points, c' inv(C) c [shape=(points,)].

    The difference of the prior and the posterior variance [RW06]_ (Eq. 2.26).

    Parameters
    ----------
    root : ndarray [shape=(samples, samples)]
        `inverse_root` of the samples' covariance C, noise included.
    cross : ndarray [shape=(points, samples)]
        Covariance of the points with the samples, one row c for each point.

    See Also
    --------
    inverse_root : Computes the root.
    """
    from priorfill.gp.triangular_kernels import blas_work, whiten  # llvmlite is slow to import

    whitened = np.array(cross, dtype=np.float64, order="C")
    whiten(np.ascontiguousarray(root.T), whitened, blas_work())
    explained: NDArray[np.float64] = np.einsum("qr,qr->q", whitened, whitened)
    return explained


def block_residuals(
    root: NDArray[np.float64],
    weights: NDArray[np.float64],
    blocks: Sequence[NDArray[np.intp]],
    basis: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the residuals of blocks of samples predicted from all others, in closed form.

    [RW06]_ Eq. (5.12) for blocks; see `priorfill.gp.process.FittedGP.leave_blocks_out`.

    Parameters
    ----------
    root : ndarray [shape=(samples, samples)]
        `inverse_root` of the samples' covariance with noise.
    weights : ndarray [shape=(samples, outputs)]
        The inverse covariance times the targets.
    blocks : sequence of ndarray of int
        The samples of each block.
    basis : tuple of ndarray [shapes=(samples, functions)], optional
        P and Q, where P Q' is subtracted from the inverse covariance, for free basis functions.

    Returns
    -------
    residuals : ndarray [shape=(samples of all blocks, outputs)]
    variance : ndarray [shape=(samples of all blocks,)]
        Noise included, in the kernel's unit.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix of a block is singular.

    See Also
    --------
    priorfill.gp.process.FittedGP.leave_blocks_out : The same for all samples of a process.
    """
    from priorfill.gp.block_kernels import hold_out_blocks  # llvmlite is slow to import
    from priorfill.gp.triangular_kernels import blas_work

    count, outputs = weights.shape
    if basis is None:
        basis = (np.empty((count, 0)), np.empty((count, 0)))
    samples, edges = joined_blocks(blocks)
    longest = max(map(len, blocks))
    work = np.empty((longest, count)), np.empty((longest, longest)), blas_work()
    residuals, variance = np.empty((len(samples), outputs)), np.empty(len(samples))
    transposed = np.ascontiguousarray(root.T)
    weights = np.ascontiguousarray(weights)
    hold_out_blocks(transposed, weights, basis, (samples, edges), work, residuals, variance)
    solve_indefinite_blocks(transposed, weights, blocks, basis, residuals, variance)
    return residuals, variance


def joined_blocks(
    blocks: Sequence[NDArray[np.intp]],
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the samples of blocks, one block after the other, and where each starts, and the end.

    Examples
    --------
    >>> import numpy as np
    >>> joined_blocks([np.array([0, 2]), np.array([5])])
    (array([0, 2, 5]), array([0, 2, 3]))
    """
    edges = np.cumsum([0, *map(len, blocks)], dtype=np.intp)
    return np.concatenate([np.empty(0, dtype=np.intp), *blocks]), edges


def solve_indefinite_blocks(
    transposed_root: NDArray[np.float64],
    weights: NDArray[np.float64],
    blocks: Sequence[NDArray[np.intp]],
    basis: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
    residuals: NDArray[np.float64],
    variance: NDArray[np.float64],
) -> None:
    """Compute what `priorfill.gp.block_kernels.hold_out_blocks` leaves NaN, with general solves.

    Rounding has made the matrices of these blocks indefinite.

    Parameters
    ----------
    transposed_root, weights, basis, residuals, variance : ndarray
        As of `hold_out_blocks`; residuals and variances are replaced.
    blocks : sequence of ndarray of int
        The samples of each block.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix of a block is singular.
    """
    _, edges = joined_blocks(blocks)
    for number in np.flatnonzero(np.isnan(variance[edges[:-1]])):
        block, place = blocks[int(number)], slice(edges[number], edges[number + 1])
        precision = transposed_root[block] @ transposed_root[block].T
        if basis is not None:
            precision -= basis[0][block] @ basis[1][block].T
        residuals[place] = np.linalg.solve(precision, weights[block])
        variance[place] = np.diag(np.linalg.solve(precision, np.eye(len(block))))
