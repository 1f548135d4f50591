"""Sets of visible markers, and which of them share a regression.

While markers are missing, others appear and disappear. Frames with the same visible markers are a
*visible set*. A regression for several sets uses the markers that all of them have in common, so
sets are merged greedily: each regression costs time, and each merged set loses some markers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gpr.gap_segments import MIN_VISIBLE

__all__ = ["MergingLimits", "VisibleSets", "merge_visible_sets"]

MAX_COMPARED = 128
"""Sets compared with each other at a time, so that time grows linearly with their number."""

MIN_IMPORTANCE = 1e-6
"""Least importance of all visible markers together."""

_Bool = NDArray[np.bool_]
_Float = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VisibleSets:
    """Sets of visible markers, by their number.

    Attributes
    ----------
    visible : ndarray of bool [shape=(sets, markers)]
        The visible markers of each.
    spans : list of tuple of int
        Numbers of the spans of frames that each consists of.
    """

    visible: _Bool
    spans: list[tuple[int, ...]]

    def __len__(self) -> int:
        return len(self.spans)

    @classmethod
    def of(cls, visible: _Bool) -> VisibleSets:
        """Find the sets of spans [shape=(spans, markers)]; equal ones are one set."""
        numbers: dict[bytes, list[int]] = {}
        for span, mask in enumerate(np.packbits(visible, axis=1)):
            numbers.setdefault(mask.tobytes(), []).append(span)
        spans = [tuple(some) for some in numbers.values()]
        return cls(visible[[some[0] for some in spans]], spans)

    def _some(self, chosen: slice) -> VisibleSets:
        return VisibleSets(self.visible[chosen], self.spans[chosen])


@dataclass(frozen=True)
class MergingLimits:
    """When sets of visible markers are merged; see `SegmentOptions` for its attributes."""

    max_share: float
    enough_sets: int
    max_forced_share: float

    def share(self, sets: int) -> float:
        """Return the share of its importance that a set may lose, with this many sets left."""
        return self.max_share if sets <= self.enough_sets else self.max_forced_share


def merge_visible_sets(sets: VisibleSets, weight: _Float, limits: MergingLimits) -> VisibleSets:
    """Merge sets of visible markers where little is lost.

    The two sets that lose the smallest share of their importance are merged first.

    Parameters
    ----------
    sets : VisibleSets
        To be merged.
    weight : ndarray [shape=(markers,)]
        Importance of each visible marker.
    limits : MergingLimits
        The share of its importance that a set may lose.

    Returns
    -------
    VisibleSets
        Two sets are not merged if that would leave too few visible markers.

    Examples
    --------
    >>> import numpy as np
    >>> seen = np.array([[1, 1, 1, 1, 1], [1, 1, 1, 1, 0], [1, 1, 1, 0, 0]], dtype=bool)
    >>> sets = VisibleSets.of(seen)
    >>> weight = np.array([1.0, 1.0, 1.0, 1.0, 0.1])
    >>> merge_visible_sets(sets, weight, MergingLimits(0.1, 8, 0.3)).spans
    [(0, 1), (2,)]
    >>> merge_visible_sets(sets, weight, MergingLimits(0.1, 1, 0.3)).spans
    [(0, 1, 2)]
    """
    while len(sets) > MAX_COMPARED:
        parts = [
            _merge_all(sets._some(slice(start, start + MAX_COMPARED)), weight, limits)
            for start in range(0, len(sets), MAX_COMPARED)
        ]
        merged = VisibleSets(
            np.concatenate([part.visible for part in parts]),
            [spans for part in parts for spans in part.spans],
        )
        if 2 * len(merged) > len(sets):
            return merged
        sets = merged
    return _merge_all(sets, weight, limits)


def _merge_all(sets: VisibleSets, weight: _Float, limits: MergingLimits) -> VisibleSets:
    """Merge sets, and compare each of them with all others."""
    visible, spans = sets.visible.copy(), list(sets.spans)
    importance = np.maximum(visible @ weight, MIN_IMPORTANCE)
    alive = np.ones(len(sets), dtype=bool)
    rank = np.full((len(sets), len(sets)), np.inf)

    def compare(one: int) -> None:
        """Rank the merging of a set with each other one by the greater share that is lost."""
        others = np.flatnonzero(alive)
        both = visible[one] & visible[others]
        common = np.maximum(both @ weight, MIN_IMPORTANCE)
        share = 1.0 - common / np.maximum(importance[one], importance[others])
        most = np.maximum(visible[one].sum(), visible[others].sum(axis=1))
        share[(both.sum(axis=1) < MIN_VISIBLE) & (most >= MIN_VISIBLE)] = np.inf
        share[others == one] = np.inf
        rank[one, others] = rank[others, one] = share

    for one in range(len(sets)):
        compare(one)
    while True:
        one, other = (int(i) for i in np.unravel_index(np.argmin(rank), rank.shape))
        if not rank[one, other] <= limits.share(int(alive.sum())):
            break
        visible[one] &= visible[other]
        importance[one] = max(importance[one], importance[other])  # a chain loses no more
        spans[one] = (*spans[one], *spans[other])
        alive[other] = False
        rank[other] = rank[:, other] = np.inf
        compare(one)
    kept = np.flatnonzero(alive)
    return VisibleSets(visible[kept], [spans[i] for i in kept])
