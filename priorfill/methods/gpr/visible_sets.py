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

__all__ = ["VisibleSets", "merge_visible_sets"]

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
    frames : ndarray of int [shape=(sets,)]
        Number of frames.
    spans : list of tuple of int
        Numbers of the spans of frames that each consists of.
    """

    visible: _Bool
    frames: NDArray[np.intp]
    spans: list[tuple[int, ...]]

    def __len__(self) -> int:
        return len(self.spans)

    @classmethod
    def of(cls, visible: _Bool, frames: NDArray[np.intp]) -> VisibleSets:
        """Find the sets of spans [shapes=(spans, markers), (spans,)]; equal ones are one set."""
        numbers: dict[bytes, list[int]] = {}
        for span, mask in enumerate(np.packbits(visible, axis=1)):
            numbers.setdefault(mask.tobytes(), []).append(span)
        spans = [tuple(some) for some in numbers.values()]
        total = np.array([frames[list(some)].sum() for some in spans], dtype=np.intp)
        return cls(visible[[some[0] for some in spans]], total, spans)

    def _some(self, chosen: slice) -> VisibleSets:
        return VisibleSets(self.visible[chosen], self.frames[chosen], self.spans[chosen])


def merge_visible_sets(
    sets: VisibleSets, weight: _Float, max_share: float, max_loss: float
) -> VisibleSets:
    """Merge sets of visible markers where little is lost.

    The error of a prediction is taken as inversely proportional to the importance of the visible
    markers. So the loss of merging two sets is the increase of the inverse importance, summed over
    their frames. The two sets with the least loss are merged first.

    Parameters
    ----------
    sets : VisibleSets
        To be merged.
    weight : ndarray [shape=(markers,)]
        Importance of each visible marker.
    max_share : float
        Two sets are merged in any case if neither loses more than this share of its importance.
    max_loss : float
        Frames. Other sets are merged if the loss is at most this.

    Returns
    -------
    VisibleSets
        Two sets are not merged if that would leave too few visible markers.

    Examples
    --------
    >>> import numpy as np
    >>> seen = np.array([[1, 1, 1, 1, 1], [1, 1, 1, 1, 0], [1, 1, 1, 0, 0]], dtype=bool)
    >>> sets = VisibleSets.of(seen, np.array([50, 50, 50]))
    >>> merge_visible_sets(sets, np.array([1.0, 1.0, 1.0, 1.0, 0.1]), 0.1, 2.0).spans
    [(0, 1), (2,)]
    """
    while len(sets) > MAX_COMPARED:
        parts = [
            _merge_all(sets._some(slice(start, start + MAX_COMPARED)), weight, max_share, max_loss)
            for start in range(0, len(sets), MAX_COMPARED)
        ]
        merged = VisibleSets(
            np.concatenate([part.visible for part in parts]),
            np.concatenate([part.frames for part in parts]),
            [spans for part in parts for spans in part.spans],
        )
        if 2 * len(merged) > len(sets):
            return merged
        sets = merged
    return _merge_all(sets, weight, max_share, max_loss)


def _merge_all(sets: VisibleSets, weight: _Float, max_share: float, max_loss: float) -> VisibleSets:
    """Merge sets, and compare each of them with all others."""
    visible, frames, spans = sets.visible.copy(), sets.frames.copy(), list(sets.spans)
    importance = np.maximum(visible @ weight, MIN_IMPORTANCE)
    alive = np.ones(len(sets), dtype=bool)
    rank = np.full((len(sets), len(sets)), np.inf)

    def compare(one: int) -> None:
        """Rank the merging of a set with each other one; below 0 if it is merged in any case."""
        others = np.flatnonzero(alive)
        both = visible[one] & visible[others]
        common = np.maximum(both @ weight, MIN_IMPORTANCE)
        share = 1.0 - common / np.maximum(importance[one], importance[others])
        loss = frames[one] * (1.0 / common - 1.0 / importance[one])
        loss += frames[others] * (1.0 / common - 1.0 / importance[others])
        order = np.where(share <= max_share, share - 1.0, loss)
        most = np.maximum(visible[one].sum(), visible[others].sum(axis=1))
        order[(both.sum(axis=1) < MIN_VISIBLE) & (most >= MIN_VISIBLE)] = np.inf
        order[others == one] = np.inf
        rank[one, others] = rank[others, one] = order

    for one in range(len(sets)):
        compare(one)
    while True:
        one, other = (int(i) for i in np.unravel_index(np.argmin(rank), rank.shape))
        if not rank[one, other] <= max_loss:
            break
        visible[one] &= visible[other]
        importance[one] = max(float(visible[one] @ weight), MIN_IMPORTANCE)
        frames[one] += frames[other]
        spans[one] = (*spans[one], *spans[other])
        alive[other] = False
        rank[other] = rank[:, other] = np.inf
        compare(one)
    kept = np.flatnonzero(alive)
    return VisibleSets(visible[kept], frames[kept], [spans[i] for i in kept])
