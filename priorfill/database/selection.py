"""Choose clips of a prior database by name, subject and markers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase

from priorfill.database.record import ClipRecord

__all__ = ["Selection"]

HASH_DIGITS = 8
"""So many digits of a content hash name a clip; fewer could be a name."""

_HEX = frozenset("0123456789abcdef")


@dataclass(frozen=True)
class Selection:
    """Which clips to take: those that every field that is not empty admits.

    Attributes
    ----------
    names : tuple of str
        Shell patterns of the name, or the first digits of the content hash (8 or more).
    subjects : tuple of str
        Shell patterns of the subject.
    markers : tuple of str
        Markers that a clip must have, all of them.
    not_names, not_subjects : tuple of str
        Patterns, as above, of clips to leave out.
    """

    names: tuple[str, ...] = ()
    subjects: tuple[str, ...] = ()
    markers: tuple[str, ...] = ()
    not_names: tuple[str, ...] = ()
    not_subjects: tuple[str, ...] = ()

    def choose(self, records: Iterable[ClipRecord]) -> tuple[ClipRecord, ...]:
        """Return the records that are admitted, in their order."""
        return tuple(record for record in records if self._admits(record))

    def _admits(self, record: ClipRecord) -> bool:
        return (
            (not self.names or _is_called(record, self.names))
            and (not self.subjects or _fits(record.subject, self.subjects))
            and set(self.markers) <= set(record.labels)
            and not _is_called(record, self.not_names)
            and not _fits(record.subject, self.not_subjects)
        )


def _fits(text: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatchcase(text, pattern) for pattern in patterns)


def _is_called(record: ClipRecord, names: tuple[str, ...]) -> bool:
    return _fits(record.name, names) or any(
        len(name) >= HASH_DIGITS and set(name) <= _HEX and record.content.startswith(name)
        for name in names
    )
