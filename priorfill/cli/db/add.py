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
@click.option(
    "--keep-outliers",
    is_flag=True,
    help="Add samples in trouble (swapped labels, spikes, phantoms, frozen markers), too.",
)
@click.option(
    "--as",
    "placed_as",
    metavar="SET",
    help="Take skeletons' motions (.amc, .bvh) and place this marker set on them, such as 41.",
)
@click.option(
    "--skeleton",
    metavar="X.asf",
    type=click.Path(path_type=Path),
    help="With --as: the skeleton of AMC files; by default the one beside them.",
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
    placed_as: str | None,
    skeleton: Path | None,
    paths: tuple[Path, ...],
    **reading: Any,
) -> None:
    """Add files, and the files in folders, to a database; make it if there is none.

    Samples in trouble (swapped labels, spikes, phantoms, frozen markers) are left out: nothing is
    learnt from them. A file whose recording is in it already is skipped. A file that cannot be
    added is reported and the others go on; the exit status is then 1. In a file of several people,
    --subject says whose markers to take.
    """
    from priorfill.cli.db import skeletons
    from priorfill.cli.db.adding import put_files, read_file, sound
    from priorfill.errors import FormatError, OptionError

    if skeleton is not None and placed_as is None:
        raise OptionError("--skeleton needs --as: say which marker set to place (--as 41)")
    marker_set = None if placed_as is None else skeletons.find_set(placed_as)

    def put(target: Target, path: Path) -> tuple[ClipRecord, str]:
        placed = left_out = ""
        if marker_set is not None:
            if not skeletons.is_skeleton(path):
                raise FormatError(
                    f"{path}: --as places markers on skeletons, and this is no .amc or .bvh file; "
                    "add it without --as"
                )
            clip = skeletons.read_skeleton(path, marker_set, skeleton, **reading)
            if len(clip.labels) < len(marker_set.labels):
                placed = f" ({len(clip.labels)} of {len(marker_set.labels)} markers placed)"
        elif skeletons.is_skeleton(path):
            raise FormatError(
                f"{path}: is a skeleton's motion; say which marker set to place on it (--as 41)"
            )
        else:
            clip = read_file(target.reader, path, subject, **reading)
        if not keep_outliers:
            clip, left_out = sound(clip)
        record = target.open().add(
            clip,
            subject=subject,
            session=session or "",
            licence=licence or "",
            credit=credit or "",
            source=path.name if marker_set is not None else None,
            virtual_markers=marker_set is not None,
        )
        return record, placed + left_out

    suffixes = None if marker_set is None else skeletons.SUFFIXES
    put_files(folder, paths, put, done="added", doing="Adding", to_do="add", suffixes=suffixes)
