"""Expected errors and bounds.

The expected error of a sample is its root mean square (Euclidean) distance from the truth, in mm.
A bound is the distance below which nine errors in ten are expected.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.elementary import power

__all__ = [
    "BOUND_COVERAGE",
    "BOUND_FACTOR",
    "MEAN_FACTOR",
    "MIN_EXPECTED_RMS",
    "calibrate",
    "common_bound",
]

BOUND_FACTOR = 1.6
"""Ratio of the 90 % bound to the expected rms error, where it is not calibrated. It is 1.44 for
normal isotropic errors in space, but the tails are heavier and the expected error is an estimate.
In 40 cases of ``scripts/studies/accuracy_study.py`` a factor of 1.6 covers 88 to 90 % of the
errors, and 65 to 98 % by kind of gap."""

MIN_EXPECTED_RMS = 0.1
"""mm. Measurement noise: a prediction from other recordings, other subjects or over time has no
smaller expected error."""

BOUND_COVERAGE = 0.9
"""Share of the errors that is expected to lie below a bound."""

MEAN_FACTOR = 0.921
"""Ratio of the mean distance from the truth to its root mean square for normal isotropic errors in
space, 4 / sqrt(6 pi). Publications mostly compare mean distances."""

UNIT_BOUND = 2.500278
"""Distance below which 90 % of the errors lie that are normal with a standard deviation of 1 in
each of the three coordinates."""

TOLERANCE = 1e-10
"""Relative error of a bound for several samples."""

MAX_STEPS = 60
"""Steps of Newton's method, kept within bounds by bisection. Mostly 5 suffice."""

MIN_BOUND = 1e-9
"""mm. Least bound of a sample; avoids a division by zero."""


def calibrate(
    ratio: NDArray[np.float64], blocks: int, prior_blocks: float, min_factor: float
) -> tuple[float, float]:
    """Calibrate expected errors by the errors of blocks that were held out.

    Parameters
    ----------
    ratio : ndarray [any shape]
        Error of each held-out sample in units of its expected rms error.
    blocks : int
        Number of blocks.
    prior_blocks : float
        The calibration without data, 1 and `BOUND_FACTOR`, counts as this many blocks.
    min_factor : float
        Least factor: that of a clip without movement is 0.

    Returns
    -------
    factor : float
        By which expected errors are to be multiplied.
    bound : float
        Ratio of the bound below which 90 % of the errors lie to the calibrated expected error.

    Examples
    --------
    >>> factor, bound = calibrate(np.full(100, 2.0), 8, 8.0, 1e-3)
    >>> round(factor, 3), round(bound, 3)
    (1.414, 1.265)
    """
    known = blocks / (blocks + prior_blocks)
    factor = float(np.sqrt((ratio**2).mean()))
    if factor < min_factor:
        return min_factor, BOUND_FACTOR
    bound = float(np.quantile(ratio, BOUND_COVERAGE)) / factor
    # both tend to their usual values where few blocks were held out
    shrunk = power(bound, known) * power(BOUND_FACTOR, 1.0 - known)
    return float(power(factor, known)), float(shrunk)


def common_bound(bounds: NDArray[np.float64]) -> float:
    """Return the distance below which 90 % of the errors of samples with different bounds lie.

    Samples near the edges of a gap have smaller errors than those in its middle; this is the bound
    for all of them together. The errors of each sample are taken as normal and isotropic, so that
    their distances follow a Maxwell distribution.

    Parameters
    ----------
    bounds : ndarray [shape=(samples,), mm]
        The 90 % bound of each sample; at least one, all finite.

    Returns
    -------
    float
        mm; of different bounds to nine digits, the same on every system.

    Examples
    --------
    >>> import numpy as np
    >>> round(common_bound(np.array([3.0, 3.0])), 5)
    3.0
    >>> round(common_bound(np.array([1.0, 5.0])), 2)
    4.31
    """
    low, high = float(bounds.min()), float(bounds.max())
    if high - low <= TOLERANCE * high:
        return high
    found = middle = 0.5 * (low + high)
    scale = UNIT_BOUND / np.maximum(bounds, MIN_BOUND)
    for _ in range(MAX_STEPS):
        ratio = scale * middle
        density = np.sqrt(2.0 / np.pi) * np.exp(-0.5 * ratio**2)
        # the distribution function of a Maxwell distribution
        errors = [math.erf(value) for value in (ratio / math.sqrt(2.0)).tolist()]
        excess = float((errors - density * ratio).mean()) - BOUND_COVERAGE
        low, high = (middle, high) if excess < 0.0 else (low, middle)
        slope = float((scale * density * ratio**2).mean())
        found = middle - excess / slope if slope > 0.0 else math.inf
        if not low <= found <= high:
            found = 0.5 * (low + high)
        if abs(found - middle) <= TOLERANCE * found:
            break
        middle = found
    return float(f"{found:.9g}")
