"""``priorfill db compact``: give back the space of clips that were removed."""

from __future__ import annotations

from pathlib import Path

import click

from priorfill.cli.db.common import database_option, size
from priorfill.cli.progress import progress

__all__ = ["compact"]


@click.command(short_help="Give back the space of removed clips.")
@database_option
def compact(folder: Path) -> None:
    """Give back the space of clips that were removed or replaced.

    Whoever reads the database meanwhile goes on with what they opened.
    """
    from priorfill.database import PriorDatabase

    with (
        PriorDatabase.open(folder, write=True) as database,
        progress(None, "Moving clips") as show,
    ):
        freed = database.compact(show)
    click.echo(f"{size(freed)} given back" if freed else "nothing to give back")
