"""Labels that go over to another marker, whose own label is missing from then on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.label_swaps import CROSSED

__all__ = ["Takeover", "find_takeovers"]


@dataclass(frozen=True)
class Takeover:
    """Frames ``start <= frame < stop`` in which a label is on another marker.

    Attributes
    ----------
    marker, other : int
        The label, and the marker that it is on.
    start, stop : int
        Frames.
    apart : float
        mm by which the marker's path breaks.
    """

    marker: int
    other: int
    start: int
    stop: int
    apart: float


def find_takeovers(
    positions: NDArray[np.float64], broken: NDArray[np.bool_]
) -> tuple[Takeover, ...]:
    """Find labels that go on with the path of another marker, which is missing then.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    broken : ndarray of bool [shape=(frames - 1, markers)]
        Where paths break.
    """
    frames = len(positions)
    back = [
        Takeover(one.marker, one.other, frames - one.stop, frames - one.start, one.apart)
        for one in _onwards(positions[::-1], broken[::-1])
    ]
    found = dict.fromkeys([*_onwards(positions, broken), *back])
    return tuple(sorted(found, key=lambda one: (one.start, one.marker, one.other)))


def _onwards(positions: NDArray[np.float64], broken: NDArray[np.bool_]) -> list[Takeover]:
    """Return those that begin at a break, in the order of the frames given."""
    seen = ~np.isnan(positions[:, :, 0])
    found = []
    for frame, marker in np.argwhere(broken).tolist():
        if frame == 0 or not seen[frame - 1, marker]:
            continue
        lost = np.flatnonzero(seen[frame] & seen[frame - 1] & ~seen[frame + 1])
        if not len(lost):
            continue
        here = positions[frame + 1, marker]
        expected = 2.0 * positions[frame] - positions[frame - 1]
        keeps = float(np.linalg.norm(here - expected[marker]))
        misses = np.linalg.norm(here - expected[lost], axis=1)
        other = int(lost[misses.argmin()])
        if misses.min() < CROSSED * keeps:
            ends = seen[frame + 1 :, other] | ~seen[frame + 1 :, marker]
            ends[1:] |= broken[frame + 1 :, marker]
            length = int(ends.argmax()) if ends.any() else len(ends)
            found.append(Takeover(marker, other, frame + 1, frame + 1 + length, keeps))
    return found
