"""Options and texts shared by the commands of ``priorfill db``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.completion import complete_sessions, complete_subjects
from priorfill.cli.output import duration, print_line
from priorfill.cli.path_types import FOLDER
from priorfill.errors import OptionError
from priorfill.runtime.display import shell_command

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from priorfill.database import ClipRecord, PriorDatabase

__all__ = [
    "ID_DIGITS",
    "choose",
    "clip_facts",
    "count",
    "database_option",
    "json_option",
    "marker_labels",
    "origin_options",
    "session_patterns",
    "size",
    "skipped",
    "subject_patterns",
    "title",
    "total",
    "warn",
    "warn_damaged",
    "warn_leftovers",
]

ID_DIGITS = 8
"""Digits of the content hash that identify a clip in lists and arguments."""

_INTERNAL = ("segment", "offset", "checksums")
"""Fields of a record that concern its storage only."""

database_option = click.option(
    "--database",
    "-d",
    "folder",
    metavar="DIR",
    required=True,
    type=FOLDER,
    help="The database's folder.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
subject_patterns = click.option(
    "--subject",
    "subjects",
    metavar="PATTERN",
    multiple=True,
    shell_complete=complete_subjects,
    help="Only clips of these subjects; can be repeated.",
)
session_patterns = click.option(
    "--session",
    "sessions",
    metavar="PATTERN",
    multiple=True,
    shell_complete=complete_sessions,
    help="Only clips of these sessions; can be repeated.",
)


def _split_labels(
    context: click.Context, option: click.Parameter, texts: tuple[str, ...]
) -> tuple[str, ...]:
    """Return labels that are separated by commas one by one."""
    return tuple(label.strip() for text in texts for label in text.split(",") if label.strip())


marker_labels = click.option(
    "--marker",
    "markers",
    metavar="LABEL",
    multiple=True,
    callback=_split_labels,
    help="Only clips that have this marker; if repeated, clips that have all of them.",
)

_ORIGIN = (
    click.option("--subject", metavar="NAME", help="Subject; by default that of the file."),
    click.option("--session", metavar="NAME", help="Recording session."),
    click.option("--licence", metavar="TEXT", help="Terms of use."),
    click.option("--credit", metavar="TEXT", help="Whom to name."),
)


def origin_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``subject session licence credit``; None if not given."""
    for option in reversed(_ORIGIN):
        command = option(command)
    return command


def clip_facts(record: ClipRecord) -> dict[str, Any]:
    """Return the fields of a record, without those that concern its storage."""
    from dataclasses import asdict

    facts = {key: value for key, value in asdict(record).items() if key not in _INTERNAL}
    return facts | {"has_filled": record.has_filled}


def title(record: ClipRecord) -> str:
    """Return a clip's name, and what distinguishes it from others of the same name."""
    subject = f"{record.subject}, " if record.subject else ""
    return f"{record.name} ({subject}{duration(record.duration)}, {record.content[:ID_DIGITS]})"


def total(records: Iterable[ClipRecord]) -> str:
    """Return the number of clips and their total length: ``23 clips, 1 min 03 s of motion``."""
    records = tuple(records)
    number = count(len(records), "clip")
    if not records:
        return number
    return f"{number}, {duration(sum(r.duration for r in records))} of motion"


def warn(database: PriorDatabase) -> None:
    """Print notes on the state in which a database was found."""
    for note in database.notes:
        print_line(f"note: {note}", err=True)


def warn_leftovers(database: PriorDatabase) -> int:
    """Tell how many bytes wait to be removed; return their number."""
    left = database.info().leftover_bytes
    if left:
        print_line(
            f"note: {size(left)} of replaced or unfinished files wait to be removed, perhaps "
            "because a program has them open; the next command that writes to the database "
            "removes them",
            err=True,
        )
    return left


def warn_damaged(database: PriorDatabase) -> int:
    """Name the clips whose rows are damaged, which are left out; return their number."""
    for name in database.damaged:
        print_line(
            f"priorfill: {database.path}: the catalogue's row of clip {name} is damaged, so it is "
            "left out; restore the database from a copy",
            err=True,
        )
    return len(database.damaged)


def skipped(number: int) -> str:
    """Return text about skipped clips, to follow that about added ones; empty if none."""
    return (
        f", skipped {number} that {'is' if number == 1 else 'are'} there already" if number else ""
    )


def count(number: int, noun: str) -> str:
    """Return ``1 clip``, ``2 clips``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def size(number: int) -> str:
    """Return a number of bytes in a suitable unit."""
    amount = float(number)
    for unit in ("bytes", "kB", "MB"):
        if amount < 1000:
            return f"{amount:.0f} {unit}" if unit == "bytes" else f"{amount:.1f} {unit}"
        amount /= 1000
    return f"{amount:.1f} GB"


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
    of = f" of {' and '.join(rest)}" if rest else ""
    of += f" with marker {' and '.join(markers)}" if markers else ""
    look = f"see: {shell_command(('priorfill', 'db', 'list', '--database', folder))}"
    for name in names:
        if not Selection(names=(name,)).choose(among):
            raise OptionError(f"{folder}: no clip{of} is called {name}; {look}")
    if not among and (of or records):
        raise OptionError(f"{folder}: has no clip{of}; {look}")
    chosen = Selection(names=tuple(names)).choose(among)
    return tuple(sorted(chosen, key=lambda record: (record.subject, record.name, record.content)))
