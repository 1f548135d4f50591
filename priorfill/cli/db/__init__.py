"""``priorfill db``: build, inspect and maintain prior databases; one module per command."""

from __future__ import annotations

import click

from priorfill.cli.db.accept import accept
from priorfill.cli.db.add import add
from priorfill.cli.db.compact import compact
from priorfill.cli.db.edit import edit
from priorfill.cli.db.export import export
from priorfill.cli.db.fetch import fetch
from priorfill.cli.db.info import info
from priorfill.cli.db.listing import list_clips
from priorfill.cli.db.merge import merge
from priorfill.cli.db.remove import remove
from priorfill.cli.db.verify import verify

__all__ = ["db"]


@click.group()
def db() -> None:
    """Build, inspect and maintain prior databases."""


for _command in (
    add,
    fetch,
    accept,
    list_clips,
    info,
    verify,
    edit,
    remove,
    compact,
    export,
    merge,
):
    db.add_command(_command)
