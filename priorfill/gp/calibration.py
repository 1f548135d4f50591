"""What a deviation says of the errors to be expected.

A deviation is an expected root mean square distance from the truth (mm). A bound is the distance
below which nine errors in ten are expected.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["BOUND_FACTOR", "BOUND_SHARE", "LEAST_DEVIATION", "MEAN_FACTOR", "common_bound"]

BOUND_FACTOR = 1.6
"""Where nothing better is known, 90 % of the errors are expected below this many times the expected
rms error. For a normal isotropic error in space it would be 1.44; tails are heavier, and the
deviation itself is an estimate. In 40 cases of `scripts/studies/accuracy_study.py` 1.6 covers 88
to 90 %;
by kind of gap 65 to 98 %."""

LEAST_DEVIATION = 0.1
"""mm. No marker is measured better, so what is not told by its own segment is not known better."""

BOUND_SHARE = 0.9
"""Share of the errors that are expected to lie below a bound; one in ten is greater."""

MEAN_FACTOR = 0.921
"""Mean of the distance from the truth, by its root mean square, for a normal isotropic error in
space: 4 / sqrt(6 pi). A mean of the distance is what recordings are usually compared by."""

UNIT_BOUND = 2.500278
"""Distance below which 90 % of the errors lie that are normal with a standard deviation of 1 in
each of the three coordinates."""

BISECTIONS = 40
"""Halvings of an interval: to a part in 10^12 of it."""


def common_bound(bounds: NDArray[np.float64]) -> float:
    """Return the distance below which 90 % of the errors of samples with different bounds lie.

    Each sample's error is taken to be normal and isotropic, of the size that its own bound says.
    Samples right at a gap's edge err little, those in its middle more; the errors of the gap are
    those of all of them together.

    Parameters
    ----------
    bounds : ndarray [shape=(samples,), mm]
        Of each sample; at least one, all finite.

    Returns
    -------
    float
        mm.
    """
    from scipy.special import erf

    low, high = 0.0, float(bounds.max())
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        ratio = UNIT_BOUND * middle / np.maximum(bounds, 1e-9)  # mm; nothing is known that well
        # share of a Maxwell distribution below
        share = erf(ratio / np.sqrt(2.0)) - np.sqrt(2.0 / np.pi) * ratio * np.exp(-0.5 * ratio**2)
        if share.mean() < BOUND_SHARE:
            low = middle
        else:
            high = middle
    return high
