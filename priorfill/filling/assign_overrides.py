"""Find the samples of a clip that each override applies to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.filling.gap_filter import matching_markers
from priorfill.filling.overrides import LEAVE, MISSING, SWAP, GapOverride, Overrides
from priorfill.gaps import runs

__all__ = ["AppliedOverrides", "apply_overrides", "frames_of"]

_MAX_PLACES = 20
"""Runs of frames, and markers, that a note lists."""


@dataclass(frozen=True, eq=False)
class AppliedOverrides:
    """What overrides mean for a clip.

    Attributes
    ----------
    clip : Clip
        The clip without the samples that are to be treated as missing.
    removed : ndarray of bool [shape=(frames, markers)]
        These samples.
    number : ndarray of int [shape=(frames, markers)]
        For each missing sample the number of the override that applies to it, from 1; 0: none.
    notes : tuple of str
        Samples that were removed, and overrides without effect, a sentence each.
    """

    clip: Clip
    removed: NDArray[np.bool_]
    number: NDArray[np.intp]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Entry:
    """An override that may apply to a clip, and where: all these markers in all these frames."""

    number: int
    entry: GapOverride
    frames: slice
    markers: list[int]

    @property
    def place(self) -> tuple[slice, list[int]]:
        """Index of the samples."""
        return self.frames, self.markers


def apply_overrides(overrides: Overrides, clip: Clip) -> AppliedOverrides:
    """Find the samples of a clip that each override applies to.

    Parameters
    ----------
    overrides : Overrides
        The overrides, as `Overrides.for_subjects` returns them.
    clip : Clip
        The clip, in which markers are exchanged already.

    Raises
    ------
    OptionError
        Where frames are not the clip's, or two overrides contradict each other.
    """
    entries = list(_entries_of(overrides, clip))
    removed, notes = _remove(overrides, clip, entries)
    number, unused = _assign(overrides, clip, removed, entries)
    positions = np.where(removed[..., None], np.nan, clip.positions)
    return AppliedOverrides(clip.with_positions(positions), removed, number, (*notes, *unused))


def frames_of(overrides: Overrides, number: int, clip: Clip) -> slice:
    """Return the frames of an override, counted from 0.

    Parameters
    ----------
    overrides : Overrides
        The overrides.
    number : int
        Number of the override, from 1.
    clip : Clip
        The clip.

    Raises
    ------
    OptionError
        Where the clip does not have them all.
    """
    entry = overrides.entries[number - 1]
    start, end = clip.first_frame, clip.first_frame + clip.frames - 1
    first = start if entry.first is None else entry.first
    last = end if entry.last is None else entry.last
    if not start <= first <= last <= end:
        raise OptionError(
            f"{overrides.name}: gap {number}: frames {first}-{last} are not all in {clip.name}, "
            f"which has {start}-{end}"
        )
    return slice(first - start, last - start + 1)


def _entries_of(overrides: Overrides, clip: Clip) -> Iterator[_Entry]:
    """Yield each override that may apply to a clip, but for exchanges of markers."""
    for number, entry in enumerate(overrides.entries, start=1):
        if entry.is_for(clip) and entry.do != SWAP:
            markers = [
                marker for pattern in entry.markers for marker in matching_markers(clip, pattern)
            ]
            yield _Entry(
                number, entry, frames_of(overrides, number, clip), list(dict.fromkeys(markers))
            )


def _remove(
    overrides: Overrides, clip: Clip, entries: Sequence[_Entry]
) -> tuple[NDArray[np.bool_], list[str]]:
    """Find the measured samples to be treated as missing [shape=(frames, markers)]."""
    missing = clip.missing
    removed, notes = np.zeros_like(missing), []
    for one in entries:
        if one.entry.do != MISSING:
            continue
        taken = ~missing[one.place]
        removed[one.place] |= taken
        if taken.any():
            notes.append(_removal_note(clip, one, taken))
        elif overrides.strict:
            notes.append(_unused(overrides, one.number, "measured"))
    return removed, notes


def _assign(
    overrides: Overrides, clip: Clip, removed: NDArray[np.bool_], entries: Sequence[_Entry]
) -> tuple[NDArray[np.intp], list[str]]:
    """Find the override of each missing sample [shape=(frames, markers)]."""
    missing = clip.missing | removed
    assigned, notes = np.zeros(missing.shape, dtype=np.intp), []
    for one in entries:
        if one.entry.do == MISSING:
            continue
        own = missing[one.place]
        before = assigned[one.place]
        for other in np.unique(before[own & (before > 0)]).tolist():
            if not _agree(overrides.entries[other - 1], one.entry):
                _refuse(overrides, clip, other, one, own & (before == other))
        if one.entry.do == LEAVE:
            _check_left(overrides, clip, one, own & removed[one.place])
        assigned[one.place] = np.where(own, one.number, before)
        if overrides.strict and not own.any():
            notes.append(_unused(overrides, one.number, "missing"))
    return assigned, notes


def _agree(one: GapOverride, two: GapOverride) -> bool:
    """Whether two overrides mean the same for a sample to which both apply."""
    if one.do != two.do:
        return False
    if (one.donors, one.sources, one.options) != (two.donors, two.sources, two.options):
        return False
    return not one.donors or one.markers == two.markers


def _refuse(
    overrides: Overrides, clip: Clip, other: int, one: _Entry, samples: NDArray[np.bool_]
) -> None:
    """Raise OptionError for two overrides that contradict each other on some samples."""
    label, frame = _first(clip, one, samples)
    actions = [overrides.entries[other - 1].do, one.entry.do]
    what = ", ".join(actions) if actions[0] != actions[1] else f"{actions[0]} in two ways"
    raise OptionError(
        f"{overrides.name}: gaps {other} and {one.number} contradict each other on {label} in "
        f"frame {frame} ({what}); remove one, or divide the frames between them"
    )


def _check_left(overrides: Overrides, clip: Clip, one: _Entry, samples: NDArray[np.bool_]) -> None:
    """Raise OptionError where samples are to be treated as missing and left alone."""
    if samples.any():
        label, frame = _first(clip, one, samples)
        raise OptionError(
            f"{overrides.name}: gap {one.number}: {label} in frame {frame} is to be treated as "
            "missing and left alone; remove one of the two"
        )


def _first(clip: Clip, one: _Entry, samples: NDArray[np.bool_]) -> tuple[str, int]:
    """Return marker and frame, as the file numbers it, of the first of some samples."""
    frame, column = np.argwhere(samples)[0]
    return clip.labels[one.markers[column]], clip.first_frame + one.frames.start + int(frame)


def _unused(overrides: Overrides, number: int, state: str) -> str:
    """Return the note on an override that applies to no sample."""
    return f"{overrides.name}: gap {number} has no effect: no sample there is {state}"


def _removal_note(clip: Clip, one: _Entry, taken: NDArray[np.bool_]) -> str:
    """Return the note on measured samples that are treated as missing."""
    labels = [clip.labels[one.markers[column]] for column in np.flatnonzero(taken.any(axis=0))]
    first = clip.first_frame + one.frames.start
    spans = [
        f"{first + start}-{first + stop - 1}"
        for start, stop in runs(np.logical_or.reduce(taken, axis=1))
    ]
    return (
        f"treated as missing: {int(taken.sum())} measured samples of {_listed(labels)} in frames "
        f"{_listed(spans)}"
    )


def _listed(texts: Sequence[str]) -> str:
    """Return texts as far as a note has room."""
    rest = len(texts) - _MAX_PLACES
    return ", ".join([*texts[:_MAX_PLACES], *([f"and {rest} more"] if rest > 0 else [])])
