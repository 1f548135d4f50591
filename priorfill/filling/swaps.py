"""Exchange the measured samples of two markers, as overrides specify, before anything is filled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.filling.assign_overrides import frames_of
from priorfill.filling.gap_filter import matching_markers
from priorfill.filling.override_entries import shown_value, unknown_marker
from priorfill.filling.overrides import SWAP, GapOverride, Overrides

__all__ = ["SwappedClip", "check_swaps", "exchange", "swap_markers"]


@dataclass(frozen=True, eq=False)
class SwappedClip:
    """A clip in which markers were exchanged.

    Attributes
    ----------
    clip : Clip
        With the samples in their new places. Its source records where they were.
    swapped : ndarray of bool [shape=(frames, markers)] or None
        Which of its measured samples are those of another marker of the file; None: none.
    notes : tuple of str
        What was exchanged, and exchanges without effect, a sentence each.
    """

    clip: Clip
    swapped: NDArray[np.bool_] | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Swap:
    """An override that exchanges two markers of a clip."""

    number: int
    frames: slice
    one: int
    two: int


def swap_markers(overrides: Overrides | None, clip: Clip) -> SwappedClip:
    """Exchange the samples of markers of a clip as overrides specify.

    Parameters
    ----------
    overrides : Overrides or None
        They are applied in their order.
    clip : Clip
        The clip as measured.

    Raises
    ------
    OptionError
        Where frames are not the clip's, or a sample is exchanged twice by the same two markers.
    """
    swaps = [] if overrides is None else list(_swaps_of(overrides, clip))
    if overrides is None or not swaps:
        return SwappedClip(clip)
    _check_repeated(overrides, clip, swaps)
    place = np.tile(np.arange(len(clip.labels), dtype=np.intp), (clip.frames, 1))
    notes = []
    for swap in swaps:
        both = [swap.one, swap.two]
        before = np.take_along_axis(clip.missing, place, axis=1)[swap.frames, both]
        place[swap.frames, both] = place[swap.frames, both[::-1]]
        notes.append(_note(overrides, clip, swap, ~before))
    swapped = exchange(clip, place)
    moved = (place != np.arange(len(clip.labels))) & ~swapped.missing
    return SwappedClip(swapped, moved if moved.any() else None, tuple(notes))


def exchange(clip: Clip, place: NDArray[np.intp]) -> Clip:
    """Return a clip in which each marker has the samples of some marker.

    Parameters
    ----------
    clip : Clip
        The clip.
    place : ndarray of int [shape=(frames, markers)]
        The marker whose sample each has; in each frame every marker once.

    Returns
    -------
    Clip
        Its source, if it has one, records the points that the samples are from.
    """
    positions = np.take_along_axis(clip.positions, place[..., None], axis=1)
    source = clip.source
    if source is not None:
        interpolated = source.interpolated
        if interpolated is not None:
            interpolated = np.take_along_axis(interpolated, place, axis=1)
            interpolated.setflags(write=False)
        taken_from = np.take_along_axis(source.point_of_sample(clip.frames), place, axis=1)
        taken_from.setflags(write=False)
        source = replace(source, interpolated=interpolated, taken_from=taken_from)
    return replace(clip, positions=positions, source=source)


def check_swaps(overrides: Overrides, clips: Sequence[Clip]) -> None:
    """Check that each exchange is of two markers of one subject.

    Parameters
    ----------
    overrides : Overrides
        The overrides.
    clips : sequence of Clip
        The clip of each subject of a file.

    Raises
    ------
    OptionError
        Where a marker is unknown, a pattern matches several, both markers are the same, or it is
        unclear which subject is meant.
    """
    for number, entry in enumerate(overrides.entries, start=1):
        if entry.do == SWAP:
            where = f"{overrides.name}: gap {number}"
            _check_swap(entry, [clip for clip in clips if entry.is_for(clip)], where)


def _check_swap(entry: GapOverride, clips: Sequence[Clip], where: str) -> None:
    """Raise OptionError unless an entry exchanges two markers of one of some clips."""
    one, two = entry.markers[0], entry.other
    first, second = ([matching_markers(clip, name) for clip in clips] for name in (one, two))
    for pattern, found in ((one, first), (two, second)):
        if not any(found):
            labels = (label for clip in clips for label in clip.labels)
            raise unknown_marker(where, pattern, clips[0].name, labels)
        for clip, markers in zip(clips, found, strict=True):
            if len(markers) > 1:
                raise OptionError(
                    f"{where}: {shown_value(pattern)} matches {len(markers)} markers "
                    f"({', '.join(clip.labels[marker] for marker in markers[:2])}, ...); swap "
                    "exchanges one with one"
                )
    both = [number for number in range(len(clips)) if first[number] and second[number]]
    if not both:
        raise OptionError(
            f"{where}: {one} and {two} are markers of different subjects; swap exchanges two "
            "markers of one subject"
        )
    if len(both) > 1:
        subjects = " and ".join(clips[number].subject for number in both[:2])
        raise OptionError(f"{where}: {one} and {two} are markers of {subjects}; give the subject")
    if first[both[0]] == second[both[0]]:
        raise OptionError(f"{where}: swaps {one} with itself; give two markers")


def _swaps_of(overrides: Overrides, clip: Clip) -> Iterator[_Swap]:
    """Yield the exchanges of markers of a clip."""
    for number, entry in enumerate(overrides.entries, start=1):
        if entry.do == SWAP and entry.is_for(clip):
            one = matching_markers(clip, entry.markers[0])
            two = matching_markers(clip, entry.other)
            if one and two:
                yield _Swap(number, frames_of(overrides, number, clip), one[0], two[0])


def _check_repeated(overrides: Overrides, clip: Clip, swaps: Sequence[_Swap]) -> None:
    """Raise OptionError where two entries exchange the same markers in a frame."""
    taken: dict[frozenset[int], NDArray[np.intp]] = {}
    for swap in swaps:
        number = taken.setdefault(
            frozenset((swap.one, swap.two)), np.zeros(clip.frames, dtype=np.intp)
        )
        before = np.flatnonzero(number[swap.frames])
        if len(before):
            frame = swap.frames.start + int(before[0])
            raise OptionError(
                f"{overrides.name}: gaps {number[frame]} and {swap.number} both swap "
                f"{clip.labels[swap.one]} and {clip.labels[swap.two]} in frame "
                f"{clip.first_frame + frame}; remove one"
            )
        number[swap.frames] = swap.number


def _note(overrides: Overrides, clip: Clip, swap: _Swap, measured: NDArray[np.bool_]) -> str:
    """Return the note on an exchange [measured: shape=(frames of it, 2)]."""
    labels = f"{clip.labels[swap.one]} and {clip.labels[swap.two]}"
    if not measured.any():
        return f"{overrides.name}: gap {swap.number} has no effect: no sample there is measured"
    first = clip.first_frame + swap.frames.start
    last = clip.first_frame + swap.frames.stop - 1
    return (
        f"swapped: {int(measured.sum())} measured samples of {labels} in "
        f"{f'frames {first}-{last}' if last > first else f'frame {first}'}"
    )
