"""Cut gaps into a clip: only where all samples are measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip

__all__ = ["EDGE", "MOST", "TRIES", "GapGenerator", "Mask", "measured_in"]

EDGE = 0.25
"""s. Gaps inside a clip stay so far from its ends."""

MOST = 0.5
"""Part of a clip that a gap takes at most: the rest is there to learn from."""

TRIES = 200
"""Placements tried before a clip is given up."""

Mask = NDArray[np.bool_]


def measured_in(clip: Clip) -> Mask:
    """Return which samples are measured [shape=(frames, markers)].

    Neither missing, nor interpolated by what the file says: these are no truth to compare with.
    """
    known: Mask = ~clip.missing
    told = clip.source.interpolated if clip.source is not None else None
    return known if told is None or told.shape != known.shape else known & ~told


class GapGenerator:
    """Cuts gaps into one clip.

    Parameters
    ----------
    clip : Clip
        The truth.
    rng : Generator
        What draws.
    known : ndarray of bool [shape=(frames, markers)], optional
        Samples that may be cut out; those that are not missing if not given.

    Attributes
    ----------
    gone : ndarray of bool [shape=(frames, markers)]
        What was cut out so far.
    """

    def __init__(self, clip: Clip, rng: np.random.Generator, known: Mask | None = None) -> None:
        self.clip = clip
        self.rng = rng
        self.known: Mask = ~clip.missing if known is None else known
        self.gone: Mask = np.zeros_like(clip.missing)

    def length(self, low: float, high: float) -> int | None:
        """Draw a length in frames; None where the clip is too short for any (s)."""
        high = min(high, MOST * self.clip.duration)
        if high < low:
            return None
        return max(round(self.rng.uniform(low, high) * self.clip.rate), 1)

    def pick(self, some: Sequence[list[int]]) -> list[int] | None:
        """Draw one of several lists of markers."""
        return some[int(self.rng.integers(len(some)))] if some else None

    def marker(self) -> list[int]:
        """Draw a marker."""
        return [int(self.rng.integers(len(self.clip.labels)))]

    def start(self, frames: int) -> int:
        """Draw where a gap inside the clip begins."""
        edge = min(round(EDGE * self.clip.rate), (self.clip.frames - frames) // 2)
        return int(self.rng.integers(edge, self.clip.frames - frames - edge + 1))

    def free(self, markers: Sequence[int], start: int, stop: int) -> bool:
        """Return whether samples, and those beside them, are measured and not cut out yet."""
        around = slice(max(start - 1, 0), stop + 1)
        return bool((self.known & ~self.gone)[around, markers].all())

    def cut(self, markers: Sequence[int] | None, frames: int | None) -> bool:
        """Cut some markers out, somewhere; return whether there was a place."""
        if not markers or frames is None:
            return False
        for _ in range(TRIES):
            start = self.start(frames)
            if self.free(markers, start, start + frames):
                self.gone[start : start + frames, markers] = True
                return True
        return False

    def scatter(
        self, share: float, seconds: tuple[float, float], at_once: int, tries: int = TRIES
    ) -> bool:
        """Cut gaps of single markers out until a share of all samples is missing.

        Parameters
        ----------
        share : float
            Of all samples.
        seconds : (float, float)
            Least and greatest length (s).
        at_once : int
            Markers missing at the same time at most.
        tries : int
            Placements tried at most.
        """
        for _ in range(tries):
            if self.gone.mean() >= share or self.scatter_one(seconds, at_once) is None:
                break
        return bool(self.gone.any())

    def scatter_one(self, seconds: tuple[float, float], at_once: int) -> bool | None:
        """Try once to cut a marker out; None where the clip is too short for any such gap."""
        frames, marker = self.length(*seconds), self.marker()
        if frames is None:
            return None
        start = self.start(frames)
        crowded = self.gone[start : start + frames].sum(axis=1).max() >= at_once
        if crowded or not self.free(marker, start, start + frames):
            return False
        self.gone[start : start + frames, marker] = True
        return True
