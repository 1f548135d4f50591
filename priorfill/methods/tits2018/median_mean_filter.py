"""A moving median followed by a moving mean, with windows that shrink towards gaps and clip ends.

The shrinking windows stay centred, so the filter has no delay; the two samples adjacent to an edge
are unchanged.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

__all__ = ["frames_in", "smooth"]

Array = NDArray[np.float64]

MIN_HALF_WINDOW = 2
"""Samples on each side of the smallest window; a sample with fewer is unchanged."""


def frames_in(window: float, rate: float) -> int:
    """Return the number of frames in a window of a length in s, at a rate in Hz."""
    return int(np.ceil(window * rate))


def smooth(values: Array, window: int) -> Array:
    """Smooth each column over time by a moving median and a moving mean.

    Parameters
    ----------
    values : ndarray [shape=(frames, columns)]
        NaN where missing; a frame is missing if its first column is.
    window : int
        Length of the window in frames. An even window extends one frame further back than forward.

    Returns
    -------
    ndarray [shape=(frames, columns)]
        NaN where ``values`` is NaN.
    """
    if window <= MIN_HALF_WINDOW - 1 or not len(values):
        return values.copy()
    back, ahead = window // 2, window - 1 - window // 2
    before, after = _visible_around(np.isnan(values[:, 0]))
    complete = (before >= back) & (after >= ahead)
    half = np.where(complete, 0, np.minimum(before, after))
    reaches = sorted({reach for reach in half.tolist() if reach >= MIN_HALF_WINDOW})
    out = values
    for middle in (_median, _mean):
        smoothed = out.copy()
        if complete.any():
            windows = sliding_window_view(out, window, axis=0)
            at = np.flatnonzero(complete)
            smoothed[at] = middle(windows[at - back])
        for reach in reaches:
            at = np.flatnonzero(half == reach)
            windows = sliding_window_view(out, 2 * reach + 1, axis=0)
            smoothed[at] = middle(windows[at - reach])
        out = smoothed
    return out


def _median(windows: Array) -> Array:
    """Return medians along the last axis; faster than `np.median`, which also checks for NaN."""
    middle = [(windows.shape[-1] - 1) // 2, windows.shape[-1] // 2]
    parted = np.partition(np.ascontiguousarray(windows), middle, axis=-1)
    return np.asarray(0.5 * (parted[..., middle[0]] + parted[..., middle[1]]))


def _mean(windows: Array) -> Array:
    """Return means along the last axis."""
    return np.asarray(windows @ np.full(windows.shape[-1], 1.0 / windows.shape[-1]))


def _visible_around(missing: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the numbers of visible frames before and after each one; -1 for missing frames."""
    frames = np.arange(len(missing))
    last = np.maximum.accumulate(np.where(missing, frames, -1))
    following = np.where(missing, frames, len(missing))[::-1]
    following = np.minimum.accumulate(following)[::-1]
    return frames - last - 1, following - frames - 1
