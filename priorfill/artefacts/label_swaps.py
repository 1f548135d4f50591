"""Label swaps: from one frame to the next, each of two markers continues the path of the other."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAX_MISS_RATIO", "LabelSwap", "find_label_swaps", "swap_labels"]

MAX_MISS_RATIO = 0.2
"""With labels exchanged, the paths continue to within this fraction of the error that they make
with the labels as they are."""


@dataclass(frozen=True)
class LabelSwap:
    """Two markers whose labels are exchanged in frames ``start <= frame < stop``.

    Attributes
    ----------
    first, second : int
        The markers.
    start, stop : int
        Frames.
    distance : float
        mm between the two where the labels change.
    """

    first: int
    second: int
    start: int
    stop: int
    distance: float


def find_label_swaps(
    positions: NDArray[np.float64],
    broken: NDArray[np.bool_],
    max_miss_ratio: float = MAX_MISS_RATIO,
) -> list[LabelSwap]:
    """Find pairs of markers that exchange their places.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    broken : ndarray of bool [shape=(frames - 1, markers)]
        Where paths break.
    max_miss_ratio : float
        See `MAX_MISS_RATIO`.

    Returns
    -------
    list of LabelSwap
        In order of time. If two markers exchange their places an odd number of times, the shorter
        part of the clip is taken as swapped.

    See Also
    --------
    priorfill.artefacts.find_artefacts : Calls all detectors.
    swap_labels : Undoes the swaps.
    """
    frames = len(positions)
    crossings: dict[tuple[int, int], list[tuple[int, float]]] = {}
    for frame in np.flatnonzero(broken.sum(axis=1) > 1).tolist():
        candidates = np.flatnonzero(broken[frame]).tolist()
        for first, second in combinations(candidates, 2):
            distance = _crossing_distance(positions, frame, first, second, max_miss_ratio)
            if distance > 0:
                crossings.setdefault((first, second), []).append((frame + 1, distance))
    found = []
    for (first, second), events in crossings.items():
        cuts = [0, *(frame for frame, _ in events), frames]
        distance = float(np.median([size for _, size in events]))
        spans = list(pairwise(cuts))
        inside, outside = spans[1::2], spans[0::2]
        if len(events) % 2 and sum(b - a for a, b in outside) < sum(b - a for a, b in inside):
            inside = outside
        found += [LabelSwap(first, second, a, b, distance) for a, b in inside]
    return sorted(found, key=lambda swap: (swap.start, swap.first, swap.second))


def swap_labels(positions: NDArray[np.float64], swaps: list[LabelSwap]) -> NDArray[np.float64]:
    """Return positions with swapped labels exchanged, so that other artefacts can be found."""
    result = positions.copy()
    for swap in swaps:
        span = slice(swap.start, swap.stop)
        result[span, [swap.first, swap.second]] = result[span, [swap.second, swap.first]]
    return result


def _crossing_distance(
    positions: NDArray[np.float64], frame: int, first: int, second: int, max_miss_ratio: float
) -> float:
    """Return the distance of two markers that exchange places after a frame; 0 if they do not."""
    pair = [first, second]
    before = positions[frame - 1 : frame + 1, pair] if frame else positions[:0]
    after = positions[frame + 2 : frame : -1, pair]
    for known, target in ((before, positions[frame + 1]), (after, positions[frame])):
        if len(known) < 2 or not np.isfinite(known).all():
            continue
        expected = 2.0 * known[1] - known[0]
        found = target[pair]
        miss = float(np.sqrt(((found - expected) ** 2).sum(axis=1)).min())
        miss_exchanged = float(np.sqrt(((found[::-1] - expected) ** 2).sum(axis=1)).max())
        if miss_exchanged < max_miss_ratio * miss:
            return float(np.sqrt(((expected[0] - expected[1]) ** 2).sum()))
    return 0.0
