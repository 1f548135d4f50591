"""Gap segments: the missing samples of markers between two frames.

A segment has one set of visible markers. How gaps are joined and divided into segments is that of
`priorfill.methods.gpr.segment_batches`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MIN_VISIBLE", "GapSegment", "SegmentBatch"]

MIN_VISIBLE = 3
"""Visible markers needed: three points define a frame of reference."""


@dataclass(frozen=True, eq=False)
class GapSegment:
    """Markers missing together in frames ``start <= frame < stop``, and the visible ones.

    Attributes
    ----------
    markers : ndarray of int [shape=(missing markers,)]
        Missing in all of these frames.
    start, stop : int
        Frames of the clip.
    visible : ndarray of int [shape=(visible markers,)]
        Measured in all of these frames.
    gap_frames : int
        Length of the gap that it is part of; its own if that is longer.
    """

    markers: NDArray[np.intp]
    start: int
    stop: int
    visible: NDArray[np.intp]
    gap_frames: int = 0

    @property
    def frames(self) -> int:
        """Its length."""
        return self.stop - self.start

    @property
    def has_enough_visible(self) -> bool:
        """Whether the visible markers define a frame of reference."""
        return len(self.visible) >= MIN_VISIBLE

    def with_margin(
        self, valid: NDArray[np.bool_], visible: NDArray[np.intp], margin: int
    ) -> NDArray[np.intp]:
        """Return its frames and adjacent ones in which some markers are measured.

        Parameters
        ----------
        valid : ndarray of bool [shape=(frames, markers)]
            Which samples of the clip are measured.
        visible : ndarray of int
            The markers that must be measured.
        margin : int
            Maximum number of adjacent frames on either side.
        """
        first, last = self.start, self.stop
        while first > max(0, self.start - margin) and valid[first - 1, visible].all():
            first -= 1
        while last < min(len(valid), self.stop + margin) and valid[last, visible].all():
            last += 1
        return np.arange(first, last)


@dataclass(frozen=True, eq=False)
class SegmentBatch:
    """Gap segments with the same markers, missing and visible, that one regression predicts.

    Attributes
    ----------
    segments : tuple of GapSegment
        In order of time; no two touch.
    """

    segments: tuple[GapSegment, ...]

    @property
    def markers(self) -> NDArray[np.intp]:
        """The missing markers."""
        return self.segments[0].markers

    @property
    def visible(self) -> NDArray[np.intp]:
        """The visible markers."""
        return self.segments[0].visible

    @property
    def has_enough_visible(self) -> bool:
        """Whether the visible markers define a frame of reference."""
        return self.segments[0].has_enough_visible

    @property
    def frames(self) -> int:
        """Usual length of its segments: the median over all of their frames."""
        return self._median([segment.frames for segment in self.segments])

    @property
    def gap_frames(self) -> int:
        """Usual length of the gaps that its segments are part of."""
        return self._median([max(one.gap_frames, one.frames) for one in self.segments])

    def _median(self, lengths: Sequence[int]) -> int:
        """Return the median over all frames of a length of each segment."""
        order = np.argsort(lengths, kind="stable")
        covered = np.cumsum([self.segments[i].frames for i in order])
        return lengths[int(order[np.searchsorted(covered, 0.5 * covered[-1])])]
