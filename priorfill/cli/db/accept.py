"""``priorfill db accept``: add filled files with a mask of the filled samples."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.completion import complete_methods
from priorfill.cli.db.common import database_option, origin_options
from priorfill.cli.path_types import FILE, PathArgument
from priorfill.cli.reading import file_options
from priorfill.errors import OptionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from priorfill.cli.db.adding import Target
    from priorfill.clip import Clip
    from priorfill.database import ClipRecord

__all__ = ["accept"]

UNKNOWN_METHOD = "unknown"
"""Recorded as the method if none is given."""


@click.command(short_help="Add filled files with a mask of the filled samples.")
@database_option
@click.option(
    "--original",
    metavar="IN.c3d",
    type=FILE,
    help="The file that was filled: samples missing in it are filled. Or a folder with files of "
    "the same names.",
)
@click.option(
    "--method",
    metavar="TEXT",
    shell_complete=complete_methods,
    default=UNKNOWN_METHOD,
    show_default=True,
    help="The method that filled the gaps.",
)
@origin_options
@file_options
@click.argument(
    "paths", metavar="FILLED.c3d...", nargs=-1, required=True, cls=PathArgument, type=FILE
)
def accept(
    folder: Path,
    original: Path | None,
    method: str,
    subject: str | None,
    session: str | None,
    licence: str | None,
    credit: str | None,
    paths: tuple[Path, ...],
    **reading: Any,
) -> None:
    """Add filled files to a database, and record which samples were filled.

    Other versions of the recording in the database, such as the one with gaps, are replaced.
    Subject, session, licence and credit are taken from them unless given.

    The filled samples are found by comparison with --original, else from the file (residual 0,
    where measured samples have others), else by comparison with the version in the database.
    """
    from priorfill.cli.db.adding import Verb, put_files, read_file
    from priorfill.database import ClipOrigin
    from priorfill.formats.file_bytes import is_there, no_such_file

    _check_method(method)
    if original is not None and not original.is_dir() and (len(paths) > 1 or paths[0].is_dir()):
        raise click.UsageError(
            "--original IN.c3d goes with one filled file; give the folder of the originals"
        )
    if original is not None and not is_there(original):
        raise no_such_file(original)
    origin = ClipOrigin(subject, session or "", licence or "", credit or "")

    def put(target: Target, path: Path) -> tuple[ClipRecord, str]:
        clip = read_file(path, subject, **reading)
        gappy_path = _original_of(path, original)
        gappy = None if gappy_path is None else read_file(gappy_path, subject, **reading)
        mask = _filled_samples(clip, gappy, target)
        accepted = target.open().accept(clip, mask, filled_by=method, origin=origin)
        replaced = ", ".join(record.name for record in accepted.replaced)
        text = f": {mask.sum()} samples filled ({100 * mask.sum() / (~clip.missing).sum():.1f} %)"
        return accepted.record, text + (f", in place of {replaced}" if replaced else "")

    put_files(folder, paths, put, Verb("accept", "accepted", "Accepting"), verbose=True)


def _check_method(method: str) -> None:
    if not method.strip():
        raise OptionError("--method is empty; name the method that filled the gaps, or omit it")


def _original_of(path: Path, original: Path | None) -> Path | None:
    """Return the file that another was filled from, if --original is given."""
    if original is None or not original.is_dir():
        return original
    same_name = original / path.name
    if not same_name.exists():
        raise OptionError(
            f"{path}: there is no {same_name}, the original it was filled from; "
            "give that file with --original"
        )
    return same_name


def _filled_samples(clip: Clip, gappy: Clip | None, target: Target) -> NDArray[np.bool_]:
    """Return which samples of a filled clip are not measured, by the best evidence available."""
    from priorfill.database.masks import mask_by_database, mask_by_original

    interpolated = clip.source.interpolated if clip.source is not None else None
    if gappy is not None:
        mask = mask_by_original(clip, gappy)
        if not mask.any():
            raise OptionError(
                f"{clip.name}: has no filled samples, --original has the same ones; "
                "use: priorfill db add"
            )
        # samples interpolated before the fill are not measured either
        return mask if interpolated is None else mask | interpolated
    if interpolated is not None and interpolated.any():
        return interpolated
    found = mask_by_database(clip, target.open()) if target.exists else None
    if found is None or not found.any():
        raise OptionError(
            f"{clip.name}: neither its residuals nor the database show which samples were filled; "
            "give the file it was filled from (--original IN.c3d)"
        )
    return found
