"""The manifest of a database: its format version, rate and levels."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from priorfill.errors import DatabaseFormatError, DatabaseNotFoundError
from priorfill.runtime.atomic_file import finish_file

__all__ = ["FORMAT_VERSION", "MANIFEST", "Manifest", "read_manifest", "write_manifest"]

FORMAT_VERSION = 1
"""Version of the format on disk."""

MANIFEST = "priorfill-database.json"
_FORMAT = "priorfill prior database"


@dataclass(frozen=True)
class Manifest:
    """The content of a manifest.

    Attributes
    ----------
    version : int
        Format version.
    rate : float
        Frames per second of level 0 (Hz).
    levels : int
        Number of levels.
    """

    version: int
    rate: float
    levels: int


def write_manifest(folder: Path, rate: float, levels: int) -> None:
    """Write a manifest of the present format version, atomically.

    Parameters
    ----------
    folder : Path
        The database's folder.
    rate, levels
        See `Manifest`.
    """
    content = {
        "format": _FORMAT,
        "version": FORMAT_VERSION,
        "rate": float(rate),
        "levels": int(levels),
        "unit": "mm",
        "up": "+Z",
    }
    unfinished = folder / f"{MANIFEST}.new"
    unfinished.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    finish_file(unfinished, folder / MANIFEST)


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a database.

    Raises
    ------
    DatabaseNotFoundError
        If the folder does not exist.
    DatabaseFormatError
        If the folder is not a database, or has a format version unknown to this priorfill.
    """
    if not folder.exists():
        raise DatabaseNotFoundError(
            f"{folder}: there is no database; "
            f"make one with: priorfill db add --database {folder} ..."
        )
    if not folder.is_dir():
        raise DatabaseNotFoundError(f"{folder}: is a file; give the folder of a database")
    file = folder / MANIFEST
    if not file.exists():
        raise DatabaseFormatError(
            f"{folder}: is not a priorfill database (it has no {MANIFEST}); "
            "give the folder of a database"
        )
    try:
        content: Any = json.loads(file.read_text(encoding="utf-8"))
        is_ours = content["format"] == _FORMAT
        version = int(content["version"])
    except (ValueError, KeyError, TypeError) as error:
        raise DatabaseFormatError(
            f"{file}: is damaged or was not written by priorfill; restore it from a copy"
        ) from error
    if not is_ours:
        raise DatabaseFormatError(
            f"{file}: was not written by priorfill; give the folder of a database"
        )
    if version != FORMAT_VERSION:
        remedy = "install a newer priorfill" if version > FORMAT_VERSION else "restore it"
        raise DatabaseFormatError(
            f"{folder}: has format version {version}, but this priorfill reads version "
            f"{FORMAT_VERSION}; {remedy}"
        )
    try:
        return Manifest(version, float(content["rate"]), int(content["levels"]))
    except (ValueError, KeyError, TypeError) as error:
        raise DatabaseFormatError(
            f"{file}: has no valid rate and levels; restore it from a copy"
        ) from error
