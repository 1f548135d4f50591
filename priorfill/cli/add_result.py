"""Add to a database what `fill` has written."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from priorfill.cli.reading import read_clip
from priorfill.errors import (
    ClipError,
    DatabaseError,
    DuplicateClipError,
    OutputError,
    PriorfillError,
)

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.database import ClipRecord
    from priorfill.filling.result import Result

__all__ = ["Kept", "facts_of_keeping", "is_to_be_made", "keep", "not_kept"]


class Kept(NamedTuple):
    """What became of adding a filled clip: its row, those that it replaced, and words for it."""

    record: ClipRecord | None
    replaced: tuple[ClipRecord, ...]
    text: str


def is_to_be_made(folder: Path) -> bool:
    """Return whether there is no database in a folder yet, but could be.

    Raises
    ------
    OutputError
        Where none could be made. What is there and no database is for the database to refuse.
    """
    if folder.exists():
        return folder.is_dir() and not any(folder.iterdir())
    if not folder.parent.is_dir():
        raise OutputError(f"{folder}: the folder {folder.parent} is not there; make it first")
    if not os.access(folder.parent, os.W_OK):
        raise OutputError(f"{folder}: cannot be made; check the permissions of {folder.parent}")
    return True


def keep(folder: Path, clip: Clip, output: Path, result: Result, reading: dict[str, Any]) -> Kept:
    """Add what was filled to a database, which is made if it is not there.

    Parameters
    ----------
    folder : Path
        The database's.
    clip : Clip
        As it was, with gaps.
    output : Path
        The filled file. It is read again: so the database has what it holds, rounded to its
        numbers, and knows it when it comes another time.
    result : Result
        What was filled, by which method.
    reading : dict
        The options of `priorfill.cli.reading.reading_options`.

    Raises
    ------
    PriorfillError, OSError
        Where it cannot be added.
    """
    import numpy as np

    from priorfill import formats
    from priorfill.artefacts import without_artefacts
    from priorfill.database import PriorDatabase

    if clip.source is not None and clip.source.format != formats.format_of(output):
        # a new file, which says itself what the options said of the first one
        reading = reading | {"unit": None, "rate": None}
    written, _ = without_artefacts(read_clip(output, **reading)[0])  # nobody shall learn from it
    # what was interpolated before is no more measured than what was filled now
    says = clip.source.interpolated if clip.source is not None else None
    filled = result.filled if says is None else np.logical_or(result.filled, says)
    with PriorDatabase.open_or_create(folder) as database:
        try:
            if not result.filled.any():  # nothing to accept, but a recording to learn from
                return Kept(database.add(written), (), f"added to {folder}")
            accepted = database.accept(written, filled, filled_by=result.method)
        except DuplicateClipError as error:
            return Kept(None, (), f"not added to {folder}: {error}")
    instead = ", ".join(record.name for record in accepted.replaced)
    text = f"added to {folder}" + (f" in place of {instead}" if instead else "")
    return Kept(accepted.record, accepted.replaced, text)


def facts_of_keeping(kept: Kept | None) -> dict[str, Any]:
    """Return what the JSON output says of it; None: it could not be added."""
    record = None if kept is None else kept.record
    return {
        "added": None if record is None else record.content,
        "replaced": [] if kept is None else [old.content for old in kept.replaced],
    }


def not_kept(
    error: PriorfillError | OSError,
    folder: Path,
    file: Path,
    output: Path,
    method: str,
    reading: dict[str, Any],
) -> DatabaseError:
    """Return an error that says what is done, and how to do the rest.

    Parameters
    ----------
    error : PriorfillError or OSError
        Why the filled clip could not be added.
    folder, file, output : Path
        The database's folder, the file with gaps, the filled one.
    method : str
        What filled it.
    reading : dict
        The options of `priorfill.cli.reading.reading_options`.
    """
    reason = str(error)
    if not isinstance(error, PriorfillError):
        reason = f"{folder}: cannot be written ({error.strerror or error})"
    reason += f"; {output} is written but not added"
    if isinstance(error, ClipError):  # no other time will it be taken either
        return DatabaseError(reason)
    line = ["priorfill", "db", "accept", "--database", str(folder), str(output)]
    line += ["--original", str(file), "--method", method]
    for name in ("up", "rate", "unit", "subject"):
        if reading[name] is not None:
            line += [f"--{name}", str(reading[name])]
    if reading["keep_zeros"]:
        line.append("--keep-zeros")
    return DatabaseError(f"{reason}; add it later with: {shlex.join(line)}")
