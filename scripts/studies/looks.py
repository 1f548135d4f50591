"""How a filled gap looks beside what is measured: steps at its edges, jitter, feet in the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Path3 = NDArray[np.float64]
"""One marker over time [shape=(frames, 3), mm]; NaN where missing."""

USUAL = 99.0
"""Percentile of a marker's own second differences up to which a step at an edge is nothing odd."""

FEWEST = 50
"""Second differences that a percentile is taken of at least."""

BODY_HZ = 10.0
"""Hz. Bodies move little above it; what is filled may shake there no more than what is measured."""

SHORTEST = 0.25
"""s. In shorter gaps nothing can be said of frequencies as low as that."""


def second_differences(path: Path3) -> NDArray[np.float64]:
    """Lengths of the second differences of a path [shape=(frames - 2,), mm]."""
    lengths: NDArray[np.float64] = np.linalg.norm(path[2:] - 2.0 * path[1:-1] + path[:-2], axis=1)
    return lengths


def edge_step(path: Path3, start: int, stop: int) -> float:
    """Return the greatest second difference (mm) that reaches over an edge of a gap.

    Parameters
    ----------
    path : ndarray [shape=(frames, 3), mm]
        Filled.
    start, stop : int
        The gap. NaN where it has no edge: it takes the whole clip.
    """
    centres = [c for c in (start - 1, start) if start > 0] + [
        c for c in (stop - 1, stop) if stop < len(path)
    ]
    lengths = second_differences(path)
    inside = [lengths[c - 1] for c in centres if 1 <= c <= len(path) - 2]
    inside = [length for length in inside if np.isfinite(length)]
    return float(max(inside)) if inside else float("nan")


def usual_step(measured: Path3) -> float:
    """Return the 99th percentile of a measured path's second differences (mm); NaN: too few."""
    lengths = second_differences(measured)
    lengths = lengths[np.isfinite(lengths)]
    return float(np.percentile(lengths, USUAL)) if len(lengths) >= FEWEST else float("nan")


def shake(path: Path3, rate: float) -> tuple[float, float]:
    """Measure how a path shakes: faster than 10 Hz.

    A window of Hann keeps slow movement, which has far more power, from leaking there.

    Parameters
    ----------
    path : ndarray [shape=(frames, 3), mm]
        A part of one marker's path.
    rate : float
        Hz.

    Returns
    -------
    power : float
        Of the accelerations above 10 Hz, to be compared with that of another path of the same
        length.
    amplitude : float
        Rms distance (mm) that the path shakes by. NaN, both, where it is too short.
    """
    acceleration = path[2:] - 2.0 * path[1:-1] + path[:-2]
    frames = len(acceleration)
    if frames < SHORTEST * rate or not np.isfinite(acceleration).all():
        return float("nan"), float("nan")
    window = np.hanning(frames)
    frequency = np.fft.rfftfreq(frames)  # cycles a frame
    power = (np.abs(np.fft.rfft(acceleration * window[:, None], axis=0)) ** 2).sum(axis=1)
    fast = frequency * rate > BODY_HZ
    # a second difference multiplies a sine by this
    gain = 2.0 - 2.0 * np.cos(2.0 * np.pi * frequency[fast])
    square = 2.0 * (power[fast] / gain**2).sum() / (frames * (window**2).sum())
    return float(power[fast].sum()), float(np.sqrt(square))


def depth(height: NDArray[np.float64], lowest: float) -> float:
    """Return how far (mm) some heights go below the lowest one measured; 0 where they do not."""
    return max(0.0, lowest - float(np.min(height)))
