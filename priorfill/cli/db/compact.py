"""``priorfill db compact``: free the disk space of removed clips."""

from __future__ import annotations

from pathlib import Path

import click

from priorfill.cli.db.common import database_option, size, warn_leftovers
from priorfill.cli.output import print_line
from priorfill.cli.progress import progress

__all__ = ["compact"]


@click.command(short_help="Free the disk space of removed clips.")
@database_option
def compact(folder: Path) -> None:
    """Free the disk space of clips that were removed or replaced.

    Processes that have the database open for reading are not affected. On Windows, what they read
    is removed later, by the next command that writes to the database.
    """
    from priorfill.database import PriorDatabase

    with PriorDatabase.open(folder, write=True) as database:
        with progress(None, "Moving clips") as show:
            freed = database.compact(show)
        left = warn_leftovers(database)
    print_line(f"{size(freed)} freed" if freed or left else "nothing to free")
