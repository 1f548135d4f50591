"""Weighted principal components of incomplete frames, and what lost columns are by them.

Equations and departures are those of `priorfill.methods.gloersen2016`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ColumnMoments", "mean_distances", "regression"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STILL = 1e-3
"""mm. A coordinate that deviates by less does not move: cameras and the floats of C3D files
resolve no more."""

FLAT = 1e-12
"""Variances below this share of the largest are rounding."""


def mean_distances(positions: Array, valid: Mask, markers: NDArray[np.intp]) -> Array:
    """Mean distance of some markers to all, each over the frames that show both.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Whatever is in samples that are not valid is not looked at, but must be finite.
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    markers : ndarray of int [shape=(some,)]
        The markers to measure from.

    Returns
    -------
    ndarray [shape=(some, markers), mm]
        Infinite for markers that are never seen together.
    """
    axes = [np.ascontiguousarray(positions[..., axis]) for axis in range(3)]
    distances = np.full((len(markers), positions.shape[1]), np.inf)
    for row, marker in zip(distances, markers, strict=True):
        seen = valid[:, marker]
        square = sum((axis[seen] - axis[seen, marker, None]) ** 2 for axis in axes)
        both = valid[seen]
        total = np.sum(np.sqrt(square), axis=0, where=both)
        np.divide(total, both.sum(axis=0), out=row, where=both.any(axis=0))
    return distances


class ColumnMoments:
    """Means and covariances of columns, over frames that differ from call to call.

    Frames that show every marker are in all of them, and are summed up once.

    Parameters
    ----------
    columns : ndarray [shape=(frames, columns)]
        Near 0 on the whole, so that squares do not swallow deviations.
    whole : ndarray of bool [shape=(frames,)]
        The frames that show everything.
    """

    def __init__(self, columns: Array, whole: Mask) -> None:
        self._columns = columns
        self._whole = whole
        self._sum = columns[whole].sum(axis=0)
        self._products = columns[whole].T @ columns[whole]

    def over(self, frames: Mask, which: Mask) -> tuple[Array, Array]:
        """Mean and covariance of some columns over the whole frames and some others.

        Parameters
        ----------
        frames : ndarray of bool [shape=(frames,)]
            The frames; the whole ones are among them.
        which : ndarray of bool [shape=(all columns,)]
            The columns.

        Returns
        -------
        mean : ndarray [shape=(columns,)]
            Of the columns chosen.
        covariance : ndarray [shape=(columns, columns)]
            Divided by the number of frames.
        """
        more = self._columns[frames & ~self._whole][:, which]
        mean = (self._sum[which] + more.sum(axis=0)) / frames.sum()
        products = self._products[np.ix_(which, which)] + more.T @ more
        return mean, products / frames.sum() - np.outer(mean, mean)


def _components(covariance: Array) -> tuple[Array, Array]:
    """Singular values, descending, and components of rows with this covariance."""
    variances, components = np.linalg.eigh(covariance)
    varied = variances > FLAT * max(variances.max(initial=0.0), 0.0)
    return np.sqrt(variances[varied][::-1]), components[:, varied][:, ::-1]


def _how_many(singular: Array, explained: float) -> int:
    """Smallest number of singular values whose sum is a share of the whole."""
    sums = np.cumsum(singular)
    return int(np.searchsorted(sums, explained * sums[-1])) + 1 if len(sums) else 0


def regression(covariance: Array, weights: Array, lost: Mask, explained: float) -> Array:
    """Slopes of lost columns on visible ones, by (1) with the diagonal of T.

    Parameters
    ----------
    covariance : ndarray [shape=(columns, columns), mm^2]
        Of visible and lost columns.
    weights : ndarray [shape=(columns,)]
        Positive for lost columns.
    lost : ndarray of bool [shape=(columns,)]
        Which are lost.
    explained : float
        Share of the sum of singular values to reach.

    Returns
    -------
    ndarray [shape=(visible columns, lost columns)]
        What to multiply visible columns' differences from their mean by.
    """
    expected_rms = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = weights / np.where(expected_rms > STILL, expected_rms, 1.0)
    scaled = covariance * np.outer(scale, scale)
    seen = ~lost
    singular, components = _components(scaled)
    singular0, components0 = _components(scaled[np.ix_(seen, seen)])
    kept = max(_how_many(singular, explained), _how_many(singular0, explained))
    kept = min(kept, len(singular), len(singular0))
    components, components0 = components[:, :kept], components0[:, :kept]
    diagonal = np.sum(components[seen] * components0, axis=0)
    slopes: Array = (components0 * diagonal) @ components[lost].T
    return scale[seen, None] * slopes / scale[lost]
