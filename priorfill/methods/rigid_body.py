"""A marker moves with those that keep their distances to it: the filler for one lost marker.

What vendors' programs call a rigid-body fill, with the neighbours found in the data. A marker is
placed by the weighted least-squares rotation [K76]_ of the three or more visible markers that keep
their distances to it and to each other best. Where it lies among them is what the frames beside
the gap show, led from one side to the other, so that the fill joins both without a step.

References
----------
.. [K76] Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst. A32,
   1976.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import constant_spans
from priorfill.geometry.root_frames import rigid_frames
from priorfill.methods.task import Estimate, Task

__all__ = ["RigidBodyOptions", "fill"]


@dataclass(frozen=True)
class RigidBodyOptions:
    """RigidBodyOptions of the rigid-body fill.

    Attributes
    ----------
    stiff : float
        mm. Neighbours keep their distance to the marker, and to each other, with no larger
        standard deviation. On seven recordings 8 mm filled two thirds of what 12 mm does at 0.9 of
        its error, 20 mm a third more at 1.4 times its error.
    most : int
        Neighbours at most, the stiffest: more of them only add softer ones.
    spread : float
        mm. Neighbours nearer to one line than this leave the rotation about it open.
    """

    stiff: float = 12.0
    most: int = 4
    spread: float = 15.0


FEWEST = 3
"""Markers that a rotation needs."""

FLOOR = 1.0
"""mm. Deviations below this say nothing of which neighbour is the better one."""

REASON = (
    "fewer than three visible markers keep their distance to it; "
    "use a method that learns from poses, such as auto"
)


def fill(
    task: Task, progress: Callable[[], None] = lambda: None, options: RigidBodyOptions | None = None
) -> Estimate:
    """Fill gaps by markers on the same rigid body.

    Parameters
    ----------
    task : Task
        The clip; takes are not looked at.
    progress : callable
        Called once a gap group.
    options : RigidBodyOptions, optional
        What counts as a neighbour.

    Returns
    -------
    Estimate
        Frames in which fewer than three neighbours are visible stay missing, and markers that the
        clip never shows together with them.
    """
    options = options or RigidBodyOptions()
    positions = task.positions.copy()
    spread = task.geometry.spread
    for group in task.groups:
        for gap in group.gaps:
            valid = task.valid[gap.start : gap.stop]
            for first, last in constant_spans(valid):
                span = slice(gap.start + first, gap.start + last)
                body = _body(spread, gap.marker, np.flatnonzero(valid[first]), options)
                positions[span, gap.marker] = _placed(task, gap.marker, body, span, options)
        progress()
    return Estimate.told(task, positions, "markers on the same rigid body", REASON)


@dataclass(frozen=True, eq=False)
class _RigidNeighbours:
    """The neighbours of a marker.

    Attributes
    ----------
    markers : ndarray of int [shape=(neighbours,)]
    weights : ndarray [shape=(neighbours,)]
        How much each counts in the rotation.
    """

    markers: NDArray[np.intp]
    weights: NDArray[np.float64]


def _body(
    expected_rms: NDArray[np.float64],
    marker: int,
    visible: NDArray[np.intp],
    options: RigidBodyOptions,
) -> _RigidNeighbours:
    """Choose a marker's neighbours among the visible ones: stiff to it and to each other."""
    chosen: list[int] = []
    for other in visible[np.argsort(expected_rms[marker, visible], kind="stable")]:
        if len(chosen) == options.most or expected_rms[marker, other] > options.stiff:
            break
        if all(expected_rms[other, mate] <= options.stiff for mate in chosen):
            chosen.append(int(other))
    markers = np.array(chosen, dtype=np.intp)
    return _RigidNeighbours(markers, 1.0 / np.maximum(expected_rms[marker, markers], FLOOR) ** 2)


def _placed(
    task: Task, marker: int, body: _RigidNeighbours, span: slice, options: RigidBodyOptions
) -> NDArray[np.float64]:
    """Place a marker by its body in a run of frames.

    Returns its positions [shape=(frames, 3), mm], NaN where that is not possible.
    """
    nowhere = np.full((span.stop - span.start, 3), np.nan)
    seen = np.logical_and.reduce(task.valid[:, [marker, *body.markers]], axis=1)
    if len(body.markers) < FEWEST or not seen.any():
        return nowhere
    beside = _beside(seen, span)
    points = task.positions[:, body.markers]
    template = points[beside[0]]
    if _off_line(template, body.weights) < options.spread:
        return nowhere
    known = rigid_frames(points[beside], template, body.weights)
    local = known.to_local(task.positions[beside, marker][:, None])[:, 0]
    frames = np.arange(span.start, span.stop)
    where = np.stack([np.interp(frames, beside, local[:, i]) for i in range(3)], axis=1)
    return rigid_frames(points[span], template, body.weights).to_world(where[:, None])[:, 0]


def _beside(seen: NDArray[np.bool_], span: slice) -> NDArray[np.intp]:
    """Return the last frame before a run and the first one after it that show all, as there are."""
    before = np.flatnonzero(seen[: span.start])[-1:]
    after = np.flatnonzero(seen[span.stop :])[:1] + span.stop
    return np.concatenate([before, after])


def _off_line(points: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Return how far (mm, rms) points are off the straight line nearest to them."""
    share = weights / weights.sum()
    centred = np.sqrt(share)[:, None] * (points - share @ points)
    return float(np.linalg.svd(centred, compute_uv=False)[1])
