"""The catalogue: an SQLite file with one row a clip, whose commit makes the clip exist."""

from __future__ import annotations

import json
import os
import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from priorfill.database.record import ClipRecord
from priorfill.errors import DatabaseCorruptError, DatabaseError

__all__ = ["Catalogue"]

BUSY_SECONDS = 30.0
"""How long to wait while another process commits; a commit takes milliseconds."""

_SCHEMA = """
CREATE TABLE IF NOT EXISTS label_sets (
    id INTEGER PRIMARY KEY,
    labels TEXT NOT NULL UNIQUE
);
CREATE TABLE IF NOT EXISTS clips (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    content TEXT NOT NULL UNIQUE,
    name TEXT NOT NULL,
    subject TEXT NOT NULL,
    session TEXT NOT NULL,
    source TEXT NOT NULL,
    licence TEXT NOT NULL,
    credit TEXT NOT NULL,
    original_rate REAL NOT NULL,
    frames TEXT NOT NULL,
    label_set INTEGER NOT NULL REFERENCES label_sets (id),
    marker_set TEXT NOT NULL,
    filled BLOB,
    added TEXT NOT NULL,
    version TEXT NOT NULL,
    synthetic INTEGER NOT NULL,
    segment INTEGER NOT NULL,
    offset INTEGER NOT NULL,
    checksums TEXT NOT NULL,
    row_checksum INTEGER NOT NULL,
    UNIQUE (segment, offset)
);
"""

_COLUMNS = (
    "content, name, subject, session, source, licence, credit, original_rate, frames, labels, "
    "marker_set, filled IS NOT NULL, added, version, synthetic, segment, offset, checksums"
)


class Catalogue:
    """The rows of a database, as they were when it was opened, and this writer's own.

    Parameters
    ----------
    path : Path
        The SQLite file.
    rate : float
        The database's rate, which every record repeats (Hz).
    write : bool
        Whether rows will be added. A file that is not there is then made; for a reader it
        is a catalogue without rows.

    Raises
    ------
    DatabaseCorruptError
        Here and in every method, where SQLite finds the file damaged.
    """

    def __init__(self, path: Path, rate: float, *, write: bool) -> None:
        self._path = path
        self._rate = rate
        self._connection: sqlite3.Connection | None = None
        if not write and not path.exists():
            self._last = 0
            return
        # A writer that crashed within a commit leaves a journal, which only a connection
        # that may write can roll back.
        journal = path.with_name(path.name + "-journal")
        roll_back = journal.exists() and os.access(path, os.W_OK)
        mode = "rwc" if write else "rw" if roll_back else "ro"
        with self._damage():
            self._connection = sqlite3.connect(
                f"{path.resolve().as_uri()}?mode={mode}",
                uri=True,
                timeout=BUSY_SECONDS,
                isolation_level=None,
            )
            if write:
                # a rollback journal, not a write-ahead log: that could not be read from
                # read-only media. EXTRA is FULL and the folder's entry of the journal.
                self._connection.execute("PRAGMA journal_mode = DELETE")
                self._connection.execute("PRAGMA synchronous = EXTRA")
                self._connection.executescript(f"BEGIN IMMEDIATE; {_SCHEMA} COMMIT;")
            row = self._connection.execute("SELECT COALESCE(MAX(id), 0) FROM clips").fetchone()
            self._last = int(row[0])

    def close(self) -> None:
        """Give the file back."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def records(self) -> list[ClipRecord]:
        """Return every clip, by content hash: an order that does not depend on history."""
        if self._connection is None:
            return []
        with self._damage():
            rows = self._connection.execute(
                f"SELECT {_COLUMNS} FROM clips JOIN label_sets ON label_sets.id = label_set "
                "WHERE clips.id <= ? ORDER BY content",
                (self._last,),
            ).fetchall()
            labels: dict[str, tuple[str, ...]] = {}
            return [self._record(row, labels) for row in rows]

    def has(self, content: str) -> str | None:
        """Return the name of the clip with this content, if it is there."""
        if self._connection is None:
            return None
        with self._damage():
            row = self._connection.execute(
                "SELECT name FROM clips WHERE content = ?", (content,)
            ).fetchone()
        return None if row is None else str(row[0])

    def filled(self, content: str) -> bytes | None:
        """Return the packed mask of a clip's synthesised samples, if it has some."""
        if self._connection is None:
            return None
        with self._damage():
            row = self._connection.execute(
                "SELECT filled FROM clips WHERE content = ?", (content,)
            ).fetchone()
        return None if row is None else row[0]

    def end(self) -> tuple[int, int]:
        """Return the number of the last segment in use and the bytes of it in use."""
        last = (1, 0)
        if self._connection is None:
            return last
        with self._damage():
            row = self._connection.execute(
                f"SELECT {_COLUMNS} FROM clips JOIN label_sets ON label_sets.id = label_set "
                "ORDER BY segment DESC, offset DESC LIMIT 1"
            ).fetchone()
            if row is not None:
                record = self._record(row, {})
                last = (record.segment, record.offset + record.nbytes)
        return last

    def insert(self, record: ClipRecord, filled: bytes | None) -> None:
        """Add a clip and commit."""
        assert self._connection is not None
        labels = json.dumps(record.labels)
        with self._damage():
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                self._connection.execute(
                    "INSERT OR IGNORE INTO label_sets (labels) VALUES (?)", (labels,)
                )
                cursor = self._connection.execute(
                    "INSERT INTO clips (content, name, subject, session, source, licence, "
                    "credit, original_rate, frames, label_set, marker_set, filled, added, "
                    "version, synthetic, segment, offset, checksums, row_checksum) VALUES "
                    "(?, ?, ?, ?, ?, ?, ?, ?, ?, (SELECT id FROM label_sets WHERE labels = ?), "
                    "?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (
                        record.content,
                        record.name,
                        record.subject,
                        record.session,
                        record.source,
                        record.licence,
                        record.credit,
                        record.original_rate,
                        json.dumps(record.frames),
                        labels,
                        record.marker_set,
                        filled,
                        record.added,
                        record.version,
                        record.synthetic,
                        record.segment,
                        record.offset,
                        json.dumps(record.checksums),
                        _row_checksum(record, filled),
                    ),
                )
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise
            self._last = cursor.lastrowid or self._last

    def check(self, record: ClipRecord) -> bool:
        """Return whether a record is what was once inserted."""
        if self._connection is None:
            return False
        with self._damage():
            row = self._connection.execute(
                "SELECT filled, row_checksum FROM clips WHERE content = ?", (record.content,)
            ).fetchone()
        return row is not None and row[1] == _row_checksum(record, row[0])

    def check_file(self) -> None:
        """Let SQLite check the file's structure.

        Raises
        ------
        DatabaseCorruptError
            Where it finds damage.
        """
        if self._connection is None:
            return
        with self._damage():
            row = self._connection.execute("PRAGMA integrity_check(1)").fetchone()
        if row[0] != "ok":
            raise self._damaged(str(row[0]))

    def _record(
        self, row: tuple[object, ...], known_labels: dict[str, tuple[str, ...]]
    ) -> ClipRecord:
        values: list[object] = list(row)
        text = str(values[9])
        if text not in known_labels:  # thousands of clips share a few lists of labels
            known_labels[text] = tuple(json.loads(text))
        values[8] = tuple(json.loads(str(values[8])))
        values[9] = known_labels[text]
        values[11] = bool(values[11])
        values[14] = bool(values[14])
        values[17] = tuple(json.loads(str(values[17])))
        values.insert(8, self._rate)
        return ClipRecord(*values)  # type: ignore[arg-type] # as SQLite gives them

    @contextmanager
    def _damage(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.OperationalError as error:  # full, locked, read-only: not damage
            raise DatabaseError(
                f"{self._path}: cannot be used now ({error}); "
                "check free space and permissions, and try again"
            ) from error
        except (sqlite3.Error, ValueError, TypeError) as error:
            raise self._damaged(str(error)) from error

    def _damaged(self, reason: str) -> DatabaseCorruptError:
        return DatabaseCorruptError(
            f"{self._path}: cannot be used ({' '.join(reason.split())}); "
            "restore the database from a copy"
        )


def _row_checksum(record: ClipRecord, filled: bytes | None) -> int:
    values = [
        record.content,
        record.name,
        record.subject,
        record.session,
        record.source,
        record.licence,
        record.credit,
        record.original_rate,
        record.frames,
        record.labels,
        record.marker_set,
        None if filled is None else zlib.crc32(filled),
        record.added,
        record.version,
        record.synthetic,
        record.segment,
        record.offset,
        record.checksums,
    ]
    return zlib.crc32(json.dumps(values).encode())
