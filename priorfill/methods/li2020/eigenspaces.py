"""The equations of Li et al. 2020, on arrays.

A is a piece: a row a frame, a column a coordinate, centred. A0 is the same piece masked: what the
clip does not show is zero, which is the mean. The paper writes the pieces of the training set A_i,
all of them one upon the other A_N, and the clip that is to be filled A_1.
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
    "components",
    "eigenspace",
    "nearest_basis",
    "train",
    "train_pieces",
    "trajectory_space",
    "transformation",
    "triangular",
    "whole_frames",
]

Array = NDArray[np.float64]

SMALLEST = 1e-10
"""Singular values below this share of the largest are rounding errors: the least squares leave
them out, where the published program divides by them."""


def triangular(rows: Array) -> Array:
    """Return rows with the same products of columns, as few as there are columns."""
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
        The eigenvectors of ``rows.T @ rows``, a column each.
    """
    # the orthogonal factor of a tall matrix changes neither
    _, values, vectors = np.linalg.svd(triangular(rows), full_matrices=False)
    return values, vectors.T


def components(values: Array, share: float) -> int:
    """Return how many singular values it takes to sum up to a share of all; at least one."""
    total = values.sum()
    if not total > 0:
        return 1
    return min(int(np.searchsorted(np.cumsum(values), share * total)) + 1, len(values))


def _rank(share: float, rank: int | None, *values: Array) -> int:
    """Return the number of eigenvectors: the one given, or what the share asks for."""
    return rank or max(components(each, share) for each in values)


def transformation(masked: Array, full: Array) -> Array:
    """Return T, the least squares of ``masked @ T = full``: Eqs. (2), (3) and (6), (7).

    Parameters
    ----------
    masked : ndarray [shape=(n, r)]
        A_i0 U_N0 of all pieces, one upon the other: coordinates in the masked space.
    full : ndarray [shape=(n, r)]
        A_i U_N of all pieces.

    Returns
    -------
    ndarray [shape=(r, r)]
        T = (sum U_N0' A_i0' A_i0 U_N0)^-1 (sum U_N0' A_i0' A_i U_N), by a decomposition that does
        not square the condition; of the smallest norm where the masked pieces span fewer than r
        directions.

    Notes
    -----
    Eq. (3) as printed, and the published program, have these two factors the other way round:
    not the solution of Eq. (2), and without bounds where the inverse hardly exists.
    """
    return np.asarray(np.linalg.lstsq(masked, full, rcond=SMALLEST)[0], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class TrainingSpaces:
    """What `train` learns.

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
    """Learn from pieces and the same pieces masked: Eqs. (1)-(3).

    Parameters
    ----------
    full, masked : ndarray [shape=(n, columns)]
        A_N and A_N0: all pieces, one upon the other.
    share, rank
        See `Li2020Options`; the larger number of both spaces.

    Returns
    -------
    TrainingSpaces
        U_N and U_N0, the eigenvectors of both, Eq. (1), and T, Eqs. (2) and (3).
    """
    values, vectors = eigenspace(full)
    masked_values, masked_vectors = eigenspace(masked)
    r = _rank(share, rank, values, masked_values)
    u, u0 = vectors[:, :r], masked_vectors[:, :r]
    return TrainingSpaces(u, u0, transformation(masked @ u0, full @ u))


def nearest_basis(vectors: Array, wanted: Array) -> Array:
    """Turn a basis inside the space that it spans so that it comes nearest to another basis.

    Parameters
    ----------
    vectors : ndarray [shape=(columns, q)]
        Orthonormal.
    wanted : ndarray [shape=(columns, r)]
        Orthonormal.

    Returns
    -------
    ndarray [shape=(columns, r)]
        ``vectors @ R`` with the R of the orthogonal Procrustes problem.
    """
    left, _, right = np.linalg.svd(vectors.T @ wanted, full_matrices=False)
    nearest: Array = vectors @ (left @ right)
    return nearest


@dataclass(frozen=True, eq=False)
class WindowSpaces:
    """What `train_pieces` learns.

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
    """Return a masked piece's own eigenvectors, in the order and with the signs of a reference."""
    _, vectors = eigenspace(masked)
    return nearest_basis(vectors[:, : reference.shape[1]], reference)


def train_pieces(
    full: Sequence[Array], masked: Sequence[Array], *, share: float = 0.99, rank: int | None = None
) -> WindowSpaces:
    """Learn from pieces, each masked one with eigenvectors of its own: Eqs. (5)-(7).

    Parameters
    ----------
    full, masked : sequence of ndarray [shape=(n_i, columns)]
        A_i and A_i0.
    share, rank
        See `Li2020Options`; the larger number of both spaces of all pieces.

    Returns
    -------
    WindowSpaces
        U_N, U_N0, and T, the least squares of A_i0 U_i0 T = A_i U_N over all pieces.

    Notes
    -----
    Signs and order of the eigenvectors U_i0, Eq. (5), are arbitrary, and T is shared by all pieces:
    left as they come, it would mean something else for each. Every basis of the space is as good,
    so the one nearest to U_N0 is taken.
    """
    values, vectors = eigenspace(np.concatenate(full))
    masked_values, masked_vectors = eigenspace(np.concatenate(masked))
    r = _rank(share, rank, values, masked_values)
    u, u0 = vectors[:, :r], masked_vectors[:, :r]
    coordinates = np.concatenate([piece @ _own_basis(piece, u0) for piece in masked])
    target = np.concatenate([piece @ u for piece in full])
    return WindowSpaces(u, u0, transformation(coordinates, target))


@dataclass(frozen=True, eq=False)
class TrajectorySpace:
    """What trajectories have in common.

    Attributes
    ----------
    vectors : ndarray [shape=(frames, r)]
        U, the eigenvectors, a column each.
    doubt : ndarray [shape=(r,)]
        How large what the eigenvectors leave over is, in one frame, beside each coordinate: both
        root mean squares over the trajectories.
    """

    vectors: Array
    doubt: Array


def trajectory_space(
    trajectories: Array, *, share: float = 0.99, rank: int | None = None
) -> TrajectorySpace:
    """Return the eigenvectors of trajectories, Eqs. (9)-(11).

    Parameters
    ----------
    trajectories : ndarray [shape=(n, frames)]
        Each a coordinate of a marker in a piece, centred.
    share, rank
        See `Li2020Options`.
    """
    values, vectors = eigenspace(trajectories)
    r = _rank(share, rank, values)
    left_over = np.sqrt((values[r:] ** 2).sum() / len(vectors))
    least = max(SMALLEST * values.max(initial=0.0), np.finfo(np.float64).tiny)
    return TrajectorySpace(vectors[:, :r], left_over / np.maximum(values[:r], least))


def whole_frames(
    visible: Array, space: TrajectorySpace, shown: NDArray[np.bool_], caution: float = 1.0
) -> Array:
    """Complete trajectories of which some frames are missing, Eqs. (12)-(16).

    Parameters
    ----------
    visible : ndarray [shape=(shown frames, n)]
        What is measured of n trajectories, centred.
    space : TrajectorySpace
        U_1 is the rows of its U in the shown frames, U_2 the others.
    shown : ndarray of bool [shape=(frames,)]
        Which frames are measured.
    caution : float
        What doubts are multiplied by.

    Returns
    -------
    ndarray [shape=(missing frames, n)]
        U_2 a, with the least squares a of U_1 a = A_1 in the measured frames and of D a = 0, D the
        diagonal matrix of doubts: a = (U_1' U_1 + D²)^-1 U_1' A_1.

    Notes
    -----
    The paper has no D: what the measured frames do not tell apart, as where all are on one side,
    is then without bounds. With it, a is what is most likely, if coordinates and what is left over
    are Gaussian and as large as they are in the trajectories that were learnt from.
    """
    r = space.vectors.shape[1]
    rows = np.concatenate([space.vectors[shown], np.diag(caution * space.doubt)])
    asked = np.concatenate([visible, np.zeros((r, visible.shape[1]))])
    # by QR with pivots, five times as fast as by singular values
    coordinates = lstsq(rows, asked, cond=SMALLEST, lapack_driver="gelsy", check_finite=False)[0]
    completed: Array = space.vectors[~shown] @ coordinates
    return completed
