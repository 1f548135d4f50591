"""The prior database: add clips, read their positions."""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.database.catalogue import Catalogue, find_catalogue, successor
from priorfill.database.catalogue_rows import CatalogueRow
from priorfill.database.content_hash import content_hash
from priorfill.database.convert import replaced_segments, unaccounted_bytes
from priorfill.database.create_database import SEGMENTS, create_database
from priorfill.database.database_lock import LOCK, DatabaseLock
from priorfill.database.database_text import database_html, database_line
from priorfill.database.ingest import ingest, stored_levels, unpack_mask
from priorfill.database.manifest import FORMAT_VERSION, MANIFEST, Manifest, read_manifest
from priorfill.database.near_duplicates import RATE_TOLERANCE, same_motion
from priorfill.database.record import (
    AcceptResult,
    ClipOrigin,
    ClipRecord,
    DatabaseInfo,
    MergeResult,
)
from priorfill.database.record_checks import has_odd_text, printable, with_printable_texts
from priorfill.database.recovery import (
    check_checksums,
    file_size,
    find_problems,
    remove_unused,
    unused_bytes,
)
from priorfill.database.segments import (
    DTYPE,
    HEADER_BYTES,
    MARK_BYTES,
    Place,
    SegmentReader,
    SegmentWriter,
)
from priorfill.database.sketch import MIN_SHARED_HASHES, is_version, sketch
from priorfill.database.subject_names import subject_name
from priorfill.database.versions import is_same_fill, reason_to_keep
from priorfill.errors import (
    ClipError,
    DatabaseCorruptError,
    DatabaseError,
    DatabaseFormatError,
    DatabaseNotFoundError,
    DuplicateClipError,
    OptionError,
)
from priorfill.runtime.argument_types import check_path
from priorfill.runtime.display import escaped

__all__ = ["DEFAULT_LEVELS", "DEFAULT_RATE", "PriorDatabase"]

DEFAULT_RATE = 30.0
"""Hz. Rate of level 0. Body movement is below 10 Hz; Baumann et al. 2011 keep their database at
30 Hz."""

DEFAULT_LEVELS = 3
"""Number of levels: 30, 15 and 7.5 Hz. The coarsest still has several frames per step."""

FILLED_IN_FILE = "another program"
"""Recorded as the method that filled samples which a file marks as interpolated."""

MAX_OPEN_ATTEMPTS = 5
"""Maximum attempts of a reader to open a database that a writer compacts at the same time."""


class PriorDatabase:
    """An open prior database; a context manager that closes it.

    Made by `open`, `create` and `open_or_create`. A reader sees the clips that existed when it
    opened the database, whatever a writer does in the meantime.

    Attributes
    ----------
    path : Path
        The directory.
    rate : float
        Frames per second of level 0 (Hz).
    levels : int
        Number of levels, each at half the rate of the previous one.

    See Also
    --------
    ClipOrigin, ClipRecord, Selection, priorfill.fill

    Examples
    --------
    >>> from priorfill.runtime.resources import resource_path
    >>> with PriorDatabase.open(resource_path("starter")) as database:
    ...     database.rate, database.levels, len(database.clips())
    (30.0, 3, 16)
    """

    def __init__(self, path: Path, *, write: bool, state: str = "") -> None:
        self.path = path
        self._earlier = state
        self._lock: DatabaseLock | None = None
        self._manifest = read_manifest(path)
        self.rate = self._manifest.rate
        self.levels = self._manifest.levels
        self._records: tuple[ClipRecord, ...] | None = None
        self._folder = path / SEGMENTS
        self._writer: SegmentWriter | None = None
        try:
            if write:
                if not (path / LOCK).exists():
                    self._refuse_damaged()
                self._lock = DatabaseLock(path)
                self._manifest = self._converted()
            self._open(write)
            if write:
                self._prepare_to_write()
        except BaseException:
            if hasattr(self, "_catalogue"):
                self._catalogue.suspend_checksum()
            self.close()
            raise

    def _refuse_damaged(self) -> None:
        """Check for damage before even the lock is written."""
        with PriorDatabase(self.path, write=False) as reader:
            catalogue = reader._catalogue
            if not catalogue.identity:
                problems = reader.verify()
            else:
                listed = catalogue.segments_list
                problems = [*find_problems(self._folder, catalogue.identity, listed).values()]
        if problems:
            raise DatabaseCorruptError(problems[0])

    def _converted(self) -> Manifest:
        """Return the manifest of the present format version; convert the database if need be."""
        manifest = read_manifest(self.path)
        if manifest.version == FORMAT_VERSION and manifest.converted_from is None:
            return manifest
        from priorfill.database.convert import convert

        with PriorDatabase(self.path, write=False) as old:
            return convert(old, manifest, old._catalogue)

    def _open(self, write: bool) -> None:
        """Open the catalogue and, for a reader, the segments in their present state."""
        for attempt in range(1, MAX_OPEN_ATTEMPTS + 1):
            catalogue = find_catalogue(self.path)
            try:
                self._catalogue = Catalogue(
                    catalogue, self._manifest, write=write, state=self._earlier
                )
            except (DatabaseError, OSError):
                # a compaction may have replaced it after it was found
                if find_catalogue(self.path) == catalogue or attempt == MAX_OPEN_ATTEMPTS:
                    raise
                continue
            self._reader = SegmentReader(self._folder)
            if write or self._reader.hold(self._catalogue.segments()):
                return
            if find_catalogue(self.path) == catalogue or attempt == MAX_OPEN_ATTEMPTS:
                return  # a segment is missing; reading its clips raises the error
            self._reader.close()
            self._catalogue.close()

    def _prepare_to_write(self) -> None:
        """Compare the segments with the catalogue, and remove what a killed writer left."""
        listed = self._catalogue.segments_list
        identity = self._manifest.identity
        problems = find_problems(self._folder, identity, listed)
        if problems:
            raise DatabaseCorruptError(next(iter(problems.values())))
        left = remove_unused(self._folder, identity, listed)
        if left != listed:
            self._catalogue.announce(left)
        self._writer = SegmentWriter(self._folder, identity, left)

    @property
    def state(self) -> str:
        """The state that is read; `open` takes it to read the same clips after later changes."""
        return self._catalogue.state

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of the state in which the database was found; usually empty."""
        return (self._catalogue.note,) if self._catalogue.note else ()

    @classmethod
    def create(
        cls, path: str | Path, *, rate: float = DEFAULT_RATE, levels: int = DEFAULT_LEVELS
    ) -> Self:
        """Create a database and open it for writing.

        Parameters
        ----------
        path : str or Path
            A directory that does not exist, or is empty.
        rate : float
            Frames per second of level 0 (Hz).
        levels : int
            Number of levels.

        Raises
        ------
        DatabaseFormatError
            If the directory is not empty.
        DatabaseNotFoundError
            If the parent folder does not exist.
        OptionError
            If the rate or the number of levels is invalid.
        """
        check_path("path", path)
        path = Path(path)
        if not (np.isfinite(rate) and rate > 0):
            raise OptionError(f"a database rate of {rate:g} Hz is invalid; give 30, for example")
        if levels < 1:
            raise OptionError(f"a database of {levels} levels is invalid; give 1 or more")
        if not path.parent.is_dir():
            raise DatabaseNotFoundError(
                f"{path}: the folder {path.parent} does not exist; create it first"
            )
        create_database(path, rate, levels)
        return cls(path, write=True)

    @classmethod
    def open(cls, path: str | Path, *, write: bool = False, state: str = "") -> Self:
        """Open a database.

        Parameters
        ----------
        path : str or Path
            Its directory.
        write : bool
            Whether clips will be added or removed. Only one process can write at a time.
        state : str
            An earlier `state` to read, as if nothing had been added or removed since. A database
            has its earlier states until it is compacted. By default the latest.

        Raises
        ------
        DatabaseNotFoundError
            If the directory does not exist.
        DatabaseStateError
            If the database does not have that state.
        OptionError
            If an earlier state is to be written to.
        DatabaseFormatError
            If the directory is not a database, or has a format version unknown to this priorfill.
        DatabaseLockedError
            If another process is writing to it.
        DatabaseCorruptError
            If its catalogue is damaged.
        """
        if write and state:
            raise OptionError("an earlier `state` of a database can only be read, not written to")
        check_path("path", path)
        return cls(Path(path), write=write, state=state)

    @classmethod
    def open_or_create(
        cls, path: str | Path, *, rate: float = DEFAULT_RATE, levels: int = DEFAULT_LEVELS
    ) -> Self:
        """Open a database for writing; create it if it does not exist.

        For an existing database `rate` and `levels` are ignored. Parameters and errors are those of
        `create` and `open`.
        """
        check_path("path", path)
        path = Path(path)
        if not (path / MANIFEST).exists():
            try:
                return cls.create(path, rate=rate, levels=levels)
            except DatabaseFormatError:
                if not (path / MANIFEST).exists():
                    raise
        return cls.open(path, write=True)  # another process has created it meanwhile, perhaps

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return database_line(self)

    def _repr_html_(self) -> str:
        """Return the database as a notebook shows it: its figures, and its clips."""
        return database_html(self)

    def close(self) -> None:
        """Close all files and release the lock."""
        if hasattr(self, "_catalogue"):
            self._catalogue.close()
        if hasattr(self, "_reader"):
            self._reader.close()
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def add(
        self,
        clip: Clip,
        origin: ClipOrigin | None = None,
        *,
        filled: NDArray[np.bool_] | None = None,
        filled_by: str = "",
    ) -> ClipRecord:
        """Add a clip; when this returns, the clip is safely on the disk.

        Positions are turned upright, resampled to the database's levels and rounded to float32.
        Gaps remain gaps.

        Parameters
        ----------
        clip : Clip
            The clip, at any rate and with any axis up.
        origin : ClipOrigin, optional
            Subject, session, terms of use and the like.
        filled : ndarray of bool [shape=(frames, markers)], optional
            Samples of the clip that were filled, not measured; by default those that the clip's
            file marks as interpolated.
        filled_by : str
            The method that filled them.

        Returns
        -------
        ClipRecord
            The new clip. It replaces a version of the recording with more gaps if `filled` names
            the samples that it adds, and a filled version if it measures all of its samples.

        Raises
        ------
        DuplicateClipError
            If the database has the same clip, or another version of the recording that has as many
            samples.
        ClipError
            If no marker is ever seen, or the clip is static, too short, or its rate too low.
        OptionError
            If `filled` does not have the shape of the clip.
        DatabaseError
            If the database was opened for reading.

        See Also
        --------
        accept
        """
        origin = origin or ClipOrigin()
        if filled is None and clip.source is not None:
            filled, filled_by = clip.source.interpolated, FILLED_IN_FILE
        self._ready_writer()
        blocks, row = ingest(clip, self.rate, self.levels, filled, filled_by)
        record = replace(
            row.record,
            subject=subject_name(clip.subject) if origin.subject is None else origin.subject,
            session=origin.session,
            licence=origin.licence,
            credit=origin.credit,
            synthetic=origin.synthetic,
            virtual_markers=origin.virtual_markers,
            source=row.record.source if origin.source is None else origin.source,
        )
        row = replace(row, record=record)
        return self._store(blocks, row, self._versions_to_replace(row, blocks, accepted=False))

    def accept(
        self,
        clip: Clip,
        filled: NDArray[np.bool_],
        *,
        filled_by: str,
        origin: ClipOrigin | None = None,
    ) -> AcceptResult:
        """Add a filled clip in place of the versions of it in the database.

        Parameters
        ----------
        clip : Clip
            The clip with its gaps filled.
        filled : ndarray of bool [shape=(frames, markers)]
            Which samples were filled.
        filled_by : str
            The method that filled them.
        origin : ClipOrigin, optional
            As for `add`; fields that are not set are taken from the replaced version.

        Returns
        -------
        AcceptResult
            The new clip and those that it replaced.

        Raises
        ------
        DuplicateClipError
            If the database has the same clip with the same mask, or a version in which samples
            filled here were measured.
        ClipError, OptionError, DatabaseError
            As for `add`.

        See Also
        --------
        add
        """
        origin = origin or ClipOrigin()
        self._ready_writer()
        blocks, row = ingest(clip, self.rate, self.levels, filled, filled_by)
        replaced = self._versions_to_replace(row, blocks, accepted=True)
        old = replaced[0] if replaced else row.record
        record = replace(
            row.record,
            subject=(
                (old.subject or subject_name(clip.subject))
                if origin.subject is None
                else origin.subject
            ),
            session=origin.session or old.session,
            licence=origin.licence or old.licence,
            credit=origin.credit or old.credit,
            synthetic=origin.synthetic or old.synthetic,
            virtual_markers=origin.virtual_markers or old.virtual_markers,
            source=row.record.source if origin.source is None else origin.source,
        )
        return AcceptResult(self._store(blocks, replace(row, record=record), replaced), replaced)

    def _ready_writer(self) -> SegmentWriter:
        if self._lock is None:
            raise DatabaseError(f"{self.path}: is open for reading; open it with write=True")
        self._lock.check()
        self._recover()
        assert self._writer is not None
        return self._writer

    def _recover(self) -> None:
        """After a change that failed, read the state on the disk."""
        if self._lock is not None and self._writer is None:
            self._lock.check()
            self._catalogue.reopen()
            self._reader.close()
            self._reader = SegmentReader(self._folder)
            try:
                self._prepare_to_write()
            except BaseException:
                self._catalogue.suspend_checksum()
                raise

    def _versions_to_replace(
        self, row: CatalogueRow, blocks: Sequence[bytes], *, accepted: bool
    ) -> tuple[ClipRecord, ...]:
        """Return the versions of a clip that it replaces; raise an error if one is to be kept."""
        new = row.record
        versions = {new.content: self._catalogue.find(new.content)}
        for content, (shared, size) in self._catalogue.sharing(row.sketch).items():
            if shared < MIN_SHARED_HASHES:
                continue
            old = self._catalogue.find(content)
            same_length = old is not None and old.original_frames == new.original_frames
            if is_version(shared, len(row.sketch), size, same_length=same_length):
                versions[content] = old
        found = [old for _, old in sorted(versions.items()) if old is not None]
        for old in found:
            same_fill = partial(self._is_same_fill, old, new, blocks)
            reason = reason_to_keep(old, new, accepted=accepted, is_same_fill=same_fill)
            if reason:
                raise DuplicateClipError(f"{new.name}: {reason}")
        return tuple(found)

    def _is_same_fill(self, old: ClipRecord, new: ClipRecord, blocks: Sequence[bytes]) -> bool:
        """Return whether the filled samples of a stored clip have the same values in a new one."""
        filled = self.filled(old)
        assert filled is not None
        fine = np.frombuffer(blocks[0], dtype=DTYPE).reshape(-1, len(new.labels), 3)
        order = [new.labels.index(label) for label in old.labels]
        return is_same_fill(self.positions(old), filled, fine, order)

    def _store(
        self, blocks: Sequence[bytes], row: CatalogueRow, replaced: Iterable[ClipRecord]
    ) -> ClipRecord:
        writer = self._ready_writer()
        row = replace(row, record=with_printable_texts(row.record))
        with self._one_change():
            place = writer.place(row.record.nbytes)
            writer.check(place)
            self._catalogue.announce(writer.announcing([place]))
            writer.append(blocks, place)
            record = replace(row.record, segment=place.segment, offset=place.offset)
            self._catalogue.change([replace(row, record=record)], replaced, writer.listed)
        return record

    @contextmanager
    def _one_change(self) -> Iterator[None]:
        """Make a change; if it fails, the next one first reads the state on the disk.

        A change that raises an error may still be complete: a disk can fail, or a user interrupt,
        right after the commit.
        """
        try:
            yield
        except BaseException:
            self._writer = None
            self._catalogue.suspend_checksum()
            raise
        finally:
            self._records = None

    def remove(self, records: Iterable[ClipRecord]) -> None:
        """Remove clips in one commit.

        `compact` frees their disk space.

        Parameters
        ----------
        records : iterable of ClipRecord
            Some of `clips`.

        Raises
        ------
        DatabaseError
            If one of them no longer exists, or the database was opened for reading.
        """
        self._ready_writer()
        with self._one_change():
            self._catalogue.change(remove=list(records))

    def edit(
        self,
        records: Iterable[ClipRecord],
        *,
        subject: str | None = None,
        session: str | None = None,
    ) -> tuple[ClipRecord, ...]:
        """Correct the subject or session of clips in one commit.

        Parameters
        ----------
        records : iterable of ClipRecord
            Some of `clips`.
        subject, session : str, optional
            The new values; an empty text removes them. None leaves them as they are.

        Returns
        -------
        tuple of ClipRecord
            The clips with their new values, in the given order; those that had them already are
            unchanged.

        Raises
        ------
        DatabaseError
            If one of them no longer exists, or the database was opened for reading.
        """
        self._ready_writer()
        records = tuple(map(self._present, records))
        edited = tuple(
            replace(
                record,
                subject=record.subject if subject is None else printable(subject),
                session=record.session if session is None else printable(session),
            )
            for record in records
        )
        pairs = [pair for pair in zip(records, edited, strict=True) if pair[0] != pair[1]]
        with self._one_change():
            self._catalogue.edit(pairs)
        return edited

    def _present(self, record: ClipRecord) -> ClipRecord:
        """Return a clip's record as it is at present."""
        found = self._catalogue.find(record.content)
        if found is None:
            raise DatabaseError(f"{record.name}: is not in the database; list its clips again")
        return found

    def compact(self, progress: Callable[[int, int], None] | None = None) -> int:
        """Free the disk space of removed clips.

        All clips are written anew; at any moment either the old or the new database exists. This
        takes as much free space as the clips occupy.

        Parameters
        ----------
        progress : callable, optional
            Called with (clips done, all clips).

        Returns
        -------
        int
            Freed bytes; without those of files that Windows does not remove now, because a process
            has them open (`DatabaseInfo.leftover_bytes`).

        Raises
        ------
        DatabaseCorruptError
            If a clip is damaged; remove it first.
        DatabaseError
            If the database was opened for reading.
        """
        self._ready_writer()
        before = self._bytes_on_disk()
        if not self._catalogue.segments_list.is_clean:  # perhaps it can be removed meanwhile
            with self._one_change():
                self._prepare_to_write()
        records = self.clips()
        if self._segment_bytes() != _bytes_needed(records):
            for record in records:
                self.check(record)
            with self._one_change():
                self._rewrite(self._ready_writer(), records, progress)
        return max(0, before - self._bytes_on_disk())

    def _rewrite(
        self,
        writer: SegmentWriter,
        records: Sequence[ClipRecord],
        progress: Callable[[int, int], None] | None,
    ) -> None:
        """Write all clips to new segments, and the catalogue anew."""
        before = self._catalogue.segments_list
        old = before.segments
        writer.begin_new()
        places: list[Place] = []
        for record in records:
            places.append(writer.place(record.nbytes, places[-1] if places else None))
        unfinished = f"{successor(self._catalogue.path).name}.new"
        self._catalogue.announce(writer.announcing(places, (unfinished,)))
        rows = []
        for done, (record, place) in enumerate(zip(records, places, strict=True), start=1):
            self.check(record)
            row = self._catalogue.row(record)
            writer.append(self._blocks(record), place)
            moved = replace(record, segment=place.segment, offset=place.offset)
            rows.append(replace(row, record=moved))
            if progress is not None:
                progress(done, len(records))
        new = {n: one for n, one in writer.listed.segments.items() if n not in old}
        listed = replaced_segments(self._folder, before, new, self._catalogue.path.name)
        self._catalogue.replace(rows, listed)
        self._reader.close()
        self._reader = SegmentReader(self._folder)
        self._prepare_to_write()

    def merge(
        self, other: PriorDatabase, progress: Callable[[int, int], None] | None = None
    ) -> MergeResult:
        """Add the clips of another database unchanged.

        Parameters
        ----------
        other : PriorDatabase
            Open, with the same rate and levels.
        progress : callable, optional
            Called with (clips done, all clips).

        Returns
        -------
        MergeResult
            The clips that were added, those that this database had, and those that are damaged.

        Raises
        ------
        OptionError
            If the rates or levels differ.
        DatabaseCorruptError
            If this database is damaged.
        DatabaseError
            If this database was opened for reading.
        """
        self._ready_writer()
        if (other.rate, other.levels) != (self.rate, self.levels):
            raise OptionError(
                f"{other.path}: has {other.levels} levels from {other.rate:g} Hz on, {self.path} "
                f"{self.levels} from {self.rate:g} Hz on; add its recordings to this one instead"
            )
        records = other.clips()
        added, skipped = [], []
        damaged = [f"{other.path}: the row of clip {name} is damaged" for name in other.damaged]
        for done, record in enumerate(records, start=1):
            try:
                other.check(record)
                row, blocks = other._catalogue.row(record), other._blocks(record)
            except DatabaseCorruptError as error:
                damaged.append(str(error))
            else:  # damage found from here on is that of this database
                try:
                    replaced = self._versions_to_replace(row, blocks, accepted=False)
                    added.append(self._store(blocks, row, replaced))
                except DuplicateClipError:
                    skipped.append(record)
            if progress is not None:
                progress(done, len(records))
        return MergeResult(tuple(added), tuple(skipped), tuple(damaged))

    def _blocks(self, record: ClipRecord) -> list[bytes]:
        return [self.positions(record, level).tobytes() for level in range(len(record.frames))]

    def versions(self, clip: Clip) -> tuple[ClipRecord, ...]:
        """Return the clips that hold samples of the same recording as a clip.

        These are other versions, parts, and exports in another format, whose samples are rounded.
        """
        sharing = self._catalogue.sharing(sketch(clip.positions))
        contents = {
            content for content, (shared, _) in sharing.items() if shared >= MIN_SHARED_HASHES
        }
        contents.add(content_hash(clip))
        contents |= self._near_duplicates(clip, contents)
        return tuple(record for record in self.clips() if record.content in contents)

    def _near_duplicates(self, clip: Clip, known: set[str]) -> set[str]:
        """Return the contents of clips of the same length and motion, except known ones."""
        same_length = [
            record
            for record in self.clips()
            if record.content not in known
            and record.original_frames == clip.frames
            and abs(record.original_rate / clip.rate - 1) <= RATE_TOLERANCE
        ]
        coarse_at = cache(
            lambda rate: stored_levels(replace(clip, rate=rate), self.rate, self.levels)[-1]
        )
        found = set()
        for record in same_length:
            with suppress(ClipError, DatabaseCorruptError):  # damage is reported by `check`
                # the same frames at the same times, even if one of the rates was rounded
                coarse = coarse_at(record.original_rate)
                stored = self.positions(record, len(record.frames) - 1)
                if same_motion(coarse, clip.labels, stored, record.labels):
                    found.add(record.content)
        return found

    def clips(self) -> tuple[ClipRecord, ...]:
        """Return every clip, in an order independent of the order of adding.

        Clips whose rows are damaged are left out; see `damaged`.
        """
        if self._records is None:
            self._recover()
            self._records = tuple(self._catalogue.records())
        return self._records

    @property
    def damaged(self) -> tuple[str, ...]:
        """Names of clips whose rows in the catalogue are damaged."""
        self.clips()
        return tuple(self._catalogue.damaged)

    def positions(self, record: ClipRecord, level: int = 0) -> NDArray[np.float32]:
        """Return a clip's positions at a level.

        Parameters
        ----------
        record : ClipRecord
            One of `clips`.
        level : int
            The level; its rate is that of the database / 2^level.

        Returns
        -------
        ndarray [shape=(frames, markers, 3), mm]
            Upright (+Z up), NaN where missing; read-only, and not compared with their checksum
            (see `check` and `checked_positions`).

        Raises
        ------
        OptionError
            If the level does not exist.
        DatabaseCorruptError
            If the file is too short.
        """
        return self._read(record, level)[0]

    def checked_positions(self, record: ClipRecord, level: int = 0) -> NDArray[np.float32]:
        """Return a clip's positions at a level, compared with their checksum.

        Parameters and result are those of `positions`.

        Raises
        ------
        DatabaseCorruptError
            If the level does not match its checksum, or the file is too short.
        """
        values, found = self._read(record, level)
        self._compare(record, level, found)
        return values

    def _read(self, record: ClipRecord, level: int) -> tuple[NDArray[np.float32], int]:
        """Return positions, and their CRC-32."""
        if not 0 <= level < len(record.frames):
            raise OptionError(
                f"level {level} is not in the database; it has 0 to {len(record.frames) - 1}"
            )
        offset, shape = self._place(record, level)
        data = self._reader.read(record.segment, offset, math.prod(shape) * DTYPE.itemsize)
        return np.frombuffer(data, dtype=DTYPE).reshape(shape), zlib.crc32(data)

    def _check_positions(self, record: ClipRecord) -> None:
        for level in range(len(record.frames)):
            offset, shape = self._place(record, level)
            nbytes = math.prod(shape) * DTYPE.itemsize
            self._compare(record, level, self._reader.checksum(record.segment, offset, nbytes))

    def _compare(self, record: ClipRecord, level: int, found: int) -> None:
        """Raise an error if a level's checksum differs from the one found."""
        if found != record.checksums[level]:
            raise DatabaseCorruptError(
                f"{self.path}: positions of clip {record.name} are damaged (level {level}); "
                "restore the database from a copy, or remove the clip"
            )

    def _place(self, record: ClipRecord, level: int) -> tuple[int, tuple[int, int, int]]:
        """Return the byte of its segment where a level of a clip begins, and its shape."""
        markers = len(record.labels)
        before = sum(record.frames[:level]) * markers * 3 * DTYPE.itemsize
        return record.offset + before, (record.frames[level], markers, 3)

    def filled(self, record: ClipRecord, level: int = 0) -> NDArray[np.bool_] | None:
        """Return which samples of a clip were filled.

        Parameters
        ----------
        record : ClipRecord
            One of `clips`.
        level : int
            The level.

        Returns
        -------
        ndarray of bool [shape=(frames, markers)] or None
            None if all were measured. A sample of level 0 counts as filled if one of the
            recording's samples that surround its time was filled; a sample of another level if
            that of level 0 at its time counts as filled.

        Raises
        ------
        DatabaseCorruptError
            If the stored mask is damaged.
        """
        packed = self._catalogue.filled(record.content)
        if packed is None:
            return None
        try:
            mask = unpack_mask(packed, (record.frames[0], len(record.labels)))
        except (zlib.error, ValueError) as error:
            raise DatabaseCorruptError(
                f"{self.path}: the mask of filled samples of clip {record.name} is damaged; "
                "restore the database from a copy, or remove the clip"
            ) from error
        return mask[:: 2**level]

    def info(self) -> DatabaseInfo:
        """Return figures of the database."""
        records = self.clips()
        files = [path for path in self.path.rglob("*") if path.is_file() and not path.is_symlink()]
        return DatabaseInfo(
            path=self.path,
            version=self._manifest.version,
            rate=self.rate,
            levels=self.levels,
            clips=len(records),
            synthetic=sum(record.synthetic for record in records),
            virtual_markers=sum(record.virtual_markers for record in records),
            subjects=len({record.subject for record in records} - {""}),
            frames=sum(record.frames[0] for record in records),
            seconds=sum(record.duration for record in records),
            bytes=sum(map(file_size, files)),
            removed_bytes=max(0, self._segment_bytes() - _bytes_needed(records)),
            leftover_bytes=unused_bytes(self._folder, self._catalogue.segments_list),
            marker_sets=dict(sorted(Counter(record.marker_set for record in records).items())),
            licences=dict(sorted(Counter(record.licence for record in records).items())),
            credits=dict(sorted(Counter(record.credit for record in records).items())),
        )

    def check(self, record: ClipRecord) -> None:
        """Compare everything stored of a clip with its checksums.

        Raises
        ------
        DatabaseCorruptError
            If they differ.
        """
        if not self._catalogue.check(record):
            raise DatabaseCorruptError(
                f"{self.path}: the catalogue's row of clip {record.name} is damaged; "
                "restore the database from a copy"
            )
        self._check_positions(record)

    def verify(self, progress: Callable[[int, int], None] | None = None) -> list[str]:
        """Check the catalogue and every clip.

        Parameters
        ----------
        progress : callable, optional
            Called with (clips done, all clips).

        Returns
        -------
        list of str
            One message for each damage found.

        Raises
        ------
        DatabaseCorruptError
            If the catalogue cannot be read at all.
        """
        records = self.clips()
        problems = [
            f"{self.path}: the catalogue's row of clip {escaped(name)} is damaged; "
            "restore the database from a copy"
            for name in self._catalogue.damaged
        ]
        problems += [
            f"{self.path}: the texts of clip {escaped(record.name)} have characters that cannot "
            "be printed; add it again under another name, or correct them (priorfill db edit)"
            for record in records
            if has_odd_text(record)
        ]
        in_segments = set()
        for done, record in enumerate(records, start=1):
            try:
                self.check(record)
            except DatabaseCorruptError as error:
                problems.append(str(error))
                in_segments.add(record.segment)
            if progress is not None:
                progress(done, len(records))
        try:
            self._catalogue.check_file()
            problems += self._check_segments(in_segments)
        except DatabaseError as error:
            problems.append(str(error))
        return problems

    def _check_segments(self, damaged: set[int]) -> list[str]:
        """Compare the segments with the catalogue's list, unless they change at the same time."""
        identity = self._catalogue.identity
        if not identity:
            return unaccounted_bytes(self._folder, self._catalogue.end(), self._manifest.identity)
        listed = self._catalogue.present_segments()
        while listed is not None:
            found = find_problems(self._folder, identity, listed)
            problems = [text for number, text in found.items() if number not in damaged]
            problems += check_checksums(self._folder, listed, damaged | set(found))
            before, listed = listed, self._catalogue.present_segments()
            if not problems or listed == before:
                return problems
        return []

    def _segment_bytes(self) -> int:
        """Return the size of the segments that the catalogue accounts for."""
        if not self._catalogue.identity:
            return sum(self._catalogue.end().values())
        return sum(one.size for one in self._catalogue.segments_list.segments.values())

    def _bytes_on_disk(self) -> int:
        """Return the size of the segments, with those that wait to be removed."""
        segments = replace(self._catalogue.segments_list, files=())
        return self._segment_bytes() + unused_bytes(self._folder, segments)


def _bytes_needed(records: Iterable[ClipRecord]) -> int:
    """Return the size of segments that hold clips, and nothing else."""
    segments = {record.segment: 0 for record in records}
    clips = sum(record.nbytes + MARK_BYTES for record in records)
    return clips + HEADER_BYTES * len(segments)
