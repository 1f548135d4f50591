"""Per-gap overrides: what a user wants done with single gaps, read from a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.filling.gap_filter import matching_markers
from priorfill.gaps import runs
from priorfill.methods import ALIASES, METHODS, resolve
from priorfill.runtime.option_checks import check_not_text
from priorfill.runtime.option_texts import close_or_all, parse_frames, parse_names
from priorfill.runtime.toml_file import read_toml

__all__ = ["LEAVE", "MISSING", "AppliedOverrides", "GapOverride", "Overrides", "read_overrides"]

LEAVE, MISSING = "leave", "missing"
"""Actions other than filling: leave a gap alone; treat measured samples as missing."""

_KEYS = ("marker", "frames", "do", "subject", "note")


@dataclass(frozen=True)
class GapOverride:
    """What to do with some samples.

    Attributes
    ----------
    markers : tuple of str
        Labels, or shell patterns of labels.
    do : str
        `LEAVE`, `MISSING`, or the method to fill with.
    first, last : int or None
        First and last frame in the clip's own numbering; None: the clip's first or last frame.
    subject : str
        The subject whose markers are meant, in a file of several; empty: every subject.

    Raises
    ------
    OptionError
        Where there is no such action, or `markers` is a text instead of a tuple.

    Examples
    --------
    >>> GapOverride(("LKNE",), "prior", first=120, last=180).do
    'gpr'

    See Also
    --------
    Overrides : Several of them.
    priorfill.read_overrides : Read them from a file.
    """

    markers: tuple[str, ...]
    do: str
    first: int | None = None
    last: int | None = None
    subject: str = ""

    def __post_init__(self) -> None:
        """Check the markers, and replace an alias of a method by its name."""
        check_not_text(self, "markers")
        if self.do not in (LEAVE, MISSING):
            object.__setattr__(self, "do", resolve(self.do))


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
class Overrides:
    """The overrides for the gaps of a file.

    Attributes
    ----------
    entries : tuple of GapOverride
        They are numbered from 1 in messages.
    path : Path, optional
        The file they were read from.
    strict : bool
        Whether each entry must match a marker of every clip; otherwise it may be meant for another
        subject.

    See Also
    --------
    read_overrides : Read them from a file.
    priorfill.fill : Fill the gaps of a clip.

    Examples
    --------
    >>> overrides = Overrides((GapOverride(("LFIN", "RFIN"), "leave"),))
    >>> overrides.entries[0].do
    'leave'
    """

    entries: tuple[GapOverride, ...]
    path: Path | None = None
    strict: bool = True

    @property
    def name(self) -> str:
        """The file's name in messages."""
        return "overrides" if self.path is None else str(self.path)

    def for_subjects(self, clips: Sequence[Clip]) -> Overrides:
        """Return the overrides for several subjects of one file; an entry need not match each.

        Parameters
        ----------
        clips : sequence of Clip
            The clips of the subjects.

        Raises
        ------
        OptionError
            Where an entry matches no marker of any subject.
        """
        for number, entry in enumerate(self.entries, start=1):
            meant = [clip for clip in clips if entry.subject in ("", clip.subject)]
            if not meant:
                raise OptionError(
                    f"{self.name}: gap {number}: there is no subject {entry.subject}; "
                    f"{close_or_all(entry.subject, [clip.subject for clip in clips])}"
                )
            for pattern in entry.markers:
                if not any(matching_markers(clip, pattern) for clip in meant):
                    labels = dict.fromkeys(label for clip in meant for label in clip.labels)
                    raise OptionError(
                        f"{self.name}: gap {number}: no marker of {meant[0].name} is called "
                        f"{pattern!r}; {close_or_all(pattern, [*labels])}"
                    )
        return replace(self, strict=len(clips) == 1)

    def apply(self, clip: Clip) -> AppliedOverrides:
        """Find the samples of a clip that each override applies to.

        Parameters
        ----------
        clip : Clip
            The clip.

        Raises
        ------
        OptionError
            Where a marker or frames are not the clip's, or two overrides contradict each other.
        """
        if self.strict:
            self.for_subjects([clip])
        entries = list(self._entries_of(clip))
        removed, notes = self._remove(clip, entries)
        number, unused = self._assign(clip, removed, entries)
        positions = np.where(removed[..., None], np.nan, clip.positions)
        return AppliedOverrides(clip.with_positions(positions), removed, number, (*notes, *unused))

    def _entries_of(self, clip: Clip) -> Iterator[tuple[int, GapOverride, NDArray[np.bool_]]]:
        """Return number, entry and samples of each override that may apply to a clip."""
        for number, entry in enumerate(self.entries, start=1):
            if entry.subject not in ("", clip.subject):
                continue
            frames = self._frames(number, entry, clip)
            samples = np.zeros_like(clip.missing)
            for pattern in entry.markers:
                samples[frames.start : frames.stop, matching_markers(clip, pattern)] = True
            yield number, entry, samples

    def _frames(self, number: int, entry: GapOverride, clip: Clip) -> range:
        """Return the frames of an override, counted from 0."""
        start, end = clip.first_frame, clip.first_frame + clip.frames - 1
        first = start if entry.first is None else entry.first
        last = end if entry.last is None else entry.last
        if not start <= first <= last <= end:
            raise OptionError(
                f"{self.name}: gap {number}: frames {first}-{last} are not all in {clip.name}, "
                f"which has {start}-{end}"
            )
        return range(first - start, last - start + 1)

    def _remove(
        self, clip: Clip, entries: Sequence[tuple[int, GapOverride, NDArray[np.bool_]]]
    ) -> tuple[NDArray[np.bool_], list[str]]:
        """Find the measured samples to be treated as missing [shape=(frames, markers)]."""
        removed, notes = np.zeros_like(clip.missing), []
        for number, entry, samples in entries:
            if entry.do != MISSING:
                continue
            taken = samples & ~clip.missing
            removed |= taken
            if taken.any():
                notes.append(_removal_note(clip, taken))
            elif self.strict:
                notes.append(self._unused(number, "measured"))
        return removed, notes

    def _assign(
        self,
        clip: Clip,
        removed: NDArray[np.bool_],
        entries: Sequence[tuple[int, GapOverride, NDArray[np.bool_]]],
    ) -> tuple[NDArray[np.intp], list[str]]:
        """Find the override of each missing sample [shape=(frames, markers)]."""
        missing = clip.missing | removed
        assigned, notes = np.zeros(missing.shape, dtype=np.intp), []
        for number, entry, samples in entries:
            if entry.do == MISSING:
                continue
            own = samples & missing
            for other in np.unique(assigned[own & (assigned > 0)]).tolist():
                if self.entries[other - 1].do != entry.do:
                    self._refuse(clip, own & (assigned == other), other, number)
            if entry.do == LEAVE and (own & removed).any():
                frame, marker = np.argwhere(own & removed)[0]
                raise OptionError(
                    f"{self.name}: gap {number}: {clip.labels[marker]} in frame "
                    f"{clip.first_frame + frame} is to be treated as missing and left alone; "
                    "remove one of the two"
                )
            assigned[own] = number
            if self.strict and not own.any():
                notes.append(self._unused(number, "missing"))
        return assigned, notes

    def _refuse(self, clip: Clip, samples: NDArray[np.bool_], one: int, two: int) -> None:
        """Raise OptionError for two overrides that contradict each other on some samples."""
        frame, marker = np.argwhere(samples)[0]
        actions = ", ".join(self.entries[number - 1].do for number in (one, two))
        raise OptionError(
            f"{self.name}: gaps {one} and {two} contradict each other on "
            f"{clip.labels[marker]} in frame {clip.first_frame + frame} ({actions}); "
            "remove one, or divide the frames between them"
        )

    def _unused(self, number: int, state: str) -> str:
        """Return the note on an override that applies to no sample."""
        return f"{self.name}: gap {number} has no effect: no sample there is {state}"


def read_overrides(path: Path | str) -> Overrides:
    r"""Read a file of overrides.

    Parameters
    ----------
    path : Path or str
        A TOML file; docs/cli.md describes its contents.

    Returns
    -------
    Overrides
        For `priorfill.fill`.

    Raises
    ------
    OptionError
        Where the file cannot be read or its contents are invalid.

    See Also
    --------
    priorfill.fill : Fill the gaps of a clip.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "gaps.toml"
    ...     _ = file.write_text('[[gap]]\nmarker = "LKNE"\ndo = "leave"')
    ...     read_overrides(file).entries[0].markers
    ('LKNE',)
    """
    path = Path(path)
    content = read_toml(path, OptionError)
    entries = content.pop("gap", [])
    if content:
        raise OptionError(f"{path}: unknown key {next(iter(content))!r}; write [[gap]] tables")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise OptionError(f"{path}: gap is not a list of tables; write [[gap]] above each")
    return Overrides(
        tuple(_read(entry, f"{path}: gap {n}") for n, entry in enumerate(entries, start=1)), path
    )


def _read(entry: dict[str, Any], where: str) -> GapOverride:
    """Read one override."""
    unknown = [key for key in entry if key not in _KEYS]
    if unknown:
        raise OptionError(f"{where}: unknown key {unknown[0]!r}; use {', '.join(_KEYS)}")
    markers = entry.get("marker")
    markers = list(parse_names(markers)) if isinstance(markers, str) and markers else markers
    if not (isinstance(markers, list) and markers and all(isinstance(m, str) for m in markers)):
        raise OptionError(f"{where}: has no marker; give a label, a pattern, or a list of these")
    do, subject, frames = entry.get("do"), entry.get("subject", ""), entry.get("frames", ":")
    actions = (LEAVE, MISSING, "auto", *METHODS)
    if not isinstance(do, str) or do not in (*actions, *ALIASES):
        raise OptionError(f"{where}: do is {do!r}; {close_or_all(str(do), actions)}")
    if not isinstance(subject, str):
        raise OptionError(f"{where}: subject is {subject!r}; give a name")
    first, last = _read_frames(frames, where)
    return GapOverride(tuple(markers), do, first, last, subject)


def _read_frames(value: Any, where: str) -> tuple[int | None, int | None]:
    """Read a number, or a text as `parse_frames` does."""
    if type(value) is int:
        return value, value
    try:
        return parse_frames(value if isinstance(value, str) else repr(value))
    except OptionError as error:
        raise OptionError(f"{where}: {error}") from None


def _removal_note(clip: Clip, taken: NDArray[np.bool_]) -> str:
    """Return the note on measured samples that are treated as missing."""
    labels = [clip.labels[marker] for marker in np.flatnonzero(taken.any(axis=0))]
    spans = [
        f"{clip.first_frame + start}-{clip.first_frame + stop - 1}"
        for start, stop in runs(np.logical_or.reduce(taken, axis=1))
    ]
    return (
        f"treated as missing: {int(taken.sum())} measured samples of {', '.join(labels)} in frames "
        f"{', '.join(spans)}"
    )
