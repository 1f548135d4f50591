"""``priorfill db list``: list the clips of a database."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.completion import complete_clips
from priorfill.cli.db.common import (
    ID_DIGITS,
    clip_facts,
    database_option,
    json_option,
    marker_labels,
    session_patterns,
    subject_patterns,
    warn,
    warn_damaged,
)
from priorfill.cli.output import print_json, print_line, print_table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from priorfill.database import ClipRecord

__all__ = ["list_clips"]

DATE_CHARACTERS = 10
"""Characters of the date in an ISO 8601 time."""

_COLUMNS = (
    "name",
    "id",
    "subject",
    "session",
    "marker set",
    "markers>",
    "s>",
    "Hz>",
    "measured>",
    "added",
    "licence",
    "",
)


@click.command("list")
@database_option
@click.option(
    "--name",
    "names",
    metavar="PATTERN",
    multiple=True,
    shell_complete=complete_clips,
    help="Only clips of these names (or ids); can be repeated.",
)
@subject_patterns
@session_patterns
@marker_labels
@json_option
def list_clips(
    folder: Path,
    names: tuple[str, ...],
    subjects: tuple[str, ...],
    sessions: tuple[str, ...],
    markers: tuple[str, ...],
    as_json: bool,
) -> None:
    """List the clips of a database, or some of them.

    PATTERN is a shell pattern in quotes: "walk*" for all names that begin with walk. The id
    identifies a clip in other commands if several have the same name.
    """
    from priorfill.database import PriorDatabase, Selection

    selection = Selection(names=names, subjects=subjects, sessions=sessions, markers=markers)
    with PriorDatabase.open(folder) as database:
        known = database.clips()
        warn(database)
        warn_damaged(database)
    records = sorted(
        selection.choose(known), key=lambda record: (record.subject, record.name, record.content)
    )
    if as_json:
        print_json([_as_json(record) for record in records])
    elif records:
        print_table(_COLUMNS, (tuple(_row(record)) for record in records))
    elif known:
        print_line(f"{folder}: no clip of {len(known)} matches")
    else:
        print_line(f"{folder}: the database has no clips")


def _row(record: ClipRecord) -> Iterator[str]:
    """Yield a record's cells, in the order of the columns."""
    yield record.name
    yield record.content[:ID_DIGITS]
    yield record.subject or "-"
    yield record.session or "-"
    yield record.marker_set or "-"
    yield str(len(record.labels))
    yield f"{record.duration:.2f}"
    yield f"{record.original_rate:g}"
    yield f"{100 * _measured_share(record):.1f} %"
    yield record.added[:DATE_CHARACTERS]
    yield record.licence or "-"
    yield ", ".join(
        word
        for word, given in (
            ("synthetic", record.synthetic),
            ("virtual markers", record.virtual_markers),
            (f"filled: {record.filled_by}", record.has_filled),
        )
        if given
    )


def _measured_share(record: ClipRecord) -> float:
    return sum(record.measured) / max(1, record.frames[0] * len(record.labels))


def _as_json(record: ClipRecord) -> dict[str, Any]:
    return clip_facts(record) | {"seconds": round(record.duration, 6), "bytes": record.nbytes}
