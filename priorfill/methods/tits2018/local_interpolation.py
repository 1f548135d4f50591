"""Local interpolation (``li``): linear interpolation over time in the frame of the triad."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["interpolate"]

Array = NDArray[np.float64]


def interpolate(local: Array) -> Array:
    """Interpolate a gap linearly.

    Parameters
    ----------
    local : ndarray [shape=(frames, 3), mm]
        The marker in the frame of its triad; NaN where missing. Before the first measured frame and
        after the last one, that frame's position is repeated.

    Returns
    -------
    ndarray [shape=(frames, 3), mm]
        NaN where no frame is measured.
    """
    seen = ~np.isnan(local).any(axis=1)
    if not seen.any():
        return local.copy()
    frames = np.arange(len(local))
    return np.stack([np.interp(frames, frames[seen], local[seen, i]) for i in range(3)], axis=1)
