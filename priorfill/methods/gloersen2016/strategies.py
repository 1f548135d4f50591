"""The two strategies: which markers are lost together, and what they are told from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MethodError
from priorfill.gaps import Gap
from priorfill.methods.gloersen2016.weighted_pca import Moments, mean_distances, regression
from priorfill.methods.task import Estimate, Task

__all__ = ["Options", "r1", "r2"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Options:
    """Constants of the publication; the names are those of its program.

    Attributes
    ----------
    sigma : float
        mm; ``WeightScale``. How fast weights fall with the distance from a lost marker.
    lost_weight : float
        ``MMweight``, w_mm. Weight of lost markers: small, so that they hardly shape the
        components, which the frames without them must give as well.
    cutoff : float
        ``DistalThreshold``. In ``r2`` other markers with gaps are left out beyond this share of
        the mean distance to all markers.
    explained : float
        ``MinCumSV``. Share of the sum of singular values that the components kept must reach.
    """

    sigma: float = 200.0
    lost_weight: float = 0.02
    cutoff: float = 0.5
    explained: float = 0.99


FEWEST_FRAMES = 2
"""Frames to learn from: one has no deviation."""

ANCHORS = 3
"""Markers whose mean stands for the place of the body where frames are left out for it: one or two
may be of a limb that swings. (Where frames need not be left out one will do, as published.)"""

HOW = "correlations with other markers"
NEVER = "never seen in the clip; use auto with a database or a static trial"
BLACKOUT = "no marker is seen; use auto, which finds similar movements elsewhere"
FEWER = "too few markers are seen; use auto"
FEW = {
    "r1": "no two frames show all markers; use r2 or auto",
    "r2": "seen in no two frames beside the markers that are seen in its gaps; use auto",
}
ANCHOR = (
    "{}: no marker is seen in all frames with gaps, and this method tells positions from the mean "
    "of those that are; fill short gaps by pchip first, or use auto"
)
NOTHING = "{}: nothing can be filled: {}"


@dataclass(frozen=True, eq=False)
class _Job:
    """Markers lost together, and what they are told from.

    Attributes
    ----------
    lost : ndarray of int [shape=(lost,)]
        The markers.
    used : ndarray of bool [shape=(markers,)]
        The markers looked at, the lost ones among them.
    distances : ndarray [shape=(markers,), mm]
        From the nearest lost marker.
    """

    lost: NDArray[np.intp]
    used: Mask
    distances: Array


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


class _Clip:
    """The frames and markers that can be worked with, free of the mean of the constant markers.

    Attributes
    ----------
    frames, markers : ndarray of int
        Which of the task's they are.
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    origin : ndarray [shape=(frames, 1, 3), mm]
        Mean of the markers that are seen in every frame.
    centre : ndarray [shape=(markers, 3), mm]
        Mean of each marker from there.
    offsets : ndarray [shape=(frames, markers, 3), mm]
        Positions from origin and centre; 0 where missing.
    """

    def __init__(self, task: Task) -> None:
        self.markers = np.flatnonzero(task.valid.any(axis=0))
        self.frames = np.flatnonzero(_workable(task.valid[:, self.markers]))
        self.valid = task.valid[np.ix_(self.frames, self.markers)]
        self.constant = self.valid.all(axis=0)
        if not len(self.frames):
            raise MethodError(ANCHOR.format(task.name))
        positions = task.positions[np.ix_(self.frames, self.markers)]
        self.origin = positions[:, self.constant].mean(axis=1, keepdims=True, dtype=np.float64)
        shown = np.where(self.valid[..., None], positions - self.origin, 0.0)
        self.centre = shown.sum(axis=0) / self.valid.sum(axis=0)[:, None]
        self.offsets = np.where(self.valid[..., None], shown - self.centre, 0.0)

    def shows(self, markers: Mask) -> Mask:
        """Tell which frames show all of some markers [shape=(frames,)]."""
        return np.asarray(self.valid[:, markers].all(axis=1))

    def at_once(self, options: Options) -> Iterator[_Job]:
        """All markers with gaps lost together."""
        lost = np.flatnonzero(~self.constant)
        if not len(lost):
            return
        distances = mean_distances(self.offsets + self.centre, self.valid, lost)
        yield _Job(lost, np.ones(len(self.markers), dtype=bool), distances.min(axis=0))

    def one_by_one(self, options: Options) -> Iterator[_Job]:
        """Each marker with gaps lost alone."""
        lost = np.flatnonzero(~self.constant)
        measured = mean_distances(self.offsets + self.centre, self.valid, lost)
        for marker, distances in zip(lost, measured, strict=True):
            near = distances <= options.cutoff * distances[np.isfinite(distances)].mean()
            beside = self.valid[~self.valid[:, marker]].all(axis=0)
            used = self.constant | (near & beside)
            used[marker] = True
            yield _Job(np.array([marker]), used, distances)


def _filled(
    task: Task,
    progress: Callable[[], None],
    options: Options,
    name: str,
    jobs: Callable[[_Clip, Options], Iterator[_Job]],
) -> Estimate:
    """Fill what can be filled by a strategy, and say why of the rest."""
    positions = task.positions.copy()
    few = np.zeros(positions.shape[1], dtype=bool)
    if task.valid.any() and not task.valid.all():
        clip = _Clip(task)
        columns = clip.offsets.reshape(len(clip.frames), -1)
        moments = Moments(columns, clip.shows(np.ones(len(clip.markers), dtype=bool)))
        for job in jobs(clip, options):
            shown = clip.shows(job.used)
            if shown.sum() < FEWEST_FRAMES:
                few[clip.markers[job.lost]] = True
                continue
            used = np.repeat(job.used, 3)
            lost = np.repeat(np.isin(np.flatnonzero(job.used), job.lost), 3)
            weights = np.repeat(np.exp(-((job.distances / options.sigma) ** 2) / 2), 3)[used]
            weights[lost] = options.lost_weight
            mean, covariance = moments.over(shown, used)
            slopes = regression(covariance, weights, lost, options.explained)
            gaps = np.flatnonzero(~clip.valid[:, job.lost].all(axis=1))
            told = mean[lost] + (columns[gaps][:, used][:, ~lost] - mean[~lost]) @ slopes
            told = told.reshape(len(gaps), len(job.lost), 3)
            told += clip.centre[job.lost] + clip.origin[gaps]
            positions[np.ix_(clip.frames[gaps], clip.markers[job.lost])] = told
    for _ in task.groups:
        progress()

    def reason(gap: Gap) -> str:
        if not task.valid[:, gap.marker].any():
            return NEVER
        if few[gap.marker]:
            return FEW[name]
        return FEWER if task.valid[gap.start : gap.stop].any() else BLACKOUT

    estimate = Estimate.told(task, positions, HOW, reason)
    if estimate.notes and not any(note.filled for note in estimate.notes):
        reasons = dict.fromkeys(note.how for note in estimate.notes)
        raise MethodError(NOTHING.format(task.name, "; ".join(reasons)))
    return estimate


def r1(
    task: Task, progress: Callable[[], None] = lambda: None, options: Options | None = None
) -> Estimate:
    """Fill all markers with gaps at once (simultaneous strategy, R1 of the publication).

    Parameters
    ----------
    task : Task
        The clip; takes are not looked at.
    progress : callable
        Called once a gap group.
    options : Options, optional
        The publication's constants by default.

    Returns
    -------
    Estimate
        Markers that are never seen and frames that show none or few stay missing.

    Raises
    ------
    MethodError
        Where no marker is seen in all of these frames, or nothing can be filled.
    """
    return _filled(task, progress, options or Options(), "r1", _Clip.at_once)


def r2(
    task: Task, progress: Callable[[], None] = lambda: None, options: Options | None = None
) -> Estimate:
    """Fill one marker after the other (consecutive strategy, R2 of the publication); see `r1`.

    What two frames or more do not show beside the markers seen in its gaps stays missing, too.
    """
    return _filled(task, progress, options or Options(), "r2", _Clip.one_by_one)
