"""Make a new database. It exists once its manifest does, which is written last."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from pathlib import Path

from priorfill.database.create_catalogue import create_catalogue
from priorfill.database.database_lock import LOCK, DatabaseLock
from priorfill.database.manifest import (
    CATALOGUE,
    FORMAT_VERSION,
    MANIFEST,
    Manifest,
    new_identity,
    write_manifest,
)
from priorfill.database.segment_list import SegmentList
from priorfill.database.sqlite_address import sqlite_address
from priorfill.errors import DatabaseFormatError
from priorfill.runtime.disk_flush import flush_folder
from priorfill.runtime.held_files import WINDOWS
from priorfill.runtime.windows_names import length_fault, name_fault

__all__ = ["SEGMENTS", "create_database"]

SEGMENTS = "segments"
"""Name of the folder of the segments."""

_NAMES_INSIDE = len("/catalogue-999.sqlite.new-journal")
"""Length of the longest name in a database."""

_UNFINISHED = re.compile(
    rf"{MANIFEST}\.new|{LOCK}|catalogue\.sqlite\.new(-journal)?|catalogue\.checksum(\.new)?"
)
"""Files that a process may leave that was killed while it made a database."""


def create_database(folder: Path, rate: float, levels: int) -> None:
    """Make a database without clips.

    Parameters
    ----------
    folder : Path
        A folder that does not exist, or is empty; its parent exists.
    rate : float
        Frames per second of level 0 (Hz).
    levels : int
        Number of levels.

    Raises
    ------
    DatabaseFormatError
        If it is a file, or contains other files, or Windows does not take its path.
    DatabaseLockedError
        If another process makes a database there at the same time.
    """
    if WINDOWS:
        _check_name(folder)  # first, as names of devices exist in every folder
    if folder.exists() and not folder.is_dir():
        raise DatabaseFormatError(f"{folder}: is a file; give a folder for the database")
    folder.mkdir(exist_ok=True)
    _check_empty(folder)
    lock = DatabaseLock(folder)
    try:
        _check_empty(folder)  # another process may have made a database meanwhile
        manifest = Manifest(FORMAT_VERSION, float(rate), int(levels), new_identity())
        create_catalogue(folder / CATALOGUE, manifest, (), SegmentList())
        (folder / SEGMENTS).mkdir(exist_ok=True)
        write_manifest(folder, manifest)
        flush_folder(folder.parent)
    finally:
        lock.release()


def _check_name(folder: Path) -> None:
    fault = name_fault(str(folder))
    if fault:
        raise DatabaseFormatError(f"{folder}: {fault}; choose another name for the database")
    fault = length_fault(str(folder), len(str(folder.absolute())) + _NAMES_INSIDE)
    if fault:
        raise DatabaseFormatError(f"{folder}: {fault}")


def _check_empty(folder: Path) -> None:
    for path in sorted(folder.iterdir()):
        if _UNFINISHED.fullmatch(path.name):
            continue
        if path.name == SEGMENTS and path.is_dir() and not any(path.iterdir()):
            continue
        if path.name == CATALOGUE and _is_without_clips(path):
            continue
        remedy = "give an empty or a new folder for a new database"
        if (folder / CATALOGUE).exists() and not (folder / MANIFEST).exists():
            remedy = f"if it is a database, restore {MANIFEST} from a copy; otherwise {remedy}"
        raise DatabaseFormatError(f"{folder}: contains other files ({path.name}); {remedy}")


def _is_without_clips(catalogue: Path) -> bool:
    """Return whether a file is a complete catalogue that never had a clip."""
    try:
        address = sqlite_address(catalogue.absolute(), "ro")
        with closing(sqlite3.connect(address, uri=True)) as connection:
            (version,) = connection.execute("PRAGMA user_version").fetchone()
            found = connection.execute("SELECT value FROM meta WHERE name = 'state'").fetchall()
            return version == FORMAT_VERSION and found == [(0,)]
    except sqlite3.Error:
        return False
