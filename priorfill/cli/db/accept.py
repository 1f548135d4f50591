"""``priorfill db accept``: add filled files, remembering which samples were filled."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.db.common import database_option, origin_options
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
"""What is kept as the method of a fill of which none was given."""


@click.command(short_help="Add filled files, noting what was filled.")
@database_option
@click.option(
    "--original",
    metavar="IN.c3d",
    type=click.Path(path_type=Path),
    help="The file that was filled: what it misses is filled. Or a folder with files of the "
    "same names.",
)
@click.option(
    "--method",
    metavar="TEXT",
    default=UNKNOWN_METHOD,
    show_default=True,
    help="What the gaps were filled with.",
)
@origin_options
@file_options
@click.argument(
    "paths", metavar="FILLED.c3d...", nargs=-1, required=True, type=click.Path(path_type=Path)
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
    """Add filled files to a database, with a note of which samples were filled.

    Other versions of the recording that are there, like the one with gaps, are replaced; what is
    not said of origin and licence is taken over from them.

    Which samples were filled is told by --original, else by the file (filled samples have
    residual 0 and measured ones do not), else by the version with gaps that the database has.
    """
    from priorfill.cli.db.adding import put_files, read_file

    _check_method(method)
    if original is not None and not original.is_dir() and (len(paths) > 1 or paths[0].is_dir()):
        raise click.UsageError(
            "--original IN.c3d goes with one filled file; give the folder of the originals"
        )

    def put(target: Target, path: Path) -> tuple[ClipRecord, str]:
        clip = read_file(target.reader, path, subject, **reading)
        before = _original_of(path, original)
        gappy = None if before is None else read_file(target.reader, before, subject, **reading)
        mask = _filled_samples(clip, gappy, target)
        accepted = target.open().accept(
            clip,
            mask,
            filled_by=method,
            subject=subject,
            session=session or "",
            licence=licence or "",
            credit=credit or "",
        )
        instead = ", ".join(record.name for record in accepted.replaced)
        text = f": {mask.sum()} samples filled ({100 * mask.sum() / (~clip.missing).sum():.1f} %)"
        return accepted.record, text + (f", in place of {instead}" if instead else "")

    put_files(folder, paths, put, done="accepted", doing="Accepting", to_do="accept")


def _check_method(method: str) -> None:
    if not method.strip():
        raise OptionError("--method is empty; say what the gaps were filled with, or leave it out")


def _original_of(path: Path, original: Path | None) -> Path | None:
    """Return the file that another was filled from, if that was given."""
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
    """Return which samples of a filled clip are not measured, by the best witness there is."""
    from priorfill.database.masks import mask_by_database, mask_by_original

    says = clip.source.interpolated if clip.source is not None else None
    if gappy is not None:
        mask = mask_by_original(clip, gappy)
        if not mask.any():
            raise OptionError(
                f"{clip.name}: nothing in it is filled, --original has the same samples; "
                "use: priorfill db add"
            )
        # what was interpolated before the fill is no more measured than what was filled
        return mask if says is None else mask | says
    if says is not None and says.any():
        return says
    found = mask_by_database(clip, target.open()) if target.exists else None
    if found is None or not found.any():
        raise OptionError(
            f"{clip.name}: neither its residuals nor the database tell which samples were filled; "
            "give the file it was filled from (--original IN.c3d)"
        )
    return found
