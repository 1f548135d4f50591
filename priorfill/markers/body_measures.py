"""Body measures: whether two recordings show the same subject, by distances between markers.

Distances between markers that move as one are the measures of a body: lengths of thigh and shank,
widths of head and pelvis. Within one session they agree to a few millimetres. Markers that are
attached anew differ by one or two centimetres each, whatever their distance, while the long
distances of two people differ by more.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.markers.marker_set import MarkerSet, same_markers

__all__ = [
    "MAX_DIFFERENCE",
    "BodyComparison",
    "body_measures",
    "compare_bodies",
    "compare_measures",
]

MAX_DIFFERENCE = 14.0
"""mm. Largest median difference of the measures of one subject. In 25 gait, 10 CMU and 3 HDM05
takes it is at most 4.3 mm within a session (17 pairs). With all markers attached anew 10 to 20 mm
away it is at most 14 mm in 33 of 34 pairs, and 14.5 mm in one. Between two subjects it is above
14 mm in 95 % of 331 pairs, with a median of 30 mm."""

MIN_DISTANCE, MAX_DISTANCE = 150.0, 500.0
"""mm. Shorter distances differ little between people; longer ones are rarely of one segment."""

MAX_SPREAD = 10.0
"""mm. Largest standard deviation of a measure in either recording."""

MAX_POSES = 60
"""Poses, evenly spaced, in which distances are measured."""

MIN_MEASURES = 6
"""Measures needed for a decision."""

MAX_CONSTANT_SHARE = 0.6
"""Share of constant distances above which a body is taken as standing still. Where both do, only
distances within the segments of a marker set are compared: the postures may differ."""

MAX_KEPT_MEASURES = 200
"""Measures kept of a recording by `body_measures`; their median differs little from that of all.
"""

MAX_MARKERS = 150
"""Markers compared; the number of distances grows with the square."""


@dataclass(frozen=True)
class BodyComparison:
    """How much the body measures of two recordings differ.

    Attributes
    ----------
    difference : float
        mm. Median absolute difference; NaN where too few measures are known.
    measures : int
        Number of distances compared.
    """

    difference: float
    measures: int

    @property
    def differs(self) -> bool:
        """Whether the measures are those of different subjects, or of different marker sets."""
        return self.difference > MAX_DIFFERENCE


def compare_bodies(
    one: tuple[NDArray[np.float64], Sequence[str]],
    other: tuple[NDArray[np.float64], Sequence[str]],
    marker_set: MarkerSet | None = None,
) -> BodyComparison:
    """Compare the body measures of two recordings.

    Parameters
    ----------
    one, other : tuple of ndarray and sequence of str
        Positions [shape=(frames, markers, 3), mm], NaN where missing, and labels.
    marker_set : MarkerSet, optional
        Definition with other spellings of labels, and with segments.

    Returns
    -------
    BodyComparison

    Examples
    --------
    >>> positions = np.zeros((10, 4, 3))
    >>> positions[:, 1:, 0] = [200.0, 400.0, 600.0]
    >>> labels = ("A", "B", "C", "D")
    >>> compare_bodies((positions, labels), (positions, labels)).measures
    0
    """
    here, there = same_markers(one[1], other[1], marker_set)
    keep = np.linspace(0, len(here) - 1, min(len(here), MAX_MARKERS)).astype(np.intp)
    here, there = ([indices[i] for i in keep] for indices in (here, there))
    first, second = np.triu_indices(len(here), 1)
    mean, spread = _measure(one[0], here, first, second)
    mean_there, spread_there = _measure(other[0], there, first, second)
    constant, constant_there = spread < MAX_SPREAD, spread_there < MAX_SPREAD
    known = ~np.isnan(spread) & ~np.isnan(spread_there)
    usable = known & constant & constant_there
    if min(_share(constant, known), _share(constant_there, known)) > MAX_CONSTANT_SHARE:
        usable &= _same_segment([one[1][i] for i in here], marker_set)[first, second]
    shorter, longer = np.minimum(mean, mean_there), np.maximum(mean, mean_there)
    with np.errstate(invalid="ignore"):
        usable &= (longer > MIN_DISTANCE) & (shorter < MAX_DISTANCE)
    count = int(usable.sum())
    if count < MIN_MEASURES:
        return BodyComparison(float("nan"), count)
    return BodyComparison(float(np.median(longer[usable] - shorter[usable])), count)


def body_measures(positions: NDArray[np.float64], labels: Sequence[str]) -> dict[str, float]:
    r"""Return the body measures of one recording, to be compared with others later.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    labels : sequence of str
        The markers.

    Returns
    -------
    dict of str to float
        Distances (mm) by their two labels, in alphabetical order and with a line break between
        them. Of many, those are kept whose names have the lowest checksums, which are mostly the
        same ones in each recording.

    Examples
    --------
    >>> positions = np.zeros((10, 2, 3))
    >>> positions[:, 1, 0] = 200.0
    >>> body_measures(positions, ("B", "A"))
    {'A\nB': 200.0}
    """
    keep = np.linspace(0, len(labels) - 1, min(len(labels), MAX_MARKERS)).astype(np.intp)
    first, second = np.triu_indices(len(keep), 1)
    mean, spread = _measure(positions, keep.tolist(), first, second)
    with np.errstate(invalid="ignore"):
        usable = (spread < MAX_SPREAD) & (mean > MIN_DISTANCE) & (mean < MAX_DISTANCE)
    names = [
        "\n".join(sorted((labels[keep[first[pair]]], labels[keep[second[pair]]])))
        for pair in np.flatnonzero(usable)
    ]
    found = dict(zip(names, mean[usable].tolist(), strict=True))
    kept = sorted(found, key=lambda name: (zlib.crc32(name.encode()), name))[:MAX_KEPT_MEASURES]
    return {name: round(found[name], 1) for name in kept}


def compare_measures(one: Mapping[str, float], other: Mapping[str, float]) -> BodyComparison:
    r"""Compare measures that `body_measures` returned.

    Parameters
    ----------
    one, other : mapping of str to float
        Of two recordings.

    Examples
    --------
    >>> compare_measures({"A\nB": 200.0}, {"A\nB": 210.0}).measures
    1
    """
    common = [abs(one[name] - other[name]) for name in sorted(one.keys() & other.keys())]
    if len(common) < MIN_MEASURES:
        return BodyComparison(float("nan"), len(common))
    return BodyComparison(float(np.median(common)), len(common))


def _share(constant: NDArray[np.bool_], known: NDArray[np.bool_]) -> float:
    """Return which share of the known distances is constant."""
    return float((constant & known).sum() / max(int(known.sum()), 1))


def _measure(
    positions: NDArray[np.float64],
    markers: Sequence[int],
    first: NDArray[np.intp],
    second: NDArray[np.intp],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and standard deviation of distances [shape=(pairs,), mm]; NaN where unknown."""
    seen = np.flatnonzero(~np.isnan(positions[:, markers, 0]).all(axis=1))
    poses = seen[np.linspace(0, len(seen) - 1, min(len(seen), MAX_POSES)).astype(np.intp)]
    part = positions[poses][:, markers]
    count = np.zeros(len(first))
    total, square = np.zeros(len(first)), np.zeros(len(first))
    for pose in part:
        distance = np.sqrt(((pose[first] - pose[second]) ** 2).sum(axis=1))
        known = ~np.isnan(distance)
        count += known
        total += np.where(known, distance, 0.0)
        square += np.where(known, distance, 0.0) ** 2
    enough = count > 0
    divisor = np.maximum(count, 1)
    mean = total / divisor
    spread = np.sqrt(np.maximum(square / divisor - mean**2, 0.0))
    return np.where(enough, mean, np.nan), np.where(enough, spread, np.nan)


def _same_segment(labels: Sequence[str], marker_set: MarkerSet | None) -> NDArray[np.bool_]:
    """Return which markers the marker set has on one segment [shape=(markers, markers)]."""
    match = {} if marker_set is None else marker_set.match(labels)
    segment = np.array(
        [
            marker_set.segment[match[label]] if marker_set is not None and label in match else ""
            for label in labels
        ]
    )
    same: NDArray[np.bool_] = (segment[:, None] == segment[None]) & (segment[:, None] != "")
    return same
