"""Add the result of a fill to a prior database."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from priorfill.artefacts import without_artefacts
from priorfill.clip import Clip
from priorfill.errors import DuplicateClipError, OutputError
from priorfill.filling.result import Result
from priorfill.formats import format_of, read
from priorfill.runtime.argument_types import check_path, check_result

if TYPE_CHECKING:
    from priorfill.database import ClipRecord

__all__ = ["AddedClip", "add_result", "can_create_database"]


@dataclass(frozen=True)
class AddedClip:
    """What became of adding one filled clip to a database.

    Attributes
    ----------
    subject : str
        The clip's subject.
    record : ClipRecord or None
        Its row in the database; None if it was not added.
    replaced : tuple of ClipRecord
        Rows of earlier versions of the recording, which it replaced.
    message : str
        The same in a sentence.

    See Also
    --------
    add_result : Add the result of a fill to a database.

    Examples
    --------
    >>> AddedClip("anna", None, (), "not added to lab: walk: is in the database already").record
    """

    subject: str
    record: ClipRecord | None
    replaced: tuple[ClipRecord, ...]
    message: str


def add_result(
    database: Path | str,
    result: Result,
    file: Path | str | None = None,
    *,
    reading: Mapping[str, Any] | None = None,
) -> tuple[AddedClip, ...]:
    """Add the result of a fill to a prior database.

    The database keeps a record of which samples were filled, and does not learn from them. A
    version of the recording that it holds, such as the one with gaps, is replaced. Samples of
    artefacts are left out.

    Parameters
    ----------
    database : path
        Its folder; the database is created if there is none.
    result : Result
        Of a fill.
    file : Path or str, optional
        The file that the result was written to. If given, it is read again, so that the database
        holds the same numbers, rounded as the file's format requires, and recognises the file when
        it is added another time.
    reading : mapping of str to object, optional
        How the original file was read, as keyword arguments of `priorfill.read`.

    Returns
    -------
    tuple of AddedClip
        One for each subject. A clip that the database already holds is not added.

    Raises
    ------
    DatabaseError
        Where the database cannot be read or written.
    ClipError
        Where the clip does not qualify: too short, static, without a measured marker.

    See Also
    --------
    priorfill.fill_file : Fill a file and add the result to a database.
    priorfill.PriorDatabase.accept : Add a filled clip with a mask of filled samples.

    Examples
    --------
    >>> import tempfile
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> result = pf.fill(make_demo_clip()[1], method="linear")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     (added,) = pf.add_result(f"{folder}/lab", result)
    >>> added.record.name, added.record.filled_by
    ('synthetic_demo', 'linear')
    """
    from priorfill.database import PriorDatabase  # few fills need it

    if not isinstance(database, PriorDatabase):
        check_path("database", database)
    check_result(result)
    return tuple(
        add_subject(
            database, one, result.clip if len(result.by_subject) > 1 else None, file, reading
        )
        for one in result.by_subject
    )


def add_subject(
    database: Path | str,
    result: Result,
    merged: Clip | None = None,
    file: Path | str | None = None,
    reading: Mapping[str, Any] | None = None,
) -> AddedClip:
    """Add the result of one subject; see `add_result`.

    Parameters
    ----------
    database : path
        Its folder.
    result : Result
        Of one subject.
    merged : Clip, optional
        The clip of all subjects, if the file holds several.
    file : Path or str, optional
        The file that the result was written to.
    reading : mapping of str to object, optional
        How the original file was read.
    """
    from priorfill.database import PriorDatabase  # few fills need it

    clip, source = result.clip, result.clip.source
    if file is not None:
        options = dict(reading or {})
        if source is not None and source.format != format_of(file):
            options |= {"unit": None, "rate": None}  # a new file states them itself
        if merged is not None:
            options["subject"] = clip.subject
        clip = read(file, **options)
    clip, _ = without_artefacts(clip)
    # samples that the original file marks as interpolated were not measured either
    interpolated = None if source is None else source.interpolated
    filled = result.filled if interpolated is None else np.logical_or(result.filled, interpolated)
    subject = result.clip.subject
    with PriorDatabase.open_or_create(database) as opened:
        try:
            if not result.filled.any():  # nothing to accept, but a recording to learn from
                return AddedClip(subject, opened.add(clip), (), f"added to {database}")
            accepted = opened.accept(clip, filled, filled_by=result.method)
        except DuplicateClipError as error:
            return AddedClip(subject, None, (), f"not added to {database}: {error}")
    names = ", ".join(record.name for record in accepted.replaced)
    message = f"added to {database}" + (f" in place of {names}" if names else "")
    return AddedClip(subject, accepted.record, accepted.replaced, message)


def can_create_database(folder: Path) -> bool:
    """Return whether a folder holds no database yet, but one can be created there.

    Parameters
    ----------
    folder : Path
        The folder. Contents that are not a database make this False; opening it reports them.

    Raises
    ------
    OutputError
        Where no database can be created.
    """
    if folder.exists():
        return folder.is_dir() and not any(folder.iterdir())
    if not folder.parent.is_dir():
        raise OutputError(f"{folder}: the folder {folder.parent} does not exist; create it first")
    if not os.access(folder.parent, os.W_OK):
        raise OutputError(f"{folder}: cannot be created; check the permissions of {folder.parent}")
    return True
