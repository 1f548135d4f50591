"""The clips of a database that a fill may learn from, and notes on those left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from priorfill.clip import Clip
from priorfill.errors import DatabaseCorruptError
from priorfill.filling.fill_options import FillOptions
from priorfill.markers.marker_set import MarkerSet
from priorfill.search.takes import Take, takes_from

if TYPE_CHECKING:
    from priorfill.database import ClipRecord, PriorDatabase

__all__ = ["DatabaseTakes"]

MAX_LABELS = 6
"""Number of labels named in a note."""


class DatabaseTakes:
    """The takes of a database that a clip may learn from.

    Versions of the clip's own recording, clips that the selection excludes and damaged clips are
    left out.

    Parameters
    ----------
    clip : Clip
        The clip to be filled.
    database : PriorDatabase or None
        The opened database; without one there are no takes.
    definition : MarkerSet or None
        The marker set whose other spellings of labels count as the same marker.
    options : FillOptions
        The selection, and whether filled samples are learnt from.
    same_subject : sequence of Clip
        Recordings that are learnt from as those of the same subject, and therefore not as clips of
        the database: from one recording under two names, a fill would seem to be more certain than
        it is.
    damaged : mapping of str to DatabaseCorruptError
        Clips known to be damaged, by content hash.

    Attributes
    ----------
    takes : tuple of Take
        The recordings to learn from.
    records : tuple of ClipRecord
        Their rows in the catalogue; rows of clips without a common marker are among them.
    withdrawn : dict of str to DatabaseCorruptError
        Clips found to be damaged after data from them was used, by content hash. A fill based on
        them must be repeated with these as `damaged`.
    """

    def __init__(
        self,
        clip: Clip,
        database: PriorDatabase | None,
        definition: MarkerSet | None,
        options: FillOptions,
        same_subject: Sequence[Clip],
        damaged: Mapping[str, DatabaseCorruptError],
    ) -> None:
        self.takes: tuple[Take, ...] = ()
        self.records: tuple[ClipRecord, ...] = ()
        self.withdrawn: dict[str, DatabaseCorruptError] = {}
        self._notes: list[str] = []
        if database is None:
            return
        self.records = self._choose(clip, database, options, same_subject, damaged)
        if not self.records:
            return
        self.takes = takes_from(
            database,
            self.records,
            clip.labels,
            definition,
            trust_filled=options.trust_filled,
            on_damaged=lambda error: self._notes.append(f"{error}; not learnt from"),
            on_damaged_after_use=self.withdrawn.__setitem__,
        )
        if not self.takes:
            held = sorted({label for record in self.records for label in record.labels})
            self._notes.append(
                f"{database.path}: no marker in common with {clip.name} "
                f"({', '.join(clip.labels[:MAX_LABELS])}, ...); its markers are "
                f"{', '.join(held[:MAX_LABELS])}, ..."
            )

    @property
    def notes(self) -> tuple[str, ...]:
        """Clips left out, with the reason; complete only after the takes were used."""
        return tuple(dict.fromkeys(self._notes))

    def _choose(
        self,
        clip: Clip,
        database: PriorDatabase,
        options: FillOptions,
        same_subject: Sequence[Clip],
        damaged: Mapping[str, DatabaseCorruptError],
    ) -> tuple[ClipRecord, ...]:
        """Return the rows of the clips that may be learnt from."""
        self._notes += database.notes
        self._notes += [
            f"{database.path}: the row of clip {name} is damaged; not learnt from"
            for name in database.damaged
        ]
        records = database.clips()
        if not records:
            self._notes.append(f"{database.path}: the database is empty")
            return ()
        own = database.versions(clip)
        if own:
            self._notes.append(
                f"not learnt from {', '.join(record.name for record in own)}: "
                "of the same recording as the clip"
            )
        self._notes += [f"{error}; not learnt from" for error in damaged.values()]
        known = {record for other in same_subject for record in database.versions(other)}
        chosen = tuple(
            record
            for record in options.selection.choose(records)
            if record not in own and record not in known and record.content not in damaged
        )
        if not chosen:
            self._notes.append(f"{database.path}: no clip is left to learn from")
        return chosen
