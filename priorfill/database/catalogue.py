"""The catalogue: an SQLite file with one row a clip, whose commit makes the clip exist.

Every change has a number. A row says by which change it came and by which it was removed, so a
reader goes on seeing the state in which it opened the file; compaction makes a new file of another
name, ``catalogue-2.sqlite``, and an open one stays what it was.
"""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.database import version1
from priorfill.database.catalogue_checksum import CatalogueChecksum
from priorfill.database.record import ClipRecord
from priorfill.database.segments import sync_folder
from priorfill.errors import DatabaseCorruptError, DatabaseError

__all__ = ["Catalogue", "Entry", "find_catalogue"]

_STEM, _SUFFIX = "catalogue", ".sqlite"

BUSY_SECONDS = 30.0
"""How long to wait while another process commits; a commit takes milliseconds."""

_USER_VERSION = 2
"""SQLite's user version of the file: the format version. Version 1 left it at 0."""

_SCHEMA = f"""
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
    segment INTEGER NOT NULL,
    offset INTEGER NOT NULL,
    checksums TEXT NOT NULL,
    sketch BLOB NOT NULL,
    added_in INTEGER NOT NULL,
    removed_in INTEGER,
    row_checksum INTEGER NOT NULL,
    UNIQUE (segment, offset)
);
CREATE UNIQUE INDEX IF NOT EXISTS content_of_clips ON clips (content) WHERE removed_in IS NULL;
CREATE TABLE IF NOT EXISTS clips_of_hash (
    hash INTEGER NOT NULL,
    clip INTEGER NOT NULL REFERENCES clips (id),
    PRIMARY KEY (hash, clip)
) WITHOUT ROWID;
PRAGMA user_version = {_USER_VERSION};
"""

# the columns that are fields of a record, and of them those that hold JSON
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
    "segment",
    "offset",
    "checksums",
)
_SYNTHESISED = 2
"""What the column ``synthetic`` holds where the markers, not the motion, are computed: 0 and 1 are
no and yes. So the form on disk is the same, and an older priorfill takes such clips as synthetic.
"""

_LISTS = frozenset({"frames", "present", "measured", "checksums"})

_ROWS = (
    "SELECT clips.id, added_in, removed_in, sketch, row_checksum, labels, filled, "
    f"{', '.join(_FIELDS)} FROM clips LEFT JOIN label_sets ON label_sets.id = label_set"
)
_BEFORE_FIELDS = 7

_LIVE = "added_in <= :state AND (removed_in IS NULL OR removed_in > :state)"
"""Which rows belong to a state."""

_VARIABLES = 500
"""Values in one statement; SQLite may be built for no more than 999."""


@dataclass(frozen=True, eq=False)
class Entry:
    """What the catalogue keeps of a clip.

    Attributes
    ----------
    record : ClipRecord
        What users see.
    filled : bytes or None
        The packed mask of synthesised samples, if there are some.
    sketch : ndarray of uint32
        See `priorfill.database.sketch`; empty where format version 1 did not keep it.
    """

    record: ClipRecord
    filled: bytes | None = None
    sketch: NDArray[np.uint32] = field(default_factory=lambda: np.empty(0, np.uint32))


class Catalogue:
    """The rows of a database as they were when it was opened, and this writer's own changes.

    Parameters
    ----------
    path : Path
        The SQLite file.
    rate : float
        The database's rate, which every record repeats (Hz).
    levels : int
        Its number of levels, which the file must confirm.
    write : bool
        Whether rows will change. A file that is not there is then made; for a reader it
        is a catalogue without rows.

    Attributes
    ----------
    damaged : list of str
        Names of clips whose rows were found damaged; `records` leaves them out.

    Raises
    ------
    DatabaseCorruptError
        Here and in every method, where SQLite finds the file damaged; for a writer also where
        a checksum does not fit.
    """

    def __init__(self, path: Path, rate: float, levels: int, *, write: bool) -> None:
        self._path = path
        self._rate = rate
        self._levels = levels
        self._write = write
        self._connection: sqlite3.Connection | None = None
        self._seal = CatalogueChecksum(path)
        self._is_whole = True  # whether the seal vouches for every byte
        self._may_seal = False  # damage must not be sealed
        self._is_version_1 = False
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
        if self._write and not (is_new or self._is_whole or self._is_version_1):
            # a wrong row could make the writer write over what others hold
            self.records()
            if self.damaged:
                raise self._damaged(f"rows of {', '.join(self.damaged)} changed")
            if self._seal.denies:
                raise self._damaged(self._seal.finding)
            with self._damage():
                self._check_structure()
        self._may_seal = self._write and not self._is_version_1

    def _connect(self, mode: str) -> None:
        if self._connection is not None:
            self._connection.close()
        with self._damage():
            self._connection = sqlite3.connect(
                f"{self._path.resolve().as_uri()}?mode={mode}",
                uri=True,
                timeout=BUSY_SECONDS,
                isolation_level=None,
            )
            if self._write:
                # a rollback journal, not a write-ahead log: that could not be read from
                # read-only media. EXTRA is FULL and the folder's entry of the journal.
                self._connection.execute("PRAGMA journal_mode = DELETE")
                self._connection.execute("PRAGMA synchronous = EXTRA")

    def _read_head(self, *, is_new: bool) -> None:
        """Make a new file, or read in which state another is."""
        kind = "IMMEDIATE" if self._write else "DEFERRED"
        with self._damage(), self._transaction(kind) as connection:
            (version,) = connection.execute("PRAGMA user_version").fetchone()
            tables = connection.execute("SELECT COUNT(*) FROM sqlite_schema").fetchone()[0]
            if self._write and (is_new or not tables):
                self._make(connection)
            elif not tables:  # the writer that made it was killed before it got on
                self._is_empty = True
                return
            elif version != _USER_VERSION:
                self._is_version_1 = True
                return
            self._state = self._read_state(connection)
            self._is_whole = self._seal.fits(connection)

    def _make(self, connection: sqlite3.Connection) -> None:
        for statement in _SCHEMA.split(";"):
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
            raise self._damaged("it does not agree with the identity file on rate and levels")
        return int(meta["state"])

    @property
    def is_version_1(self) -> bool:
        """Whether the file has the form of format version 1."""
        return self._is_version_1

    def close(self) -> None:
        """Give the file back; a writer seals it."""
        if self._connection is None:
            return
        # where the disk is full, say, it stays without a seal, which costs time only
        with suppress(OSError, sqlite3.Error):
            if self._may_seal and not self._connection.in_transaction:
                self._seal.renew(self._connection)
        self._connection.close()
        self._connection = None

    def records(self) -> list[ClipRecord]:
        """Return every clip, by content hash: an order that does not depend on history.

        Rows are checked one by one where no seal vouches for the file. Clips whose rows are
        damaged are left out; see `damaged`.
        """
        if self._connection is None:
            return []
        self.damaged = []
        with self._damage():
            if self._is_version_1:
                records, self.damaged = version1.read(self._connection, self._rate)
                return records
            labels: dict[str, tuple[str, ...]] = {}
            found = [
                _parsed(row, labels, self._rate, checked=not self._is_whole)
                for row in self._query(
                    f"{_ROWS} WHERE {_LIVE} ORDER BY content", {"state": self._state}
                )
            ]
        self.damaged = [row for row in found if isinstance(row, str)]
        return [row for row in found if isinstance(row, ClipRecord)]

    def entry(self, record: ClipRecord) -> Entry:
        """Return all that is kept of a clip."""
        return Entry(record, self.filled(record.content), self.sketch(record.content))

    def sketch(self, content: str) -> NDArray[np.uint32]:
        """Return the sketch of a clip, ascending."""
        row = None
        if self._connection is not None and not self._is_version_1:
            with self._damage():
                row = self._row(content)
        return np.frombuffer(b"" if row is None else row[3], dtype="<u4")

    def sharing(self, sketch: NDArray[np.uint32]) -> dict[str, tuple[int, int]]:
        """Return which clips share hashes with a sketch.

        Returns
        -------
        dict of str to (int, int)
            By content hash: how many they share, and how many the clip's own sketch has.
        """
        if self._connection is None or self._is_version_1:
            return {}
        found = {}
        with self._damage():
            for clip, count in self._clips_of(sketch).items():
                for content, size in self._query(
                    f"SELECT content, length(sketch) / 4 FROM clips WHERE id = :id AND {_LIVE}",
                    {"id": clip, "state": self._state},
                ):
                    found[str(content)] = (count, int(size))
        return found

    def _clips_of(self, sketch: NDArray[np.uint32]) -> Counter[int]:
        """Return how many hashes of a sketch each clip has, by its row's number."""
        shared: Counter[int] = Counter()
        for start in range(0, len(sketch), _VARIABLES):
            some = sketch[start : start + _VARIABLES].tolist()
            marks = ",".join("?" * len(some))
            rows = self._query(f"SELECT clip FROM clips_of_hash WHERE hash IN ({marks})", some)
            shared.update(row[0] for row in rows)
        return shared

    def find(self, content: str) -> ClipRecord | None:
        """Return the clip with this content, if it is there and its row is sound."""
        if self._connection is None or self._is_version_1:
            return next((r for r in self.records() if r.content == content), None)
        with self._damage():
            row = self._row(content)
            found = None if row is None else _parsed(row, {}, self._rate, checked=True)
        return found if isinstance(found, ClipRecord) else None

    def filled(self, content: str) -> bytes | None:
        """Return the packed mask of a clip's synthesised samples, if it has some."""
        if self._connection is None:
            return None
        with self._damage():
            if self._is_version_1:
                return version1.filled(self._connection, content)
            row = self._row(content)
        return None if row is None else row[_BEFORE_FIELDS - 1]

    def _row(self, content: str) -> tuple[Any, ...] | None:
        rows = self._query(
            f"{_ROWS} WHERE content = :content AND {_LIVE}",
            {"content": content, "state": self._state},
        )
        return rows[0] if rows else None

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
        """Return the numbers of the segments in use, by removed clips too."""
        if self._connection is None:
            return set()
        with self._damage():
            rows = self._query("SELECT DISTINCT segment FROM clips")
        return {int(row[0]) for row in rows}

    def end(self) -> tuple[int, int]:
        """Return the number of the last segment in use and the bytes of it in use."""
        if self._connection is None:
            return 1, 0
        with self._damage():
            rows = self._query(
                "SELECT segment, offset, frames, labels FROM clips "
                "JOIN label_sets ON label_sets.id = label_set "
                "ORDER BY segment DESC, offset DESC LIMIT 1"
            )
            if not rows:
                return 1, 0
            segment, offset, frames, labels = rows[0]
            return segment, offset + sum(json.loads(frames)) * len(json.loads(labels)) * 12

    def change(self, add: Sequence[Entry] = (), remove: Iterable[ClipRecord] = ()) -> None:
        """Add and remove clips in one commit.

        Raises
        ------
        DatabaseError
            Where a clip to be removed is not there.
        """
        assert self._connection is not None and self._write
        add, remove = list(add), list(remove)
        if not add and not remove:
            return
        state = self._state + 1
        with self._damage(), self._transaction("IMMEDIATE") as connection:
            meta = dict(connection.execute("SELECT name, value FROM meta"))
            rows, digest = int(meta["rows"]), int(meta["digest"])
            for record in remove:
                digest ^= self._take_out(connection, record, state)
            for entry in add:
                digest ^= _insert(connection, entry, state)
                rows += 1
            for name, value in (("state", state), ("rows", rows), ("digest", digest)):
                connection.execute("UPDATE meta SET value = ? WHERE name = ?", (value, name))
        self._state = state

    def doubt(self) -> None:
        """Do not seal the file, unless it is opened again: a change failed, perhaps half way."""
        self._may_seal = False

    def reopen(self) -> None:
        """Read anew in which state the file is: a change that failed may have gone through."""
        self._open()

    def replace(self, entries: Iterable[Entry]) -> None:
        """Put a new file with these entries alone in the place of this one, and go on with it.

        The new file has a name of its own, and so its own journal: readers that have the old one
        open keep it.
        """
        assert self._connection is not None and self._write
        path = _successor(self._path)
        unfinished = path.with_name(f"{path.name}.new")
        made = Catalogue(unfinished, self._rate, self._levels, write=True)
        try:
            made.change(add=list(entries))
        finally:
            made.close()
        self._connection.close()
        self._connection = None
        unfinished.replace(path)
        sync_folder(path.parent)
        self._path = path
        self._seal = CatalogueChecksum(path)
        self._is_version_1 = False
        self._open()
        self.remove_others()

    def remove_others(self) -> None:
        """Remove other catalogues: former ones, and what a killed writer left of a new one."""
        kept = {self._path.name, f"{self._path.name}-journal", self._seal.path.name}
        for other in self._path.parent.glob(f"{_STEM}*"):
            if other.name not in kept:
                other.unlink(missing_ok=True)

    def check(self, record: ClipRecord) -> bool:
        """Return whether a record, its mask and its sketch are what was once inserted."""
        if self._connection is None:
            return False
        with self._damage():
            if self._is_version_1:
                return version1.check(self._connection, record)
            row = self._row(record.content)
            if row is None or _parsed(row, {}, self._rate, checked=True) != record:
                return False
            sketch = np.frombuffer(row[3], dtype="<u4")
            return self._clips_of(sketch)[row[0]] == len(sketch)

    def check_file(self) -> None:
        """Check the file as a whole: SQLite's structure, the seal, and that no row is lost.

        Raises
        ------
        DatabaseCorruptError
            Where there is damage.
        """
        if self._connection is None:
            return
        with self._damage():
            self._check_structure()
            if not self._is_version_1:
                with self._transaction("DEFERRED") as connection:
                    fits = self._seal.fits(connection)
                if not fits and self._seal.finding:
                    raise self._damaged(self._seal.finding)

    def _check_structure(self) -> None:
        """Let SQLite check the file, and see that no row is lost."""
        assert self._connection is not None
        row = self._connection.execute("PRAGMA integrity_check(1)").fetchone()
        if row[0] != "ok":
            raise self._damaged(str(row[0]))
        if self._is_version_1:
            return
        with self._transaction("DEFERRED") as connection:
            meta = dict(connection.execute("SELECT name, value FROM meta"))
            sums = [int(r[0]) for r in connection.execute("SELECT row_checksum FROM clips")]
            last = connection.execute(
                "SELECT MAX(COALESCE(removed_in, added_in)) FROM clips"
            ).fetchone()[0]
        digest = 0
        for value in sums:
            digest ^= value
        if (len(sums), digest) != (meta.get("rows"), meta.get("digest")):
            raise self._damaged("rows are lost or changed")
        if last is not None and meta.get("state") != last:
            raise self._damaged("the number of its last change is wrong")

    def _take_out(self, connection: sqlite3.Connection, record: ClipRecord, state: int) -> int:
        """Mark a clip as removed; return by what the digest changes."""
        row = self._row(record.content)
        if row is None:
            raise DatabaseError(f"{record.name}: is not in the database (any more); list it again")
        checksum = _row_checksum(row[6:], row[5], row[3], row[1], state)
        connection.execute(
            "UPDATE clips SET removed_in = ?, row_checksum = ? WHERE id = ?",
            (state, checksum, row[0]),
        )
        return int(row[4]) ^ checksum

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
    def _damage(self) -> Iterator[None]:
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
            "copy, or merge what is sound of it into a new one"
        )


def find_catalogue(folder: Path) -> Path:
    """Return the path of a database's catalogue, which need not be there yet.

    Where compaction was killed, there are two: the one with the higher number counts.
    """
    found = [path for path in folder.glob(f"{_STEM}*{_SUFFIX}") if _number(path)]
    return max(found, key=_number, default=folder / f"{_STEM}{_SUFFIX}")


def _number(path: Path) -> int:
    """Return the number of a catalogue: the first has none in its name; 0 for other files."""
    number = path.name.removeprefix(_STEM).removesuffix(_SUFFIX)
    if not number:
        return 1
    return int(number[1:]) if number[0] == "-" and number[1:].isdigit() else 0


def _successor(path: Path) -> Path:
    return path.with_name(f"{_STEM}-{_number(path) + 1}{_SUFFIX}")


def _needs_rollback(error: BaseException | None) -> bool:
    """Return whether a reader failed because a writer was killed within a commit.

    It left a journal, which only a connection that may write can roll back.
    """
    return getattr(error, "sqlite_errorname", "").startswith("SQLITE_READONLY")


def _insert(connection: sqlite3.Connection, entry: Entry, state: int) -> int:
    """Insert a clip; return by what the digest changes."""
    record = entry.record
    labels = json.dumps(record.labels)
    connection.execute("INSERT OR IGNORE INTO label_sets (labels) VALUES (?)", (labels,))
    values = [_stored(record, name) for name in _FIELDS]
    sketch = np.ascontiguousarray(entry.sketch, dtype="<u4").tobytes()
    checksum = _row_checksum([entry.filled, *values], labels, sketch, state, None)
    cursor = connection.execute(
        "INSERT INTO clips (label_set, filled, sketch, added_in, row_checksum, "
        f"{', '.join(_FIELDS)}) VALUES ((SELECT id FROM label_sets WHERE labels = ?), "
        f"?, ?, ?, ?{', ?' * len(_FIELDS)})",
        (labels, entry.filled, sketch, state, checksum, *values),
    )
    connection.executemany(
        "INSERT INTO clips_of_hash (hash, clip) VALUES (?, ?)",
        ((value, cursor.lastrowid) for value in entry.sketch.tolist()),
    )
    return checksum


def _stored(record: ClipRecord, name: str) -> Any:
    """Return a field of a record as its column holds it."""
    value = getattr(record, name)
    if name == "synthetic" and record.virtual_markers:
        return _SYNTHESISED
    if name in _LISTS:
        return json.dumps(value)
    return int(value) if isinstance(value, bool) else value


def _parsed(
    row: tuple[Any, ...], labels: dict[str, tuple[str, ...]], rate: float, *, checked: bool
) -> ClipRecord | str:
    """Return what a row says; the name in it, where that makes no sense or was changed.

    Parameters
    ----------
    row : tuple
        By `_ROWS`.
    labels : dict
        Lists of labels met before: thousands of clips share a few.
    rate : float
        The database's.
    checked : bool
        Whether to compare the row with its checksum.
    """
    _, added_in, removed_in, sketch, row_checksum, text, *rest = row
    values = dict(zip(_FIELDS, rest[1:], strict=True))
    name = str(values["name"])
    if checked and row_checksum != _row_checksum(rest, text, sketch, added_in, removed_in):
        return name
    try:
        if text not in labels:
            labels[text] = tuple(json.loads(text))
        for key in _LISTS:
            values[key] = tuple(json.loads(values[key]))
        values["virtual_markers"] = values["synthetic"] == _SYNTHESISED
        values["synthetic"] = bool(values["synthetic"]) and not values["virtual_markers"]
        return ClipRecord(**values, labels=labels[text], rate=rate)
    except (ValueError, TypeError):
        return name


def _row_checksum(
    values: Sequence[Any],
    labels: str,
    sketch: bytes,
    added_in: int,
    removed_in: int | None,
) -> int:
    """Return the checksum of a row: of the mask and the fields as they are stored, and the rest."""
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
