"""Interpolation of a marker over time, also between single samples.

Some gaps are separated by single frames, or have a single sample on one side: the Gaussian process
of `priorfill.signal.gp_interpolation` needs two on either side, which give a velocity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.calibration import MIN_EXPECTED_RMS
from priorfill.signal.gp_interpolation import InterpolationOptions, interpolate_gap

__all__ = ["interpolate_marker"]

MIN_SPEED = 100.0
"""mm/s. Speed that the expected error allows for even where the clip shows no movement."""

_Floats = NDArray[np.float64]


def interpolate_marker(
    path: _Floats,
    frames: slice,
    rate: float,
    speed: float,
    options: InterpolationOptions,
) -> tuple[_Floats, _Floats] | None:
    """Interpolate a marker in some frames over time.

    Between two samples or more on either side, by a Gaussian process. Otherwise on the straight
    line between the two adjacent samples, or, at an end of the recording, at the adjacent sample:
    one sample gives no velocity.

    Parameters
    ----------
    path : ndarray [shape=(frames, 3), mm]
        The marker; NaN where missing.
    frames : slice
        The frames, all of them missing.
    rate : float
        Hz.
    speed : float
        mm/s. How fast markers of the clip move; at least `MIN_SPEED` is used.
    options : InterpolationOptions
        The process, the longest gap that is interpolated, and the acceleration that expected errors
        allow for.

    Returns
    -------
    positions : ndarray [shape=(frames, 3), mm]
    expected_rms : ndarray [shape=(frames,), mm]
        Expected rms Euclidean error.

    None instead of both where the marker is missing for longer, or throughout.

    See Also
    --------
    priorfill.signal.gp_interpolation.interpolate_gap : The process.

    Examples
    --------
    >>> path = np.full((4, 3), np.nan)
    >>> path[[0, 3]] = [0.0, 0.0, 900.0], [6.0, 0.0, 900.0]
    >>> options = InterpolationOptions()
    >>> positions, expected_rms = interpolate_marker(path, slice(1, 3), 50.0, 500.0, options)
    >>> positions[:, 0], expected_rms
    (array([2., 4.]), array([4., 4.]))
    """
    known = np.flatnonzero(~np.isnan(path[:, 0]))
    place = int(np.searchsorted(known, frames.start))
    before = int(known[place - 1]) if place else None
    after = int(known[place]) if place < len(known) else None
    start = 0 if before is None else before + 1
    stop = len(path) if after is None else after
    if (before is None and after is None) or (stop - start) / rate > options.max_seconds:
        return None
    found = interpolate_gap(path, start, stop, rate, options)
    if found is not None:
        inside = slice(frames.start - start, frames.stop - start)
        return found[0][inside], np.maximum(found[1][inside], MIN_EXPECTED_RMS)
    wanted = np.arange(frames.start, frames.stop)
    ends = [frame for frame in (before, after) if frame is not None]
    positions = np.stack([np.interp(wanted, ends, path[ends, i]) for i in range(3)], axis=1)
    elapsed = np.abs(wanted[:, None] - ends) / rate
    expected_rms = max(speed, MIN_SPEED) * elapsed.min(axis=1)
    if len(ends) > 1:
        curvature = 0.5 * options.acceleration * elapsed.prod(axis=1)
        expected_rms = np.minimum(expected_rms, curvature)
    return positions, np.maximum(expected_rms, MIN_EXPECTED_RMS)
