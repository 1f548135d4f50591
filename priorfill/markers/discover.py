"""Find segments, reliable markers and mirror pairs of an unknown marker set from the data."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import PairStatistics, pair_statistics
from priorfill.geometry.neighbourhoods import MAX_DENSE_MARKERS, neighbourhoods
from priorfill.geometry.rigid_groups import MIN_COMMON, rigid_groups
from priorfill.markers.marker_set import DISCOVERED, MarkerSet

__all__ = ["discover"]

MIN_SEGMENT_MARKERS = 3
"""Markers that a segment needs to be rigid or a root: the smallest frame of reference."""

MAX_RIGID_SPREAD = 5.0
"""mm. Rms standard deviation of a rigidly placed marker's distances from the other markers of its
segment. Half of the pairs on one known segment have less in real recordings."""

MIN_RELIABLE_MARKERS = 6
"""If fewer markers are reliable by the data, all that are mostly visible count as reliable;
otherwise the search would ignore most of the body's posture."""

HALF_SCORE_DISTANCE = 0.5
"""Distance of a segment from the centre of the body, relative to the mean of all markers, at which
its score as a root halves. Pelvis and thorax are nearer, head and limbs farther away."""

MIN_VISIBLE_SHARE = 0.5
"""Fraction of the frames in which a reliable marker must be visible."""

MAX_SCORED_MARKERS = 4
"""Markers of a segment up to which its size adds to its score as a root."""


def discover(
    positions: NDArray[np.floating], labels: Sequence[str], pairs: PairStatistics | None = None
) -> MarkerSet:
    """Find a marker set from the data alone.

    Segments are groups of markers whose mutual distances hardly vary (`rigid_groups`). A marker is
    reliable if it is visible in most frames and rigidly placed (`MAX_RIGID_SPREAD`) on a segment
    with at least `MIN_SEGMENT_MARKERS` markers. If that applies to fewer than
    `MIN_RELIABLE_MARKERS`, all markers visible in most frames are reliable. Root segments have at
    least `MIN_SEGMENT_MARKERS` markers and are ordered by how often they are complete and by how
    large, rigid and central they are. Mirror pairs follow from the labels, if at least half of
    them come in pairs of left and right.

    More than `MAX_DENSE_MARKERS` markers are divided into neighbourhoods first.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    labels : sequence of str
        Unique labels, one per marker.
    pairs : PairStatistics, optional
        Statistics of the distances of these markers; computed if not given.

    Returns
    -------
    MarkerSet
        With the name `DISCOVERED` and segments ``segment01``, ``segment02``, ... in the order of
        their first markers.

    See Also
    --------
    describe : Uses a definition if there is one.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> shape = np.array([[0, 0, 0], [100, 0, 0], [0, 80, 0], [0, 0, 60.0]])
    >>> positions = rng.normal(0.0, 200.0, (50, 1, 3)) + shape  # four markers on one bone
    >>> discover(positions, ("A", "B", "C", "D")).segments
    {'segment01': ('A', 'B', 'C', 'D')}
    """
    if pairs is None and len(labels) > MAX_DENSE_MARKERS:
        return _discover_in_parts(positions, labels)
    spread = (pairs or pair_statistics(positions)).of_common(MIN_COMMON)[1]
    groups = rigid_groups(spread)
    names = [f"segment{i + 1:02d}" for i in range(len(groups))]
    segment = {labels[m]: name for name, group in zip(names, groups, strict=True) for m in group}

    seen = ~np.isnan(positions[:, :, 0])
    visible = np.zeros(len(labels), dtype=bool)
    if len(seen):
        visible = seen.mean(axis=0) >= MIN_VISIBLE_SHARE
    rigid = np.zeros(len(labels), dtype=bool)
    for group in groups:
        if len(group) >= MIN_SEGMENT_MARKERS:
            inner = spread[np.ix_(group, group)]
            rms_spread = np.sqrt((inner**2).sum(axis=1) / (len(group) - 1))
            rigid[group] = rms_spread <= MAX_RIGID_SPREAD
    reliable = rigid & visible
    if reliable.sum() < MIN_RELIABLE_MARKERS:
        reliable = visible

    order = sorted(range(len(groups)), key=_root_score(positions, spread, groups), reverse=True)
    roots = [i for i in order if len(groups[i]) >= MIN_SEGMENT_MARKERS]
    return MarkerSet(
        name=DISCOVERED,
        labels=tuple(labels),
        segment={label: segment[label] for label in labels},
        reliable={label: bool(reliable[m]) for m, label in enumerate(labels)},
        mirror=_mirror_by_names(labels),
        root_segments=tuple(names[i] for i in roots or order),
        title="found from the data",
    )


def _discover_in_parts(positions: NDArray[np.floating], labels: Sequence[str]) -> MarkerSet:
    """Find a marker set neighbourhood by neighbourhood."""
    parts = [
        discover(positions[:, group], [labels[marker] for marker in group])
        for group in neighbourhoods(positions)
    ]
    order = {label: place for place, label in enumerate(labels)}
    groups = sorted(
        (
            (order[markers[0]], part, name)
            for part, found in enumerate(parts)
            for name, markers in found.segments.items()
        )
    )
    name_of = {(part, name): f"segment{i + 1:02d}" for i, (_, part, name) in enumerate(groups)}
    segment: dict[str, str] = {}
    reliable: dict[str, bool] = {}
    for number, part in enumerate(parts):
        segment |= {label: name_of[number, name] for label, name in part.segment.items()}
        reliable |= part.reliable
    return MarkerSet(
        name=DISCOVERED,
        labels=tuple(labels),
        segment={label: segment[label] for label in labels},
        reliable={label: reliable[label] for label in labels},
        mirror=_mirror_by_names(labels),
        root_segments=tuple(
            name_of[number, name]
            for number, part in enumerate(parts)
            for name in part.root_segments
        ),
        title="found from the data",
    )


def _root_score(
    positions: NDArray[np.floating], spread: NDArray[np.float64], groups: list[list[int]]
) -> Callable[[int], float]:
    """Return the sort key of ``groups``: how well each one is suited to define the root frame.

    The score is a product, so that a group that fails in one respect does not come first: the
    fraction of frames in which the group is complete, its size, how rigid and how central it is.
    Half of the score is lost at a spread of `MAX_RIGID_SPREAD`, and half at a distance of
    `HALF_SCORE_DISTANCE`; the square in the latter ranks limbs below the trunk.
    """
    seen = ~np.isnan(positions[:, :, 0])
    step = max(1, positions.shape[0] // 100)
    data = np.asarray(positions[::step], dtype=np.float64)
    known = ~np.isnan(data[:, :, :1])
    filled = np.where(known, data, 0.0)
    centre = filled.sum(axis=1, keepdims=True) / np.maximum(known.sum(axis=1, keepdims=True), 1)
    distance = np.where(known[:, :, 0], np.linalg.norm(filled - centre, axis=2), 0.0)
    distance = distance.sum(axis=0) / np.maximum(known[:, :, 0].sum(axis=0), 1)
    mean_distance = max(float(distance.mean()), 1e-9)

    def score(i: int) -> float:
        group = groups[i]
        complete = float(seen[:, group].all(axis=1).mean()) if len(seen) else 0.0
        size = min(len(group), MAX_SCORED_MARKERS) / MAX_SCORED_MARKERS
        max_spread = float(spread[np.ix_(group, group)].max()) if len(group) > 1 else np.inf
        off_centre = float(distance[group].mean()) / mean_distance
        rigidity = 1 / (1 + max_spread / MAX_RIGID_SPREAD)
        return complete * size * rigidity / (1 + (off_centre / HALF_SCORE_DISTANCE) ** 2)

    return score


def _mirror_by_names(labels: Sequence[str]) -> dict[str, str]:
    """Return mirror pairs by the labels: L and R, l and r, left and right.

    If at least half of the labels come in pairs, the others are midline markers, except those named
    as of one side. Otherwise nothing is returned.
    """
    present = set(labels)
    pairs: dict[str, str] = {}
    one_sided: set[str] = set()
    for label in labels:
        others = _other_side(label)
        if others:
            one_sided.add(label)
        for other in others:
            if other in present:
                pairs[label] = other
    if 2 * len(pairs) < len(labels):
        return {}
    return {
        label: pairs.get(label, label)
        for label in labels
        if label in pairs or label not in one_sided
    }


def _other_side(label: str) -> list[str]:
    """Return possible labels of the contralateral marker."""
    swap = {"L": "R", "R": "L", "l": "r", "r": "l"}
    words = {"left": "right", "Left": "Right", "LEFT": "RIGHT"}
    words |= {right: left for left, right in words.items()}
    others = [label.replace(a, b) for a, b in words.items() if a in label]
    if label[:1] in swap:
        others.append(swap[label[0]] + label[1:])
    if len(label) > 2 and label[-2] in "_.- " and label[-1] in swap:
        others.append(label[:-1] + swap[label[-1]])
    return others
