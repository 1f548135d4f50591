"""Interpolation of each marker over time: the baselines of every comparison.

Before a marker's first sample and after its last one, that sample's position is repeated:
extrapolated curves can diverge by metres.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap, find_gaps
from priorfill.methods.task import Estimate, Progress, Task, no_progress

__all__ = ["linear", "pchip", "spline"]

Array = NDArray[np.float64]

Curve = Callable[[Array, Array, Array], Array]
"""Function of times, positions and query times [shapes=(n,), (n, 3), (m,)] that returns the
positions at the query times [shape=(m, 3)]."""

NEVER_VISIBLE = "it is never visible; use a method that learns from other markers or recordings"


def _pchip(times: Array, positions: Array, query: Array) -> Array:
    from scipy.interpolate import PchipInterpolator  # slow to import, and `linear` needs none of it

    return np.asarray(PchipInterpolator(times, positions)(query))


def _spline(times: Array, positions: Array, query: Array) -> Array:
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(times, positions)(query))


def _put_curves(curve: Curve, task: Task, positions: Array, progress: Progress) -> None:
    """Put a curve through all samples of a marker into its gaps between two samples."""
    frames = np.arange(len(positions), dtype=np.float64)
    for marker in np.flatnonzero(~task.valid.all(axis=0)):
        seen = task.valid[:, marker]
        if seen.any():
            times = frames[seen]
            inside = ~seen & (frames > times[0]) & (frames < times[-1])
            if inside.any():
                samples = positions[seen, marker]
                positions[inside, marker] = curve(times, samples, frames[inside])
            progress(len(frames) - len(times))


def _put_lines(task: Task, positions: Array, progress: Progress) -> None:
    """Put straight lines into the gaps between two samples, all gaps at once."""
    seen = task.valid.any(axis=0)
    progress(int((~task.valid[:, seen]).sum()))
    inner = [gap for gap in find_gaps(~task.valid) if gap.start > 0 and gap.stop < len(positions)]
    if not inner:
        return
    start, stop, marker = np.array([(gap.start, gap.stop, gap.marker) for gap in inner]).T
    frames = stop - start
    first, last = positions[start - 1, marker], positions[stop, marker]
    slope = (last - first) / (frames + 1)[:, None]
    gap = np.repeat(np.arange(len(inner)), frames)
    step = 1 + np.arange(len(gap)) - (np.cumsum(frames) - frames)[gap]
    positions[start[gap] + step - 1, marker[gap]] = slope[gap] * step[:, None] + first[gap]


def _interpolated(
    task: Task, progress: Progress, put: Callable[[Task, Array, Progress], None], source: str
) -> Estimate:
    """Interpolate each marker's gaps; repeat its first and last sample beyond them."""
    positions = task.positions.copy()
    put(task, positions, progress)
    first, last = task.valid.argmax(axis=0), len(positions) - task.valid[::-1].argmax(axis=0)
    for marker in np.flatnonzero(task.valid.any(axis=0)):
        positions[: first[marker], marker] = positions[first[marker], marker]
        positions[last[marker] :, marker] = positions[last[marker] - 1, marker]

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
    return _interpolated(task, progress, _put_lines, "straight lines over time")


def pchip(task: Task, progress: Progress = no_progress) -> Estimate:
    """Fill gaps by monotone piecewise cubic curves, which do not overshoot [FB84]_; see `linear`.

    References
    ----------
    .. [FB84] Fritsch and Butland, A method for constructing local monotone piecewise cubic
       interpolants, SIAM J. Sci. Stat. Comput. 5(2), 1984.
    """
    return _interpolated(
        task, progress, partial(_put_curves, _pchip), "monotone cubic curves over time"
    )


def spline(task: Task, progress: Progress = no_progress) -> Estimate:
    """Fill gaps by cubic splines through all samples, with "not-a-knot" ends; see `linear`."""
    return _interpolated(task, progress, partial(_put_curves, _spline), "cubic splines over time")
