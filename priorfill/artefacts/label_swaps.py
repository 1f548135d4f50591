"""Swapped labels: from one frame to the next, each of two markers goes on with the other's path."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["Swap", "exchange", "find_swaps"]

CROSSED = 0.2
"""Of what the two miss by with the labels as they are, they may miss by with labels exchanged."""


@dataclass(frozen=True)
class Swap:
    """Two markers whose labels are exchanged in frames ``start <= frame < stop``.

    Attributes
    ----------
    one, other : int
        The markers.
    start, stop : int
        Frames.
    apart : float
        mm between the two where the labels change.
    """

    one: int
    other: int
    start: int
    stop: int
    apart: float


def find_swaps(positions: NDArray[np.float64], broken: NDArray[np.bool_]) -> list[Swap]:
    """Find pairs of markers that change places.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    broken : ndarray of bool [shape=(frames - 1, markers)]
        Where paths break.

    Returns
    -------
    list of Swap
        Where two change places and not back, the shorter part of the clip is taken as swapped.
    """
    frames = len(positions)
    crossings: dict[tuple[int, int], list[tuple[int, float]]] = {}
    for frame in np.flatnonzero(broken.sum(axis=1) > 1).tolist():
        candidates = np.flatnonzero(broken[frame]).tolist()
        for one, other in combinations(candidates, 2):
            apart = _crossing(positions, frame, one, other)
            if apart > 0:
                crossings.setdefault((one, other), []).append((frame + 1, apart))
    found = []
    for (one, other), events in crossings.items():
        at = [0, *(frame for frame, _ in events), frames]
        apart = float(np.median([size for _, size in events]))
        spans = list(pairwise(at))
        inside, outside = spans[1::2], spans[0::2]
        if len(events) % 2 and sum(b - a for a, b in outside) < sum(b - a for a, b in inside):
            inside = outside
        found += [Swap(one, other, a, b, apart) for a, b in inside]
    return sorted(found, key=lambda swap: (swap.start, swap.one, swap.other))


def exchange(positions: NDArray[np.float64], swaps: list[Swap]) -> NDArray[np.float64]:
    """Return positions with the labels as they should be, to look for what else is wrong."""
    result = positions.copy()
    for swap in swaps:
        part = slice(swap.start, swap.stop)
        result[part, [swap.one, swap.other]] = result[part, [swap.other, swap.one]]
    return result


def _crossing(positions: NDArray[np.float64], frame: int, one: int, other: int) -> float:
    """Return how far apart two markers are that change places after a frame; 0 if they do not."""
    before = positions[frame - 1 : frame + 1, [one, other]] if frame else positions[:0]
    after = positions[frame + 2 : frame : -1, [one, other]]
    for known, then in ((before, positions[frame + 1]), (after, positions[frame])):
        if len(known) < 2 or not np.isfinite(known).all():
            continue
        expected = 2.0 * known[1] - known[0]
        found = then[[one, other]]
        keeps = float(np.sqrt(((found - expected) ** 2).sum(axis=1)).min())
        crosses = float(np.sqrt(((found[::-1] - expected) ** 2).sum(axis=1)).max())
        if crosses < CROSSED * keeps:
            return float(np.sqrt(((expected[0] - expected[1]) ** 2).sum()))
    return 0.0
