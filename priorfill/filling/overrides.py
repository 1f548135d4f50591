"""Decisions: what a user has said of single gaps, in a file."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.filling.gap_filter import fitting
from priorfill.gaps import runs
from priorfill.methods import METHODS, resolve

__all__ = ["LEAVE", "MISSING", "Decision", "Override", "Overrides", "read_overrides"]

LEAVE, MISSING = "leave", "missing"
"""What can be done beside filling: leave a gap alone; take measured samples as missing."""

_KEYS = ("marker", "frames", "do", "subject", "note")


@dataclass(frozen=True)
class Decision:
    """What is to be done with some samples.

    Attributes
    ----------
    number : int
        Its place in the file, from 1.
    markers : tuple of str
        Labels, or shell patterns of labels.
    first, last : int or None
        Frames, as the clip numbers them; None: the clip's first, its last.
    do : str
        `LEAVE`, `MISSING`, or the method to fill with.
    subject : str
        Whose markers, in a file of several people; empty: everybody's.
    """

    number: int
    markers: tuple[str, ...]
    first: int | None
    last: int | None
    do: str
    subject: str = ""


@dataclass(frozen=True, eq=False)
class Override:
    """What decisions mean for a clip.

    Attributes
    ----------
    clip : Clip
        The clip without the samples that are to be taken as missing.
    removed : ndarray of bool [shape=(frames, markers)]
        Which these are.
    fate : ndarray of int [shape=(frames, markers)]
        For each missing sample 0, or the number of the decision on what becomes of it.
    notes : tuple of str
        What was removed, and which decisions meet nothing, a sentence each.
    """

    clip: Clip
    removed: NDArray[np.bool_]
    fate: NDArray[np.intp]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Overrides:
    """The decisions of a file.

    Attributes
    ----------
    path : Path
        The file.
    entries : tuple of Decision
        In its order.
    strict : bool
        Whether every decision must fit a clip; else those that do not are of another one.
    """

    path: Path
    entries: tuple[Decision, ...]
    strict: bool = True

    def of_several(self, clips: Sequence[Clip]) -> Overrides:
        """Return the decisions for several clips, people of one file, that need not fit each.

        Raises
        ------
        OptionError
            Where one fits none of them.
        """
        for one in self.entries:
            whose = [clip for clip in clips if one.subject in ("", clip.subject)]
            if not whose:
                raise OptionError(
                    f"{self.path}: gap {one.number}: there is no subject {one.subject}; there are "
                    f"{', '.join(clip.subject for clip in clips)}"
                )
            for pattern in one.markers:
                if not any(fitting(clip, pattern) for clip in whose):
                    raise OptionError(f"{self.path}: gap {one.number}: no marker fits {pattern!r}")
        return replace(self, strict=len(clips) == 1)

    def apply(self, clip: Clip) -> Override:
        """Find what the decisions mean for a clip.

        Parameters
        ----------
        clip : Clip
            The clip.

        Raises
        ------
        OptionError
            Where a marker or frames are not the clip's, or two decisions contradict each other.
        """
        entries = [one for one in self.entries if one.subject in ("", clip.subject)]
        if self.strict and len(entries) < len(self.entries):
            self.of_several([clip])  # which says whose it is
        where = [(one, *self._place(one, clip)) for one in entries]
        removed = np.zeros_like(clip.missing)
        notes = []
        for one, within, markers in where:
            if one.do == MISSING:
                taken = np.zeros_like(removed)
                taken[within.start : within.stop, markers] = True
                taken &= ~clip.missing
                removed |= taken
                if taken.any():
                    notes.append(_told(clip, taken))
                elif self.strict:
                    notes.append(self._idle(one, "measured"))
        missing = clip.missing | removed
        fate = np.zeros(missing.shape, dtype=np.intp)
        by_number = {one.number: one for one in entries}
        for one, within, markers in where:
            if one.do == MISSING:
                continue
            mine = np.zeros_like(missing)
            mine[within.start : within.stop, markers] = True
            mine &= missing
            for number in np.unique(fate[mine & (fate > 0)]):
                if by_number[int(number)].do != one.do:
                    self._refuse(clip, mine & (fate == number), by_number[int(number)], one)
            if one.do == LEAVE and (mine & removed).any():
                frame, marker = np.argwhere(mine & removed)[0]
                raise OptionError(
                    f"{self.path}: {clip.labels[marker]} in frame {clip.first_frame + frame} is "
                    f"to be taken as missing and left alone (gap {one.number}); do one of both"
                )
            fate[mine] = one.number
            if self.strict and not mine.any():
                notes.append(self._idle(one, "missing"))
        positions = np.where(removed[..., None], np.nan, clip.positions)
        return Override(clip.with_positions(positions), removed, fate, tuple(notes))

    def _place(self, one: Decision, clip: Clip) -> tuple[range, list[int]]:
        """Return the frames of a decision, counted from 0, and its markers."""
        markers: dict[int, None] = {}
        for pattern in one.markers:
            fits = fitting(clip, pattern)
            if not fits and self.strict:
                raise OptionError(
                    f"{self.path}: gap {one.number}: no marker of {clip.name} is called "
                    f"{pattern!r}; its markers are {', '.join(clip.labels)}"
                )
            markers |= dict.fromkeys(fits)
        start, end = clip.first_frame, clip.first_frame + clip.frames - 1
        first, last = (start if one.first is None else one.first), one.last
        last = end if last is None else last
        if not start <= first <= last <= end:
            raise OptionError(
                f"{self.path}: gap {one.number}: frames {first}:{last} are not all in {clip.name}, "
                f"which has {start}-{end}"
            )
        return range(first - start, last - start + 1), list(markers)

    def _refuse(self, clip: Clip, both: NDArray[np.bool_], one: Decision, other: Decision) -> None:
        """Raise OptionError for two decisions on the same samples."""
        frame, marker = np.argwhere(both)[0]
        raise OptionError(
            f"{self.path}: gaps {one.number} and {other.number} contradict each other on "
            f"{clip.labels[marker]} in frame {clip.first_frame + frame} ({one.do}, {other.do}); "
            "remove one, or divide the frames between them"
        )

    def _idle(self, one: Decision, what: str) -> str:
        """Say that a decision meets nothing."""
        return f"{self.path}: gap {one.number} changes nothing: nothing is {what} there"


def read_overrides(path: Path) -> Overrides:
    """Read a file of decisions.

    Parameters
    ----------
    path : Path
        TOML; docs/cli.md says what is in it.

    Raises
    ------
    OptionError
        Where it cannot be read, or says what makes no sense.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OptionError(f"{path}: cannot be read ({error.strerror}); check the name") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise OptionError(f"{path}: is no TOML ({error}); correct it") from error
    entries = content.pop("gap", [])
    if content:
        raise OptionError(f"{path}: {next(iter(content))!r} is not known; write [[gap]] tables")
    if not isinstance(entries, list) or not all(isinstance(one, dict) for one in entries):
        raise OptionError(f"{path}: gap is no list of tables; write [[gap]] above each")
    return Overrides(path, tuple(_read(one, n, path) for n, one in enumerate(entries, start=1)))


def _read(entry: dict[str, Any], number: int, path: Path) -> Decision:
    """Read a decision."""
    where = f"{path}: gap {number}"
    unknown = [key for key in entry if key not in _KEYS]
    if unknown:
        raise OptionError(f"{where}: {unknown[0]!r} is not known; it may have {', '.join(_KEYS)}")
    markers = entry.get("marker")
    markers = [markers] if isinstance(markers, str) else markers
    if not (isinstance(markers, list) and markers and all(isinstance(m, str) for m in markers)):
        raise OptionError(f"{where}: has no marker; give a label, a pattern, or a list of these")
    do, subject, frames = entry.get("do"), entry.get("subject", ""), entry.get("frames", ":")
    if not isinstance(do, str) or do not in (LEAVE, MISSING, "auto", *METHODS):
        raise OptionError(
            f"{where}: do is {do!r}; use one of {LEAVE} {MISSING} auto {' '.join(METHODS)}"
        )
    if not isinstance(subject, str):
        raise OptionError(f"{where}: subject is {subject!r}; a name is needed")
    first, last = _frames(frames, where)
    do = do if do in (LEAVE, MISSING) else resolve(do)
    return Decision(number, tuple(markers), first, last, do, subject)


def _frames(value: Any, where: str) -> tuple[int | None, int | None]:
    """Understand 12, "12:40", "12:" and ":40"."""
    if type(value) is int:
        return value, value
    try:
        first, last = (int(part) if part.strip() else None for part in str(value).split(":"))
    except ValueError:
        raise OptionError(
            f'{where}: frames are {value!r}; write "120:180", or a number for one frame'
        ) from None
    if first is not None and last is not None and first > last:
        raise OptionError(f"{where}: frames {first}:{last}: the first is after the last")
    return first, last


def _told(clip: Clip, taken: NDArray[np.bool_]) -> str:
    """Say which samples are taken as missing."""
    labels = [clip.labels[marker] for marker in np.flatnonzero(taken.any(axis=0))]
    spans = [
        f"{clip.first_frame + start}-{clip.first_frame + stop - 1}"
        for start, stop in runs(np.logical_or.reduce(taken, axis=1))
    ]
    return (
        f"taken as missing: {int(taken.sum())} measured samples of {', '.join(labels)} in frames "
        f"{', '.join(spans)}"
    )
