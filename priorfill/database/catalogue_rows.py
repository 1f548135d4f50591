"""The tables of a catalogue: how a clip's record becomes a row, and a row a record."""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.database.manifest import FORMAT_VERSION
from priorfill.database.record import ClipRecord
from priorfill.database.record_checks import is_possible

__all__ = [
    "LIVE",
    "SCHEMA",
    "CatalogueRow",
    "StoredRow",
    "fields_of",
    "insert_row",
    "parse_row",
    "row_checksum",
    "select_rows",
]

SCHEMA = f"""
CREATE TABLE IF NOT EXISTS meta (
    name TEXT PRIMARY KEY,
    value
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS label_sets (
    id INTEGER PRIMARY KEY,
    labels TEXT NOT NULL UNIQUE
);
CREATE TABLE IF NOT EXISTS clips (
    id INTEGER PRIMARY KEY,
    content TEXT NOT NULL,
    name TEXT NOT NULL,
    subject TEXT NOT NULL,
    session TEXT NOT NULL,
    source TEXT NOT NULL,
    licence TEXT NOT NULL,
    credit TEXT NOT NULL,
    original_rate REAL NOT NULL,
    original_frames INTEGER NOT NULL,
    frames TEXT NOT NULL,
    label_set INTEGER NOT NULL REFERENCES label_sets (id),
    marker_set TEXT NOT NULL,
    filled_by TEXT NOT NULL,
    filled BLOB,
    present TEXT NOT NULL,
    measured TEXT NOT NULL,
    added TEXT NOT NULL,
    version TEXT NOT NULL,
    synthetic INTEGER NOT NULL,
    virtual_markers INTEGER NOT NULL,
    segment INTEGER NOT NULL,
    offset INTEGER NOT NULL,
    checksums TEXT NOT NULL,
    sketch BLOB NOT NULL,
    added_in INTEGER NOT NULL,
    removed_in INTEGER,
    row_checksum INTEGER NOT NULL
);
CREATE UNIQUE INDEX IF NOT EXISTS place_of_clips
    ON clips (segment, offset) WHERE removed_in IS NULL;
CREATE UNIQUE INDEX IF NOT EXISTS content_of_clips ON clips (content) WHERE removed_in IS NULL;
CREATE TABLE IF NOT EXISTS clips_of_hash (
    hash INTEGER NOT NULL,
    clip INTEGER NOT NULL REFERENCES clips (id),
    PRIMARY KEY (hash, clip)
) WITHOUT ROWID;
PRAGMA user_version = {FORMAT_VERSION};
"""

# columns that are fields of a record, and among these the ones that hold JSON and truth values
_FIELDS = (
    "content",
    "name",
    "subject",
    "session",
    "source",
    "licence",
    "credit",
    "original_rate",
    "original_frames",
    "frames",
    "marker_set",
    "filled_by",
    "present",
    "measured",
    "added",
    "version",
    "synthetic",
    "virtual_markers",
    "segment",
    "offset",
    "checksums",
)
_LISTS = frozenset({"frames", "present", "measured", "checksums"})
_FLAGS = frozenset({"synthetic", "virtual_markers"})


def fields_of(version: int) -> tuple[str, ...]:
    """Return the columns of a format version that are fields of a record."""
    return tuple(name for name in _FIELDS if version != 2 or name != "virtual_markers")


def select_rows(version: int) -> str:
    """Return a statement that selects rows in the order that `StoredRow` expects."""
    return (
        "SELECT clips.id, added_in, removed_in, sketch, row_checksum, labels, filled, "
        f"{', '.join(fields_of(version))} "
        "FROM clips LEFT JOIN label_sets ON label_sets.id = label_set"
    )


LIVE = "added_in <= :state AND (removed_in IS NULL OR removed_in > :state)"
"""Condition for the rows that belong to a state."""


@dataclass(frozen=True, eq=False)
class CatalogueRow:
    """What the catalogue stores of a clip.

    Attributes
    ----------
    record : ClipRecord
        The part that users see.
    filled : bytes or None
        The compressed mask of filled samples, if there are any.
    sketch : ndarray of uint32 [shape=(hashes,)]
        See `priorfill.database.sketch`.
    """

    record: ClipRecord
    filled: bytes | None
    sketch: NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class StoredRow:
    """A row as `SELECT_ROWS` returns it.

    Attributes
    ----------
    id : int
        Primary key.
    added_in, removed_in : int
        Numbers of the changes that added and removed it; `removed_in` may be None.
    sketch : bytes
        Little-endian uint32.
    checksum : int
        As stored.
    labels : str
        JSON.
    filled : bytes or None
        The compressed mask of filled samples.
    fields : list
        The columns that are fields of a record.
    """

    id: int
    added_in: int
    removed_in: int | None
    sketch: bytes
    checksum: int
    labels: str
    filled: bytes | None
    fields: list[Any]

    @classmethod
    def of(cls, row: tuple[Any, ...]) -> StoredRow:
        """Return a row that SQLite returned."""
        key, added_in, removed_in, sketch, checksum, labels, filled, *fields = row
        return cls(key, added_in, removed_in, sketch, checksum, labels, filled, fields)

    def checksum_with(self, removed_in: int | None) -> int:
        """Return the checksum that the row should have if it was removed in a change."""
        fields = [self.filled, *self.fields]
        return row_checksum(fields, self.labels, self.sketch, self.added_in, removed_in)


def insert_row(connection: sqlite3.Connection, row: CatalogueRow, state: int) -> int:
    """Insert a clip as part of a change; return its checksum."""
    record = row.record
    labels = json.dumps(record.labels)
    connection.execute("INSERT OR IGNORE INTO label_sets (labels) VALUES (?)", (labels,))
    values = [_column_value(record, name) for name in _FIELDS]
    sketch = np.ascontiguousarray(row.sketch, dtype="<u4").tobytes()
    checksum = row_checksum([row.filled, *values], labels, sketch, state, None)
    cursor = connection.execute(
        "INSERT INTO clips (label_set, filled, sketch, added_in, row_checksum, "
        f"{', '.join(_FIELDS)}) VALUES ((SELECT id FROM label_sets WHERE labels = ?), "
        f"?, ?, ?, ?{', ?' * len(_FIELDS)})",
        (labels, row.filled, sketch, state, checksum, *values),
    )
    connection.executemany(
        "INSERT INTO clips_of_hash (hash, clip) VALUES (?, ?)",
        ((value, cursor.lastrowid) for value in row.sketch.tolist()),
    )
    return checksum


def _column_value(record: ClipRecord, name: str) -> Any:
    value = getattr(record, name)
    if name in _LISTS:
        return json.dumps(value)
    return int(value) if name in _FLAGS else value


def parse_row(
    row: StoredRow,
    labels: dict[str, tuple[str, ...]],
    rate: float,
    levels: int,
    *,
    version: int,
    checked: bool,
) -> ClipRecord | str:
    """Return the record of a row, or the name in it if the row is damaged.

    Parameters
    ----------
    row : StoredRow
        The row.
    labels : dict
        Cache of parsed label lists: thousands of clips share a few.
    rate : float
        The database's rate (Hz).
    levels : int
        Its number of levels.
    version : int
        The format version.
    checked : bool
        Whether to compare the row with its checksum.
    """
    values = dict(zip(fields_of(version), row.fields, strict=True))
    name = str(values["name"])
    try:
        if checked and row.checksum != row.checksum_with(row.removed_in):
            return name
        if row.labels not in labels:
            labels[row.labels] = tuple(json.loads(row.labels))
        for key in _LISTS:
            values[key] = tuple(json.loads(values[key]))
        values.setdefault("virtual_markers", 0)
        for key in _FLAGS:
            values[key] = bool(values[key])
        record = ClipRecord(**values, labels=labels[row.labels], rate=rate)
        return record if len(record.frames) == levels and is_possible(record) else name
    except (ValueError, TypeError, RecursionError):
        return name


def row_checksum(
    values: Sequence[Any],
    labels: str,
    sketch: bytes,
    added_in: int,
    removed_in: int | None,
) -> int:
    """Return the CRC-32 of a row.

    Parameters
    ----------
    values : sequence
        The compressed mask, then the fields, as they are stored.
    labels, sketch, added_in, removed_in
        As in `StoredRow`.
    """
    filled, *fields = values
    parts = [
        labels,
        *fields,
        None if filled is None else zlib.crc32(filled),
        zlib.crc32(sketch),
        added_in,
        removed_in,
    ]
    return zlib.crc32(json.dumps(parts).encode())
