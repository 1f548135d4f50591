"""``priorfill db merge``: add the clips of other databases."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import click

from priorfill.cli.db.common import database_option, skipped, total
from priorfill.cli.output import print_line
from priorfill.cli.path_types import FOLDER, PathArgument
from priorfill.cli.progress import progress
from priorfill.errors import OptionError

__all__ = ["merge"]


@click.command(short_help="Add the clips of other databases.")
@database_option
@click.argument(
    "others", metavar="OTHER...", nargs=-1, required=True, cls=PathArgument, type=FOLDER
)
def merge(folder: Path, others: tuple[Path, ...]) -> None:
    """Add the clips of OTHER databases; create DIR if it does not exist.

    Recordings that DIR has already are skipped. Damaged clips are named and left out, and the exit
    status is 1. The databases must have the same rate and levels.
    """
    from priorfill.database import PriorDatabase

    with ExitStack() as stack:
        # wrong names are reported before anything is done
        sources = []
        for other in others:
            if folder.exists() and other.exists() and other.samefile(folder):
                raise OptionError(f"{other}: is the database to merge into; leave it out")
            sources.append(stack.enter_context(PriorDatabase.open(other)))
        first = sources[0]
        folder.parent.mkdir(parents=True, exist_ok=True)
        database = stack.enter_context(
            PriorDatabase.open_or_create(folder, rate=first.rate, levels=first.levels)
        )
        damaged = 0
        for other, source in zip(others, sources, strict=True):
            with progress(None, f"Merging {other}") as show:
                merged = database.merge(source, show)
            damaged += len(merged.damaged)
            for reason in merged.damaged:
                print_line(f"priorfill: {reason}", err=True)
            print_line(
                f"{other}: added {total(merged.added)}{skipped(len(merged.skipped))}"
                + (f", left out {len(merged.damaged)} damaged" if merged.damaged else "")
            )
    if damaged:
        click.get_current_context().exit(1)
