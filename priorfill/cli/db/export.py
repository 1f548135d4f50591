"""``priorfill db export``: write clips of a database as files."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from priorfill.cli.completion import complete_clips
from priorfill.cli.db.common import (
    ID_DIGITS,
    choose,
    clip_facts,
    count,
    database_option,
    marker_labels,
    session_patterns,
    subject_patterns,
    title,
    total,
    warn,
    warn_damaged,
)
from priorfill.cli.output import print_line
from priorfill.cli.path_types import FOLDER
from priorfill.cli.progress import progress
from priorfill.errors import ClipError, DatabaseCorruptError, OutputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from priorfill.database import ClipRecord, PriorDatabase

__all__ = ["export"]

_NOT_IN_NAMES = re.compile(r'[\x00-\x1f\x7f<>:"/\\|?*]')
"""Characters that some file systems do not allow in names."""

_RESERVED = frozenset(["CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"]) | frozenset(
    f"{device}{digit}" for device in ("COM", "LPT") for digit in "0123456789¹²³"
)
"""Names of devices on Windows, whatever follows after a dot."""

_MAX_NAME_BYTES = 150
"""Maximum bytes of a clip's name in its file's name: file systems allow 255, and the names of
temporary files are longer."""


@click.command(short_help="Write clips as C3D or npz files.")
@database_option
@click.option(
    "--output",
    "-o",
    "output",
    metavar="FOLDER",
    required=True,
    type=FOLDER,
    help="Folder for the files; created if it does not exist.",
)
@click.option(
    "--format",
    "suffix",
    type=click.Choice(["c3d", "npz"]),
    default="c3d",
    show_default=True,
    help="c3d, or npz for NumPy, which also holds the clip's record.",
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
@click.option("--measured-only", is_flag=True, help="Leave out samples that were filled.")
@subject_patterns
@session_patterns
@marker_labels
@click.argument("names", metavar="[NAME]...", nargs=-1, shell_complete=complete_clips)
def export(
    folder: Path,
    output: Path,
    suffix: str,
    overwrite: bool,
    measured_only: bool,
    subjects: tuple[str, ...],
    sessions: tuple[str, ...],
    markers: tuple[str, ...],
    names: tuple[str, ...],
) -> None:
    """Write clips of a database to files, one each: all clips, or those named.

    NAME is a clip's name, a pattern of names (in quotes: "walk*"), or its id as db list shows it.
    The files have the rate of the database, mm, +Z up. A file is named after its clip; the id is
    added to the names of clips that share a name.
    """
    from priorfill.database import PriorDatabase

    with PriorDatabase.open(folder) as database:
        warn(database)
        known = database.clips()
        records = choose(folder, known, names, subjects, markers, sessions)
        stems = _file_stems(known)
        files = {record.content: output / f"{stems[record.content]}.{suffix}" for record in records}
        _prepare(output, folder, list(files.values()), overwrite=overwrite)
        written: list[ClipRecord] = []
        failures = warn_damaged(database)
        with progress(len(records), "Exporting clips") as show:
            for done, record in enumerate(records):
                show(done, None)
                path = files[record.content]
                try:
                    _write(path, database, record, overwrite, measured_only)
                except (ClipError, DatabaseCorruptError) as error:  # the next may be undamaged
                    failures += 1
                    print_line(f"priorfill: {error}", err=True)
                else:
                    written.append(record)
                    print_line(f"{path}: {title(record)}")
    print_line(
        f"exported {total(written)}" + (f", could not export {failures}" if failures else "")
    )
    mixed = sum(record.has_filled for record in written)
    if mixed and suffix == "c3d" and not measured_only:
        print_line(
            f"note: {count(mixed, 'clip')} with filled samples, which these C3D files do not "
            "distinguish from measured ones (--format npz does; --measured-only leaves them out)",
            err=True,
        )
    if failures:
        click.get_current_context().exit(1)


def _prepare(output: Path, folder: Path, files: Sequence[Path], *, overwrite: bool) -> None:
    """Create the folder for the files, and check that they can be written there.

    Raises
    ------
    OutputError
        If they cannot.
    """
    if output.resolve().is_relative_to(folder.resolve()):
        raise OutputError(f"{output}: is inside the database; choose another folder (-o)")
    for path in files:  # a link may lead out of the folder
        if path.is_symlink() or path.parent != output or path.name in ("", ".", ".."):
            raise OutputError(f"{path}: is a link; remove it, or choose another folder (-o)")
    there = [path for path in files if path.exists()]
    if there and not overwrite:
        raise OutputError(
            f"{there[0]}: exists already"
            + (f", and {len(there) - 1} more" if len(there) > 1 else "")
            + "; choose another folder (-o) or use --overwrite"
        )
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{output}: cannot be created ({error.strerror}); choose another folder (-o)"
        ) from error


def _file_stems(records: Sequence[ClipRecord]) -> dict[str, str]:
    """Return the stem of each clip's file name, by content hash.

    All clips of the database count, selected or not, so that a clip's file always has the same
    name.
    """
    stems = {record.content: _safe(record.name) for record in records}
    for digits in (ID_DIGITS, None):  # a name may equal another one with digits
        uses = Counter(_without_case(stem) for stem in stems.values())  # it may not matter
        stems = {
            content: f"{stem}-{content[:digits]}" if uses[_without_case(stem)] > 1 else stem
            for content, stem in stems.items()
        }
    return stems


def _without_case(name: str) -> str:
    """Return what names have in common that a file system without case may take for one.

    Windows compares capital letters, in which the dotless i equals the other one; Python's
    ``casefold`` keeps them apart.
    """
    return name.upper().casefold()


def _safe(name: str) -> str:
    """Return a file name that is valid on all systems and not hidden."""
    from priorfill.database.record_checks import printable

    text = unicodedata.normalize("NFC", printable(name))  # as some file systems store names
    short = _NOT_IN_NAMES.sub("_", text).encode()[:_MAX_NAME_BYTES].decode(errors="ignore")
    stem = short.strip(" .")
    if stem.partition(".")[0].strip().upper() in _RESERVED:
        stem = f"_{stem}"
    return stem or "clip"


def _write(
    path: Path, database: PriorDatabase, record: ClipRecord, overwrite: bool, measured_only: bool
) -> None:
    """Write one clip.

    Raises
    ------
    OutputError
        If it cannot be written.
    ClipError
        If it is too long for the format.
    DatabaseCorruptError
        If it is damaged in the database.
    """
    import numpy as np

    from priorfill.clip import Clip
    from priorfill.formats import create_c3d, create_npz
    from priorfill.formats.c3d.create import MAX_C3D_FRAMES

    database.check(record)
    positions = database.positions(record)
    filled = database.filled(record)
    if filled is None:
        filled = np.zeros(positions.shape[:2], dtype=bool)
    if measured_only:
        positions = np.where(filled[:, :, None], np.float32(np.nan), positions)
        filled = np.zeros_like(filled)
    filled = filled & ~np.isnan(positions[:, :, 0])
    if path.suffix == ".npz":
        create_npz(path, _arrays(record, positions, filled), overwrite=overwrite)
        return
    if record.frames[0] > MAX_C3D_FRAMES:
        raise ClipError(
            f"{record.name}: has {record.frames[0]} frames, C3D holds {MAX_C3D_FRAMES}; "
            "export it with --format npz"
        )
    clip = Clip(
        positions.astype(np.float64),
        record.labels,
        record.rate,
        name=record.name,
        subject=record.subject,
        first_frame=1,
    )
    create_c3d(path, clip, filled=filled, overwrite=overwrite)


def _arrays(
    record: ClipRecord, positions: NDArray[np.float32], filled: NDArray[np.bool_]
) -> dict[str, object]:
    """Return the content of a clip's npz file."""
    facts = clip_facts(record)
    del facts["has_filled"], facts["frames"]  # the arrays contain them
    return facts | {"positions": positions, "filled": filled, "unit": "mm", "up": "+Z"}
