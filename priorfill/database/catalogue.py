"""The catalogue: an SQLite file with one row per clip. A clip exists once its row is committed.

Changes are numbered. A row holds the numbers of the changes that added and removed it, so that a
reader continues to see the state in which it opened the file. Compaction writes a new file with
another name, ``catalogue-2.sqlite``; readers keep the old one open.
"""

from __future__ import annotations

import json
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.database.catalogue_checksum import CatalogueChecksum
from priorfill.database.catalogue_rows import (
    LIVE,
    SCHEMA,
    SELECT_ROWS,
    CatalogueRow,
    StoredRow,
    insert_row,
    parse_row,
)
from priorfill.database.manifest import FORMAT_VERSION
from priorfill.database.record import ClipRecord
from priorfill.errors import DatabaseCorruptError, DatabaseError
from priorfill.runtime.atomic_file import flush_folder

__all__ = ["Catalogue", "find_catalogue"]

_STEM, _SUFFIX = "catalogue", ".sqlite"

BUSY_SECONDS = 30.0
"""Maximum wait while another process commits; a commit takes milliseconds."""

MAX_VARIABLES = 500
"""Maximum number of variables in one statement; SQLite may be built for no more than 999."""


class Catalogue:
    """The rows of a database in the state in which it was opened, plus this writer's own changes.

    Parameters
    ----------
    path : Path
        The SQLite file.
    rate : float
        The database's rate (Hz), which every record repeats.
    levels : int
        The database's number of levels. The file must agree on both.
    write : bool
        Whether rows will change. If the file does not exist, a writer creates it; for a reader it
        is a catalogue without rows.

    Attributes
    ----------
    damaged : list of str
        Names of clips whose rows are damaged; `records` leaves them out.

    Raises
    ------
    DatabaseCorruptError
        In all methods, if SQLite finds the file damaged; for a writer also if a checksum does not
        match.
    """

    def __init__(self, path: Path, rate: float, levels: int, *, write: bool) -> None:
        self._path = path
        self._rate = rate
        self._levels = levels
        self._write = write
        self._connection: sqlite3.Connection | None = None
        self._checksum_file = CatalogueChecksum(path)
        self._is_verified = True  # whether the checksum file covers every byte
        self._may_write_checksum = False  # never of a damaged file
        self._is_empty = False
        self._state = 0
        self.damaged: list[str] = []
        if not write and not path.exists():
            return
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        is_new = not self._path.exists()
        if self._write:
            self._connect("rwc")
            self._read_head(is_new=is_new)
        else:
            self._connect("ro")
            try:
                self._read_head(is_new=False)
            except DatabaseError as error:
                if not _needs_rollback(error.__cause__):
                    raise
                self._connect("rw")
                self._read_head(is_new=False)
            if self._is_empty:
                self.close()
        if self._write and not (is_new or self._is_verified):
            # because of a damaged row, the writer could overwrite other clips
            self.records()
            if self.damaged:
                raise self._damaged(f"rows of {', '.join(self.damaged)} changed")
            if self._checksum_file.catalogue_is_damaged:
                raise self._damaged(self._checksum_file.problem)
            with self._reporting_damage():
                self._check_structure()
        self._may_write_checksum = self._write

    def _connect(self, mode: str) -> None:
        if self._connection is not None:
            self._connection.close()
        with self._reporting_damage():
            self._connection = sqlite3.connect(
                f"{self._path.resolve().as_uri()}?mode={mode}",
                uri=True,
                timeout=BUSY_SECONDS,
                isolation_level=None,
            )
            if self._write:
                # a rollback journal, because a write-ahead log cannot be read on read-only media;
                # EXTRA is FULL and flushes the folder's entry of the journal
                self._connection.execute("PRAGMA journal_mode = DELETE")
                self._connection.execute("PRAGMA synchronous = EXTRA")

    def _read_head(self, *, is_new: bool) -> None:
        """Create the tables of a new file, or read the state of an existing one."""
        kind = "IMMEDIATE" if self._write else "DEFERRED"
        with self._reporting_damage(), self._transaction(kind) as connection:
            (version,) = connection.execute("PRAGMA user_version").fetchone()
            tables = connection.execute("SELECT COUNT(*) FROM sqlite_schema").fetchone()[0]
            if self._write and (is_new or not tables):
                self._create_tables(connection)
            elif not tables:  # the writer that made the file was killed before it made the tables
                self._is_empty = True
                return
            elif version != FORMAT_VERSION:
                raise self._damaged(f"its format version is {version}, not {FORMAT_VERSION}")
            self._state = self._read_state(connection)
            self._is_verified = self._checksum_file.matches(connection)

    def _create_tables(self, connection: sqlite3.Connection) -> None:
        for statement in SCHEMA.split(";"):
            connection.execute(statement)
        for name, value in (
            ("rate", self._rate),
            ("levels", self._levels),
            ("state", 0),
            ("rows", 0),
            ("digest", 0),
        ):
            connection.execute("INSERT INTO meta VALUES (?, ?)", (name, value))

    def _read_state(self, connection: sqlite3.Connection) -> int:
        meta = dict(connection.execute("SELECT name, value FROM meta"))
        if (meta.get("rate"), meta.get("levels")) != (self._rate, self._levels):
            raise self._damaged("its rate and levels are not those of the manifest")
        return int(meta["state"])

    def close(self) -> None:
        """Close the file; a writer writes its checksum."""
        if self._connection is None:
            return
        # if this fails (the disk is full), the next one to open it checks row by row
        with suppress(OSError, sqlite3.Error):
            if self._may_write_checksum and not self._connection.in_transaction:
                self._checksum_file.write(self._connection)
        self._connection.close()
        self._connection = None

    def records(self) -> list[ClipRecord]:
        """Return every clip, ordered by content hash, independent of the order of adding.

        Rows are checked one by one unless the checksum file covers the catalogue. Clips whose rows
        are damaged are left out; see `damaged`.
        """
        if self._connection is None:
            return []
        self.damaged = []
        with self._reporting_damage():
            labels: dict[str, tuple[str, ...]] = {}
            found = [
                parse_row(StoredRow.of(row), labels, self._rate, checked=not self._is_verified)
                for row in self._query(
                    f"{SELECT_ROWS} WHERE {LIVE} ORDER BY content", {"state": self._state}
                )
            ]
        self.damaged = [row for row in found if isinstance(row, str)]
        return [row for row in found if isinstance(row, ClipRecord)]

    def row(self, record: ClipRecord) -> CatalogueRow:
        """Return all that is stored of a clip."""
        found = self._find_row(record.content)
        if found is None:
            return CatalogueRow(record, None, np.empty(0, "<u4"))
        return CatalogueRow(record, found.filled, np.frombuffer(found.sketch, dtype="<u4"))

    def find(self, content: str) -> ClipRecord | None:
        """Return the clip with a content hash, if it exists and its row is undamaged."""
        row = self._find_row(content)
        with self._reporting_damage():
            found = None if row is None else parse_row(row, {}, self._rate, checked=True)
        return found if isinstance(found, ClipRecord) else None

    def filled(self, content: str) -> bytes | None:
        """Return the compressed mask of a clip's filled samples, if it has any."""
        row = self._find_row(content)
        return None if row is None else row.filled

    def sharing(self, sketch: NDArray[np.uint32]) -> dict[str, tuple[int, int]]:
        """Return the clips that have hashes in common with a sketch.

        Returns
        -------
        dict of str to (int, int)
            By content hash: the number of common hashes, and of the clip's hashes.
        """
        if self._connection is None:
            return {}
        found = {}
        with self._reporting_damage():
            for clip, count in self._common_hashes(sketch).items():
                for content, size in self._query(
                    f"SELECT content, length(sketch) / 4 FROM clips WHERE id = :id AND {LIVE}",
                    {"id": clip, "state": self._state},
                ):
                    found[str(content)] = (count, int(size))
        return found

    def _common_hashes(self, sketch: NDArray[np.uint32]) -> Counter[int]:
        """Return the number of hashes in common with a sketch, by primary key of the clip."""
        common: Counter[int] = Counter()
        for start in range(0, len(sketch), MAX_VARIABLES):
            hashes = sketch[start : start + MAX_VARIABLES].tolist()
            marks = ",".join("?" * len(hashes))
            rows = self._query(f"SELECT clip FROM clips_of_hash WHERE hash IN ({marks})", hashes)
            common.update(row[0] for row in rows)
        return common

    def _find_row(self, content: str) -> StoredRow | None:
        if self._connection is None:
            return None
        with self._reporting_damage():
            rows = self._query(
                f"{SELECT_ROWS} WHERE content = :content AND {LIVE}",
                {"content": content, "state": self._state},
            )
            return StoredRow.of(rows[0]) if rows else None

    def _query(self, sql: str, parameters: Any = ()) -> list[tuple[Any, ...]]:
        assert self._connection is not None
        try:
            return self._connection.execute(sql, parameters).fetchall()
        except sqlite3.OperationalError as error:
            if self._write or not _needs_rollback(error):
                raise
            self._connect("rw")
            return self._connection.execute(sql, parameters).fetchall()

    def segments(self) -> set[int]:
        """Return the numbers of the segments in use, also by removed clips."""
        if self._connection is None:
            return set()
        with self._reporting_damage():
            rows = self._query("SELECT DISTINCT segment FROM clips")
        # other types are damage, which `records` reports; the other clips stay readable
        return {row[0] for row in rows if isinstance(row[0], int)}

    def end(self) -> tuple[int, int]:
        """Return the number of the last segment in use, and the number of its bytes in use."""
        if self._connection is None:
            return 1, 0
        with self._reporting_damage():
            rows = self._query(
                "SELECT segment, offset, frames, labels FROM clips "
                "JOIN label_sets ON label_sets.id = label_set "
                "ORDER BY segment DESC, offset DESC LIMIT 1"
            )
            if not rows:
                return 1, 0
            segment, offset, frames, labels = rows[0]
            return segment, offset + sum(json.loads(frames)) * len(json.loads(labels)) * 12

    def change(self, add: Sequence[CatalogueRow] = (), remove: Iterable[ClipRecord] = ()) -> None:
        """Add and remove clips in one commit.

        Raises
        ------
        DatabaseError
            If a clip to be removed does not exist.
        """
        assert self._connection is not None and self._write
        add, remove = list(add), list(remove)
        if not add and not remove:
            return
        state = self._state + 1
        with self._reporting_damage(), self._transaction("IMMEDIATE") as connection:
            meta = dict(connection.execute("SELECT name, value FROM meta"))
            rows, digest = int(meta["rows"]), int(meta["digest"])
            for record in remove:
                digest ^= self._mark_removed(connection, record, state)
            for row in add:
                digest ^= insert_row(connection, row, state)
                rows += 1
            for name, value in (("state", state), ("rows", rows), ("digest", digest)):
                connection.execute("UPDATE meta SET value = ? WHERE name = ?", (value, name))
        self._state = state

    def suspend_checksum(self) -> None:
        """Write no checksum until the file is reopened: a change failed, perhaps midway."""
        self._may_write_checksum = False

    def reopen(self) -> None:
        """Read the state of the file again: a change that failed may have been committed."""
        self._open()

    def replace(self, rows: Iterable[CatalogueRow]) -> None:
        """Replace the file by a new one that has only these rows, and continue with it.

        The new file has another name, and therefore its own journal; readers keep the old one open.
        """
        assert self._connection is not None and self._write
        path = _successor(self._path)
        unfinished = path.with_name(f"{path.name}.new")
        made = Catalogue(unfinished, self._rate, self._levels, write=True)
        try:
            made.change(add=list(rows))
        finally:
            made.close()
        self._connection.close()
        self._connection = None
        unfinished.replace(path)
        flush_folder(path.parent)
        self._path = path
        self._checksum_file = CatalogueChecksum(path)
        self._open()
        self.remove_others()

    def remove_others(self) -> None:
        """Remove other catalogues: previous ones, and unfinished ones of killed writers."""
        kept = {self._path.name, f"{self._path.name}-journal", self._checksum_file.path.name}
        for other in self._path.parent.glob(f"{_STEM}*"):
            if other.name not in kept:
                other.unlink(missing_ok=True)

    def check(self, record: ClipRecord) -> bool:
        """Return whether a record, its mask and its sketch are as they were inserted."""
        row = self._find_row(record.content)
        if row is None:
            return False
        with self._reporting_damage():
            if parse_row(row, {}, self._rate, checked=True) != record:
                return False
            sketch = np.frombuffer(row.sketch, dtype="<u4")
            return self._common_hashes(sketch)[row.id] == len(sketch)

    def check_file(self) -> None:
        """Check the whole file: SQLite's structure, the checksum file, and that no row is lost.

        Raises
        ------
        DatabaseCorruptError
            If there is damage.
        """
        if self._connection is None:
            return
        with self._reporting_damage():
            self._check_structure()
            with self._transaction("DEFERRED") as connection:
                matches = self._checksum_file.matches(connection)
            if not matches and self._checksum_file.problem:
                raise self._damaged(self._checksum_file.problem)

    def _check_structure(self) -> None:
        """Check SQLite's structure, and that no row is lost."""
        assert self._connection is not None
        row = self._connection.execute("PRAGMA integrity_check(1)").fetchone()
        if row[0] != "ok":
            raise self._damaged(str(row[0]))
        with self._transaction("DEFERRED") as connection:
            meta = dict(connection.execute("SELECT name, value FROM meta"))
            checksums = [int(r[0]) for r in connection.execute("SELECT row_checksum FROM clips")]
            last = connection.execute(
                "SELECT MAX(COALESCE(removed_in, added_in)) FROM clips"
            ).fetchone()[0]
        digest = 0
        for checksum in checksums:
            digest ^= checksum
        if (len(checksums), digest) != (meta.get("rows"), meta.get("digest")):
            raise self._damaged("rows are lost or changed")
        if last is not None and meta.get("state") != last:
            raise self._damaged("the number of its last change is wrong")

    def _mark_removed(self, connection: sqlite3.Connection, record: ClipRecord, state: int) -> int:
        """Mark a clip as removed; return the change of the digest."""
        row = self._find_row(record.content)
        if row is None:
            raise DatabaseError(f"{record.name}: is not in the database; list its clips again")
        checksum = row.checksum_with(state)
        connection.execute(
            "UPDATE clips SET removed_in = ?, row_checksum = ? WHERE id = ?",
            (state, checksum, row.id),
        )
        return int(row.checksum) ^ checksum

    @contextmanager
    def _transaction(self, kind: str) -> Iterator[sqlite3.Connection]:
        assert self._connection is not None
        try:
            self._connection.execute(f"BEGIN {kind}")
            yield self._connection
            self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            raise

    @contextmanager
    def _reporting_damage(self) -> Iterator[None]:
        """Turn errors of SQLite, and of invalid values, into errors of the database."""
        try:
            yield
        except sqlite3.OperationalError as error:  # full, locked, read-only: not damage
            raise DatabaseError(
                f"{self._path}: cannot be used now ({error}); "
                "check free space and permissions, and try again"
            ) from error
        except (sqlite3.Error, LookupError, ValueError, TypeError) as error:
            if isinstance(error, DatabaseError):
                raise
            raise self._damaged(str(error)) from error

    def _damaged(self, reason: str) -> DatabaseCorruptError:
        return DatabaseCorruptError(
            f"{self._path}: is damaged ({' '.join(reason.split())}); restore the database from a "
            "copy, or merge its undamaged clips into a new one"
        )


def find_catalogue(folder: Path) -> Path:
    """Return the path of a database's catalogue, which need not exist.

    If a compaction was killed, there may be two: the one with the higher number counts.
    """
    found = [path for path in folder.glob(f"{_STEM}*{_SUFFIX}") if _number(path)]
    return max(found, key=_number, default=folder / f"{_STEM}{_SUFFIX}")


def _number(path: Path) -> int:
    """Return the number of a catalogue: 1 if its name has none; 0 for other files."""
    number = path.name.removeprefix(_STEM).removesuffix(_SUFFIX)
    if not number:
        return 1
    return int(number[1:]) if number[0] == "-" and number[1:].isdigit() else 0


def _successor(path: Path) -> Path:
    return path.with_name(f"{_STEM}-{_number(path) + 1}{_SUFFIX}")


def _needs_rollback(error: BaseException | None) -> bool:
    """Return whether a reader failed because a writer was killed during a commit.

    Its journal can be rolled back only by a connection that may write.
    """
    return getattr(error, "sqlite_errorname", "").startswith("SQLITE_READONLY")
