"""Overrides: what a user wants done with single gaps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.filling.gap_filter import matching_markers
from priorfill.filling.override_entries import (
    ACCEPT,
    ACTIONS,
    LEAVE,
    MISSING,
    SWAP,
    check_entry,
    entry_fields,
    entry_of,
    flat_options,
    shown_value,
    unknown_marker,
)
from priorfill.methods import resolve
from priorfill.runtime.option_checks import check_not_text
from priorfill.runtime.option_texts import close_or_all

__all__ = ["ACCEPT", "LEAVE", "MISSING", "SWAP", "GapOverride", "MadeFor", "Overrides"]


@dataclass(frozen=True)
class GapOverride:
    """What to do with some samples.

    Attributes
    ----------
    markers : tuple of str
        Labels, or shell patterns of labels.
    do : str
        `ACCEPT`: the default method fills, as without the override. `LEAVE`: leave missing.
        `MISSING`: treat measured samples as missing. `SWAP`: exchange the samples of two markers.
        Or the method to fill with.
    first, last : int or None
        First and last frame in the clip's own numbering; None: the clip's first or last frame.
    subject : str
        The subject whose markers are meant, in a file of several; empty: every subject.
    other : str
        The marker to exchange samples with, for `SWAP`.
    donors : tuple of str
        Labels, or shell patterns of labels: the markers that the method sees, besides `markers`;
        empty: all. For a method.
    sources : tuple of str
        What the method learns from: ``clip``, ``same-subject``, ``database``, or
        ``database:PATTERN`` with a shell pattern of names of clips; empty: all. For a method.
    options : mapping of str to object
        Options of the method by dotted name, in addition to those of the fill if its method is the
        same.
    note : str
        Any text.

    Raises
    ------
    OptionError
        Where there is no such action, a field does not apply to it, or `markers`, `donors` or
        `sources` is a text instead of a tuple.

    Examples
    --------
    >>> GapOverride(("LKNE",), "prior", first=120, last=180, donors=("LTHI", "LTIB")).do
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
    other: str = ""
    donors: tuple[str, ...] = ()
    sources: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""

    def __post_init__(self) -> None:
        """Check the fields, and replace an alias of a method by its name."""
        check_not_text(self, "markers", "donors", "sources")
        if self.do not in ACTIONS:
            object.__setattr__(self, "do", resolve(self.do))
        object.__setattr__(self, "options", flat_options(self.options))
        check_entry(self)

    @property
    def is_method(self) -> bool:
        """Whether the samples are filled by a method that the override names."""
        return self.do not in ACTIONS

    def is_for(self, clip: Clip) -> bool:
        """Return whether the markers of a clip, of one subject, may be meant.

        Parameters
        ----------
        clip : Clip
            The clip.
        """
        return self.subject in ("", clip.subject)


@dataclass(frozen=True)
class MadeFor:
    """What overrides were made for; a fill of something else notes the difference.

    Attributes
    ----------
    file : str
        Name of the file, without the folder.
    sha256 : str
        Hash of its bytes; empty: unknown.
    method : str
        The method for gaps without an override; empty: unknown.
    database : str or None
        Content hash of the database; empty: none was used. None: unknown.

    Examples
    --------
    >>> MadeFor("walk.c3d").file
    'walk.c3d'

    See Also
    --------
    Overrides : Their `made_for` is one.
    """

    file: str = ""
    sha256: str = ""
    method: str = ""
    database: str | None = None


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
    made_for : MadeFor, optional
        What they were made for.

    See Also
    --------
    read_overrides : Read them from a file.
    write_overrides : Write them to a file.
    priorfill.fill : Fill the gaps of a clip.

    Examples
    --------
    >>> overrides = Overrides((GapOverride(("LFIN", "RFIN"), "leave"),))
    >>> overrides.entries[0].do
    'leave'
    >>> overrides.to_entries()
    [{'marker': ['LFIN', 'RFIN'], 'do': 'leave'}]
    """

    entries: tuple[GapOverride, ...]
    path: Path | None = None
    strict: bool = True
    made_for: MadeFor | None = None

    @classmethod
    def from_entries(
        cls,
        entries: Iterable[Mapping[str, Any]],
        path: Path | None = None,
        made_for: MadeFor | None = None,
    ) -> Overrides:
        """Make overrides of mappings with the keys of a file of overrides.

        Parameters
        ----------
        entries : iterable of mapping
            As from `to_entries`, or read from JSON or TOML.
        path : Path, optional
            The file that they are from.
        made_for : MadeFor, optional
            What they were made for.

        Raises
        ------
        OptionError
            Where an entry is invalid.
        """
        name = "overrides" if path is None else str(path)
        return cls(
            tuple(
                GapOverride(**entry_fields(entry, f"{name}: gap {number}"))
                for number, entry in enumerate(entries, start=1)
            ),
            path,
            made_for=made_for,
        )

    def to_entries(self) -> list[dict[str, Any]]:
        """Return the entries as dictionaries of texts, numbers and lists, for TOML or JSON.

        Returns
        -------
        list of dict
            With the keys of a file of overrides; those at their defaults are left out.
        """
        return [entry_of(entry) for entry in self.entries]

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
            meant = [clip for clip in clips if entry.is_for(clip)]
            if not meant:
                raise OptionError(
                    f"{self.name}: gap {number}: there is no subject "
                    f"{shown_value(entry.subject)}; {_other_subjects(entry.subject, clips)}"
                )
            for pattern in entry.markers:
                if not any(matching_markers(clip, pattern) for clip in meant):
                    raise unknown_marker(
                        f"{self.name}: gap {number}",
                        pattern,
                        meant[0].name,
                        (label for clip in meant for label in clip.labels),
                    )
        return replace(self, strict=len(clips) == 1)


def _other_subjects(name: str, clips: Sequence[Clip]) -> str:
    """Return what to write in place of an unknown subject, the end of a message."""
    known = [clip.subject for clip in clips if clip.subject]
    return close_or_all(name, known) if known else "the file names none; leave subject out"
