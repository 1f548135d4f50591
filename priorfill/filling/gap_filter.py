"""Gap filter: which missing samples of a clip are to be filled, and which are left alone."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from numbers import Integral, Real

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.gaps import Gap, find_gaps
from priorfill.runtime.argument_types import check_type
from priorfill.runtime.option_checks import check_not_text
from priorfill.runtime.option_texts import Duration, check_positive, close_or_all, seconds_of

__all__ = ["GapFilter", "matching_markers"]

OUTSIDE = "outside the requested frames"
"""Reason given for the part of a gap that lies outside the requested frames."""


@dataclass(frozen=True)
class GapFilter:
    """The gaps to fill: those that pass every field that is not empty.

    Attributes
    ----------
    markers : tuple of str
        Labels, or shell patterns of labels; see `matching_markers`.
    frames : tuple of (int or None, int or None), optional
        First and last frame in the clip's own numbering; None: the clip's first or last frame.
    max_gap : float or str, optional
        Longest gap to fill, in seconds, or in frames as text (``"10f"``). Longer gaps are left
        alone as a whole.
    skip_edges : bool
        Leave gaps at the clip's start and end alone.
    strict : bool
        Whether each pattern must match a marker of every clip.

    Raises
    ------
    OptionError
        Where `max_gap` is not positive, the first frame is after the last, or `markers` is a text
        instead of a tuple.

    See Also
    --------
    priorfill.fill : Fill the gaps of a clip.

    Examples
    --------
    >>> GapFilter(markers=("L*",), max_gap=0.5).skip_edges
    False
    """

    markers: tuple[str, ...] = ()
    frames: tuple[int | None, int | None] | None = None
    max_gap: Duration | None = None
    skip_edges: bool = False
    strict: bool = True

    def __post_init__(self) -> None:
        """Check the fields."""
        check_not_text(self, "markers")
        check_type("markers", self.markers, Collection, "a tuple of labels or patterns")
        for number, one in enumerate(self.markers):
            check_type(f"markers[{number}]", one, str, "a label or pattern")
        if self.max_gap is not None:
            check_type("max_gap", self.max_gap, (Real, str), "seconds, or frames as '10f'")
            check_positive(self.max_gap, "the longest gap to fill (`max_gap`)")
        if self.frames is not None and not _is_frame_range(self.frames):
            raise OptionError(
                f"`frames` is {self.frames!r}; give the first and the last frame, as (92, 116)"
            )
        if self.frames is not None and None not in self.frames:
            first, last = self.frames
            assert first is not None
            assert last is not None
            if first > last:
                raise OptionError(f"frames {first}-{last}: the first is after the last")

    def for_subjects(self, clips: Sequence[Clip]) -> GapFilter:
        """Return a filter for several subjects of one file; a pattern need not match each.

        Parameters
        ----------
        clips : sequence of Clip
            The clips of the subjects.

        Raises
        ------
        OptionError
            Where a pattern matches no marker of any subject.
        """
        for pattern in self.markers:
            if not any(matching_markers(clip, pattern) for clip in clips):
                self._refuse(clips, pattern)
        return replace(self, strict=len(clips) == 1)

    def left_alone(self, clip: Clip) -> list[tuple[Gap, str]]:
        """Return the gaps, and parts of gaps, that are not to be filled, with the reason.

        Parameters
        ----------
        clip : Clip
            The clip.

        Raises
        ------
        OptionError
            Where a pattern matches no marker of the clip, or it has none of the frames.
        """
        wanted = self._wanted(clip)
        within = self._within(clip)
        longest = np.inf if self.max_gap is None else seconds_of(self.max_gap, clip.rate)
        left: list[tuple[Gap, str]] = []
        for gap in find_gaps(clip.missing):
            seconds = gap.frames / clip.rate
            if not wanted[gap.marker]:
                left.append((gap, "not one of the requested markers"))
            elif seconds > longest:
                limit = f"{longest:g} s"
                if isinstance(self.max_gap, str):
                    limit = f"{round(longest * clip.rate)} frames"
                reason = f"longer than {limit}, the longest gap to be filled"
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
        """Return which markers are requested [shape=(markers,)]."""
        if not self.markers:
            return np.ones(len(clip.labels), dtype=bool)
        wanted = np.zeros(len(clip.labels), dtype=bool)
        for pattern in self.markers:
            matching = matching_markers(clip, pattern)
            wanted[matching] = True
            if self.strict and not matching:
                self._refuse([clip], pattern)
        return wanted

    def _refuse(self, clips: Sequence[Clip], pattern: str) -> None:
        """Raise OptionError for a pattern that matches no marker."""
        labels = dict.fromkeys(label for clip in clips for label in clip.labels)
        raise OptionError(
            f"{clips[0].name}: no marker is called {pattern!r}; {close_or_all(pattern, [*labels])}"
        )

    def _within(self, clip: Clip) -> range:
        """Return the requested frames, counted from 0."""
        first, last = self.frames or (None, None)
        own = (clip.first_frame, clip.first_frame + clip.frames - 1)
        first, last = (own[0] if first is None else first), (own[1] if last is None else last)
        if first > own[1] or last < own[0]:
            raise OptionError(
                f"{clip.name}: has frames {own[0]}-{own[1]}, none of {first}-{last}; "
                "give frames of the clip"
            )
        return range(max(first - own[0], 0), min(last - own[0] + 1, clip.frames))


def _is_frame_range(value: object) -> bool:
    """Return whether a value is a first and a last frame, each a whole number or None."""
    return (
        isinstance(value, (tuple, list))
        and len(value) == 2
        and all(one is None or isinstance(one, Integral) for one in value)
    )


def matching_markers(clip: Clip, pattern: str) -> list[int]:
    """Return the indices of the markers of a clip that match a pattern.

    Parameters
    ----------
    clip : Clip
        The clip.
    pattern : str
        A label, or a shell pattern of labels, in any case; the subject may precede it
        (``Anna:L*``). A label that matches exactly takes precedence.
    """
    prefix = f"{clip.subject}:"
    own = pattern[len(prefix) :] if pattern.startswith(prefix) else pattern
    exact = [marker for marker, label in enumerate(clip.labels) if label in (pattern, own)]
    any_case = pattern.casefold()
    return exact or [
        marker
        for marker, label in enumerate(clip.labels)
        if fnmatchcase(label.casefold(), any_case)
        or fnmatchcase(f"{prefix}{label}".casefold(), any_case)
    ]
