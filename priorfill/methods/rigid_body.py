"""Rigid-body fill: a marker moves with markers at constant distances from it.

Motion-capture programs offer this with neighbours chosen by hand; here they are found in the data.
A marker is placed by the weighted least-squares rotation [K76]_ of three or more visible markers
whose distances to it and to each other vary least. Its position relative to them is interpolated
between the nearest frames before and after the gap that show them all, so the fill is continuous at
both edges.

References
----------
.. [K76] Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst. A32,
   1976.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import constant_spans
from priorfill.geometry.root_frames import rigid_frames
from priorfill.methods.task import Estimate, Progress, Task, no_progress
from priorfill.runtime.option_checks import check_at_least

__all__ = ["RigidBodyOptions", "fill"]

MIN_NEIGHBOURS = 3
"""Markers that determine a rotation."""

MIN_SD = 1.0
"""mm. Smaller standard deviations of distances are all treated alike: they are noise."""


@dataclass(frozen=True)
class RigidBodyOptions:
    """Options of ``rigid``.

    Attributes
    ----------
    max_distance_sd : float
        mm. Largest standard deviation of a neighbour's distances from the marker and from the other
        neighbours. On seven recordings, 8 mm filled two thirds of the samples that 12 mm fills, at
        0.9 of its error; 20 mm filled a third more, at 1.4 times its error.
    max_neighbours : int
        Maximum number of neighbours, those with the smallest standard deviations first.
    min_off_line : float
        mm. Smallest rms distance of the neighbours from their best-fitting line. Below it the
        rotation about that line is undetermined.

    Raises
    ------
    OptionError
        Where a value is below its minimum.
    """

    max_distance_sd: float = 12.0
    max_neighbours: int = 4
    min_off_line: float = 15.0

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "max_distance_sd", "min_off_line")
        check_at_least(self, MIN_NEIGHBOURS, "max_neighbours")


NO_NEIGHBOURS = (
    "fewer than three visible markers keep their distance to it; "
    "use a method that learns from poses, such as auto"
)


def fill(
    task: Task,
    progress: Progress = no_progress,
    options: RigidBodyOptions | None = None,
) -> Estimate:
    """Fill gaps from markers on the same rigid body.

    Parameters
    ----------
    task : Task
        The clip; its takes are not used.
    progress : callable
        Called with the number of samples done since the last call.
    options : RigidBodyOptions, optional
        The defaults if not given.

    Returns
    -------
    Estimate
        Frames with fewer than three visible neighbours stay missing, and so do markers that no
        frame shows together with them. Errors are not predicted.

    See Also
    --------
    priorfill.methods.tits2018.li : Interpolation in the frame of three neighbours.
    """
    options = options or RigidBodyOptions()
    positions = task.positions.copy()
    spread = task.geometry.spread
    for group in task.groups:
        for gap in group.gaps:
            valid = task.valid[gap.start : gap.stop]
            for first, last in constant_spans(valid):
                span = slice(gap.start + first, gap.start + last)
                visible = np.flatnonzero(valid[first])
                neighbours = _neighbours(spread, gap.marker, visible, options)
                positions[span, gap.marker] = _placed(task, gap.marker, neighbours, span, options)
            progress(gap.frames)
    return Estimate.without_errors(task, positions, "markers on the same rigid body", NO_NEIGHBOURS)


@dataclass(frozen=True, eq=False)
class _RigidNeighbours:
    """The neighbours of a marker.

    Attributes
    ----------
    markers : ndarray of int [shape=(neighbours,)]
    weights : ndarray [shape=(neighbours,)]
        Weight of each in the least-squares rotation.
    """

    markers: NDArray[np.intp]
    weights: NDArray[np.float64]


def _neighbours(
    distance_sd: NDArray[np.float64],
    marker: int,
    visible: NDArray[np.intp],
    options: RigidBodyOptions,
) -> _RigidNeighbours:
    """Choose a marker's neighbours among the visible ones, at constant distances from each other.

    ``distance_sd`` has the standard deviation of each pair's distance [shape=(markers, markers),
    mm].
    """
    chosen: list[int] = []
    for other in visible[np.argsort(distance_sd[marker, visible], kind="stable")]:
        enough = len(chosen) == options.max_neighbours
        if enough or distance_sd[marker, other] > options.max_distance_sd:
            break
        if all(distance_sd[other, one] <= options.max_distance_sd for one in chosen):
            chosen.append(int(other))
    markers = np.array(chosen, dtype=np.intp)
    return _RigidNeighbours(markers, 1.0 / np.maximum(distance_sd[marker, markers], MIN_SD) ** 2)


def _placed(
    task: Task, marker: int, neighbours: _RigidNeighbours, span: slice, options: RigidBodyOptions
) -> NDArray[np.float64]:
    """Place a marker by its neighbours in a run of frames.

    Returns its positions [shape=(frames, 3), mm], NaN where that is not possible.
    """
    nowhere = np.full((span.stop - span.start, 3), np.nan)
    seen = np.logical_and.reduce(task.valid[:, [marker, *neighbours.markers]], axis=1)
    if len(neighbours.markers) < MIN_NEIGHBOURS or not seen.any():
        return nowhere
    adjacent = _adjacent(seen, span)
    points = task.positions[:, neighbours.markers]
    template = points[adjacent[0]]
    if _off_line(template, neighbours.weights) < options.min_off_line:
        return nowhere
    known = rigid_frames(points[adjacent], template, neighbours.weights)
    local = known.to_local(task.positions[adjacent, marker][:, None])[:, 0]
    frames = np.arange(span.start, span.stop)
    where = np.stack([np.interp(frames, adjacent, local[:, i]) for i in range(3)], axis=1)
    return rigid_frames(points[span], template, neighbours.weights).to_world(where[:, None])[:, 0]


def _adjacent(seen: NDArray[np.bool_], span: slice) -> NDArray[np.intp]:
    """Return the last complete frame before a run and the first one after it, where they exist."""
    before = np.flatnonzero(seen[: span.start])[-1:]
    after = np.flatnonzero(seen[span.stop :])[:1] + span.stop
    return np.concatenate([before, after])


def _off_line(points: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Return the rms distance (mm) of points from their best-fitting straight line."""
    share = weights / weights.sum()
    centred = np.sqrt(share)[:, None] * (points - share @ points)
    return float(np.linalg.svd(centred, compute_uv=False)[1])
