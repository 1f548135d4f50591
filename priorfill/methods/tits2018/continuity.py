"""The continuity correction: a linear ramp over time that removes the steps at a gap's edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ramp"]

Array = NDArray[np.float64]


def ramp(frames: int, before: Array | None, after: Array | None) -> Array:
    """Return the correction to subtract from a prediction.

    Parameters
    ----------
    frames : int
        Frames of the prediction, including the measured ones adjacent to the gap.
    before, after : ndarray [shape=(3,), mm] or None
        Errors of the prediction at its first and last frame; None at an end of the clip, where the
        error at the other edge is subtracted throughout.

    Returns
    -------
    ndarray [shape=(frames, 3), mm]
        Zero where neither error is known.
    """
    if before is None and after is None:
        return np.zeros((frames, 3))
    start = after if before is None else before
    stop = before if after is None else after
    return np.linspace(np.asarray(start), np.asarray(stop), frames)
