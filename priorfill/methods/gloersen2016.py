"""Gaps filled by what markers have in common: Gløersen and Federolf, PLoS ONE 2016 [GF16]_.

The mean of the markers that are seen throughout is taken out of each frame. In the frames that
show everything needed, each column x (one coordinate of a marker) is brought to

    z = w (x - mean) / deviation,    w = exp(-d^2 / 2 sigma^2),    w = w_mm for lost markers,

where d is the marker's mean distance to the nearest lost marker. V are the principal components
of these frames (right singular vectors of the rows z), V0 those of the same frames with the lost
markers' columns set to zero; of both as many are kept as the sum of the singular values needs to
reach a share of the whole in both. With T = V' V0, the frames z0 that lack the markers give

    z = z0 V0 T V'                                                    (1)

and the lost columns of it, brought back to mm, fill the gaps.

``r1``, simultaneous: all markers with gaps are lost at once, and learnt from frames that show all.
``r2``, consecutive, the program's default: one marker after the other is lost. Of the other
markers with gaps those stay that are nearer than a share of the mean distance and are seen in all
its gaps; it is learnt from frames that show them. No marker is predicted from filled samples.

Where it departs from the publication's program (PredictMissingMarkers.m):

* Of T its diagonal is kept. In (1) component j of V0 becomes component k of V with the sign of
  both, and the sign of a singular vector is arbitrary: for j = k it cancels, for all others the
  fill depends on which signs the SVD happens to return (on a limb of HDM05 means of 84 to 147 mm).
  The diagonal is the mean of (1) over all choices of signs, and the same for each of them.
* The components come from covariances, which is the same in exact arithmetic, and 100 times
  faster: sums over frames that show everything are taken once for all markers, and lost columns
  are left out rather than zeroed.
* Frames that show no marker and markers that are never seen are left out. There the program's
  means and distances are NaN, and it fills nothing.
* A pair of markers never seen together is infinitely far apart; the program's cut-off is NaN then.
* A column is still below `STILL`, not only at a deviation of exactly 0, which rounding misses.
* Components without variance are not counted.

As in the publication, deviations differ by axis, so that a clip turned by other than right angles
gives slightly other fills, and fills do not join the samples beside the gap.

References
----------
.. [GF16] Gløersen and Federolf, Predicting missing marker trajectories in human motion data using
   marker intercorrelations, PLoS ONE 11(3), e0152616, 2016. DOI 10.1371/journal.pone.0152616.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MethodError
from priorfill.gaps import Gap
from priorfill.methods.task import Estimate, Task

__all__ = ["Moments", "Options", "mean_distances", "r1", "r2", "regression"]

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


STILL = 1e-3
"""mm. A coordinate that deviates by less does not move: cameras and the floats of C3D files
resolve no more."""

FLAT = 1e-12
"""Variances below this share of the largest are rounding."""

FEWEST_FRAMES = 2
"""Frames to learn from: one has no deviation."""

HOW = "correlations with other markers"
NEVER = "never seen in the clip; use auto with a database or a static trial"
BLACKOUT = "no marker is seen; use auto, which finds similar movements elsewhere"
FEW = {
    "r1": "no two frames show all markers; use r2 or auto",
    "r2": "seen in no two frames beside the markers that are seen in its gaps; use auto",
}
ANCHOR = (
    "{}: no marker is seen in every frame, and this method tells positions from the mean of those "
    "that are; fill short gaps by pchip first, or use auto"
)
NOTHING = "{}: nothing can be filled: {}"


def mean_distances(positions: Array, valid: Mask, markers: NDArray[np.intp]) -> Array:
    """Mean distance of some markers to all, each over the frames that show both.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Whatever is in samples that are not valid is not looked at, but must be finite.
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    markers : ndarray of int [shape=(some,)]
        The markers to measure from.

    Returns
    -------
    ndarray [shape=(some, markers), mm]
        Infinite for markers that are never seen together.
    """
    axes = [np.ascontiguousarray(positions[..., axis]) for axis in range(3)]
    distances = np.full((len(markers), positions.shape[1]), np.inf)
    for row, marker in zip(distances, markers, strict=True):
        seen = valid[:, marker]
        square = sum((axis[seen] - axis[seen, marker, None]) ** 2 for axis in axes)
        both = valid[seen]
        total = np.sum(np.sqrt(square), axis=0, where=both)
        np.divide(total, both.sum(axis=0), out=row, where=both.any(axis=0))
    return distances


class Moments:
    """Means and covariances of columns, over frames that differ from call to call.

    Frames that show every marker are in all of them, and are summed up once.

    Parameters
    ----------
    columns : ndarray [shape=(frames, columns)]
        Near 0 on the whole, so that squares do not swallow deviations.
    whole : ndarray of bool [shape=(frames,)]
        The frames that show everything.
    """

    def __init__(self, columns: Array, whole: Mask) -> None:
        self._columns = columns
        self._whole = whole
        self._sum = columns[whole].sum(axis=0)
        self._products = columns[whole].T @ columns[whole]

    def over(self, frames: Mask, which: Mask) -> tuple[Array, Array]:
        """Mean and covariance of some columns over the whole frames and some others.

        Parameters
        ----------
        frames : ndarray of bool [shape=(frames,)]
            The frames; the whole ones are among them.
        which : ndarray of bool [shape=(all columns,)]
            The columns.

        Returns
        -------
        mean : ndarray [shape=(columns,)]
            Of the columns chosen.
        covariance : ndarray [shape=(columns, columns)]
            Divided by the number of frames.
        """
        more = self._columns[frames & ~self._whole][:, which]
        mean = (self._sum[which] + more.sum(axis=0)) / frames.sum()
        products = self._products[np.ix_(which, which)] + more.T @ more
        return mean, products / frames.sum() - np.outer(mean, mean)


def _components(covariance: Array) -> tuple[Array, Array]:
    """Singular values, descending, and components of rows with this covariance."""
    variances, components = np.linalg.eigh(covariance)
    varied = variances > FLAT * max(variances.max(initial=0.0), 0.0)
    return np.sqrt(variances[varied][::-1]), components[:, varied][:, ::-1]


def _how_many(singular: Array, explained: float) -> int:
    """Smallest number of singular values whose sum is a share of the whole."""
    sums = np.cumsum(singular)
    return int(np.searchsorted(sums, explained * sums[-1])) + 1 if len(sums) else 0


def regression(covariance: Array, weights: Array, lost: Mask, explained: float) -> Array:
    """Slopes of lost columns on visible ones, by (1) with the diagonal of T.

    Parameters
    ----------
    covariance : ndarray [shape=(columns, columns), mm^2]
        Of visible and lost columns.
    weights : ndarray [shape=(columns,)]
        Positive for lost columns.
    lost : ndarray of bool [shape=(columns,)]
        Which are lost.
    explained : float
        Share of the sum of singular values to reach.

    Returns
    -------
    ndarray [shape=(visible columns, lost columns)]
        What to multiply visible columns' differences from their mean by.
    """
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = weights / np.where(deviation > STILL, deviation, 1.0)
    scaled = covariance * np.outer(scale, scale)
    seen = ~lost
    singular, components = _components(scaled)
    singular0, components0 = _components(scaled[np.ix_(seen, seen)])
    kept = max(_how_many(singular, explained), _how_many(singular0, explained))
    kept = min(kept, len(singular), len(singular0))
    components, components0 = components[:, :kept], components0[:, :kept]
    diagonal = np.sum(components[seen] * components0, axis=0)
    slopes: Array = (components0 * diagonal) @ components[lost].T
    return scale[seen, None] * slopes / scale[lost]


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
        self.frames = np.flatnonzero(task.valid.any(axis=1))
        self.markers = np.flatnonzero(task.valid.any(axis=0))
        self.valid = task.valid[np.ix_(self.frames, self.markers)]
        self.constant = self.valid.all(axis=0)
        if not self.constant.any():
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
        return FEW[name] if few[gap.marker] else BLACKOUT

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
        Markers that are never seen and frames that show no marker stay missing.

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
