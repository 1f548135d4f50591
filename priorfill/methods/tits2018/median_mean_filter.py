"""A moving median, then a moving mean, that shrink towards gaps and ends of the clip.

Both stay centred there, so nothing is delayed; the two samples next to an edge stay as they are.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

__all__ = ["frames_in", "smooth"]

Array = NDArray[np.float64]

LEAST_HALF = 2
"""Samples to each side that a window must have; with fewer a sample stays as it is."""


def frames_in(window: float, rate: float) -> int:
    """Return how many frames a window of so many seconds has."""
    return int(np.ceil(window * rate))


def smooth(values: Array, window: int) -> Array:
    """Smooth each column over time.

    Parameters
    ----------
    values : ndarray [shape=(frames, columns)]
        NaN where missing; a frame is missing where its first column is.
    window : int
        PcaFrames: length of the window. An even one reaches one frame further back than forward.

    Returns
    -------
    ndarray [shape=(frames, columns)]
        NaN where ``values`` is.
    """
    if window <= LEAST_HALF - 1 or not len(values):
        return values.copy()
    back, ahead = window // 2, window - 1 - window // 2
    since, until = _room(np.isnan(values[:, 0]))
    whole = (since >= back) & (until >= ahead)
    half = np.where(whole, 0, np.minimum(since, until))
    out = values
    for middle in (_median, _mean):
        smoothed = out.copy()
        if whole.any():
            windows = sliding_window_view(out, window, axis=0)
            at = np.flatnonzero(whole)
            smoothed[at] = middle(windows[at - back])
        for reach in range(LEAST_HALF, max(back, ahead) + 1):
            at = np.flatnonzero(half == reach)
            if len(at):
                windows = sliding_window_view(out, 2 * reach + 1, axis=0)
                smoothed[at] = middle(windows[at - reach])
        out = smoothed
    return out


def _median(windows: Array) -> Array:
    """Return medians along the last axis; faster than NumPy's, which looks for NaN too."""
    middle = [(windows.shape[-1] - 1) // 2, windows.shape[-1] // 2]
    parted = np.partition(np.ascontiguousarray(windows), middle, axis=-1)
    return np.asarray(0.5 * (parted[..., middle[0]] + parted[..., middle[1]]))


def _mean(windows: Array) -> Array:
    """Return means along the last axis."""
    return np.asarray(windows @ np.full(windows.shape[-1], 1.0 / windows.shape[-1]))


def _room(missing: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return how many seen frames there are before and after each seen frame; -1 for missing."""
    frames = np.arange(len(missing))
    last = np.maximum.accumulate(np.where(missing, frames, -1))
    following = np.where(missing, frames, len(missing))[::-1]
    following = np.minimum.accumulate(following)[::-1]
    return frames - last - 1, following - frames - 1
