"""Find segments, reliable markers and mirror pairs of an unknown marker set from the data."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import PairStatistics, pair_statistics
from priorfill.geometry.rigid_groups import MIN_COMMON, rigid_groups
from priorfill.markers.marker_set import (
    DISCOVERED,
    MarkerSet,
)

__all__ = ["discover"]

MIN_COMPANIONS = 2
"""Other markers that a segment needs for a marker's place on it to be known; three markers
also make the smallest frame of reference."""


FIRM = 5.0
"""mm. A marker sits firmly if its distances to the other markers of its segment vary by no more
than this (root mean square). Half of the pairs of one known segment do so in real takes."""


MIN_RELIABLE = 6
"""Where fewer markers than this are reliable by the data, all that are mostly seen count: with
fewer, most of the body's posture would have no say in the search."""


CENTRAL = 0.5
"""Distance of a segment from the body's middle, relative to the markers' mean distance, at which
it loses half its credit as a root: pelvis and thorax are nearer, head and limbs farther off."""


MOSTLY_SEEN = 0.5
"""Share of the frames in which a marker must be seen to count as reliable."""


def discover(
    positions: NDArray[np.floating], labels: Sequence[str], pairs: PairStatistics | None = None
) -> MarkerSet:
    """Return a marker set found from the data alone.

    Segments are groups of markers whose mutual distances hardly vary (`rigid_groups`). A marker
    is reliable if it is mostly seen and sits firmly (`FIRM`) on a segment with at least
    `MIN_COMPANIONS` others; if that leaves fewer than `MIN_RELIABLE`, every marker that is
    mostly seen is. Root segments have three markers or more and come in order of how often
    they are whole, how large, rigid and central they are. Mirror images are told by the names, if
    at least half of the labels come in pairs of a left and a right one.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    labels : sequence of str
        One for each marker, unique.
    pairs : PairStatistics, optional
        Of the distances of these markers; computed if not given.

    Returns
    -------
    MarkerSet
        With the name `DISCOVERED` and segments ``segment01``, ``segment02``, ... in the order
        of their first markers.
    """
    spread = (pairs or pair_statistics(positions)).of_common(MIN_COMMON)[1]
    groups = rigid_groups(spread)
    names = [f"segment{i + 1:02d}" for i in range(len(groups))]
    segment = {labels[m]: name for name, group in zip(names, groups, strict=True) for m in group}

    seen = ~np.isnan(positions[:, :, 0])
    mostly_seen = seen.mean(axis=0) >= MOSTLY_SEEN if len(seen) else np.zeros(len(labels), bool)
    firm = np.zeros(len(labels), dtype=bool)
    for group in groups:
        if len(group) > MIN_COMPANIONS:
            inner = spread[np.ix_(group, group)]
            firm[group] = np.sqrt((inner**2).sum(axis=1) / (len(group) - 1)) <= FIRM
    reliable = firm & mostly_seen
    if reliable.sum() < MIN_RELIABLE:
        reliable = mostly_seen

    order = sorted(range(len(groups)), key=_root_fitness(positions, spread, groups), reverse=True)
    frames = [i for i in order if len(groups[i]) > MIN_COMPANIONS]
    return MarkerSet(
        name=DISCOVERED,
        labels=tuple(labels),
        segment={label: segment[label] for label in labels},
        reliable={label: bool(reliable[m]) for m, label in enumerate(labels)},
        mirror=_mirror_by_names(labels),
        root_segments=tuple(names[i] for i in frames or order),
        title="found from the data",
    )


def _root_fitness(
    positions: NDArray[np.floating], spread: NDArray[np.float64], groups: list[list[int]]
) -> Callable[[int], float]:
    """Return the sort key of `groups`: how fit each is to carry the root frame.

    A product, so that a group which fails in one respect does not come first: the share of
    frames in which it is whole, its size (up to 4 markers; more add nothing), how rigid and how
    central it is. Half the credit is lost at a spread of `FIRM`, and at `CENTRAL` times the
    markers' mean distance from the body's middle; the square keeps limbs behind the trunk.
    """
    seen = ~np.isnan(positions[:, :, 0])
    step = max(1, positions.shape[0] // 100)
    data = np.asarray(positions[::step], dtype=np.float64)
    known = ~np.isnan(data[:, :, :1])
    filled = np.where(known, data, 0.0)
    middle = filled.sum(axis=1, keepdims=True) / np.maximum(known.sum(axis=1, keepdims=True), 1)
    distance = np.where(known[:, :, 0], np.linalg.norm(filled - middle, axis=2), 0.0)
    distance = distance.sum(axis=0) / np.maximum(known[:, :, 0].sum(axis=0), 1)
    body = max(float(distance.mean()), 1e-9)

    def fitness(i: int) -> float:
        group = groups[i]
        whole = float(seen[:, group].all(axis=1).mean()) if len(seen) else 0.0
        size = min(len(group), 4) / 4
        loose = float(spread[np.ix_(group, group)].max()) if len(group) > 1 else np.inf
        off = float(distance[group].mean()) / body
        return whole * size / (1 + loose / FIRM) / (1 + (off / CENTRAL) ** 2)

    return fitness


def _mirror_by_names(labels: Sequence[str]) -> dict[str, str]:
    """Return mirror pairs told by L and R, l and r, left and right; else nothing.

    If half of the labels come in pairs, the others are taken for markers in the middle,
    except those that are named as of one side.
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
    """Return what the mirror image of a marker could be called."""
    swap = {"L": "R", "R": "L", "l": "r", "r": "l"}
    words = {"left": "right", "Left": "Right", "LEFT": "RIGHT"}
    words |= {right: left for left, right in words.items()}
    others = [label.replace(a, b) for a, b in words.items() if a in label]
    if label[:1] in swap:
        others.append(swap[label[0]] + label[1:])
    if len(label) > 2 and label[-2] in "_.- " and label[-1] in swap:
        others.append(label[:-1] + swap[label[-1]])
    return others
