"""Curves over time through each marker's own samples: the baselines of every comparison.

Before a marker's first sample and after its last one nothing is known of its course: it is held
where it was seen, since a curve led on from there runs away by metres.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap
from priorfill.methods.task import Estimate, Task

__all__ = ["linear", "pchip", "spline"]

Array = NDArray[np.float64]

Curve = Callable[[Array, Array, Array], Array]
"""Values at the times asked for, from times and values [shapes=(n,), (n, 3), (asked,)]."""

REASON = "it is never seen; use a method that learns from other markers or recordings"


def _line(seen: Array, positions: Array, asked: Array) -> Array:
    return np.stack([np.interp(asked, seen, positions[:, i]) for i in range(3)], axis=1)


def _pchip(seen: Array, positions: Array, asked: Array) -> Array:
    from scipy.interpolate import PchipInterpolator  # slow to import; lines do without

    return np.asarray(PchipInterpolator(seen, positions)(asked))


def _spline(seen: Array, positions: Array, asked: Array) -> Array:
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(seen, positions)(asked))


def _interpolated(task: Task, progress: Callable[[], None], curve: Curve, how: str) -> Estimate:
    """Lead a curve through each marker's gaps, and hold it beyond its first and last sample."""
    positions = task.positions.copy()
    frames = np.arange(len(positions), dtype=np.float64)
    for marker in range(positions.shape[1]):
        seen = task.valid[:, marker]
        if seen.all() or not seen.any():
            continue
        times, samples = frames[seen], positions[seen, marker]
        inside = ~seen & (frames > times[0]) & (frames < times[-1])
        if inside.any():
            positions[inside, marker] = curve(times, samples, frames[inside])
        positions[frames < times[0], marker] = samples[0]
        positions[frames > times[-1], marker] = samples[-1]
    for _ in task.groups:
        progress()

    def told(gap: Gap) -> str:
        inside = gap.start > 0 and gap.stop < len(positions)
        return how if inside else f"{'first' if gap.start == 0 else 'last'} position held"

    return Estimate.told(task, positions, told, REASON)


def linear(task: Task, progress: Callable[[], None] = lambda: None) -> Estimate:
    """Fill gaps by straight lines between the samples beside them.

    Parameters
    ----------
    task : Task
        The clip; takes are not looked at.
    progress : callable
        Called once a gap group.

    Returns
    -------
    Estimate
        Only markers that are never seen stay missing.
    """
    return _interpolated(task, progress, _line, "straight lines over time")


def pchip(task: Task, progress: Callable[[], None] = lambda: None) -> Estimate:
    """Fill gaps by piecewise cubic curves that do not overshoot [FB84]_; see `linear`.

    References
    ----------
    .. [FB84] Fritsch and Butland, A method for constructing local monotone piecewise cubic
       interpolants, SIAM J. Sci. Stat. Comput. 5(2), 1984.
    """
    return _interpolated(task, progress, _pchip, "monotone cubic curves over time")


def spline(task: Task, progress: Callable[[], None] = lambda: None) -> Estimate:
    """Fill gaps by cubic splines with "not-a-knot" ends through all samples; see `linear`."""
    return _interpolated(task, progress, _spline, "cubic splines over time")
