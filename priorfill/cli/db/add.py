"""``priorfill db add``: add files to a database."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.completion import complete_marker_sets
from priorfill.cli.db.common import count, database_option, origin_options
from priorfill.cli.output import print_line
from priorfill.cli.path_types import FILE, PathArgument
from priorfill.cli.reading import file_options

if TYPE_CHECKING:
    from priorfill.cli.db.adding import Target
    from priorfill.clip import Clip
    from priorfill.database import ClipRecord
    from priorfill.markers.marker_set import MarkerSet

__all__ = ["add"]


@click.command(short_help="Add files to a database.")
@database_option
@origin_options
@file_options
@click.option(
    "--keep-artefacts",
    is_flag=True,
    help="Also add artefacts (swapped labels, spikes, ghost markers, stuck markers).",
)
@click.option(
    "--as",
    "placed_as",
    metavar="SET",
    shell_complete=complete_marker_sets,
    help="Read skeleton motions (.amc, .bvh) and compute the virtual markers of this marker set, "
    "such as 41.",
)
@click.option(
    "--skeleton",
    metavar="X.asf",
    type=FILE,
    help="With --as: the skeleton of AMC files; by default the ASF file of the same name.",
)
@click.option(
    "--joints",
    metavar="FILE.toml",
    type=FILE,
    help="With --as: the names of joints by part of the body, where they are not recognised.",
)
@click.option("--verbose", "-v", is_flag=True, help="Print a line for each file.")
@click.argument("paths", metavar="PATH...", nargs=-1, required=True, cls=PathArgument, type=FILE)
def add(
    folder: Path,
    subject: str | None,
    session: str | None,
    licence: str | None,
    credit: str | None,
    keep_artefacts: bool,
    placed_as: str | None,
    skeleton: Path | None,
    joints: Path | None,
    verbose: bool,
    paths: tuple[Path, ...],
    **reading: Any,
) -> None:
    """Add files, and the files in folders, to a database; create it if there is none.

    Artefacts (swapped labels, spikes, ghost markers, stuck markers) are left out. A file is skipped
    if the database has its recording already. A file that cannot be added is reported, the others
    are added, and the exit status is 1; where a PATH leads to nothing, it is 2, and nothing is
    added. In a file of several subjects, --subject selects one.
    """
    from priorfill.cli.db import skeletons
    from priorfill.cli.db.adding import ADD, put_files, read_file, without_artefacts
    from priorfill.database import ClipOrigin
    from priorfill.errors import OptionError

    if skeleton is not None and placed_as is None:
        raise OptionError("--skeleton needs --as; name the marker set to compute (--as 41)")
    if joints is not None and placed_as is None:
        raise OptionError("--joints needs --as; name the marker set to compute (--as 41)")
    marker_set = None if placed_as is None else skeletons.find_set(placed_as)
    options = reading | {
        "skeleton": skeleton,
        "joints": None if joints is None else skeletons.read_joints(joints),
    }
    notes: Counter[str] = Counter()

    def put(target: Target, path: Path) -> tuple[ClipRecord, str]:
        placed = left_out = ""
        about: tuple[str, ...] = ()
        if marker_set is not None:
            clip, placed, about = _read_with_virtual_markers(path, marker_set, options)
        else:
            _refuse_skeleton(path)
            clip = read_file(path, subject, **reading)
        if not keep_artefacts:
            clip, left_out = without_artefacts(clip)
        origin = ClipOrigin(
            subject,
            session or "",
            licence or "",
            credit or "",
            source=path.name if marker_set is not None else None,
            virtual_markers=marker_set is not None,
        )
        record = target.add(clip, origin)
        notes.update(about)
        return record, placed + left_out

    suffixes = None if marker_set is None else skeletons.SUFFIXES
    try:
        put_files(folder, paths, put, ADD, suffixes=suffixes, verbose=verbose)
    finally:
        for note, number in notes.items():
            print_line(f"note: {note}: {count(number, 'file')}", err=True)


def _read_with_virtual_markers(
    path: Path, marker_set: MarkerSet, options: dict[str, Any]
) -> tuple[Clip, str, tuple[str, ...]]:
    """Read a skeleton motion; also return text about lacking markers, and what was assumed."""
    from priorfill.cli.db import skeletons
    from priorfill.errors import FormatError

    if not skeletons.is_skeleton(path):
        raise FormatError(
            f"{path}: is no .amc or .bvh file, and --as computes markers from skeletons only; "
            "add it without --as"
        )
    clip, about = skeletons.read_skeleton(path, marker_set, **options)
    lacking = ""
    if len(clip.labels) < len(marker_set.labels):
        lacking = f" ({len(clip.labels)} of {len(marker_set.labels)} markers computed)"
    return clip, lacking, about


def _refuse_skeleton(path: Path) -> None:
    from priorfill.cli.db import skeletons
    from priorfill.errors import FormatError

    if skeletons.is_skeleton(path):
        raise FormatError(
            f"{path}: is a skeleton motion; name the marker set to compute from it (--as 41)"
        )
