"""Find the floor from where markers rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["floor_heights"]

LOWEST = 1.0
"""Percentile of a marker's heights that is its lowest: a few samples may be wrong, or of a push
into a soft floor."""


FEWEST = 30
"""Measured samples that say where a marker's floor is."""


NEAR = 10.0
"""mm. A marker rests while it is no higher above its lowest."""


RESTING = 0.04
"""Share of its samples in which a marker rests that the floor stops: feet stand for a good part of
any clip, while what swings or bends is lowest for moments only."""


STANDING = 150.0
"""mm. Lowest heights above the ground that the floor is behind: an ankle's is 90 to 100."""


def floor_heights(
    positions: NDArray[np.float64], contralateral: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Find where the floor stops each marker.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Upright, NaN where missing.
    partner : ndarray of int [shape=(markers,)]
        Each marker's partner on the other side of the body; -1 where it has none.

    Returns
    -------
    ndarray [shape=(markers,), mm]
        Minus infinity for markers that are not seen to rest low, nor their partners.
    """
    count = positions.shape[1]
    lowest, rests = np.full(count, np.inf), np.zeros(count, dtype=bool)
    for marker in range(count):
        heights = positions[:, marker, 2]
        heights = heights[~np.isnan(heights)]
        if len(heights) >= FEWEST:
            lowest[marker] = np.percentile(heights, LOWEST)
            rests[marker] = (heights <= lowest[marker] + NEAR).mean() >= RESTING
    ground = lowest.min(initial=np.inf)
    rests &= lowest <= ground + STANDING
    # feet of one body stand about as high; the lower one of both is the more cautious
    beside = np.where((contralateral >= 0) & rests[contralateral], lowest[contralateral], np.inf)
    floor: NDArray[np.float64] = np.where(
        rests | np.isfinite(beside), np.minimum(lowest, beside), -np.inf
    )
    return floor
