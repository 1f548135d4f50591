"""Scope: which of a clip's missing samples are to be filled, and which are left alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.gaps import Gap, find_gaps

__all__ = ["GapFilter", "fitting"]

OUTSIDE = "outside the frames asked for"


@dataclass(frozen=True)
class GapFilter:
    """What to fill: what every field that is not empty admits.

    Attributes
    ----------
    markers : tuple of str
        Shell patterns of labels.
    frames : tuple of (int or None, int or None), optional
        First and last frame, as the clip numbers them; None: from its first, to its last.
    max_gap : float, optional
        s. Longer gaps are left alone as a whole.
    skip_edges : bool
        Leave gaps at the clip's start and end alone.
    strict : bool
        Whether each pattern must fit a marker of a clip.
    """

    markers: tuple[str, ...] = ()
    frames: tuple[int | None, int | None] | None = None
    max_gap: float | None = None
    skip_edges: bool = False
    strict: bool = True

    def __post_init__(self) -> None:
        """Check the fields; raise `OptionError` where one makes no sense."""
        if self.max_gap is not None and not self.max_gap > 0:
            raise OptionError(f"the longest gap to fill is {self.max_gap} s; it must be above 0")
        if self.frames is not None and None not in self.frames:
            first, last = self.frames
            assert first is not None
            assert last is not None
            if first > last:
                raise OptionError(f"frames {first}:{last}: the first is after the last")

    def of_several(self, clips: Sequence[Clip]) -> GapFilter:
        """Return the scope for several clips, people of one file, whose markers need not fit each.

        Raises
        ------
        OptionError
            Where a pattern fits a marker of none of them.
        """
        for pattern in self.markers:
            if not any(fitting(clip, pattern) for clip in clips):
                self._refuse(clips, pattern)
        return replace(self, strict=len(clips) == 1)

    def left_alone(self, clip: Clip) -> list[tuple[Gap, str]]:
        """Return what of a clip's gaps is not to be filled, and why.

        Raises
        ------
        OptionError
            Where a pattern fits no marker of the clip, or the frames are not its own.
        """
        wanted = self._wanted(clip)
        within = self._within(clip)
        left: list[tuple[Gap, str]] = []
        for gap in find_gaps(clip.missing):
            seconds = gap.frames / clip.rate
            if not wanted[gap.marker]:
                left.append((gap, "not one of the markers asked for"))
            elif self.max_gap is not None and seconds > self.max_gap:
                reason = f"longer than {self.max_gap:g} s, the longest gap that is to be filled"
                left.append((gap, reason))
            elif self.skip_edges and (gap.start == 0 or gap.stop == clip.frames):
                left.append((gap, "at the clip's start or end"))
            else:
                outside = ((gap.start, within.start), (within.stop, gap.stop))
                left += [
                    (Gap(max(start, gap.start), min(stop, gap.stop), gap.marker), OUTSIDE)
                    for start, stop in outside
                    if max(start, gap.start) < min(stop, gap.stop)
                ]
        return left

    def _wanted(self, clip: Clip) -> NDArray[np.bool_]:
        """Which markers are asked for [shape=(markers,)]."""
        if not self.markers:
            return np.ones(len(clip.labels), dtype=bool)
        wanted = np.zeros(len(clip.labels), dtype=bool)
        for pattern in self.markers:
            fits = fitting(clip, pattern)
            wanted[fits] = True
            if self.strict and not fits:
                self._refuse([clip], pattern)
        return wanted

    def _refuse(self, clips: Sequence[Clip], pattern: str) -> None:
        """Raise OptionError for a pattern that fits nothing."""
        labels = dict.fromkeys(label for clip in clips for label in clip.labels)
        raise OptionError(
            f"{clips[0].name}: no marker is called {pattern!r}; its markers are {', '.join(labels)}"
        )

    def _within(self, clip: Clip) -> range:
        """Return the frames asked for, counted from 0."""
        first, last = self.frames or (None, None)
        own = (clip.first_frame, clip.first_frame + clip.frames - 1)
        first, last = (own[0] if first is None else first), (own[1] if last is None else last)
        if first > own[1] or last < own[0]:
            raise OptionError(
                f"{clip.name}: has frames {own[0]}-{own[1]}, none of those asked for "
                f"({first}:{last})"
            )
        return range(max(first - own[0], 0), min(last - own[0] + 1, clip.frames))


def fitting(clip: Clip, pattern: str) -> list[int]:
    """Return the markers of a clip that a pattern names.

    Parameters
    ----------
    clip : Clip
        The clip.
    pattern : str
        A label, or a shell pattern of labels; the subject may stand before it (``Anna:L*``).
    """
    names = [(label, f"{clip.subject}:{label}") for label in clip.labels]
    exact = [marker for marker, name in enumerate(names) if pattern in name]
    return exact or [
        marker
        for marker, name in enumerate(names)
        if any(fnmatchcase(one, pattern) for one in name)
    ]
