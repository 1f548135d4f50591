"""Positions of markers shortly before and after poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["complete_lagged"]


def complete_lagged(
    now: NDArray[np.float64], before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Extrapolate lagged positions that are missing.

    A marker that is missing on one side is extrapolated linearly from the other side and the pose;
    one that is missing on both sides keeps its position.

    Parameters
    ----------
    now : ndarray [shape=(poses, markers, 3), mm]
        The poses, complete.
    before, after : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing.

    Returns
    -------
    ndarray [shape=(2, poses, markers, 3), mm]
        Before and after, complete.

    Examples
    --------
    >>> import numpy as np
    >>> now, missing = np.array([[[5.0, 5.0, 5.0]]]), np.full((1, 1, 3), np.nan)
    >>> complete_lagged(now, now - 2.0, missing).ravel()
    array([3., 3., 3., 7., 7., 7.])
    """
    before = np.where(np.isnan(before), 2.0 * now - after, before)
    after = np.where(np.isnan(after), 2.0 * now - before, after)
    return np.stack([np.where(np.isnan(x), now, x) for x in (before, after)])
