"""``priorfill db verify``: check a database against its checksums."""

from __future__ import annotations

from pathlib import Path

import click

from priorfill.cli.db.common import count, database_option, warn, warn_leftovers
from priorfill.cli.output import print_line
from priorfill.cli.progress import progress

__all__ = ["verify"]


@click.command(short_help="Check a database against its checksums.")
@database_option
def verify(folder: Path) -> None:
    """Check the catalogue and every clip of a database against their checksums."""
    from priorfill.database import PriorDatabase

    with PriorDatabase.open(folder) as database, progress(None, "Checking clips") as show:
        warn(database)
        warn_leftovers(database)
        problems = database.verify(show)
        number = len(database.clips())
    for problem in problems:
        print_line(f"priorfill: {problem}", err=True)
    if problems:
        click.get_current_context().exit(1)
    print_line(f"{count(number, 'clip')} checked, no damage found")
