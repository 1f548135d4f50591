"""``priorfill db add``: add files to a database."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.db.common import database_option, origin_options
from priorfill.cli.reading import file_options

if TYPE_CHECKING:
    from priorfill.cli.db.adding import Target
    from priorfill.database import ClipRecord

__all__ = ["add"]


@click.command(short_help="Add files to a database.")
@database_option
@origin_options
@file_options
@click.argument(
    "paths", metavar="PATH...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
def add(
    folder: Path,
    subject: str | None,
    session: str | None,
    licence: str | None,
    credit: str | None,
    paths: tuple[Path, ...],
    **reading: Any,
) -> None:
    """Add files, and the files in folders, to a database; make it if there is none.

    A file whose recording is in it already is skipped. A file that cannot be added is reported
    and the others go on; the exit status is then 1. In a file of several people, --subject says
    whose markers to take.
    """
    from priorfill.cli.db.adding import put_files, read_file

    def put(target: Target, path: Path) -> tuple[ClipRecord, str]:
        clip = read_file(target.reader, path, subject, **reading)
        record = target.open().add(
            clip,
            subject=subject,
            session=session or "",
            licence=licence or "",
            credit=credit or "",
        )
        return record, ""

    put_files(folder, paths, put, done="added", doing="Adding", to_do="add")
