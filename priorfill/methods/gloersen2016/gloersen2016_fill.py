"""The methods ``r1`` and ``r2``: a strategy applied to the usable frames of a task."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MethodError
from priorfill.gaps import Gap
from priorfill.methods.gloersen2016.strategies import (
    Gloersen2016Options,
    MissingMarkers,
    PcaFrames,
    consecutive,
    simultaneous,
)
from priorfill.methods.task import Estimate, Progress, Task, no_progress

__all__ = ["r1", "r2"]

Mask = NDArray[np.bool_]

MIN_ANCHORS = 3
"""Markers whose mean is the origin of the poses, where frames are left out to obtain them: one or
two may belong to a limb that swings. (Where no frame is left out one suffices, as published.)"""

SOURCE = "correlations with other markers"
NEVER_VISIBLE = "never visible in the clip; use auto with a database or a static trial"
NO_MARKER = "no marker is visible; use auto, which finds similar movements elsewhere"
TOO_FEW_MARKERS = "too few markers are visible; use auto"
NO_COMPLETE_FRAMES = "{}: no two frames show all markers; use r2 or auto"
NEVER_TOGETHER = (
    "fewer than two frames show it with the markers that are visible in its gaps; use auto"
)
NO_ANCHOR = (
    "{}: no marker is visible in all frames with gaps, and this method needs one as the origin of "
    "its poses; fill short gaps by pchip first, or use auto"
)


def _usable_frames(valid: Mask) -> Mask:
    """Choose the frames to work with.

    These are all frames with a visible marker, if a marker is visible in all of them. Otherwise the
    frames with the fewest visible markers are left out until `MIN_ANCHORS` markers are visible in
    all remaining ones.

    Parameters
    ----------
    valid : ndarray of bool [shape=(frames, markers)]
        Measured samples of the markers that are visible in some frame.

    Returns
    -------
    ndarray of bool [shape=(frames,)]
        All False where no marker is visible in all frames with gaps.
    """
    shown = valid.sum(axis=1)
    if valid[shown > 0].all(axis=0).any():
        return np.asarray(shown > 0)
    for count in np.unique(shown[shown < valid.shape[1]]):
        if valid[shown >= count].all(axis=0).sum() >= MIN_ANCHORS:
            return np.asarray(shown >= count)
    return np.zeros(len(valid), dtype=bool)


def _filled(
    task: Task,
    progress: Progress,
    options: Gloersen2016Options,
    strategy: Callable[[PcaFrames, Gloersen2016Options], Iterator[MissingMarkers]],
) -> Estimate:
    """Fill a task by a strategy, and give the reason for what stays missing."""
    positions = task.positions.copy()
    untrained = np.zeros(positions.shape[1], dtype=bool)
    unused = untrained  # visible only in frames that are left out
    if task.valid.any() and not task.valid.all():
        markers = np.flatnonzero(task.valid.any(axis=0))
        rows = np.flatnonzero(_usable_frames(task.valid[:, markers]))
        if not len(rows):
            raise MethodError(NO_ANCHOR.format(task.name))
        unused = np.asarray(task.valid.any(axis=0) & ~task.valid[rows].any(axis=0))
        markers = markers[~unused[markers]]
        clip = positions[np.ix_(rows, markers)]
        constant = task.valid[np.ix_(rows, markers)].all(axis=0)
        origin = clip[:, constant].mean(axis=1, keepdims=True)
        frames = PcaFrames(clip - origin)
        for missing in strategy(frames, options):
            predicted = frames.predict(missing, options)
            if predicted is None:
                untrained[markers[missing.markers]] = True
                continue
            gaps, found = predicted
            progress(len(gaps) * len(missing.markers))
            positions[np.ix_(rows[gaps], markers[missing.markers])] = found + origin[gaps]
    if strategy is simultaneous and untrained.any():
        raise MethodError(NO_COMPLETE_FRAMES.format(task.name))

    def reason(gap: Gap) -> str:
        if not task.valid[:, gap.marker].any():
            return NEVER_VISIBLE
        if untrained[gap.marker] or unused[gap.marker]:
            return NEVER_TOGETHER
        return TOO_FEW_MARKERS if task.valid[gap.start : gap.stop].any() else NO_MARKER

    return Estimate.without_errors(task, positions, SOURCE, reason)


def r1(
    task: Task,
    progress: Progress = no_progress,
    options: Gloersen2016Options | None = None,
) -> Estimate:
    """Fill all markers with gaps at once: the simultaneous strategy, R1 of the publication.

    Parameters
    ----------
    task : Task
        The clip; its takes are not used.
    progress : callable
        Called with the number of samples done since the last call.
    options : Gloersen2016Options, optional
        The publication's constants if not given.

    Returns
    -------
    Estimate
        Markers that are never visible, and frames with no or too few visible markers, stay missing.
        Errors are not predicted.

    Raises
    ------
    MethodError
        Where no marker is visible in all usable frames, or fewer than two frames are complete.

    See Also
    --------
    r2 : One marker after another.
    priorfill.methods.tits2018.wpca : ``r2`` constrained by distances.
    """
    return _filled(task, progress, options or Gloersen2016Options(), simultaneous)


def r2(
    task: Task,
    progress: Progress = no_progress,
    options: Gloersen2016Options | None = None,
) -> Estimate:
    """Fill one marker after another: the consecutive strategy, R2 of the publication; see `r1`.

    Markers also stay missing where fewer than two frames show them together with the markers that
    are visible in their gaps.
    """
    return _filled(task, progress, options or Gloersen2016Options(), consecutive)
