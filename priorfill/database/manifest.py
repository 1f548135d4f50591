"""The manifest of a database: its identity, format version, rate and levels."""

from __future__ import annotations

import json
import math
import re
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from priorfill.errors import DatabaseError, DatabaseFormatError, DatabaseNotFoundError
from priorfill.runtime.atomic_file import finish_file
from priorfill.runtime.display import shell_command
from priorfill.runtime.held_files import is_held, retry_while_held

__all__ = [
    "CATALOGUE",
    "FORMAT_VERSION",
    "MANIFEST",
    "OLDER_VERSIONS",
    "Manifest",
    "new_identity",
    "read_manifest",
    "write_manifest",
]

FORMAT_VERSION = 3
"""Version of the format on disk."""

OLDER_VERSIONS = (1, 2)
"""Versions that can be read, and are converted before they are written to."""

MANIFEST = "priorfill-database.json"
CATALOGUE = "catalogue.sqlite"
_FORMAT = "priorfill prior database"

MAX_RATE = 100_000.0
"""Hz; beyond any camera."""

MAX_LEVELS = 32
"""Maximum number of levels; half the rate of each leaves less than a frame a day beyond."""

MAX_BYTES = 65_536
"""Maximum size of a manifest, which takes 200 bytes."""

_IDENTITY = re.compile(r"[0-9a-f]{32}")


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
    identity : str
        Random, 32 hexadecimal digits; the catalogue and the segments repeat it. Empty in older
        versions.
    converted_from : int or None
        The older version from which the database is being converted. Until the new catalogue is in
        place, that of this version counts.
    """

    version: int
    rate: float
    levels: int
    identity: str = ""
    converted_from: int | None = None


def new_identity() -> str:
    """Return a new random identity."""
    return secrets.token_hex(16)


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write a manifest of the present format version, atomically.

    Parameters
    ----------
    folder : Path
        The database's folder.
    manifest : Manifest
        Its content.

    Raises
    ------
    DatabaseError
        If another program has the present one open, on Windows.
    """
    content = {
        "format": _FORMAT,
        "version": FORMAT_VERSION,
        "id": manifest.identity,
        "rate": float(manifest.rate),
        "levels": int(manifest.levels),
        "unit": "mm",
        "up": "+Z",
    }
    if manifest.converted_from is not None:
        content["converted_from"] = manifest.converted_from
    unfinished = folder / f"{MANIFEST}.new"
    # bytes: on Windows, text would get other line ends
    unfinished.write_bytes((json.dumps(content, indent=2) + "\n").encode("utf-8"))
    try:
        finish_file(unfinished, folder / MANIFEST)
    except OSError as error:
        if not is_held(error):
            raise
        raise DatabaseError(
            f"{folder / MANIFEST}: another program has it open, or it is write-protected; close it "
            "there, or check its permissions, and try again"
        ) from error


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a database.

    Raises
    ------
    DatabaseNotFoundError
        If the folder does not exist.
    DatabaseFormatError
        If the folder is not a database, or has a format version unknown to this priorfill.
    DatabaseError
        If the system refuses to read the manifest.
    """
    if not folder.exists():
        root = Path(folder.absolute().anchor)
        if not root.exists():
            raise DatabaseNotFoundError(
                f"{folder}: there is no {root}; check the drive, or the connection to the share"
            )
        raise DatabaseNotFoundError(
            f"{folder}: there is no database; make one with: "
            f"{shell_command(['priorfill', 'db', 'add', '--database', folder])} ..."
        )
    if not folder.is_dir():
        raise DatabaseNotFoundError(f"{folder}: is a file; give the folder of a database")
    file = folder / MANIFEST
    if not file.is_file():
        remedy = "give the folder of a database"
        if (folder / CATALOGUE).exists():
            remedy = f"{remedy}, or restore {MANIFEST} from a copy"
        raise DatabaseFormatError(
            f"{folder}: is not a priorfill database (it has no {MANIFEST}); {remedy}"
        )
    content = _load(file)
    try:
        is_ours = content["format"] == _FORMAT
        version = int(content["version"])
    except (ValueError, LookupError, TypeError, OverflowError) as error:
        raise _damaged(file) from error
    if not is_ours:
        raise DatabaseFormatError(
            f"{file}: was not written by priorfill; give the folder of a database"
        )
    if version not in (*OLDER_VERSIONS, FORMAT_VERSION):
        remedy = "install a newer priorfill" if version > FORMAT_VERSION else "restore it"
        raise DatabaseFormatError(
            f"{folder}: has format version {version}, but this priorfill reads versions "
            f"{OLDER_VERSIONS[0]} to {FORMAT_VERSION}; {remedy}"
        )
    return _checked(content, version, file)


def _load(file: Path) -> Any:
    try:
        with retry_while_held(lambda: file.open("rb")) as opened:
            data = opened.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise ValueError("too large")
        return json.loads(data.decode("utf-8"))
    except OSError as error:
        raise DatabaseError(
            f"{file}: cannot be read ({error.strerror or error}); check its permissions"
            f"{', and close it in other programs' if is_held(error) else ''}"
        ) from error
    except (ValueError, RecursionError) as error:
        raise _damaged(file) from error


def _checked(content: Any, version: int, file: Path) -> Manifest:
    try:
        rate, levels = float(content["rate"]), int(content["levels"])
        if not (math.isfinite(rate) and 0 < rate <= MAX_RATE and 1 <= levels <= MAX_LEVELS):
            raise ValueError
    except (ValueError, LookupError, TypeError, OverflowError) as error:
        raise DatabaseFormatError(
            f"{file}: has no valid rate and levels; restore it from a copy"
        ) from error
    if version != FORMAT_VERSION:
        return Manifest(version, rate, levels)
    identity, older = content.get("id"), content.get("converted_from")
    if not isinstance(identity, str) or not _IDENTITY.fullmatch(identity):
        raise DatabaseFormatError(f"{file}: has no valid id; restore it from a copy")
    if older is not None and older not in OLDER_VERSIONS:
        raise _damaged(file)
    return Manifest(version, rate, levels, identity, older)


def _damaged(file: Path) -> DatabaseFormatError:
    return DatabaseFormatError(
        f"{file}: is damaged or was not written by priorfill; restore it from a copy"
    )
