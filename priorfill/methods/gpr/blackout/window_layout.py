"""Layout of the windows of a blackout: which of their frames are used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gpr.blackout.options import BlackoutOptions

__all__ = ["WindowLayout", "lay_out_window"]

MIN_EDGE_FRAMES = 2
"""Frames that at least one side must show: two give a velocity."""


@dataclass(frozen=True, eq=False)
class WindowLayout:
    """Frames of a window, counted from the first missing one.

    Attributes
    ----------
    frames : int
        Length of the blackout.
    before, after : ndarray of int
        Frames on either side that the curves are computed from, in order of time; one of them may
        be empty.
    inside : ndarray of int
        Frames of the blackout at which the movement is learnt.
    step : int
        Step of the finite differences at the edges, in frames.
    """

    frames: int
    before: NDArray[np.intp]
    after: NDArray[np.intp]
    inside: NDArray[np.intp]
    step: int

    @property
    def context(self) -> NDArray[np.intp]:
        """The frames on both sides."""
        return np.concatenate([self.before, self.after])

    @property
    def first(self) -> int:
        """The first frame of a window."""
        return int(self.before[0]) if len(self.before) else 0

    @property
    def last(self) -> int:
        """The frame after the last one of a window."""
        return int(self.after[-1]) + 1 if len(self.after) else self.frames

    @property
    def length(self) -> int:
        """Frames of a window."""
        return self.last - self.first

    def edge_frames(self) -> list[list[int]]:
        """Return the frames of each edge that give its pose, velocity and acceleration.

        Returns
        -------
        list of list of int
            For each visible side up to three frames, the one adjacent to the blackout first.
        """
        edges = []
        if len(self.before):
            near = [-1, -1 - self.step, -1 - 2 * self.step]
            edges.append([f for f in near if f >= self.before[0]])
        if len(self.after):
            near = [self.frames, self.frames + self.step, self.frames + 2 * self.step]
            edges.append([f for f in near if f <= self.after[-1]])
        return edges


def lay_out_window(
    known: NDArray[np.bool_], start: int, stop: int, rate: float, options: BlackoutOptions
) -> WindowLayout | None:
    """Choose the frames of a window of a blackout.

    Parameters
    ----------
    known : ndarray of bool [shape=(frames, markers)]
        Which samples of the clip are known, of the markers to be predicted.
    start, stop : int
        First frame of the blackout, and the frame after its last one.
    rate : float
        Hz.
    options : BlackoutOptions
        Extent and sampling of the window.

    Returns
    -------
    WindowLayout or None
        None where neither side shows two frames.

    Examples
    --------
    >>> known = np.ones((100, 5), dtype=bool)
    >>> known[40:60] = False
    >>> layout = lay_out_window(known, 40, 60, rate=50.0, options=BlackoutOptions())
    >>> layout.before, layout.frames, layout.length
    (array([-8, -7, -6, -5, -4, -3, -2, -1]), 20, 36)
    >>> layout.inside
    array([ 1,  4,  6,  8, 11, 13, 15, 18])
    """
    reach = max(MIN_EDGE_FRAMES, round(options.edge_seconds * rate))
    before = _visible_side(known, np.arange(start - 1, max(start - 1 - reach, -1), -1))
    after = _visible_side(known, np.arange(stop, min(stop + reach, len(known))))
    if max(len(before), len(after)) < MIN_EDGE_FRAMES:
        return None
    frames = stop - start
    count = np.ceil(frames / rate * options.inside_rate)
    count = int(np.clip(count, options.min_inside_frames, options.max_inside_frames))
    spaced = np.round(np.linspace(-1, frames, count + 2)[1:-1])
    return WindowLayout(
        frames,
        _thinned(before, options.max_edge_samples)[::-1] - start,
        _thinned(after, options.max_edge_samples) - start,
        np.unique(np.clip(spaced, 0, frames - 1).astype(np.intp)),
        max(1, round(options.difference_seconds * rate)),
    )


def _visible_side(known: NDArray[np.bool_], order: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the frames of one side, nearest first, up to the first in which a marker disappears.

    The markers known in the frame adjacent to the blackout must be known in all of them.
    """
    if not len(order):
        return order
    share = known[order].mean(axis=1)
    enough = (share >= share[0]) & (share > 0.0)
    return np.asarray(order[: len(order) if enough.all() else int(np.argmin(enough))])


def _thinned(frames: NDArray[np.intp], max_count: int) -> NDArray[np.intp]:
    """Return up to ``max_count`` of some frames, evenly spaced, including the first and last."""
    if len(frames) <= max_count:
        return frames
    return frames[np.round(np.linspace(0, len(frames) - 1, max_count)).astype(np.intp)]
