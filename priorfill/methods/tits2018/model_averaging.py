"""PMA, probabilistic model averaging: each model counts by how likely its distances are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.tits2018.median_mean_filter import smooth

__all__ = ["average", "bandwidth", "density"]

Array = NDArray[np.float64]

LEAST_WEIGHT = 1e-200
"""Where all models are that unlikely, they count the same."""

MAD_TO_DEVIATION = 0.6745
"""Median absolute deviation of a normal distribution, in standard deviations."""

NARROWEST = 1e-9
"""mm: bandwidth where all distances are the same."""


def bandwidth(sample: Array) -> float:
    """Return the bandwidth that is best for a normal distribution (mm).

    σ (4 / 3n)^(1/5), σ from the median absolute deviation or, where that is 0, the range.
    """
    sigma = float(np.median(np.abs(sample - np.median(sample)))) / MAD_TO_DEVIATION
    if sigma <= 0.0:
        sigma = float(np.ptp(sample))
    return max(sigma * float((4.0 / (3.0 * len(sample))) ** 0.2), NARROWEST)


def density(sample: Array, at: Array) -> Array:
    """Estimate a probability density with normal kernels.

    Parameters
    ----------
    sample : ndarray [shape=(n,), mm]
        Measured distances.
    at : ndarray [any shape, mm]
        Where it is asked for.

    Returns
    -------
    ndarray [shape of at, 1/mm]
        The density.
    """
    width = bandwidth(sample)
    # in place: the table is large, and copies of it cost more than its exponentials
    table = at[..., None] / width - sample / width
    np.square(table, out=table)
    table *= -0.5
    np.exp(table, out=table)
    return np.asarray(table.mean(axis=-1) / (width * np.sqrt(2.0 * np.pi)))


def average(curves: Array, references: Array, samples: list[Array], window: int) -> Array:
    """Average the curves of several models.

    Parameters
    ----------
    curves : ndarray [shape=(models, frames, 3), mm]
        Each model's prediction, with the frames beside the gap.
    references : ndarray [shape=(frames, references, 3), mm]
        The markers whose distances are judged.
    samples : list of ndarray [shape=(n,), mm]
        Measured distances from each of them.
    window : int
        Frames that curves and weights are smoothed over.

    Returns
    -------
    ndarray [shape=(frames, 3), mm]
        NaN where a model or a reference is missing.
    """
    curves = np.stack([smooth(curve, window) for curve in curves])
    distance = np.linalg.norm(curves[:, :, None] - references, axis=3)
    known = ~np.isnan(distance).any(axis=(0, 2))
    weight = np.full(distance.shape[:2], np.nan)
    weight[:, known] = 1.0
    for reference, sample in enumerate(samples):
        weight[:, known] *= density(sample, distance[:, known, reference])
    weight[:, known] = np.maximum(weight[:, known], LEAST_WEIGHT)
    # half a short gap at most: its weights must be free to change
    shorter = min(window, -(-(curves.shape[1] - 2) // 2))
    weight = smooth(weight.T, shorter).T
    # relative to the largest, lest products be too small for a float
    weight[:, known] /= weight[:, known].max(axis=0)
    mixed = (weight[..., None] * curves).sum(axis=0) / weight.sum(axis=0)[:, None]
    return np.asarray(mixed)
