"""A database in a line, and as a notebook shows it."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING

from priorfill.errors import PriorfillError, escaped
from priorfill.runtime.markup import html_table

if TYPE_CHECKING:
    from priorfill.database.prior_database import PriorDatabase
    from priorfill.database.record import ClipRecord

__all__ = ["database_html", "database_line"]


def database_line(database: PriorDatabase) -> str:
    """Return a database in a line; also of one that is closed or damaged.

    Parameters
    ----------
    database : PriorDatabase
        Open, or closed again.
    """
    try:
        facts = ", ".join(f"{name} {value}" for name, value in _facts(database.clips()))
    except (PriorfillError, OSError, sqlite3.Error):
        facts = "cannot be read"
    return escaped(f"<PriorDatabase {database.path}: {facts}>")


def database_html(database: PriorDatabase) -> str:
    """Return a database as a notebook shows it: its figures, and its clips.

    Parameters
    ----------
    database : PriorDatabase
        Open.
    """
    clips = database.clips()
    rows = [
        (clip.name, clip.subject, clip.marker_set, f"{clip.frames[0] / clip.rate:.1f}")
        for clip in clips
    ]
    return html_table(f"Prior database {database.path}", ("", ""), _facts(clips)) + html_table(
        "Clips", ("name", "subject", "marker set", "s>"), rows
    )


def _facts(clips: tuple[ClipRecord, ...]) -> list[tuple[str, str]]:
    """Return figures of the clips of a database, as names and values."""
    seconds = sum(clip.frames[0] / clip.rate for clip in clips)
    return [
        ("clips", str(len(clips))),
        ("subjects", str(len({clip.subject for clip in clips if clip.subject}))),
        ("length", f"{seconds:.0f} s"),
    ]
