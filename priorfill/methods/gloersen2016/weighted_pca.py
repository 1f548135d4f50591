"""Regression of missing columns on visible ones through weighted principal components.

Equations and departures are in `priorfill.methods.gloersen2016`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ColumnMoments", "mean_distances", "regression"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MIN_SD = 1e-3
"""mm. A coordinate with a smaller standard deviation counts as constant: cameras and the 32-bit
floats of C3D files resolve no less."""

MIN_VARIANCE_SHARE = 1e-12
"""Variances below this share of the largest are rounding errors."""


def mean_distances(positions: Array, valid: Mask, markers: NDArray[np.intp]) -> Array:
    """Return the mean distances of some markers from all, over the frames that show both.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Finite; the values of samples that are not valid are ignored.
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    markers : ndarray of int [shape=(some,)]
        The markers whose distances are returned.

    Returns
    -------
    ndarray [shape=(some, markers), mm]
        Infinite for markers that are never visible together.
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
    """Means and covariances of columns over different sets of frames.

    Complete frames belong to every set, so they are summed only once.

    Parameters
    ----------
    columns : ndarray [shape=(frames, columns)]
        Approximately centred, so that sums of squares lose no precision.
    complete : ndarray of bool [shape=(frames,)]
        The complete frames.
    """

    def __init__(self, columns: Array, complete: Mask) -> None:
        self._columns = columns
        self._complete = complete
        self._sum = columns[complete].sum(axis=0)
        self._products = columns[complete].T @ columns[complete]

    def over(self, frames: Mask, which: Mask) -> tuple[Array, Array]:
        """Return mean and covariance of some columns over a set of frames.

        Parameters
        ----------
        frames : ndarray of bool [shape=(frames,)]
            The frames, including all complete ones.
        which : ndarray of bool [shape=(all columns,)]
            The columns.

        Returns
        -------
        mean : ndarray [shape=(columns,)]
            Of the chosen columns.
        covariance : ndarray [shape=(columns, columns)]
            Divided by the number of frames.
        """
        more = self._columns[frames & ~self._complete][:, which]
        mean = (self._sum[which] + more.sum(axis=0)) / frames.sum()
        products = self._products[np.ix_(which, which)] + more.T @ more
        return mean, products / frames.sum() - np.outer(mean, mean)


def _components(covariance: Array) -> tuple[Array, Array]:
    """Return the singular values, descending, and the components of rows with this covariance."""
    variances, components = np.linalg.eigh(covariance)
    varied = variances > MIN_VARIANCE_SHARE * max(variances.max(initial=0.0), 0.0)
    return np.sqrt(variances[varied][::-1]), components[:, varied][:, ::-1]


def _component_count(singular: Array, min_share: float) -> int:
    """Return the smallest number of singular values whose sum reaches a share of the total."""
    sums = np.cumsum(singular)
    return int(np.searchsorted(sums, min_share * sums[-1])) + 1 if len(sums) else 0


def regression(covariance: Array, weights: Array, missing: Mask, min_share: float) -> Array:
    """Return the slopes of missing columns on visible ones, by Eq. (1) with the diagonal of T.

    Parameters
    ----------
    covariance : ndarray [shape=(columns, columns), mm^2]
        Of visible and missing columns.
    weights : ndarray [shape=(columns,)]
        Positive for missing columns.
    missing : ndarray of bool [shape=(columns,)]
        Which columns are missing.
    min_share : float
        Share of the sum of the singular values that the components must reach.

    Returns
    -------
    ndarray [shape=(visible columns, missing columns)]
        Factors of the visible columns' deviations from their means.
    """
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = weights / np.where(sd > MIN_SD, sd, 1.0)
    scaled = covariance * np.outer(scale, scale)
    seen = ~missing
    singular, components = _components(scaled)
    singular0, components0 = _components(scaled[np.ix_(seen, seen)])
    kept = max(_component_count(singular, min_share), _component_count(singular0, min_share))
    kept = min(kept, len(singular), len(singular0))
    components, components0 = components[:, :kept], components0[:, :kept]
    diagonal = np.sum(components[seen] * components0, axis=0)
    slopes: Array = (components0 * diagonal) @ components[missing].T
    return scale[seen, None] * slopes / scale[missing]
