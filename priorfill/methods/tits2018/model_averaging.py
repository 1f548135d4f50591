"""Probabilistic model averaging (``pma``): weights are the densities of each model's distances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.tits2018.median_mean_filter import smooth

__all__ = ["average", "bandwidth", "density"]

Array = NDArray[np.float64]

MIN_WEIGHT = 1e-200
"""Lower bound of the products of densities: where all are smaller, the models have equal
weights."""

MAD_PER_SD = 0.6745
"""Median absolute deviation divided by standard deviation, for normal errors."""

MIN_BANDWIDTH = 1e-9
"""mm. Bandwidth where all distances are equal."""


def bandwidth(sample: Array) -> float:
    """Return the kernel bandwidth that is optimal for a normal distribution (mm).

    It is σ (4 / 3n)^(1/5), with σ from the median absolute deviation or, where that is 0, the
    range.
    """
    sigma = float(np.median(np.abs(sample - np.median(sample)))) / MAD_PER_SD
    if sigma <= 0.0:
        sigma = float(np.ptp(sample))
    return max(sigma * float((4.0 / (3.0 * len(sample))) ** 0.2), MIN_BANDWIDTH)


def density(sample: Array, at: Array) -> Array:
    """Estimate a probability density by normal kernels.

    Parameters
    ----------
    sample : ndarray [shape=(n,), mm]
        Measured distances.
    at : ndarray [any shape, mm]
        Distances at which the density is estimated.

    Returns
    -------
    ndarray [shape of at, 1/mm]
        The density.
    """
    width = bandwidth(sample)
    # in place: copies of this large table take longer than its exponentials
    table = at[..., None] / width - sample / width
    np.square(table, out=table)
    table *= -0.5
    np.exp(table, out=table)
    return np.asarray(table.mean(axis=-1) / (width * np.sqrt(2.0 * np.pi)))


def average(curves: Array, references: Array, samples: list[Array], window: int) -> Array:
    """Average the predictions of several models.

    Parameters
    ----------
    curves : ndarray [shape=(models, frames, 3), mm]
        Each model's prediction, including the frames adjacent to the gap.
    references : ndarray [shape=(frames, references, 3), mm]
        The reference markers.
    samples : list of ndarray [shape=(n,), mm]
        Measured distances from each reference.
    window : int
        Frames over which predictions and weights are smoothed.

    Returns
    -------
    ndarray [shape=(frames, 3), mm]
        The average; NaN where a model or a reference is missing.
    """
    curves = np.stack([smooth(curve, window) for curve in curves])
    distance = np.linalg.norm(curves[:, :, None] - references, axis=3)
    known = ~np.isnan(distance).any(axis=(0, 2))
    weight = np.full(distance.shape[:2], np.nan)
    weight[:, known] = 1.0
    for reference, sample in enumerate(samples):
        weight[:, known] *= density(sample, distance[:, known, reference])
    weight[:, known] = np.maximum(weight[:, known], MIN_WEIGHT)
    # at most half of a short gap, so that its weights can change
    shorter = min(window, -(-(curves.shape[1] - 2) // 2))
    weight = smooth(weight.T, shorter).T
    # relative to the largest, so that the products do not underflow
    weight[:, known] /= weight[:, known].max(axis=0)
    mixed = (weight[..., None] * curves).sum(axis=0) / weight.sum(axis=0)[:, None]
    return np.asarray(mixed)
