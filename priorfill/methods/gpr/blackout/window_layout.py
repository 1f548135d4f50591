"""The stencil of a blackout: which frames of a window are looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["EDGE_STEP", "REACH", "Stencil", "stencil_of"]

REACH = 0.15
"""s. How far beside the blackout its edges reach: 0.1 to 0.3 s do as well."""

EDGE_SAMPLES = 9
"""Samples of an edge that are looked at, at most."""

EDGE_STEP = 0.05
"""s. Velocities and accelerations at an edge are differences over this."""

INSIDE_RATE = 20.0
"""Hz. Resolution in which what came between is learnt: what the curves get wrong is slow."""

FEWEST_INSIDE = 3
"""Frames inside at which it is learnt at least."""

MOST_INSIDE = 60
"""The same at most: of what a body did a second from either edge the coarse shape can be told."""


@dataclass(frozen=True, eq=False)
class Stencil:
    """Frames of a window, counted from the first frame that is missing.

    Attributes
    ----------
    frames : int
        Length of the blackout.
    before, after : ndarray of int
        Frames beside it that the curves go by, in order of time; one of them may be empty.
    inside : ndarray of int
        Frames at which what came between is learnt.
    step : int
        Frames over which velocities are taken.
    """

    frames: int
    before: NDArray[np.intp]
    after: NDArray[np.intp]
    inside: NDArray[np.intp]
    step: int

    @property
    def beside(self) -> NDArray[np.intp]:
        """All frames beside it."""
        return np.concatenate([self.before, self.after])

    @property
    def first(self) -> int:
        """The first frame that a window needs."""
        return int(self.before[0]) if len(self.before) else 0

    @property
    def last(self) -> int:
        """The frame after the last one that a window needs."""
        return int(self.after[-1]) + 1 if len(self.after) else self.frames

    def edges(self) -> list[list[int]]:
        """Frames of each edge that tell its pose, velocity and acceleration, nearest first."""
        found = []
        if len(self.before):
            near = [-1, -1 - self.step, -1 - 2 * self.step]
            found.append([f for f in near if f >= self.before[0]])
        if len(self.after):
            near = [self.frames, self.frames + self.step, self.frames + 2 * self.step]
            found.append([f for f in near if f <= self.after[-1]])
        return found


def stencil_of(known: NDArray[np.bool_], start: int, stop: int, rate: float) -> Stencil | None:
    """Lay out the window of a blackout; None where neither side shows anything."""
    reach = max(2, round(REACH * rate))
    before = _side(known, np.arange(start - 1, max(start - 1 - reach, -1), -1))[::-1]
    after = _side(known, np.arange(stop, min(stop + reach, len(known))))
    if len(before) < 2 and len(after) < 2:
        return None
    frames = stop - start
    inside_count = int(np.clip(np.ceil(frames / rate * INSIDE_RATE), FEWEST_INSIDE, MOST_INSIDE))
    spread = np.linspace(-1, frames, inside_count + 2)[1:-1]
    inside = np.unique(np.clip(np.round(spread), 0, frames - 1).astype(np.intp))
    return Stencil(
        frames,
        _thinned(before[::-1])[::-1] - start,
        _thinned(after) - start,
        inside,
        max(1, round(EDGE_STEP * rate)),
    )


def _side(known: NDArray[np.bool_], order: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the frames of one side, nearest first, up to the first one that shows too little."""
    shows = known[order].mean(axis=1) if len(order) else np.empty(0)
    # what is shown right beside the blackout must be shown throughout
    enough = (shows >= shows[0]) & (shows > 0.0) if len(order) else np.empty(0, dtype=bool)
    count = len(order) if enough.all() else int(np.argmin(enough))
    return np.asarray(order[:count])


def _thinned(frames: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return up to `EDGE_SAMPLES` of some frames, the first ones among them."""
    if len(frames) <= EDGE_SAMPLES:
        return frames
    return frames[np.round(np.linspace(0, len(frames) - 1, EDGE_SAMPLES)).astype(np.intp)]
