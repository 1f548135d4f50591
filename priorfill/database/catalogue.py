"""The catalogue: an SQLite file with one row per clip. A clip exists once its row is committed.

Changes are numbered. A row holds the numbers of the changes that added and removed it, so that a
reader continues to see the state in which it opened the file. Compaction writes a new file with
another name, ``catalogue-2.sqlite``; readers keep the old one open.

The catalogue repeats the identity of its database, and lists the segments with their sizes. Each
use compares both with what was there before, so that another file in its place is noticed.
"""

from __future__ import annotations

import json
import re
import secrets
import sqlite3
import stat
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.database.catalogue_checksum import CatalogueChecksum
from priorfill.database.catalogue_rows import (
    LIVE,
    CatalogueRow,
    StoredRow,
    insert_row,
    parse_row,
    select_rows,
)
from priorfill.database.create_catalogue import create_catalogue, set_durable
from priorfill.database.manifest import FORMAT_VERSION, Manifest
from priorfill.database.read_only_copy import rolled_back_copy
from priorfill.database.record import ClipRecord
from priorfill.database.segment_list import MAX_SEGMENTS, SegmentList
from priorfill.database.sqlite_address import sqlite_address
from priorfill.errors import DatabaseCorruptError, DatabaseError, DatabaseStateError
from priorfill.runtime.held_files import WINDOWS, is_held, wait_until_writable

__all__ = ["Catalogue", "find_catalogue", "successor"]

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
    manifest : Manifest
        The database's manifest; the file must agree with it.
    write : bool
        Whether rows will change.
    state : str
        An earlier `state` to read; the latest by default. Not for a writer.

    Attributes
    ----------
    path : Path
        As above; another one after `replace`.
    version : int
        The format version of the file: older than the manifest's until a conversion is complete.
    segments_list : SegmentList
        The segments in the state in which the file was opened, or since the last change.
    note : str
        What a user should know of how the file was opened; may be empty.
    damaged : list of str
        Names of clips whose rows are damaged; `records` leaves them out.

    Raises
    ------
    DatabaseCorruptError
        In all methods, if SQLite finds the file damaged; for a writer also if a checksum does not
        match.
    DatabaseStateError
        If the file does not have the earlier `state`.
    """

    def __init__(self, path: Path, manifest: Manifest, *, write: bool, state: str = "") -> None:
        self.path = path
        self.version = manifest.version
        self._manifest = manifest
        self._rate, self._levels = manifest.rate, manifest.levels
        self._write = write
        self._connection: sqlite3.Connection | None = None
        self._is_unfinished = False  # whether a failed transaction waits to be rolled back
        self._is_verified = True  # whether the checksum file covers every byte
        self._may_write_checksum = False  # never of a damaged file
        self._state = 0
        self._meta: dict[str, Any] = {}
        self.segments_list = SegmentList()
        self.damaged: list[str] = []
        self.note = ""
        try:
            self._open()
            if state:
                self._go_back(state)
        except BaseException:
            self.close()
            raise

    @property
    def state(self) -> str:
        """The state that is read: number of the file, and of its last change, ``1:24``."""
        return f"{_number(self.path)}:{self._state}"

    def _go_back(self, state: str) -> None:
        """Read an earlier state. Removed clips stay in the file until a compaction replaces it."""
        match = re.fullmatch("([0-9]{1,9}):([0-9]{1,18})", state)
        if not match or int(match[1]) != _number(self.path) or int(match[2]) > self._state:
            raise DatabaseStateError(
                f"{self.path.parent}: does not have the state {state}, as it was compacted or "
                "replaced since; read the latest state instead"
            )
        self._state = int(match[2])

    def _open(self) -> None:
        self._may_write_checksum = False
        try:
            self._file = _file_identity(self.path)
        except FileNotFoundError as error:
            raise self._missing() from error
        if self._write:
            wait_until_writable(self.path)  # SQLite would open it read-only at once
            self._connect("rw")
            self._read_head()
        else:
            self._connect("ro")
            try:
                self._read_head()
            except DatabaseError as error:
                if not _needs_rollback(error.__cause__):
                    raise
                self._roll_back()
                self._read_head()
        if self._write and not self._is_verified:
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
            self._is_unfinished = False
            self._connection = sqlite3.connect(
                sqlite_address(self.path.absolute(), mode),
                uri=True,
                timeout=BUSY_SECONDS,
                isolation_level=None,
            )
            if self._write:
                set_durable(self._connection)

    def _roll_back(self) -> None:
        """Roll back what a killed writer left: in the file, or else in a copy of it."""
        try:
            self._connect("rw")
            with self._reporting_damage():
                assert self._connection is not None
                self._connection.execute("PRAGMA user_version").fetchone()
        except DatabaseCorruptError:
            raise
        except DatabaseError:  # on read-only media
            assert self._connection is not None
            self._connection.close()
            with self._reporting_damage():
                self._connection = rolled_back_copy(self.path)
            self.note = (
                f"{self.path.parent}: a writer was killed here and nothing can be written; "
                "the clips are read as they were before its last change"
            )

    def _read_head(self) -> None:
        """Read the state of the file, and check that it belongs to the manifest."""
        kind = "IMMEDIATE" if self._write else "DEFERRED"
        with self._reporting_damage(), self._transaction(kind) as connection:
            (version,) = connection.execute("PRAGMA user_version").fetchone()
            if not connection.execute("SELECT COUNT(*) FROM sqlite_schema").fetchone()[0]:
                raise self._missing("is empty")
            older = self._manifest.converted_from
            if version != self._manifest.version and (version != older or self._write):
                raise self._damaged(
                    f"its format version is {version}, not {self._manifest.version}"
                )
            self.version = version
            self._checksum_file = CatalogueChecksum(self.path, version)
            self._meta = _read_meta(connection)
            if (self._meta.get("rate"), self._meta.get("levels")) != (self._rate, self._levels):
                raise self._damaged("its rate and levels are not those of the manifest")
            if version == FORMAT_VERSION:
                if self._meta.get("id") != self._manifest.identity:
                    raise self._foreign()
                self.segments_list = SegmentList.from_text(self._meta.get("segments"))
            self._state = int(self._meta["state"])
            self._is_verified = self._checksum_file.matches(connection)

    @property
    def identity(self) -> str:
        """The database's identity; empty if the catalogue has an older format version."""
        return self._manifest.identity if self.version == FORMAT_VERSION else ""

    def check_place(self) -> None:
        """Check that the file that is open is still the database's catalogue.

        Raises
        ------
        DatabaseError
            If it was moved, removed or replaced.
        """
        try:
            is_same = _file_identity(self.path) == self._file
        except OSError:
            is_same = False
        if not is_same:
            self.suspend_checksum()
            raise DatabaseError(
                f"{self.path}: was moved or replaced while it was open, so nothing was written; "
                "open the database again"
            )

    def _check_unchanged(self, connection: sqlite3.Connection) -> None:
        """Check, in a transaction, that the contents are those of the database that was opened."""
        meta = _read_meta(connection)
        if self._write:
            is_same = meta == self._meta
        else:
            state = meta.get("state", -1)
            is_same = meta.get("id") == self._meta.get("id") and (
                state > self._state or (state == self._state and _gist(meta) == _gist(self._meta))
            )
        if not is_same:
            self.suspend_checksum()
            raise DatabaseError(
                f"{self.path}: was exchanged while it was open; open the database again, and "
                "restore it from a copy if that fails"
            )

    def close(self) -> None:
        """Close the file; a writer writes its checksum."""
        if self._connection is None:
            return
        # if this fails (the disk is full), the next one to open it checks row by row
        with suppress(OSError, sqlite3.Error, DatabaseError):
            if self._may_write_checksum and not self._connection.in_transaction:
                self.check_place()
                self._check_disk()
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
                self._parse(StoredRow.of(row), labels, checked=not self._is_verified)
                for row in self._query(
                    f"{select_rows(self.version)} WHERE {LIVE} ORDER BY content",
                    {"state": self._state},
                )
            ]
        self.damaged = [row for row in found if isinstance(row, str)]
        return [row for row in found if isinstance(row, ClipRecord)]

    def _parse(
        self, row: StoredRow, labels: dict[str, tuple[str, ...]], *, checked: bool
    ) -> ClipRecord | str:
        return parse_row(
            row, labels, self._rate, self._levels, version=self.version, checked=checked
        )

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
            found = None if row is None else self._parse(row, {}, checked=True)
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
                f"{select_rows(self.version)} WHERE content = :content AND {LIVE}",
                {"content": content, "state": self._state},
            )
            return StoredRow.of(rows[0]) if rows else None

    def _query(self, sql: str, parameters: Any = ()) -> list[tuple[Any, ...]]:
        assert self._connection is not None
        try:
            return self._read(sql, parameters)
        except sqlite3.OperationalError as error:
            if self._write or not _needs_rollback(error):
                raise
            self._roll_back()
            return self._read(sql, parameters)

    def _read(self, sql: str, parameters: Any) -> list[tuple[Any, ...]]:
        assert self._connection is not None
        self._end_unfinished()
        if self._connection.in_transaction:
            return self._connection.execute(sql, parameters).fetchall()
        with self._transaction("DEFERRED") as connection:
            self._check_unchanged(connection)
            return connection.execute(sql, parameters).fetchall()

    def segments(self) -> set[int]:
        """Return the numbers of the segments in use, also by removed clips."""
        if self._connection is None:
            return set()
        with self._reporting_damage():
            rows = self._query("SELECT DISTINCT segment FROM clips")
        # other types are damage, which `records` reports; the other clips stay readable
        return {row[0] for row in rows if isinstance(row[0], int) and 0 < row[0] <= MAX_SEGMENTS}

    def present_segments(self) -> SegmentList | None:
        """Return the list of segments as it is on the disk; None if another catalogue counts."""
        if self._connection is None or find_catalogue(self.path.parent) != self.path:
            return None
        with self._reporting_damage():
            ((text,),) = self._query("SELECT value FROM meta WHERE name = 'segments'")
            return SegmentList.from_text(text)

    def end(self) -> dict[int, int]:
        """Return, by segment, the end of the last clip; of an older format version."""
        if self._connection is None:
            return {}
        ends: dict[int, int] = {}
        with self._reporting_damage():
            for segment, offset, frames, labels in self._query(
                "SELECT segment, offset, frames, labels FROM clips "
                "JOIN label_sets ON label_sets.id = label_set"
            ):
                end = offset + sum(json.loads(frames)) * len(json.loads(labels)) * 12
                ends[segment] = max(ends.get(segment, 0), end)
        return ends

    def announce(self, segments: SegmentList) -> None:
        """Commit a list that names what is about to be written, or was removed."""
        self._commit({"segments": segments.to_text()}, lambda connection, state, meta: None)
        self.segments_list = segments

    def change(
        self,
        add: Sequence[CatalogueRow] = (),
        remove: Iterable[ClipRecord] = (),
        segments: SegmentList | None = None,
    ) -> None:
        """Add and remove clips in one commit.

        Parameters
        ----------
        add : sequence of CatalogueRow
            New clips.
        remove : iterable of ClipRecord
            Clips to remove.
        segments : SegmentList, optional
            The segments with the new clips.

        Raises
        ------
        DatabaseError
            If a clip to be removed does not exist, or the file was exchanged.
        """
        add, remove = list(add), list(remove)
        if not add and not remove:
            return
        listed = self.segments_list if segments is None else segments

        def put(connection: sqlite3.Connection, state: int, meta: dict[str, Any]) -> None:
            rows, digest = int(meta["rows"]), int(meta["digest"])
            for record in remove:
                digest ^= self._mark_removed(connection, record, state)
            for row in add:
                digest ^= insert_row(connection, row, state)
                rows += 1
            meta |= {"state": state, "rows": rows, "digest": digest}

        self._commit({"segments": listed.to_text()}, put)
        self.segments_list = listed

    def edit(self, edited: Sequence[tuple[ClipRecord, ClipRecord]]) -> None:
        """Replace records by others with the same positions, in one commit."""
        rows = [replace(self.row(old), record=new) for old, new in edited]
        self.change(add=rows, remove=[old for old, _ in edited])

    def _commit(
        self,
        meta: dict[str, Any],
        put: Callable[[sqlite3.Connection, int, dict[str, Any]], None],
    ) -> None:
        """Change the file in one transaction, if it is the one that was opened."""
        assert self._connection is not None and self._write
        self.check_place()
        self._check_disk()
        with self._reporting_damage(), self._transaction("IMMEDIATE") as connection:
            self._check_unchanged(connection)
            changed = self._meta | meta | {"commit": secrets.token_hex(8)}
            put(connection, self._state + 1, changed)
            for name, value in changed.items():
                if value != self._meta.get(name):
                    connection.execute("UPDATE meta SET value = ? WHERE name = ?", (value, name))
        self._meta, self._state = changed, int(changed["state"])
        self.check_place()

    def _check_disk(self) -> None:
        """Check that the file has what this writer committed last.

        A connection may answer from its memory; a new one reads the file.
        """
        address = sqlite_address(self.path.absolute(), "ro")
        with (
            self._reporting_damage(),
            closing(sqlite3.connect(address, uri=True, timeout=BUSY_SECONDS)) as connection,
        ):
            self._check_unchanged(connection)

    def suspend_checksum(self) -> None:
        """Write no checksum until the file is reopened: a change failed, perhaps midway."""
        self._may_write_checksum = False

    def reopen(self) -> None:
        """Read the state on the disk again: a change that failed may have been committed."""
        self.path = find_catalogue(self.path.parent)
        self._open()

    def replace(self, rows: Iterable[CatalogueRow], segments: SegmentList) -> None:
        """Replace the file by a new one that has only these rows, and continue with it.

        The new file has another name, and therefore its own journal; readers keep the old one open.

        Parameters
        ----------
        rows : iterable of CatalogueRow
            All clips.
        segments : SegmentList
            The segments that hold them, and what may be removed then.
        """
        assert self._connection is not None and self._write
        self.check_place()
        path = successor(self.path)
        create_catalogue(path, self._manifest, rows, segments)
        self.check_place()
        self._connection.close()
        self._connection = None
        self.path = path
        self._open()

    def check(self, record: ClipRecord) -> bool:
        """Return whether a record, its mask and its sketch are as they were inserted."""
        row = self._find_row(record.content)
        if row is None:
            return False
        with self._reporting_damage():
            if self._parse(row, {}, checked=True) != record:
                return False
            sketch = np.frombuffer(row.sketch, dtype="<u4")
            return self._common_hashes(sketch)[row.id] == len(sketch)

    def check_file(self) -> None:
        """Check the whole file: SQLite's structure, the checksum file, and that no row is lost.

        Raises
        ------
        DatabaseCorruptError
            If there is damage.
        DatabaseError
            If the system refuses to read the checksum file.
        """
        if self._connection is None:
            return
        if not self.note and find_catalogue(self.path.parent) == self.path:
            try:
                self._check_disk()
            except DatabaseError:
                # a compaction may have removed the file in between
                if find_catalogue(self.path.parent) == self.path:
                    raise
        with self._reporting_damage():
            self._check_structure()
            with self._transaction("DEFERRED") as connection:
                matches = self._checksum_file.matches(connection)
            refusal = self._checksum_file.refusal
            if refusal is not None:
                raise DatabaseError(
                    f"{self._checksum_file.path}: cannot be read ({refusal.strerror or refusal}), "
                    "so the catalogue was not compared with it; check its permissions"
                    f"{', and close it in other programs' if is_held(refusal) else ''}"
                )
            if not matches and self._checksum_file.problem:
                raise self._damaged(self._checksum_file.problem)

    def _check_structure(self) -> None:
        """Check SQLite's structure, and that no row is lost."""
        assert self._connection is not None
        row = self._connection.execute("PRAGMA integrity_check(1)").fetchone()
        if row[0] != "ok":
            raise self._damaged(str(row[0]))
        with self._transaction("DEFERRED") as connection:
            meta = _read_meta(connection)
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
        self._end_unfinished()
        try:
            self._connection.execute(f"BEGIN {kind}")
            yield self._connection
            self._connection.execute("COMMIT")
        except BaseException:
            self._is_unfinished = self._connection.in_transaction
            self._end_unfinished()
            raise

    def _end_unfinished(self) -> None:
        """Roll back a transaction that failed, and that could not be rolled back at that time."""
        if self._is_unfinished and self._connection is not None:
            self._connection.execute("ROLLBACK")
            self._is_unfinished = False

    @contextmanager
    def _reporting_damage(self) -> Iterator[None]:
        """Turn errors of SQLite, and of invalid values, into errors of the database."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if getattr(error, "sqlite_errorname", "") == "SQLITE_ERROR":  # no such table
                raise self._damaged(str(error)) from error
            # full, locked, read-only, a share that is gone: not damage
            is_busy = WINDOWS or getattr(error, "sqlite_errorname", "").startswith("SQLITE_BUSY")
            others = "close it in other programs, and " if is_busy else ""
            raise DatabaseError(
                f"{self.path}: cannot be used now ({error}); {others}check free space and "
                "permissions (on a network share also its connection and file locks), and try again"
            ) from error
        except (sqlite3.Error, LookupError, ValueError, TypeError, RecursionError) as error:
            if isinstance(error, DatabaseError):
                raise
            raise self._damaged(str(error)) from error

    def _missing(self, how: str = "is missing") -> DatabaseCorruptError:
        return DatabaseCorruptError(
            f"{self.path}: {how}, so nothing is known of the segments; restore it from a copy"
        )

    def _foreign(self) -> DatabaseCorruptError:
        return DatabaseCorruptError(
            f"{self.path}: belongs to another database; restore the catalogue of this one from a "
            "copy"
        )

    def _damaged(self, reason: str) -> DatabaseCorruptError:
        return DatabaseCorruptError(
            f"{self.path}: is damaged ({' '.join(reason.split())}); restore the database from a "
            "copy, or merge its undamaged clips into a new one"
        )


def find_catalogue(folder: Path) -> Path:
    """Return the path of a database's catalogue, which need not exist.

    There may be two if a compaction was killed, or if a reader has the older one open, which
    Windows does not remove then: the one with the higher number counts.
    """
    found = [path for path in folder.glob(f"{_STEM}*{_SUFFIX}") if _number(path) and path.is_file()]
    return max(found, key=_number, default=folder / f"{_STEM}{_SUFFIX}")


def _number(path: Path) -> int:
    """Return the number of a catalogue: 1 if its name has none; 0 for other files."""
    number = path.name.removeprefix(_STEM).removesuffix(_SUFFIX)
    if not number:
        return 1
    match = re.fullmatch("-([1-9][0-9]{0,8})", number)
    return int(match[1]) if match else 0


def successor(path: Path) -> Path:
    """Return the path of the catalogue that replaces another; no file of that name is left."""
    folder = path.parent
    for number in count(_number(path) + 1):
        if not any(folder.glob(f"{_STEM}-{number}.*")):
            break
    return folder / f"{_STEM}-{number}{_SUFFIX}"


def _needs_rollback(error: BaseException | None) -> bool:
    """Return whether a reader failed because a writer was killed during a commit.

    Its journal can be rolled back only by a connection that may write.
    """
    return getattr(error, "sqlite_errorname", "").startswith("SQLITE_READONLY")


def _file_identity(path: Path) -> tuple[int, int]:
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):  # SQLite would wait for a pipe for ever
        raise FileNotFoundError(f"{path} is no regular file")
    return found.st_dev, found.st_ino


def _read_meta(connection: sqlite3.Connection) -> dict[str, Any]:
    return dict(connection.execute("SELECT name, value FROM meta"))


def _gist(meta: dict[str, Any]) -> tuple[Any, Any]:
    return meta.get("rows"), meta.get("digest")
