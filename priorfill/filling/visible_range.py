"""The frames between which enough markers are visible; before and after them nothing is filled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["OUTSIDE_VISIBLE", "visible_range"]

MIN_VISIBLE = 3
"""Visible markers needed: three points define a frame of reference."""

OUTSIDE_VISIBLE = (
    "fewer than three markers are visible from here to the clip's start or end (`extrapolate`)"
)
"""Reason given for samples at the clip's ends that are left missing."""


def visible_range(measured: NDArray[np.bool_], extrapolate: int = 0) -> tuple[int, int]:
    """Return the frames from the first to the last one in which at least three markers are visible.

    Parameters
    ----------
    measured : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    extrapolate : int
        Frames that are added at either end.

    Returns
    -------
    start, stop : int
        Frames ``start <= frame < stop``. Where no frame has three visible markers, those with the
        greatest number of them count; (0, 0) where nothing is measured.

    Examples
    --------
    >>> measured = np.ones((10, 4), dtype=bool)
    >>> measured[:2, 1:], measured[4:6], measured[9, 2:] = False, False, False
    >>> visible_range(measured), visible_range(measured, extrapolate=1)
    ((2, 9), (1, 10))
    """
    visible = measured.sum(axis=1)
    needed = min(MIN_VISIBLE, int(visible.max(initial=0)))
    if needed == 0:
        return 0, 0
    enough = np.flatnonzero(visible >= needed)
    return max(int(enough[0]) - extrapolate, 0), min(
        int(enough[-1]) + 1 + extrapolate, len(visible)
    )
