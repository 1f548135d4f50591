"""Read the catalogue of format version 1, which kept less of each clip."""

from __future__ import annotations

import json
import sqlite3
import zlib
from typing import Any

from priorfill.database.record import ClipRecord

__all__ = ["check", "filled", "read"]

FILLED_BY = "unknown"
"""Version 1 did not keep by what samples were filled."""

_FIELDS = (
    "content",
    "name",
    "subject",
    "session",
    "source",
    "licence",
    "credit",
    "original_rate",
    "frames",
    "labels",
    "marker_set",
    "filled",
    "added",
    "version",
    "synthetic",
    "segment",
    "offset",
    "checksums",
)
_ROWS = (
    f"SELECT {', '.join(_FIELDS)}, row_checksum FROM clips "
    "JOIN label_sets ON label_sets.id = label_set"
)


def read(connection: sqlite3.Connection, rate: float) -> tuple[list[ClipRecord], list[str]]:
    """Return the records by content hash, and the names of damaged ones.

    Parameters
    ----------
    connection : sqlite3.Connection
        To the catalogue.
    rate : float
        The database's rate (Hz).
    """
    records, damaged = [], []
    for row in connection.execute(f"{_ROWS} ORDER BY content"):
        record = _parsed(row, rate)
        if record is None:
            damaged.append(str(row[1]))
        else:
            records.append(record)
    return records, damaged


def filled(connection: sqlite3.Connection, content: str) -> bytes | None:
    """Return the packed mask of a clip's synthesised samples, if it has some."""
    row = connection.execute("SELECT filled FROM clips WHERE content = ?", (content,)).fetchone()
    return None if row is None else row[0]


def check(connection: sqlite3.Connection, record: ClipRecord) -> bool:
    """Return whether a record is what was once inserted."""
    row = connection.execute(f"{_ROWS} WHERE content = ?", (record.content,)).fetchone()
    return row is not None and _parsed(row, record.rate) == record


def _parsed(row: tuple[Any, ...], rate: float) -> ClipRecord | None:
    """Return what a row says; None where that makes no sense or was changed."""
    values = dict(zip(_FIELDS, row, strict=False))
    try:
        for name in ("frames", "labels", "checksums"):
            values[name] = tuple(json.loads(values[name]))
        values["synthetic"] = bool(values["synthetic"])
        if row[-1] != _row_checksum(values):
            return None
        mask = values.pop("filled")
        return ClipRecord(
            **values,
            rate=rate,
            original_frames=0,
            filled_by="" if mask is None else FILLED_BY,
            # not kept: as far as anybody can say without reading the positions, everywhere
            present=(values["frames"][0],) * len(values["labels"]),
            measured=(values["frames"][0],) * len(values["labels"]),
        )
    except (ValueError, TypeError):
        return None


def _row_checksum(values: dict[str, Any]) -> int:
    mask = values["filled"]
    return zlib.crc32(
        json.dumps(
            [
                (None if mask is None else zlib.crc32(mask)) if name == "filled" else values[name]
                for name in _FIELDS
            ]
        ).encode()
    )
