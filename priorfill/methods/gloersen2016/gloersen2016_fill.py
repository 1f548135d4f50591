"""The strategies on a task: which frames they can work with, and what they say of gaps."""

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
    at_once,
    one_by_one,
)
from priorfill.methods.task import Estimate, Task

__all__ = ["r1", "r2"]

Mask = NDArray[np.bool_]

ANCHORS = 3
"""Markers whose mean stands for the place of the body where frames are left out for it: one or two
may be of a limb that swings. (Where frames need not be left out one will do, as published.)"""

HOW = "correlations with other markers"
NEVER = "never seen in the clip; use auto with a database or a static trial"
BLACKOUT = "no marker is seen; use auto, which finds similar movements elsewhere"
FEWER = "too few markers are seen; use auto"
WHOLE = "{}: no two frames show all markers; use r2 or auto"
FEW = "seen in no two frames beside the markers that are seen in its gaps; use auto"
ANCHOR = (
    "{}: no marker is seen in all frames with gaps, and this method tells positions from the mean "
    "of those that are; fill short gaps by pchip first, or use auto"
)


def _workable(valid: Mask) -> Mask:
    """Choose the frames that show a marker, or many enough that some markers are in all of them.

    Parameters
    ----------
    valid : ndarray of bool [shape=(frames, markers)]
        Of markers that are seen at all.

    Returns
    -------
    ndarray of bool [shape=(frames,)]
        None where no marker is in all frames that have gaps to be filled.
    """
    shown = valid.sum(axis=1)
    if valid[shown > 0].all(axis=0).any():
        return np.asarray(shown > 0)
    for fewest in np.unique(shown[shown < valid.shape[1]]):
        if valid[shown >= fewest].all(axis=0).sum() >= ANCHORS:
            return np.asarray(shown >= fewest)
    return np.zeros(len(valid), dtype=bool)


def _filled(
    task: Task,
    progress: Callable[[], None],
    options: Gloersen2016Options,
    strategy: Callable[[PcaFrames, Gloersen2016Options], Iterator[MissingMarkers]],
) -> Estimate:
    """Fill what can be filled by a strategy, and say why of the rest."""
    positions = task.positions.copy()
    few = np.zeros(positions.shape[1], dtype=bool)
    if task.valid.any() and not task.valid.all():
        markers = np.flatnonzero(task.valid.any(axis=0))
        rows = np.flatnonzero(_workable(task.valid[:, markers]))
        if not len(rows):
            raise MethodError(ANCHOR.format(task.name))
        clip = positions[np.ix_(rows, markers)]
        constant = task.valid[np.ix_(rows, markers)].all(axis=0)
        origin = clip[:, constant].mean(axis=1, keepdims=True)
        frames = PcaFrames(clip - origin)
        for lost in strategy(frames, options):
            told = frames.told(lost, options)
            if told is None:
                few[markers[lost.markers]] = True
                continue
            gaps, found = told
            positions[np.ix_(rows[gaps], markers[lost.markers])] = found + origin[gaps]
    if strategy is at_once and few.any():
        raise MethodError(WHOLE.format(task.name))
    for _ in task.groups:
        progress()

    def reason(gap: Gap) -> str:
        if not task.valid[:, gap.marker].any():
            return NEVER
        if few[gap.marker]:
            return FEW
        return FEWER if task.valid[gap.start : gap.stop].any() else BLACKOUT

    return Estimate.told(task, positions, HOW, reason)


def r1(
    task: Task,
    progress: Callable[[], None] = lambda: None,
    options: Gloersen2016Options | None = None,
) -> Estimate:
    """Fill all markers with gaps at once (simultaneous strategy, R1 of the publication).

    Parameters
    ----------
    task : Task
        The clip; takes are not looked at.
    progress : callable
        Called once a gap group.
    options : Gloersen2016Options, optional
        The publication's constants by default.

    Returns
    -------
    Estimate
        Markers that are never seen and frames that show none or few stay missing.

    Raises
    ------
    MethodError
        Where no marker is seen in all of these frames, or no two of them show all markers (``r1``).
    """
    return _filled(task, progress, options or Gloersen2016Options(), at_once)


def r2(
    task: Task,
    progress: Callable[[], None] = lambda: None,
    options: Gloersen2016Options | None = None,
) -> Estimate:
    """Fill one marker after the other (consecutive strategy, R2 of the publication); see `r1`.

    What two frames or more do not show beside the markers seen in its gaps stays missing, too.
    """
    return _filled(task, progress, options or Gloersen2016Options(), one_by_one)
