"""``priorfill db remove``: remove clips from a database."""

from __future__ import annotations

from pathlib import Path

import click

from priorfill.cli.completion import complete_clips
from priorfill.cli.db.common import (
    choose,
    database_option,
    session_patterns,
    subject_patterns,
    title,
    total,
)
from priorfill.cli.output import print_line

__all__ = ["remove"]


@click.command(short_help="Remove clips from a database.")
@database_option
@subject_patterns
@session_patterns
@click.option("--dry-run", is_flag=True, help="Only show what would be removed.")
@click.argument("names", metavar="[NAME]...", nargs=-1, shell_complete=complete_clips)
def remove(
    folder: Path,
    subjects: tuple[str, ...],
    sessions: tuple[str, ...],
    dry_run: bool,
    names: tuple[str, ...],
) -> None:
    """Remove clips from a database, all of them or none.

    NAME is a clip's name, a pattern of names (in quotes: "walk*"), or its id as db list shows it.
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
