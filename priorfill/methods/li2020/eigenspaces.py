"""The equations of Li et al. 2020, on arrays.

A is a centred window with a row per frame and a column per coordinate. A0 is the same window
masked: coordinates that are missing in the clip are zero, which is the mean. As in the paper, A_i
are the training windows, A_N is all of them stacked, and A_1 is the clip to fill.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq

__all__ = [
    "TrainingSpaces",
    "TrajectorySpace",
    "WindowSpaces",
    "complete_frames",
    "components",
    "eigenspace",
    "nearest_basis",
    "train",
    "train_windows",
    "trajectory_space",
    "transformation",
    "triangular",
]

Array = NDArray[np.float64]

MIN_SINGULAR_RATIO = 1e-10
"""Singular values below this share of the largest are rounding errors. They are left out of least
squares; the published program divides by them."""


def triangular(rows: Array) -> Array:
    """Return the triangular factor of a matrix, which has the same inner products of columns.

    It has at most as many rows as columns; a matrix without more rows is returned as it is.
    """
    return np.asarray(np.linalg.qr(rows).R) if len(rows) > rows.shape[1] else rows


def eigenspace(rows: Array) -> tuple[Array, Array]:
    """Return the singular values and the eigenvectors of a matrix of rows.

    Parameters
    ----------
    rows : ndarray [shape=(n, columns)]
        Centred.

    Returns
    -------
    values : ndarray [shape=(min(n, columns),)]
        Descending.
    vectors : ndarray [shape=(columns, min(n, columns))]
        The eigenvectors of ``rows.T @ rows`` as columns.
    """
    # the orthogonal factor of a tall matrix affects neither
    _, values, vectors = np.linalg.svd(triangular(rows), full_matrices=False)
    return values, vectors.T


def components(values: Array, share: float) -> int:
    """Return how many singular values are needed to sum to a share of the total; at least one.

    Examples
    --------
    >>> components(np.array([98.0, 1.0, 1.0]), 0.99)
    2
    """
    total = values.sum()
    if not total > 0:
        return 1
    return min(int(np.searchsorted(np.cumsum(values), share * total)) + 1, len(values))


def _rank(share: float, rank: int | None, *values: Array) -> int:
    """Return the number of eigenvectors: the rank, or what the share requires."""
    return rank or max(components(each, share) for each in values)


def transformation(masked: Array, full: Array) -> Array:
    """Return T, the least squares of ``masked @ T = full``: Eqs. (2), (3) and (6), (7).

    Parameters
    ----------
    masked : ndarray [shape=(n, r)]
        A_i0 U_N0 of all windows, stacked: coordinates in the masked eigenspace.
    full : ndarray [shape=(n, r)]
        A_i U_N of all windows.

    Returns
    -------
    ndarray [shape=(r, r)]
        T = (sum U_N0' A_i0' A_i0 U_N0)^-1 (sum U_N0' A_i0' A_i U_N), by a decomposition that does
        not square the condition number; with the smallest norm where the masked windows span fewer
        than r dimensions.

    Notes
    -----
    Eq. (3) as printed, and the published program, have these factors in the opposite order. That is
    not the solution of Eq. (2), and unbounded where the matrix is nearly singular.
    """
    return np.asarray(np.linalg.lstsq(masked, full, rcond=MIN_SINGULAR_RATIO)[0], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class TrainingSpaces:
    """Eigenspaces of complete and masked training data, and the map between them.

    Attributes
    ----------
    full, masked : ndarray [shape=(columns, r)]
        U_N and U_N0.
    transformation : ndarray [shape=(r, r)]
        T.
    """

    full: Array
    masked: Array
    transformation: Array

    def complete(self, masked: Array) -> Array:
        """Return the completed clip, A_1* = A_10 U_N0 T U_N': Eq. (4).

        Parameters
        ----------
        masked : ndarray [shape=(frames, columns)]
            A_10.
        """
        completed: Array = masked @ self.masked @ self.transformation @ self.full.T
        return completed


def train(
    full: Array, masked: Array, *, share: float = 0.99, rank: int | None = None
) -> TrainingSpaces:
    """Fit the eigenspaces and T to windows and the same windows masked: Eqs. (1)-(3).

    Parameters
    ----------
    full, masked : ndarray [shape=(n, columns)]
        A_N and A_N0: all windows, stacked.
    share, rank
        See `Li2020Options.min_singular_share`; the larger number of the two spaces.

    Returns
    -------
    TrainingSpaces
        U_N and U_N0, the eigenvectors of both, Eq. (1), and T, Eqs. (2) and (3).

    See Also
    --------
    train_windows : With eigenvectors of each window.
    """
    values, vectors = eigenspace(full)
    masked_values, masked_vectors = eigenspace(masked)
    r = _rank(share, rank, values, masked_values)
    u, u0 = vectors[:, :r], masked_vectors[:, :r]
    return TrainingSpaces(u, u0, transformation(masked @ u0, full @ u))


def nearest_basis(vectors: Array, wanted: Array) -> Array:
    """Return the basis of the same space that is nearest to another basis.

    Parameters
    ----------
    vectors : ndarray [shape=(columns, q)]
        Orthonormal.
    wanted : ndarray [shape=(columns, r)]
        Orthonormal.

    Returns
    -------
    ndarray [shape=(columns, r)]
        ``vectors @ R``, where R solves the orthogonal Procrustes problem.
    """
    left, _, right = np.linalg.svd(vectors.T @ wanted, full_matrices=False)
    nearest: Array = vectors @ (left @ right)
    return nearest


@dataclass(frozen=True, eq=False)
class WindowSpaces:
    """As `TrainingSpaces`, where each masked window has eigenvectors of its own.

    Attributes
    ----------
    full, reference : ndarray [shape=(columns, r)]
        U_N and U_N0.
    transformation : ndarray [shape=(r, r)]
        T.
    """

    full: Array
    reference: Array
    transformation: Array

    def complete(self, masked: Array) -> Array:
        """Return the completed clip, A_1* = A_10 U_10 T U_N': Eq. (8).

        Parameters
        ----------
        masked : ndarray [shape=(frames, columns)]
            A_10, whose eigenvectors are U_10.
        """
        own = _own_basis(masked, self.reference)
        completed: Array = masked @ own @ self.transformation @ self.full.T
        return completed


def _own_basis(masked: Array, reference: Array) -> Array:
    """Return the eigenvectors of a masked window, with the order and signs of a reference."""
    _, vectors = eigenspace(masked)
    return nearest_basis(vectors[:, : reference.shape[1]], reference)


def train_windows(
    full: Sequence[Array], masked: Sequence[Array], *, share: float = 0.99, rank: int | None = None
) -> WindowSpaces:
    """Fit the eigenspaces and T, with eigenvectors of each masked window: Eqs. (5)-(7).

    Parameters
    ----------
    full, masked : sequence of ndarray [shape=(n_i, columns)]
        A_i and A_i0.
    share, rank
        See `Li2020Options.min_singular_share`; the larger number of the two spaces of all windows.

    Returns
    -------
    WindowSpaces
        U_N, U_N0, and T, the least-squares solution of A_i0 U_i0 T = A_i U_N over all windows.

    See Also
    --------
    train : With eigenvectors of all windows.

    Notes
    -----
    Signs and order of the eigenvectors U_i0, Eq. (5), are arbitrary, but T is shared by all
    windows. Any basis of the space is equivalent, so the one nearest to U_N0 is used.
    """
    values, vectors = eigenspace(np.concatenate(full))
    masked_values, masked_vectors = eigenspace(np.concatenate(masked))
    r = _rank(share, rank, values, masked_values)
    u, u0 = vectors[:, :r], masked_vectors[:, :r]
    coordinates = np.concatenate([window @ _own_basis(window, u0) for window in masked])
    target = np.concatenate([window @ u for window in full])
    return WindowSpaces(u, u0, transformation(coordinates, target))


@dataclass(frozen=True, eq=False)
class TrajectorySpace:
    """The eigenspace of trajectories.

    Attributes
    ----------
    vectors : ndarray [shape=(frames, r)]
        U, the eigenvectors as columns.
    relative_std : ndarray [shape=(r,)]
        Rms residual of the trajectories per frame, relative to the rms of each coordinate.
    """

    vectors: Array
    relative_std: Array


def trajectory_space(
    trajectories: Array, *, share: float = 0.99, rank: int | None = None
) -> TrajectorySpace:
    """Return the eigenvectors of trajectories, Eqs. (9)-(11).

    Parameters
    ----------
    trajectories : ndarray [shape=(n, frames)]
        Each a coordinate of a marker in a window, centred.
    share, rank
        See `Li2020Options.trajectory_singular_share`.
    """
    values, vectors = eigenspace(trajectories)
    r = _rank(share, rank, values)
    left_over = np.sqrt((values[r:] ** 2).sum() / len(vectors))
    least = max(MIN_SINGULAR_RATIO * values.max(initial=0.0), np.finfo(np.float64).tiny)
    return TrajectorySpace(vectors[:, :r], left_over / np.maximum(values[:r], least))


def complete_frames(
    visible: Array, space: TrajectorySpace, shown: NDArray[np.bool_], shrinkage: float = 1.0
) -> Array:
    """Complete trajectories with missing frames, Eqs. (12)-(16).

    Parameters
    ----------
    visible : ndarray [shape=(shown frames, n)]
        The measured frames of n trajectories, centred.
    space : TrajectorySpace
        U_1 has the rows of its U in the measured frames, U_2 the others.
    shown : ndarray of bool [shape=(frames,)]
        Which frames are measured.
    shrinkage : float
        Factor of ``space.relative_std``.

    Returns
    -------
    ndarray [shape=(missing frames, n)]
        U_2 a, where a is the least-squares solution of U_1 a = A_1 and D a = 0, with D the diagonal
        matrix of shrinkage times relative standard deviation: a = (U_1' U_1 + D²)^-1 U_1' A_1.

    See Also
    --------
    trajectory_space : Computes the eigenvectors.

    Notes
    -----
    The paper has no D, so coordinates that the measured frames hardly determine are unbounded, as
    where all measured frames are on one side. With D, a is the most probable solution if
    coordinates and residuals are Gaussian with the variances of the training trajectories.
    """
    r = space.vectors.shape[1]
    rows = np.concatenate([space.vectors[shown], np.diag(shrinkage * space.relative_std)])
    target = np.concatenate([visible, np.zeros((r, visible.shape[1]))])
    # QR with pivoting is five times as fast as singular values
    coordinates = lstsq(
        rows, target, cond=MIN_SINGULAR_RATIO, lapack_driver="gelsy", check_finite=False
    )[0]
    completed: Array = space.vectors[~shown] @ coordinates
    return completed
