"""Label swaps: from one frame to the next, each of two markers continues the path of the other.

A label is constant along an unbroken path. A swap therefore lasts until the two markers exchange
their places again, or until one of them is missing: when it is seen again, its label is assigned
anew. Which of the parts between these frames are swapped is decided by the distances from the
reference markers.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.marker_path import known_medians
from priorfill.artefacts.reference_markers import ReferenceMarkers, distances
from priorfill.gaps import runs

__all__ = ["MAX_MISS_RATIO", "LabelSwap", "find_label_swaps", "swap_labels"]

MAX_MISS_RATIO = 0.2
"""With labels exchanged, the paths continue to within this fraction of the error that they make
with the labels as they are."""

GAP_CHANGE_COST = 300.0
"""mm, summed over frames. Labels are taken to change in a gap only if the distances from the
reference markers are nearer to the usual ones by more than this."""

SWAPPED_FRAME_COST = 1e-3
"""mm. Cost of each swapped frame: without reference markers the shorter part counts as swapped."""

BATCH_SIZE = 500
"""Markers compared with all others at once, to limit the memory."""


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
    references: ReferenceMarkers,
    max_miss_ratio: float = MAX_MISS_RATIO,
) -> list[LabelSwap]:
    """Find pairs of markers that exchange their places.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    broken : ndarray of bool [shape=(frames - 1, markers)]
        Where paths break.
    references : ReferenceMarkers
        Show which part of a clip is swapped if there are gaps of both markers.
    max_miss_ratio : float
        See `MAX_MISS_RATIO`.

    Returns
    -------
    list of LabelSwap
        In order of time. If two markers exchange their places an odd number of times, the part in
        which their distances from the reference markers are less usual is taken as swapped; without
        a gap of both, the shorter part.

    See Also
    --------
    priorfill.artefacts.find_artefacts : Calls all detectors.
    swap_labels : Undoes the swaps.
    """
    crossings: dict[tuple[int, int], list[tuple[int, float]]] = {}
    for frame in np.flatnonzero(broken.sum(axis=1) > 1).tolist():
        candidates = np.flatnonzero(broken[frame]).tolist()
        for pair, distance in _crossings(positions, frame, candidates, max_miss_ratio):
            crossings.setdefault(pair, []).append((frame + 1, distance))
    found = []
    for pair, events in crossings.items():
        distance = float(np.median([size for _, size in events]))
        cuts = [frame for frame, _ in events]
        found += [
            LabelSwap(*pair, start, stop, distance)
            for start, stop in _swapped_spans(positions, references, pair, cuts)
        ]
    return sorted(found, key=lambda swap: (swap.start, swap.first, swap.second))


def _swapped_spans(
    positions: NDArray[np.float64],
    references: ReferenceMarkers,
    pair: tuple[int, int],
    cuts: list[int],
) -> list[tuple[int, int]]:
    """Return the frames in which two markers are swapped that exchange places at some frames.

    The cheapest sequence of states (as labelled, swapped): at an exchange the state changes, in a
    gap it may.
    """
    gain = _exchange_gains(positions, references, pair) - SWAPPED_FRAME_COST
    spans: list[tuple[int, int]] = []
    exchanged: list[bool] = []  # whether the state changes at the beginning of a span
    for start, stop in runs(np.isfinite(positions[:, pair[0], 0] + positions[:, pair[1], 0])):
        inner = [cut for cut in cuts if start < cut < stop]
        spans += pairwise([start, *inner, stop])
        exchanged += [False] + [True] * len(inner)
    cost = np.zeros(2)
    choices = []
    for (start, stop), change in zip(spans, exchanged, strict=True):
        stay = np.array([0, 1])
        if change:
            stay = stay[::-1]
            came_from = stay
            cost = cost[stay]
        else:
            switched = cost[::-1] + GAP_CHANGE_COST
            came_from = np.where(switched < cost, stay[::-1], stay)
            cost = np.minimum(cost, switched)
        choices.append(came_from)
        cost = cost - np.array([0.0, float(gain[start:stop].sum())])
    state = int(cost.argmin())
    found = []
    for span, came_from in zip(reversed(spans), reversed(choices), strict=True):
        if state:
            found.append(span)
        state = int(came_from[state])
    return found


def _exchange_gains(
    positions: NDArray[np.float64], references: ReferenceMarkers, pair: tuple[int, int]
) -> NDArray[np.float64]:
    """Return by how much nearer to the usual distances an exchange of two labels leads.

    In mm, for each frame; negative where the labels are right, 0 where nothing is known.
    """
    gains = np.zeros(len(positions))
    for marker, other in (pair, pair[::-1]):
        others = references.of(marker)
        others = others[others != other]
        own = distances(positions, marker, others)
        typical = known_medians(own)
        exchanged = np.sqrt(
            ((positions[:, others] - positions[:, other : other + 1]) ** 2).sum(axis=2)
        )
        gains += np.nan_to_num(np.abs(own - typical) - np.abs(exchanged - typical)).sum(axis=1)
    return gains


def swap_labels(positions: NDArray[np.float64], swaps: list[LabelSwap]) -> NDArray[np.float64]:
    """Return positions with swapped labels exchanged, so that other artefacts can be found."""
    result = positions.copy()
    for swap in swaps:
        span = slice(swap.start, swap.stop)
        result[span, [swap.first, swap.second]] = result[span, [swap.second, swap.first]]
    return result


def _crossings(
    positions: NDArray[np.float64], frame: int, markers: list[int], max_miss_ratio: float
) -> list[tuple[tuple[int, int], float]]:
    """Return the pairs of markers that exchange places after a frame, and their distance (mm).

    No marker is in two of them: of several candidates the one that continues best is taken.
    """
    before = positions[frame - 1 : frame + 1] if frame else positions[:0]
    after = positions[frame + 2 : frame : -1]
    candidates: dict[tuple[int, int], tuple[float, float]] = {}
    for known, target in ((before, positions[frame + 1]), (after, positions[frame])):
        if len(known) < 2:
            continue
        expected = 2.0 * known[1, markers] - known[0, markers]
        found = target[markers]
        miss = np.sqrt(((found - expected) ** 2).sum(axis=1))
        for first, second in _mutual_neighbours(expected, found, max_miss_ratio * miss):
            pair = (markers[first], markers[second])
            if pair not in candidates:
                exchanged = found[[second, first]] - expected[[first, second]]
                worst = float(np.sqrt((exchanged**2).sum(axis=1)).max())
                if worst < max_miss_ratio * min(miss[first], miss[second]):
                    apart = expected[first] - expected[second]
                    candidates[pair] = worst, float(np.sqrt((apart**2).sum()))
    taken: set[int] = set()
    result = []
    for pair, (_, distance) in sorted(candidates.items(), key=lambda item: item[1][0]):
        if taken.isdisjoint(pair):
            taken.update(pair)
            result.append((pair, distance))
    return result


def _mutual_neighbours(
    expected: NDArray[np.float64], found: NDArray[np.float64], radius: NDArray[np.float64]
) -> list[tuple[int, int]]:
    """Return pairs of markers, each within a radius of where the other is expected."""
    near: list[set[int]] = []
    for start in range(0, len(expected), BATCH_SIZE):
        part = slice(start, start + BATCH_SIZE)
        apart = np.sqrt(((expected[part, None] - found[None]) ** 2).sum(axis=2))
        with np.errstate(invalid="ignore"):
            inside = apart < radius[part, None]
        near += [set(np.flatnonzero(row).tolist()) for row in inside]
    return [
        (a, b) for a, others in enumerate(near) for b in sorted(others) if b > a and a in near[b]
    ]
