"""Interpolation of each marker over time: the baselines of every comparison.

Before a marker's first sample and after its last one, that sample's position is repeated:
extrapolated curves can diverge by metres.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap
from priorfill.methods.task import Estimate, Progress, Task, no_progress

__all__ = ["linear", "pchip", "spline"]

Array = NDArray[np.float64]

Curve = Callable[[Array, Array, Array], Array]
"""Function of times, positions and query times [shapes=(n,), (n, 3), (m,)] that returns the
positions at the query times [shape=(m, 3)]."""

NEVER_VISIBLE = "it is never visible; use a method that learns from other markers or recordings"


def _line(times: Array, positions: Array, query: Array) -> Array:
    return np.stack([np.interp(query, times, positions[:, i]) for i in range(3)], axis=1)


def _pchip(times: Array, positions: Array, query: Array) -> Array:
    from scipy.interpolate import PchipInterpolator  # slow to import, and `linear` needs none of it

    return np.asarray(PchipInterpolator(times, positions)(query))


def _spline(times: Array, positions: Array, query: Array) -> Array:
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(times, positions)(query))


def _interpolated(task: Task, progress: Progress, curve: Curve, source: str) -> Estimate:
    """Interpolate each marker's gaps; repeat its first and last sample beyond them."""
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
        progress(len(frames) - len(times))

    def source_of(gap: Gap) -> str:
        inside = gap.start > 0 and gap.stop < len(positions)
        return source if inside else f"{'first' if gap.start == 0 else 'last'} position held"

    return Estimate.without_errors(task, positions, source_of, NEVER_VISIBLE)


def linear(task: Task, progress: Progress = no_progress) -> Estimate:
    """Fill gaps by linear interpolation between the adjacent samples.

    Parameters
    ----------
    task : Task
        The clip; its takes are not used.
    progress : callable
        Called with the number of samples done since the last call.

    Returns
    -------
    Estimate
        Only markers that are never visible stay missing. Errors are not predicted.

    See Also
    --------
    pchip : By monotone piecewise cubic curves.
    spline : By cubic splines.
    """
    return _interpolated(task, progress, _line, "straight lines over time")


def pchip(task: Task, progress: Progress = no_progress) -> Estimate:
    """Fill gaps by monotone piecewise cubic curves, which do not overshoot [FB84]_; see `linear`.

    References
    ----------
    .. [FB84] Fritsch and Butland, A method for constructing local monotone piecewise cubic
       interpolants, SIAM J. Sci. Stat. Comput. 5(2), 1984.
    """
    return _interpolated(task, progress, _pchip, "monotone cubic curves over time")


def spline(task: Task, progress: Progress = no_progress) -> Estimate:
    """Fill gaps by cubic splines through all samples, with "not-a-knot" ends; see `linear`."""
    return _interpolated(task, progress, _spline, "cubic splines over time")
