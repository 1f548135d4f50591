"""The path of one marker, cut into segments and described by distances from its references."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.reference_markers import distances
from priorfill.gaps import runs
from priorfill.geometry.distances import norms
from priorfill.runtime.option_checks import check_at_least

__all__ = [
    "MarkerPath",
    "OutlierRunOptions",
    "PathSegment",
    "SuspectSpan",
    "TypicalDistances",
    "cut_path",
    "known_medians",
    "known_quantiles",
    "medians_of_parts",
    "thinned",
    "thinned_frames",
]

MAX_MEDIAN_FRAMES = 500
"""Frames, evenly spaced, over which a median is taken."""

MAX_SINGLE_PARTS = 16
"""Parts of an array whose medians are found one after the other; more are sorted at once."""

STD_PER_MAD = 1.4826
"""Standard deviation divided by median absolute deviation, for normal errors."""


@dataclass(frozen=True)
class OutlierRunOptions:
    """When a segment of a marker's path counts as an outlier run.

    Deviations of a distance are measured in standard deviations of that distance.

    Attributes
    ----------
    max_spike_seconds : float
        s. A segment between breaks that is no longer than this is a spike: no part of a body goes
        anywhere for so short a time.
    min_long_break : float
        mm. Least size of a break at the end of a longer segment. Smaller ones also occur when some
        cameras lose the marker, which shifts its position by a centimetre or two.
    min_spread : float
        mm. Least standard deviation assumed for a distance: noise and soft tissue cause as much.
    min_deviation : float
        Deviation of a distance in a longer segment that begins or ends at a break.
    min_gap_deviation, min_gap_distance : float
        Deviation, and its size in mm, in a segment between gaps: there the posture may have
        changed meanwhile.
    min_main_seconds : float
        s. Length of the main segment needed to assess a segment between gaps, because shorter ones
        do not show how much distances vary.
    min_kink : float
        mm. Least distance by which the straight lines leading to a spike of one frame miss it,
        relative to the reference markers. No hit turns a path by ``min_long_break`` within a frame.
    min_spike_deviation : float
        Deviation of a distance in a spike after which the path does not continue where it was, as
        for the hand of a boxer. It must also exceed the deviation in the frames before and after by
        this factor.
    wrong_side_ratio : float
        Deviation on the wrong side of a break, relative to the other side.
    min_references : int
        Reference markers that must agree, if that many are visible: one may itself be affected.
    max_rigid_spread : float
        mm. Distances with a smaller standard deviation are within one bone or bar, and show exactly
        where an artefact begins and ends.
    main_candidates : int
        Number of longest segments considered as the main segment.
    min_evidence_deviation : float
        Deviation of a distance that is given as evidence.
    """

    max_spike_seconds: float = 0.1
    min_long_break: float = 25.0
    min_spread: float = 4.0
    min_deviation: float = 3.0
    min_gap_deviation: float = 6.0
    min_gap_distance: float = 40.0
    min_main_seconds: float = 1.0
    min_kink: float = 8.0
    min_spike_deviation: float = 4.0
    wrong_side_ratio: float = 1.5
    min_references: int = 2
    max_rigid_spread: float = 2.0
    main_candidates: int = 4
    min_evidence_deviation: float = 2.0

    def __post_init__(self) -> None:
        check_at_least(self, 1e-3, "min_spread")
        check_at_least(self, 1, "min_references", "main_candidates")
        check_at_least(self, 0.0, "max_spike_seconds", "min_long_break", "wrong_side_ratio")


@dataclass(frozen=True)
class PathSegment:
    """Frames ``start <= frame < stop`` of a path, between breaks or gaps.

    Attributes
    ----------
    start, stop : int
        Frames.
    break_before, break_after : float
        mm. Size of the break at either end; 0 where a gap or the clip ends the segment.
    """

    start: int
    stop: int
    break_before: float
    break_after: float

    @property
    def frames(self) -> int:
        """Length in frames."""
        return self.stop - self.start

    @property
    def broken(self) -> bool:
        """Whether a break is at one of its ends."""
        return self.break_before > 0 or self.break_after > 0


@dataclass(frozen=True, order=True)
class SuspectSpan:
    """Frames ``start <= frame < stop`` that are not the marker; ``spike`` if only briefly so."""

    start: int
    stop: int
    spike: bool


@dataclass(frozen=True, eq=False)
class TypicalDistances:
    """Median and robust standard deviation of each distance [shape=(references,), mm]."""

    median: NDArray[np.float64]
    spread: NDArray[np.float64]

    @classmethod
    def of(cls, distance: NDArray[np.float64], min_spread: float) -> TypicalDistances:
        """Measure distances [shape=(frames, references), mm]; NaN where missing."""
        sample = thinned_frames(distance)
        median = known_medians(sample)
        spread = STD_PER_MAD * known_medians(np.abs(sample - median))
        return cls(median, np.fmax(min_spread, spread))


@dataclass(frozen=True, eq=False)
class MarkerPath:
    """The path of one marker, and its distances from its reference markers.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Of the clip; NaN where missing.
    marker : int
        The marker.
    references : ndarray of int [shape=(references,)]
        Its reference markers.
    rate : float
        Hz.
    options : OutlierRunOptions
    """

    positions: NDArray[np.float64]
    marker: int
    references: NDArray[np.intp]
    rate: float
    options: OutlierRunOptions

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        """Distances from the reference markers [shape=(frames, references), mm]."""
        return distances(self.positions, self.marker, self.references)

    def distances_in(self, frames: NDArray[np.intp] | slice) -> NDArray[np.float64]:
        """Return the distances in some frames only [shape=(frames, references), mm]."""
        if "distance" in self.__dict__:
            return self.distance[frames]
        columns = [self.marker, *self.references.tolist()]
        some = [self.positions[frames, column] for column in columns]
        found = np.empty((len(some[0]), len(self.references)))
        for column, other in enumerate(some[1:]):
            found[:, column] = norms(other - some[0])
        return found

    @property
    def spike_frames(self) -> int:
        """Longest spike in frames."""
        return max(1, round(self.options.max_spike_seconds * self.rate))

    def relative(self, frames: NDArray[np.intp] | slice) -> NDArray[np.float64]:
        """Return the path in some frames relative to the references' mean [shape=(frames, 3), mm].

        Only references that are measured in all of these frames are used; without any the path is
        returned as it is.
        """
        part = self.positions[frames]
        seen = self.references[np.isfinite(part[:, self.references]).all(axis=(0, 2))]
        path: NDArray[np.float64] = part[:, self.marker]
        return path - part[:, seen].mean(axis=1) if len(seen) else path


def cut_path(seen: NDArray[np.bool_], size: NDArray[np.float64]) -> list[PathSegment]:
    """Cut a path where it breaks and where the marker is missing.

    Parameters
    ----------
    seen : ndarray of bool [shape=(frames,)]
        Where the marker is measured.
    size : ndarray [shape=(frames - 1,), mm]
        Sizes of the breaks; 0 where there is none.
    """
    segments = []
    broken = np.flatnonzero(size)
    for start, stop in runs(seen):
        first, last = np.searchsorted(broken, (start, stop - 1)) if len(broken) else (0, 0)
        breaks = broken[first:last]
        cuts = [start, *(breaks + 1).tolist(), stop]
        sizes = [0.0, *size[breaks].tolist(), 0.0]
        segments += [
            PathSegment(a, b, sizes[i], sizes[i + 1]) for i, (a, b) in enumerate(pairwise(cuts))
        ]
    return segments


def thinned_frames(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return evenly spaced frames of distances [shape=(frames, references), mm].

    More than `MAX_MEDIAN_FRAMES` do not improve a median.
    """
    return distance[:: max(1, -(-len(distance) // MAX_MEDIAN_FRAMES))]


def thinned(start: int, stop: int) -> NDArray[np.intp]:
    """Return the frames that `thinned_frames` takes of a part of a clip."""
    return np.arange(start, stop, max(1, -(-(stop - start) // MAX_MEDIAN_FRAMES)))


def known_medians(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median of each column's known values; NaN where there is none."""
    if not len(values):
        return np.full(values.shape[1], np.nan)
    ordered = np.sort(values, axis=0)  # NaN last
    count = (~np.isnan(ordered)).sum(axis=0)
    column = np.arange(values.shape[1])
    low = ordered[np.maximum(count - 1, 0) // 2, column]
    high = ordered[np.minimum(count // 2, len(values) - 1), column]
    return np.where(count > 0, 0.5 * (low + high), np.nan)


def medians_of_parts(values: NDArray[np.float64], lengths: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the medians of each column's known values in consecutive parts of an array.

    Parameters
    ----------
    values : ndarray [shape=(rows, columns)]
        NaN where unknown.
    lengths : ndarray of int [shape=(parts,)]
        Rows of each part, at least 1.

    Returns
    -------
    ndarray [shape=(parts, columns)]
        As `known_medians` gives them.
    """
    start = np.cumsum(lengths) - lengths
    if len(lengths) <= MAX_SINGLE_PARTS:
        parts = np.split(values, start[1:])
        return np.array([known_medians(part) for part in parts]).reshape(-1, values.shape[1])
    number = np.repeat(np.arange(len(lengths)), lengths)
    count = np.add.reduceat(~np.isnan(values), start, axis=0, dtype=np.intp)
    medians = np.empty(count.shape)
    for column in range(values.shape[1]):
        ordered = values[np.lexsort((values[:, column], number)), column]  # NaN last in each part
        low = ordered[start + np.maximum(count[:, column] - 1, 0) // 2]
        high = ordered[start + np.minimum(count[:, column] // 2, lengths - 1)]
        medians[:, column] = 0.5 * (low + high)
    return np.where(count > 0, medians, np.nan)


def known_quantiles(values: NDArray[np.float64], quantile: float) -> NDArray[np.float64]:
    """Return a quantile over the first axis of the known values; NaN where there is none."""
    ordered = np.sort(values, axis=0)  # NaN last
    count = (~np.isnan(ordered)).sum(axis=0)
    rank = (quantile * np.maximum(count - 1, 0)).astype(np.intp)
    found: NDArray[np.float64] = np.take_along_axis(ordered, rank[None], axis=0)[0]
    return found
