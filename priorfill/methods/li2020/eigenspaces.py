"""The equations of Li et al. 2020, on arrays.

As in the paper, A_i is a centred training piece with a row per frame and a column per coordinate,
A_i0 the same piece masked: what is missing in the clip is zero, which is the mean. A is all pieces,
and B the masked clip.

==============  =====================================================================
Eqs. (1)-(4)    `train_pieces`: A has the pieces one upon the other
Eqs. (5)-(8)    the same with transposed pieces: A has the pieces side by side, and the
                eigenvectors V, V_i0, V_B0 are over frames: V'A_i = F V_i0'A_i0 is
                A_i' V = A_i0' V_i0 F'
a variant       `train`: one U_0 for all masked pieces and the clip
Eqs. (9)-(16)   `trajectory_space`, `complete_frames`
==============  =====================================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq

__all__ = [
    "PieceSpaces",
    "TrainingSpaces",
    "TrajectorySpace",
    "complete_frames",
    "components",
    "eigenspace",
    "nearest_basis",
    "train",
    "train_pieces",
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
    """Return T, the least squares of ``masked @ T = full``: Eqs. (2) and (3), or (6) and (7).

    Parameters
    ----------
    masked : ndarray [shape=(n, r)]
        A_i0 U_i0 of all pieces, stacked: coordinates in the masked eigenspaces.
    full : ndarray [shape=(n, r)]
        A_i U of all pieces.

    Returns
    -------
    ndarray [shape=(r, r)]
        T = (sum U_i0' A_i0' A_i0 U_i0)^-1 (sum U_i0' A_i0' A_i U), by a decomposition that does
        not square the condition number; with the smallest norm where the masked pieces span fewer
        than r dimensions.

    Notes
    -----
    Eq. (3) as printed, and the published program, have these factors in the opposite order. That is
    not the solution of Eq. (2), and unbounded where the matrix is nearly singular. Eq. (3) also has
    U' in place of U, which has no valid dimensions. Eq. (7) is the least squares of Eq. (6).
    """
    return np.asarray(np.linalg.lstsq(masked, full, rcond=MIN_SINGULAR_RATIO)[0], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class TrainingSpaces:
    """Eigenspaces of complete and masked training data, and the map between them.

    Attributes
    ----------
    full, masked : ndarray [shape=(columns, r)]
        U and U_0.
    transformation : ndarray [shape=(r, r)]
        T.
    """

    full: Array
    masked: Array
    transformation: Array

    def complete(self, masked: Array) -> Array:
        """Return the completed clip, B* = B U_0 T U'.

        Parameters
        ----------
        masked : ndarray [shape=(frames, columns)]
            B.
        """
        completed: Array = masked @ self.masked @ self.transformation @ self.full.T
        return completed


def train(
    full: Array, masked: Array, *, share: float = 0.99, rank: int | None = None
) -> TrainingSpaces:
    """Fit the eigenspaces and T to pieces and the same pieces masked, with one masked eigenspace.

    Parameters
    ----------
    full, masked : ndarray [shape=(n, columns)]
        A and A_0: all pieces, stacked.
    share, rank
        See `Li2020Options.min_singular_share`; the larger number of the two spaces.

    Returns
    -------
    TrainingSpaces
        U and U_0, the eigenvectors of both, and T, the least squares of A_0 U_0 T = A U.

    See Also
    --------
    train_pieces : As in the paper, with eigenvectors of each masked piece.

    Notes
    -----
    This is a variant of Eqs. (1)-(4), in which U_0 takes the place of U_i0 and U_B0. The published
    program uses U_0 for the clip, though U_i0 for the pieces.
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
class PieceSpaces:
    """As `TrainingSpaces`, where each masked piece, and the clip, has eigenvectors of its own.

    Attributes
    ----------
    full, reference : ndarray [shape=(columns, r)]
        U, and U_0 of all masked pieces.
    transformation : ndarray [shape=(r, r)]
        T.
    """

    full: Array
    reference: Array
    transformation: Array

    def complete(self, masked: Array) -> Array:
        """Return the completed clip, B* = B U_B0 T U': Eq. (4), or (8) if transposed.

        Parameters
        ----------
        masked : ndarray [shape=(frames, columns)]
            B, whose eigenvectors are U_B0.
        """
        own = _own_basis(masked, self.reference)
        completed: Array = masked @ own @ self.transformation @ self.full.T
        return completed


def _own_basis(masked: Array, reference: Array) -> Array:
    """Return the eigenvectors of a masked piece, with the order and signs of a reference."""
    _, vectors = eigenspace(masked)
    return nearest_basis(vectors[:, : reference.shape[1]], reference)


def train_pieces(
    full: Sequence[Array], masked: Sequence[Array], *, share: float = 0.99, rank: int | None = None
) -> PieceSpaces:
    """Fit the eigenspaces and T, with eigenvectors of each masked piece: Eqs. (1)-(3), or (5)-(7).

    Parameters
    ----------
    full, masked : sequence of ndarray [shape=(n_i, columns)]
        A_i and A_i0; transposed [shape=(columns, frames)] for Eqs. (5)-(7).
    share, rank
        See `Li2020Options.min_singular_share`; the larger number of the two spaces of all pieces.

    Returns
    -------
    PieceSpaces
        U, U_0, and T, the least-squares solution of A_i0 U_i0 T = A_i U over all pieces.

    See Also
    --------
    train : With one masked eigenspace.

    Notes
    -----
    Signs and order of the eigenvectors U_i0, Eq. (1), are arbitrary, but T is shared by all
    pieces. Any basis of the space is equivalent, so the one nearest to U_0 is used.
    """
    values, vectors = eigenspace(np.concatenate(full))
    masked_values, masked_vectors = eigenspace(np.concatenate(masked))
    r = _rank(share, rank, values, masked_values)
    u, u0 = vectors[:, :r], masked_vectors[:, :r]
    coordinates = np.concatenate([piece @ _own_basis(piece, u0) for piece in masked])
    target = np.concatenate([piece @ u for piece in full])
    return PieceSpaces(u, u0, transformation(coordinates, target))


@dataclass(frozen=True, eq=False)
class TrajectorySpace:
    """The eigenspace of trajectories.

    Attributes
    ----------
    vectors : ndarray [shape=(frames, r)]
        V, the eigenvectors as columns.
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
    visible: Array,
    space: TrajectorySpace,
    shown: NDArray[np.bool_],
    shrinkage: float = 1.0,
    *,
    weights: Array | None = None,
) -> Array:
    """Complete trajectories with missing frames, Eqs. (12)-(16).

    Parameters
    ----------
    visible : ndarray [shape=(shown frames, n)]
        A~, the measured frames of n trajectories, centred.
    space : TrajectorySpace
        V; V~ has its rows in the measured frames, V^ the others.
    shown : ndarray of bool [shape=(frames,)]
        Which frames are measured.
    shrinkage : float
        Factor of ``space.relative_std``.
    weights : ndarray [shape=(shown frames,)], optional
        The diagonal of W; ones if not given.

    Returns
    -------
    ndarray [shape=(missing frames, n)]
        V^ α, where α is the weighted least-squares solution of V~ α = A~ and D α = 0, with D the
        diagonal matrix of shrinkage times relative standard deviation:
        α = (V~' W V~ + D²)^-1 V~' W A~.

    See Also
    --------
    trajectory_space : Computes the eigenvectors.

    Notes
    -----
    Eq. (13) as printed is minimised over W instead of α, and Eqs. (15) and (16) lack the second W
    of Eq. (14).

    The paper has no D, so coordinates that the measured frames hardly determine are unbounded, as
    where all measured frames are on one side. With D, α is the most probable solution if
    coordinates and residuals are Gaussian with the variances of the training trajectories.
    """
    r = space.vectors.shape[1]
    root = 1.0 if weights is None else np.sqrt(weights)[:, None]
    rows = np.concatenate([root * space.vectors[shown], np.diag(shrinkage * space.relative_std)])
    target = np.concatenate([root * visible, np.zeros((r, visible.shape[1]))])
    # QR with pivoting is five times as fast as singular values
    coordinates = lstsq(
        rows, target, cond=MIN_SINGULAR_RATIO, lapack_driver="gelsy", check_finite=False
    )[0]
    completed: Array = space.vectors[~shown] @ coordinates
    return completed
