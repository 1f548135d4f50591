"""What the commands of ``priorfill db`` share: options, and words for what they print."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.output import duration

if TYPE_CHECKING:
    from collections.abc import Iterable

    from priorfill.database import ClipRecord, PriorDatabase

__all__ = [
    "ID_DIGITS",
    "clip_facts",
    "count",
    "database_option",
    "json_option",
    "marker_labels",
    "origin_options",
    "size",
    "skipped",
    "subject_patterns",
    "tell_damaged",
    "title",
    "total",
]

ID_DIGITS = 8
"""First digits of a content hash by which a clip can be named, and is listed."""

_INTERNAL = ("segment", "offset", "checksums")
"""Of a record: where and how its positions are stored, no one's business outside."""

database_option = click.option(
    "--database",
    "-d",
    "folder",
    metavar="DIR",
    required=True,
    type=click.Path(path_type=Path),
    help="The database's folder.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
subject_patterns = click.option(
    "--subject",
    "subjects",
    metavar="PATTERN",
    multiple=True,
    help="Only clips of these subjects; may be given again.",
)
marker_labels = click.option(
    "--marker",
    "markers",
    metavar="LABEL",
    multiple=True,
    help="Only clips that have this marker; may be given again, for clips that have all.",
)

_ORIGIN = (
    click.option("--subject", metavar="NAME", help="Whose motion it is; by default as known."),
    click.option("--session", metavar="NAME", help="Recording session."),
    click.option("--licence", metavar="TEXT", help="Terms under which it may be used."),
    click.option("--credit", metavar="TEXT", help="Whom to name."),
)


def origin_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``subject session licence credit``; None where not given."""
    for option in reversed(_ORIGIN):
        command = option(command)
    return command


def clip_facts(record: ClipRecord) -> dict[str, Any]:
    """Return what a record says of its clip, without where it is stored."""
    from dataclasses import asdict

    facts = {key: value for key, value in asdict(record).items() if key not in _INTERNAL}
    return facts | {"has_filled": record.has_filled}


def title(record: ClipRecord) -> str:
    """Return a clip's name and what tells it from others of that name."""
    whose = f"{record.subject}, " if record.subject else ""
    return f"{record.name} ({whose}{duration(record.duration)}, {record.content[:ID_DIGITS]})"


def total(records: Iterable[ClipRecord]) -> str:
    """Return how many clips there are and how long they are together."""
    records = tuple(records)
    return f"{count(len(records), 'clip')} ({duration(sum(r.duration for r in records))})"


def tell_damaged(database: PriorDatabase) -> int:
    """Name the clips whose rows are damaged, which are not among the clips; return how many."""
    for name in database.damaged:
        click.echo(
            f"priorfill: {database.path}: the catalogue's row of clip {name} is damaged, so it is "
            "left out; restore the database from a copy",
            err=True,
        )
    return len(database.damaged)


def skipped(number: int) -> str:
    """Return how many were skipped, to follow how many were added; nothing for none."""
    return (
        f", skipped {number} that {'is' if number == 1 else 'are'} there already" if number else ""
    )


def count(number: int, noun: str) -> str:
    """Return ``1 clip``, ``2 clips``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def size(number: int) -> str:
    """Return a number of bytes for people."""
    amount = float(number)
    for unit in ("bytes", "kB", "MB"):
        if amount < 1000:
            return f"{amount:.0f} {unit}" if unit == "bytes" else f"{amount:.1f} {unit}"
        amount /= 1000
    return f"{amount:.1f} GB"
