"""Whether two clips are one recording, though no sample is the same bit for bit.

A recording that was exported twice, as C3D and as text, or in other units or axes, has been
rounded: sketches, which hash bits, have nothing in common. Its length is the same, and so are the
distances between its markers, whatever the axes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["RATE_ERROR", "same_motion"]

RATE_ERROR = 0.01
"""Relative difference of two rates that may be the same one, written with few digits."""

_ROUNDING = 0.3
"""mm, by which a distance changes where coordinates are rounded to 0.1 mm, as files of integers
usually are."""

_FEWEST = 30
"""Distances that are compared at least."""

_SHARE = 0.5
"""Share of these that agree at least: what was filled, or filtered beside a gap, need not.
Distances in two takes of the same person agree to 0.3 mm now and then only, as the markers that are
compared are on different segments."""


def same_motion(
    one: NDArray[np.float32],
    labels: Sequence[str],
    other: NDArray[np.float32],
    other_labels: Sequence[str],
) -> bool:
    """Tell if two clips are of one recording.

    Parameters
    ----------
    one, other : ndarray [shape=(frames, markers, 3), mm]
        At the same rate, of about the same length, NaN where missing.
    labels, other_labels : sequence of str
        Their markers.
    """
    there = {label.casefold(): marker for marker, label in enumerate(other_labels)}
    pairs = [(i, there[x.casefold()]) for i, x in enumerate(labels) if x.casefold() in there]
    frames = min(len(one), len(other))
    if len(pairs) < 2 or frames == 0:
        return False
    mine, theirs = (list(column) for column in zip(*pairs, strict=True))
    # markers stand in the order of the body: half of them apart is far apart
    step = len(pairs) // 2
    first, second = one[:frames, mine], other[:frames, theirs]
    distances = [
        np.linalg.norm(both - np.roll(both, step, axis=1), axis=2) for both in (first, second)
    ]
    off = np.abs(distances[0] - distances[1])
    off = off[~np.isnan(off)]
    return len(off) >= _FEWEST and bool((off < _ROUNDING).mean() >= _SHARE)
