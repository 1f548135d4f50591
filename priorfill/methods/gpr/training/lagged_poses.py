"""Moments: where markers are shortly before and after poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["standing_in"]


def standing_in(
    now: NDArray[np.float64], before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return markers before and after poses, none missing.

    A marker that is missing on one side is taken to go on as from or to the other; on both
    sides, to stand still.

    Parameters
    ----------
    now : ndarray [shape=(poses, markers, 3), mm]
        The poses, none missing.
    before, after : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing.

    Returns
    -------
    ndarray [shape=(2, poses, markers, 3), mm]
    """
    before = np.where(np.isnan(before), 2.0 * now - after, before)
    after = np.where(np.isnan(after), 2.0 * now - before, after)
    return np.stack([np.where(np.isnan(x), now, x) for x in (before, after)])
