"""The continuity correction: a straight line over time that closes the steps at a gap's edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ramp"]

Array = NDArray[np.float64]


def ramp(frames: int, before: Array | None, after: Array | None) -> Array:
    """Return what is to be taken off a prediction.

    Parameters
    ----------
    frames : int
        Frames of the prediction, the measured ones beside the gap included.
    before, after : ndarray [shape=(3,), mm] or None
        How far the prediction is off at its first and last frame; None at an end of the clip,
        where the step of the other side is taken off throughout.

    Returns
    -------
    ndarray [shape=(frames, 3), mm]
        Zero where neither side is known.
    """
    if before is None and after is None:
        return np.zeros((frames, 3))
    start = after if before is None else before
    stop = before if after is None else after
    return np.linspace(np.asarray(start), np.asarray(stop), frames)
