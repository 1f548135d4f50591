"""Quality of a fill apart from its error: steps at its edges, jitter, penetration of the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Path3 = NDArray[np.float64]
"""One marker over time [shape=(frames, 3), mm]; NaN where missing."""

PERCENTILE = 99.0
"""Percentile of a marker's measured second differences that counts as an ordinary step."""

MIN_DIFFERENCES = 50
"""Minimum number of second differences for a percentile."""

MOTION_HZ = 10.0
"""Hz. Body motion has little power above; a fill should not have more than the measured path."""

MIN_SECONDS = 0.25
"""s. Shorter gaps do not resolve frequencies of 10 Hz."""


def second_differences(path: Path3) -> NDArray[np.float64]:
    """Lengths of the second differences of a path [shape=(frames - 2,), mm]."""
    lengths: NDArray[np.float64] = np.linalg.norm(path[2:] - 2.0 * path[1:-1] + path[:-2], axis=1)
    return lengths


def edge_step(path: Path3, start: int, stop: int) -> float:
    """Return the largest second difference (mm) across an edge of a gap.

    Parameters
    ----------
    path : ndarray [shape=(frames, 3), mm]
        Filled.
    start, stop : int
        The gap. The result is NaN for a gap that spans the clip and has no edge.
    """
    centres = [c for c in (start - 1, start) if start > 0] + [
        c for c in (stop - 1, stop) if stop < len(path)
    ]
    lengths = second_differences(path)
    inside = [lengths[c - 1] for c in centres if 1 <= c <= len(path) - 2]
    inside = [length for length in inside if np.isfinite(length)]
    return float(max(inside)) if inside else float("nan")


def reference_step(measured: Path3) -> float:
    """Return the 99th percentile of measured second differences (mm); NaN for too few."""
    lengths = second_differences(measured)
    lengths = lengths[np.isfinite(lengths)]
    return (
        float(np.percentile(lengths, PERCENTILE))
        if len(lengths) >= MIN_DIFFERENCES
        else float("nan")
    )


def jitter(path: Path3, rate: float) -> tuple[float, float]:
    """Measure the motion of a path above 10 Hz.

    A Hann window limits leakage from slow motion, which has far more power.

    Parameters
    ----------
    path : ndarray [shape=(frames, 3), mm]
        Part of one marker's path.
    rate : float
        Hz.

    Returns
    -------
    power : float
        Power of the accelerations above 10 Hz, comparable between paths of equal length.
    amplitude : float
        Rms displacement above 10 Hz (mm). Both are NaN for a path that is too short.
    """
    acceleration = path[2:] - 2.0 * path[1:-1] + path[:-2]
    frames = len(acceleration)
    if frames < MIN_SECONDS * rate or not np.isfinite(acceleration).all():
        return float("nan"), float("nan")
    window = np.hanning(frames)
    frequency = np.fft.rfftfreq(frames)  # cycles a frame
    power = (np.abs(np.fft.rfft(acceleration * window[:, None], axis=0)) ** 2).sum(axis=1)
    fast = frequency * rate > MOTION_HZ
    # gain of a second difference
    gain = 2.0 - 2.0 * np.cos(2.0 * np.pi * frequency[fast])
    square = 2.0 * (power[fast] / gain**2).sum() / (frames * (window**2).sum())
    return float(power[fast].sum()), float(np.sqrt(square))


def penetration(height: NDArray[np.float64], lowest: float) -> float:
    """Return how far (mm) heights go below the lowest measured one, at least 0."""
    return max(0.0, lowest - float(np.min(height)))
