"""``priorfill db remove``: remove clips from a database."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from priorfill.cli.db.common import (
    database_option,
    session_patterns,
    subject_patterns,
    title,
    total,
)
from priorfill.cli.output import print_line
from priorfill.errors import OptionError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from priorfill.database import ClipRecord

__all__ = ["choose", "remove"]


@click.command(short_help="Remove clips from a database.")
@database_option
@subject_patterns
@session_patterns
@click.option("--dry-run", is_flag=True, help="Only show what would be removed.")
@click.argument("names", metavar="[NAME]...", nargs=-1)
def remove(
    folder: Path,
    subjects: tuple[str, ...],
    sessions: tuple[str, ...],
    dry_run: bool,
    names: tuple[str, ...],
) -> None:
    """Remove clips from a database, all of them or none.

    NAME is a clip's name, a pattern of names (in quotes: 'walk*'), or its id as db list shows it.
    To free the disk space, use: priorfill db compact.
    """
    from priorfill.database import PriorDatabase

    if not (names or subjects or sessions):
        raise click.UsageError("name the clips: NAME... or --subject PATTERN or --session PATTERN")
    with PriorDatabase.open(folder, write=not dry_run) as database:
        records = choose(folder, database.clips(), names, subjects, sessions=sessions)
        if not dry_run:
            database.remove(records)
    done = "would remove" if dry_run else "removed"
    for record in records:
        print_line(f"{done} {title(record)}")
    print_line(f"{done} {total(records)}")


def choose(
    folder: Path,
    records: Sequence[ClipRecord],
    names: Sequence[str],
    subjects: Sequence[str],
    markers: Sequence[str] = (),
    sessions: Sequence[str] = (),
) -> tuple[ClipRecord, ...]:
    """Return the clips that arguments select, ordered by subject and name.

    Parameters
    ----------
    folder : Path
        The database's folder, for messages.
    records : sequence of ClipRecord
        All of its clips.
    names, subjects, markers, sessions : sequence of str
        As in `priorfill.database.Selection`.

    Raises
    ------
    OptionError
        If a name, or the combination, matches no clip.
    """
    from priorfill.database import Selection

    among = Selection(
        subjects=tuple(subjects), markers=tuple(markers), sessions=tuple(sessions)
    ).choose(records)
    rest = []
    if subjects:
        rest.append(f"subject {' or '.join(subjects)}")
    if sessions:
        rest.append(f"session {' or '.join(sessions)}")
    if markers:
        rest.append(f"marker {' and '.join(markers)}")
    of = f" of {' and '.join(rest)}" if rest else ""
    look = f"see: priorfill db list --database {folder}"
    for name in names:
        if not Selection(names=(name,)).choose(among):
            raise OptionError(f"{folder}: no clip{of} is called {name}; {look}")
    if not among and (rest or records):
        raise OptionError(f"{folder}: has no clip{of}; {look}")
    chosen = Selection(names=tuple(names)).choose(among)
    return tuple(sorted(chosen, key=lambda record: (record.subject, record.name, record.content)))
