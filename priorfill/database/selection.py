"""Select clips of a prior database by name, subject and markers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from priorfill.runtime.option_checks import check_not_text

if TYPE_CHECKING:
    from priorfill.database.record import ClipRecord

__all__ = ["Selection"]

MIN_HASH_DIGITS = 8
"""Minimum digits of a content hash that select a clip; fewer could be a name."""

_HEX_DIGITS = frozenset("0123456789abcdef")


@dataclass(frozen=True)
class Selection:
    """Criteria for clips; a clip must meet all that are not empty.

    Attributes
    ----------
    names : tuple of str
        Shell patterns of the name, or the first 8 or more digits of the content hash.
    subjects : tuple of str
        Shell patterns of the subject.
    markers : tuple of str
        Markers that a clip must have; case does not matter.
    sessions : tuple of str
        Shell patterns of the session.
    not_names, not_subjects : tuple of str
        Patterns, as above, of clips to exclude.

    See Also
    --------
    PriorDatabase.clips

    Raises
    ------
    OptionError
        Where a field is a text instead of a tuple.

    Examples
    --------
    >>> Selection(names=("walk*",)).choose([])
    ()
    """

    names: tuple[str, ...] = ()
    subjects: tuple[str, ...] = ()
    markers: tuple[str, ...] = ()
    not_names: tuple[str, ...] = ()
    not_subjects: tuple[str, ...] = ()
    sessions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the fields."""
        check_not_text(
            self, "names", "subjects", "markers", "not_names", "not_subjects", "sessions"
        )

    def choose(self, records: Iterable[ClipRecord]) -> tuple[ClipRecord, ...]:
        """Return the selected records in their order."""
        return tuple(record for record in records if self._selects(record))

    def _selects(self, record: ClipRecord) -> bool:
        return (
            (not self.names or _name_matches(record, self.names))
            and (not self.subjects or _matches(record.subject, self.subjects))
            and (not self.sessions or _matches(record.session, self.sessions))
            and _casefolded(self.markers) <= _casefolded(record.labels)
            and not _name_matches(record, self.not_names)
            and not _matches(record.subject, self.not_subjects)
        )


def _casefolded(labels: Iterable[str]) -> set[str]:
    return {label.casefold() for label in labels}


def _matches(text: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatchcase(text, pattern) for pattern in patterns)


def _name_matches(record: ClipRecord, names: tuple[str, ...]) -> bool:
    return _matches(record.name, names) or any(
        len(name) >= MIN_HASH_DIGITS
        and set(name) <= _HEX_DIGITS
        and record.content.startswith(name)
        for name in names
    )
