"""Make a catalogue: a file that appears under its name once it is complete."""

from __future__ import annotations

import secrets
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from priorfill.database.catalogue_checksum import CatalogueChecksum
from priorfill.database.catalogue_rows import SCHEMA, CatalogueRow, insert_row
from priorfill.database.manifest import FORMAT_VERSION, Manifest
from priorfill.database.segment_list import SegmentList
from priorfill.errors import DatabaseError
from priorfill.runtime.atomic_file import finish_file
from priorfill.runtime.held_files import retry_while_held

__all__ = ["create_catalogue", "set_durable"]


def create_catalogue(
    path: Path, manifest: Manifest, rows: Iterable[CatalogueRow], segments: SegmentList
) -> None:
    """Make a catalogue.

    Parameters
    ----------
    path : Path
        The file; it must not exist.
    manifest : Manifest
        The database's manifest.
    rows : iterable of CatalogueRow
        Its clips.
    segments : SegmentList
        The segments that hold them.

    Raises
    ------
    DatabaseError
        If it cannot be written.
    """
    unfinished = path.with_name(f"{path.name}.new")
    checksum = CatalogueChecksum(path, FORMAT_VERSION)
    for left in (unfinished, path.with_name(f"{unfinished.name}-journal"), checksum.path):
        retry_while_held(partial(left.unlink, missing_ok=True))
    try:
        with closing(sqlite3.connect(unfinished, isolation_level=None)) as connection:
            set_durable(connection)
            connection.execute("BEGIN IMMEDIATE")
            for statement in SCHEMA.split(";"):
                connection.execute(statement)
            meta: dict[str, Any] = {
                "id": manifest.identity,
                "rate": manifest.rate,
                "levels": manifest.levels,
                "state": 0,
                "rows": 0,
                "digest": 0,
                "segments": segments.to_text(),
                "commit": secrets.token_hex(8),
            }
            for row in rows:
                meta["digest"] ^= insert_row(connection, row, 1)
                meta["rows"] += 1
                meta["state"] = 1
            connection.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
            connection.execute("COMMIT")
            checksum.write(connection)
    except sqlite3.Error as error:
        raise DatabaseError(
            f"{path}: cannot be made ({error}); check free space and permissions"
        ) from error
    finish_file(unfinished, path)


def set_durable(connection: sqlite3.Connection) -> None:
    """Make commits survive a power cut, and keep the file readable on read-only media."""
    # a rollback journal, because a write-ahead log cannot be read on read-only media;
    # EXTRA is FULL and flushes the folder's entry of the journal
    connection.execute("PRAGMA journal_mode = DELETE")
    connection.execute("PRAGMA synchronous = EXTRA")
    connection.execute("PRAGMA fullfsync = ON")  # macOS: F_FULLFSYNC, as in disk_flush
