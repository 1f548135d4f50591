"""The identity file of a database: that it is one, of which form, at which rate and levels."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from priorfill.database.segments import sync_folder
from priorfill.errors import DatabaseFormatError, DatabaseNotFoundError

__all__ = ["FORMAT_VERSION", "MANIFEST", "Manifest", "read_manifest", "write_manifest"]

FORMAT_VERSION = 2
"""Version of the form on disk. Version 1 is read, and brought to 2 when written to."""

MANIFEST = "priorfill-database.json"
_FORMAT = "priorfill prior database"


@dataclass(frozen=True)
class Manifest:
    """What the identity file says.

    Attributes
    ----------
    version : int
        Format version.
    rate : float
        Frames per second of level 0 (Hz).
    levels : int
        Number of resolutions.
    """

    version: int
    rate: float
    levels: int


def write_manifest(folder: Path, rate: float, levels: int) -> Manifest:
    """Write the identity file of this priorfill's format, whole or not at all.

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
    temporary = folder / f"{MANIFEST}.new"
    with temporary.open("w", encoding="utf-8") as file:
        file.write(json.dumps(content, indent=2) + "\n")
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(folder / MANIFEST)
    sync_folder(folder)
    return Manifest(FORMAT_VERSION, float(rate), int(levels))


def read_manifest(folder: Path) -> Manifest:
    """Read the identity file.

    Raises
    ------
    DatabaseNotFoundError
        Where there is no such folder.
    DatabaseFormatError
        Where the folder is no database, or one of a version that this priorfill does not know.
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
            f"{file}: is damaged or not of priorfill; restore it from a copy"
        ) from error
    if not is_ours:
        raise DatabaseFormatError(f"{file}: is not of priorfill; give the folder of a database")
    if not 1 <= version <= FORMAT_VERSION:
        raise DatabaseFormatError(
            f"{folder}: has format version {version}, this priorfill knows versions 1 to "
            f"{FORMAT_VERSION}; "
            + ("install a newer priorfill" if version > 1 else "restore it from a copy")
        )
    try:
        return Manifest(version, float(content["rate"]), int(content["levels"]))
    except (ValueError, KeyError, TypeError) as error:
        raise DatabaseFormatError(
            f"{file}: has no valid rate and levels; restore it from a copy"
        ) from error
