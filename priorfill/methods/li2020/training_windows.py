"""The training data of Li et al. 2020: windows of the database that are similar to the clip.

The paper uses windows of the clip's length from recordings of the same kind of motion by the same
person, chosen by hand. Here the windows are chosen whose poses are nearest to the clip's, of
subjects whose rigid distances are nearest to those of the clip's subject.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.methods.li2020.li2020_options import Li2020Options
from priorfill.search.takes import Take

__all__ = ["TrainingWindow", "choose_windows", "marker_sets", "shows_all"]

Array = NDArray[np.float64]

MAX_SAMPLE_POSES = 200
"""Poses of the clip that windows are compared with; more are nearly the same."""

MIN_FRAMES = 8
"""Complete frames of a window at the coarsest resolution: 1 s at 7.5 Hz."""

MIN_VISIBLE_RATIO = 0.9
"""Markers are compared if they are visible this often, relative to the marker visible most
often."""

PAIRS_PER_MARKER = 2
"""Pairs of markers, per marker, whose distances describe a body's shape: those that vary least."""


@dataclass(frozen=True, eq=False)
class TrainingWindow:
    """A window of a take with frames that show every marker.

    Attributes
    ----------
    name : str
        Name of the take.
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where the take does not show a marker.
    rate : float
        Hz.
    """

    name: str
    positions: Array
    rate: float


def shows_all(take: Take, markers: NDArray[np.intp]) -> bool:
    """Return whether a take shows each of some markers in some frame."""
    return bool((take.shown[markers] > 0).all())


def marker_sets(valid: NDArray[np.bool_], takes: Sequence[Take]) -> Iterator[NDArray[np.intp]]:
    """Yield sets of markers to fill, the largest first, which the takes may not show.

    Parameters
    ----------
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples of the clip are measured.
    takes : sequence of Take
        The database.
    """
    seen = valid.any(axis=0)
    largest = seen.copy()
    for take in takes:
        if shows_all(take, np.flatnonzero(seen)):
            largest |= take.shown > 0
    yield np.flatnonzero(largest)
    if largest.sum() > seen.sum():
        yield np.flatnonzero(seen)


def _shape(poses: Array) -> Array:
    """Return centred poses as rows [shape=(n, 3 markers)]."""
    shape: Array = (poses - poses.mean(axis=1, keepdims=True)).reshape(len(poses), -1)
    return shape


def _distances(poses: Array, pairs: tuple[NDArray[np.intp], NDArray[np.intp]]) -> Array:
    """Return the distances of pairs of markers in some poses [shape=(poses, pairs)]."""
    return np.asarray(np.linalg.norm(poses[:, pairs[0]] - poses[:, pairs[1]], axis=2))


class _ClipDistance:
    """Distance of windows from a clip, in poses and in body shape."""

    def __init__(self, positions: Array, options: Li2020Options) -> None:
        valid = ~np.isnan(positions[..., 0])
        seen = valid.mean(axis=0)
        self.markers = np.flatnonzero(seen >= MIN_VISIBLE_RATIO * seen.max())
        frames = np.flatnonzero(valid[:, self.markers].all(axis=1))
        if len(frames) == 0:  # no frame shows all of them: use those of one frame
            fullest = int(valid.sum(axis=1).argmax())
            self.markers, frames = np.flatnonzero(valid[fullest]), np.array([fullest])
        poses = positions[frames[evenly_spaced(len(frames), MAX_SAMPLE_POSES)]][:, self.markers]
        self._poses = _shape(poses)
        self._norms = (self._poses**2).sum(axis=1)
        self._shape_weight = options.body_shape_weight
        pairs = np.triu_indices(len(self.markers), 1)
        lengths = _distances(poses, pairs)
        rigid = np.argsort(lengths.std(axis=0), kind="stable")[
            : PAIRS_PER_MARKER * len(self.markers)
        ]
        self._pairs = (pairs[0][rigid], pairs[1][rigid])
        self._lengths = lengths.mean(axis=0)[rigid]

    def _rigid_lengths(self, poses: Array) -> Array:
        """Return the mean rigid distances of other poses (mm)."""
        sample = poses[evenly_spaced(len(poses), MAX_SAMPLE_POSES)]
        lengths: Array = _distances(sample, self._pairs).mean(axis=0)
        return lengths

    def shape_difference(self, poses: Array) -> float:
        """Return the median difference of rigid distances from the clip's (mm)."""
        if len(self._lengths) == 0:
            return 0.0
        return float(np.median(abs(self._rigid_lengths(poses) - self._lengths)))

    def scale(self, poses: Array) -> float:
        """Return the size of the clip's subject relative to that of other poses."""
        lengths = self._rigid_lengths(poses)
        known = lengths > 0.0
        return float(np.median(self._lengths[known] / lengths[known])) if known.any() else 1.0

    def poses(self, poses: Array) -> Array:
        """Return the distance of each pose from the clip's nearest one (mm, rms over markers)."""
        rows = _shape(poses)
        squares = (rows**2).sum(axis=1)[:, None] + self._norms - 2.0 * rows @ self._poses.T
        nearest: Array = np.sqrt(np.maximum(squares.min(axis=1), 0.0) / len(self.markers))
        return nearest

    def combined(self, shape_difference: float, poses: Array) -> float:
        """Return the distance of a window from the clip (mm), by the distances of its poses."""
        return math.hypot(float(poses.mean()), self._shape_weight * shape_difference)


@dataclass(frozen=True, order=True)
class _Candidate:
    """A window of a take; candidates are ordered by their distance from the clip."""

    distance: float  # mm
    take: int  # number of the take
    index: int  # number of the window in the take
    begin: float  # s
    end: float  # s
    scale: float  # of the clip's subject, relative to the take's


def _candidates(
    number: int,
    take: Take,
    markers: NDArray[np.intp],
    seconds: float,
    distance_from_clip: _ClipDistance,
    *,
    scaled: bool,
) -> list[_Candidate]:
    """Return the windows of a take, of some length, with enough complete frames.

    They are compared with the clip at the take's coarsest resolution.
    """
    poses = np.asarray(take.positions(len(take.rates) - 1, markers), dtype=np.float64)
    complete = ~np.isnan(poses[..., 0]).any(axis=1)
    if complete.sum() < min(MIN_FRAMES, len(poses)) or not complete.any():
        return []
    compared = poses[:, distance_from_clip.markers]
    scale = distance_from_clip.scale(compared[complete]) if scaled else 1.0
    compared = compared * scale
    shape_difference = distance_from_clip.shape_difference(compared[complete])
    apart = np.full(len(poses), np.nan)
    apart[complete] = distance_from_clip.poses(compared[complete])
    rate = take.rates[-1]
    length = max(round(seconds * rate), MIN_FRAMES)
    found = []
    for index, start in enumerate(range(0, len(poses), length)):
        inside = apart[start : start + length]
        inside = inside[~np.isnan(inside)]
        if len(inside) >= MIN_FRAMES or (index == 0 and len(inside)):
            distance = distance_from_clip.combined(shape_difference, inside)
            begin = start / rate
            end = begin + length / rate
            found.append(_Candidate(distance, number, index, begin, end, scale))
    return found


def choose_windows(
    positions: Array,
    rate: float,
    takes: Sequence[Take],
    markers: NDArray[np.intp],
    options: Li2020Options,
) -> list[TrainingWindow]:
    """Choose the windows of takes that are most similar to a clip.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The clip's ``markers``; NaN where missing.
    rate : float
        Rate of the clip (Hz).
    takes : sequence of Take
        The database.
    markers : ndarray of int
        The clip's markers that a window must show.
    options : Li2020Options
        Number of windows, weight of the body shape, and whether windows are scaled.

    Returns
    -------
    list of TrainingWindow
        At their finest resolution, the most similar first; none is longer than the clip.

    See Also
    --------
    priorfill.methods.li2020.pca_train : Fills a clip by them.
    """
    if not takes or np.isnan(positions[..., 0]).all():
        return []
    distance_from_clip = _ClipDistance(positions, options)
    seconds = len(positions) / rate
    ranked = sorted(
        candidate
        for number, take in enumerate(takes)
        if shows_all(take, markers)
        for candidate in _candidates(
            number, take, markers, seconds, distance_from_clip, scaled=options.scale_sources
        )
    )
    windows = []
    for candidate in ranked[: options.max_windows]:
        take = takes[candidate.take]
        first, last = (round(time * take.rates[0]) for time in (candidate.begin, candidate.end))
        found = np.asarray(take.positions(0, markers), dtype=np.float64)[first:last]
        windows.append(TrainingWindow(take.name, found * candidate.scale, take.rates[0]))
    return windows
