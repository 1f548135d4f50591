"""Remove samples from a clip at random, only where they are measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip

__all__ = [
    "MAX_CLIP_SHARE",
    "MAX_TRIES",
    "MIN_EDGE_SECONDS",
    "GapGenerator",
    "Mask",
    "measured_in",
]

MIN_EDGE_SECONDS = 0.25
"""s. Distance of gaps inside a clip from its ends."""

MAX_CLIP_SHARE = 0.5
"""Largest share of a clip's frames in one gap: the rest is needed to learn from."""

MAX_TRIES = 200
"""Placements tried before a gap is skipped."""

Mask = NDArray[np.bool_]


def measured_in(clip: Clip) -> Mask:
    """Return which samples are measured [shape=(frames, markers)].

    Samples that are missing, or that the file marks as interpolated, are no ground truth.
    """
    measured: Mask = ~clip.missing
    interpolated = clip.source.interpolated if clip.source is not None else None
    if interpolated is None or interpolated.shape != measured.shape:
        return measured
    return measured & ~interpolated


class GapGenerator:
    """Generates gaps in one clip.

    Parameters
    ----------
    clip : Clip
        The ground truth.
    rng : Generator
        Source of randomness.
    measured : ndarray of bool [shape=(frames, markers)], optional
        Samples that may be removed; those that are not missing if not given.

    Attributes
    ----------
    mask : ndarray of bool [shape=(frames, markers)]
        The removed samples.
    """

    def __init__(self, clip: Clip, rng: np.random.Generator, measured: Mask | None = None) -> None:
        self.clip = clip
        self.rng = rng
        self.measured: Mask = ~clip.missing if measured is None else measured
        self.mask: Mask = np.zeros_like(clip.missing)

    def length(self, low: float, high: float) -> int | None:
        """Draw a length in frames, from a range in s; None where the clip is too short."""
        high = min(high, MAX_CLIP_SHARE * self.clip.duration)
        if high < low:
            return None
        return max(round(self.rng.uniform(low, high) * self.clip.rate), 1)

    def pick(self, some: Sequence[list[int]]) -> list[int] | None:
        """Draw one of several lists of markers; None where there are none."""
        return some[int(self.rng.integers(len(some)))] if some else None

    def marker(self) -> list[int]:
        """Draw a marker."""
        return [int(self.rng.integers(len(self.clip.labels)))]

    def start(self, frames: int) -> int:
        """Draw the first frame of a gap inside the clip."""
        edge = min(round(MIN_EDGE_SECONDS * self.clip.rate), (self.clip.frames - frames) // 2)
        return int(self.rng.integers(edge, self.clip.frames - frames - edge + 1))

    def is_free(self, markers: Sequence[int], start: int, stop: int) -> bool:
        """Return whether samples and the adjacent ones are measured and not removed yet."""
        frames = slice(max(start - 1, 0), stop + 1)
        return bool((self.measured & ~self.mask)[frames, markers].all())

    def remove(self, markers: Sequence[int] | None, frames: int | None) -> bool:
        """Remove some markers for a number of frames at a random time.

        Returns False where no place was found, or there is no marker or length.
        """
        if not markers or frames is None:
            return False
        for _ in range(MAX_TRIES):
            start = self.start(frames)
            if self.is_free(markers, start, start + frames):
                self.mask[start : start + frames, markers] = True
                return True
        return False

    def scatter(
        self,
        share: float,
        seconds: tuple[float, float],
        max_missing: int,
        max_tries: int = MAX_TRIES,
    ) -> bool:
        """Remove single markers until a share of all samples is missing.

        Parameters
        ----------
        share : float
            Share of all samples.
        seconds : (float, float)
            Minimum and maximum length of a gap (s).
        max_missing : int
            Maximum number of markers missing in the same frame.
        max_tries : int
            Maximum number of placements tried.

        Returns
        -------
        bool
            Whether any sample was removed.
        """
        for _ in range(max_tries):
            if self.mask.mean() >= share or self.scatter_one(seconds, max_missing) is None:
                break
        return bool(self.mask.any())

    def scatter_one(self, seconds: tuple[float, float], max_missing: int) -> bool | None:
        """Try once to remove a random marker; None where the clip is too short for any gap."""
        frames, marker = self.length(*seconds), self.marker()
        if frames is None:
            return None
        start = self.start(frames)
        crowded = self.mask[start : start + frames].sum(axis=1).max() >= max_missing
        if crowded or not self.is_free(marker, start, start + frames):
            return False
        self.mask[start : start + frames, marker] = True
        return True
