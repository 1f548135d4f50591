"""``priorfill db add``: add files to a database."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.db.common import database_option, origin_options
from priorfill.cli.reading import file_options

if TYPE_CHECKING:
    from priorfill.cli.db.adding import Target
    from priorfill.clip import Clip
    from priorfill.database import ClipRecord

__all__ = ["add"]

MAX_NAMES = 6
"""Markers named in a line."""


@click.command(short_help="Add files to a database.")
@database_option
@origin_options
@file_options
@click.option(
    "--keep-outliers",
    is_flag=True,
    help="Add samples in trouble (swapped labels, spikes, phantoms, frozen markers), too.",
)
@click.argument(
    "paths", metavar="PATH...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
def add(
    folder: Path,
    subject: str | None,
    session: str | None,
    licence: str | None,
    credit: str | None,
    keep_outliers: bool,
    paths: tuple[Path, ...],
    **reading: Any,
) -> None:
    """Add files, and the files in folders, to a database; make it if there is none.

    Samples in trouble (swapped labels, spikes, phantoms, frozen markers) are left out: nothing is
    learnt from them. A file whose recording is in it already is skipped. A file that cannot be
    added is reported and the others go on; the exit status is then 1. In a file of several people,
    --subject says whose markers to take.
    """
    from priorfill.cli.db.adding import put_files, read_file

    def put(target: Target, path: Path) -> tuple[ClipRecord, str]:
        clip = read_file(target.reader, path, subject, **reading)
        text = ""
        if not keep_outliers:
            clip, text = _sound(clip)
        record = target.open().add(
            clip,
            subject=subject,
            session=session or "",
            licence=licence or "",
            credit=credit or "",
        )
        return record, text

    put_files(folder, paths, put, done="added", doing="Adding", to_do="add")


def _sound(clip: Clip) -> tuple[Clip, str]:
    """Return a clip without samples in trouble, and what to say of them."""
    from priorfill.trouble import without_trouble

    sound, trouble = without_trouble(clip)
    lost = int((sound.missing & ~clip.missing).sum())
    markers = sorted({label for one in trouble for label in one.markers}, key=clip.labels.index)
    if not lost:
        return clip, ""
    names = " ".join(markers[:MAX_NAMES]) + (" ..." if len(markers) > MAX_NAMES else "")
    return sound, f", without {lost} samples in trouble of {names} (see: priorfill inspect)"
