"""The prior database: clips in, positions out."""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.database.catalogue import Catalogue, Entry, find_catalogue
from priorfill.database.ingest import (
    content_hash,
    counts,
    filled_at_level_0,
    levels_of,
    pack,
    unpack,
)
from priorfill.database.lock import WriterLock
from priorfill.database.manifest import (
    FORMAT_VERSION,
    MANIFEST,
    Manifest,
    read_manifest,
    write_manifest,
)
from priorfill.database.near_duplicates import RATE_ERROR, same_motion
from priorfill.database.record import (
    Accepted,
    ClipRecord,
    DatabaseInfo,
    Merged,
)
from priorfill.database.segments import (
    DTYPE,
    SegmentReader,
    SegmentWriter,
    checksum,
    sync_folder,
)
from priorfill.database.sketch import FEWEST_SHARED, is_version, sketch
from priorfill.database.versions import reason_to_keep
from priorfill.errors import (
    ClipError,
    DatabaseCorruptError,
    DatabaseError,
    DatabaseFormatError,
    DatabaseNotFoundError,
    DuplicateClipError,
    OptionError,
)

__all__ = ["DEFAULT_LEVELS", "DEFAULT_RATE", "PriorDatabase"]

DEFAULT_RATE = 30.0
"""Hz of level 0. Body movement is below 10 Hz; [B11] keeps its database at 30 Hz."""

DEFAULT_LEVELS = 3
"""Resolutions: 30, 15 and 7.5 Hz. The coarsest still has several frames a step."""

FROM_FILE = "another program"
"""By what samples were filled that a file marks as interpolated."""

ATTEMPTS = 5
"""How often a reader tries to open a database that a writer compacts at the same moment."""

_SEGMENTS = "segments"
_LOCK = "lock"


class PriorDatabase:
    """A prior database that is open; a context manager that closes it.

    Made by `open`, `create` and `open_or_create`. A reader sees the clips that were there when
    it was opened, whatever a writer does meanwhile.

    Attributes
    ----------
    path : Path
        The directory.
    rate : float
        Frames per second of level 0 (Hz).
    levels : int
        Number of resolutions, each at half the rate of the one before.
    """

    def __init__(self, path: Path, *, write: bool) -> None:
        self.path = path
        self._lock: WriterLock | None = None
        identity = read_manifest(path)
        self.rate = identity.rate
        self.levels = identity.levels
        self._version = identity.version
        self._records: tuple[ClipRecord, ...] | None = None
        self._folder = path / _SEGMENTS
        if write:
            self._lock = WriterLock(path / _LOCK)
        try:
            self._open(write)
            self._writer: SegmentWriter | None = None
            if write:
                self._prepare_to_write(identity)
        except BaseException:
            self.close()
            raise

    def _open(self, write: bool) -> None:
        """Open the catalogue and, for a reader, hold the segments as they are now."""
        for attempt in range(1, ATTEMPTS + 1):
            catalogue = find_catalogue(self.path)
            if not catalogue.exists() and any(self._folder.glob("*.f32")):
                if attempt < ATTEMPTS:
                    continue  # removed since it was looked for
                raise DatabaseCorruptError(
                    f"{catalogue}: is gone, but there are segments; "
                    "restore the database from a copy"
                )
            try:
                self._catalogue = Catalogue(catalogue, self.rate, self.levels, write=write)
            except DatabaseError:
                if catalogue.exists() or attempt == ATTEMPTS:
                    raise
                continue
            self._reader = SegmentReader(self._folder)
            if write or self._reader.hold(self._catalogue.segments()):
                return
            if catalogue.exists() or attempt == ATTEMPTS:
                return  # the clips that need what is gone will say so
            self._reader.close()
            self._catalogue.close()

    def _prepare_to_write(self, identity: Manifest) -> None:
        self._folder.mkdir(exist_ok=True)
        sync_folder(self.path)
        if self._catalogue.is_version_1:
            records = self._read_records()
            if self._catalogue.damaged:
                raise DatabaseCorruptError(
                    f"{self.path}: rows of clips {', '.join(self._catalogue.damaged)} are "
                    "damaged; restore the database from a copy"
                )
            self._catalogue.replace([self._catalogue.entry(record) for record in records])
        self._catalogue.remove_others()
        if identity.version != FORMAT_VERSION:
            self._version = write_manifest(self.path, self.rate, self.levels).version
        self._writer = SegmentWriter(
            self._folder, self._catalogue.segments(), *self._catalogue.end()
        )

    @classmethod
    def create(
        cls, path: str | Path, *, rate: float = DEFAULT_RATE, levels: int = DEFAULT_LEVELS
    ) -> Self:
        """Make a database and open it for writing.

        Parameters
        ----------
        path : str or Path
            A directory that is not there yet, or an empty one.
        rate : float
            Frames per second of level 0 (Hz).
        levels : int
            Number of resolutions.

        Raises
        ------
        DatabaseFormatError
            Where the directory has something in it.
        DatabaseNotFoundError
            Where the folder that should hold it is not there.
        OptionError
            Where rate or levels make no sense.
        """
        path = Path(path)
        if not (np.isfinite(rate) and rate > 0):
            raise OptionError(f"a database rate of {rate:g} Hz makes no sense; give 30, say")
        if levels < 1:
            raise OptionError(f"a database of {levels} levels makes no sense; give 1 or more")
        if not path.parent.is_dir():
            raise DatabaseNotFoundError(
                f"{path}: the folder {path.parent} is not there; make it first"
            )
        if path.exists() and not path.is_dir():
            raise DatabaseFormatError(f"{path}: is a file; give a folder for the database")
        path.mkdir(exist_ok=True)
        # an unfinished identity file is all that a crash in this function can leave behind
        for other in sorted(path.iterdir()):
            if other.name != f"{MANIFEST}.new":
                raise DatabaseFormatError(
                    f"{path}: has other files in it ({other.name}); "
                    "give an empty or a new folder for a new database"
                )
        write_manifest(path, rate, levels)
        sync_folder(path.parent)
        return cls(path, write=True)

    @classmethod
    def open(cls, path: str | Path, *, write: bool = False) -> Self:
        """Open a database.

        Parameters
        ----------
        path : str or Path
            Its directory.
        write : bool
            Whether clips will be added or removed. Only one process can write at a time; a
            database of an older format is brought to the present one.

        Raises
        ------
        DatabaseNotFoundError
            Where there is no such directory.
        DatabaseFormatError
            Where the directory is no database, or one of a newer format version.
        DatabaseLockedError
            Where another process is writing to it.
        DatabaseCorruptError
            Where its catalogue is damaged.
        """
        return cls(Path(path), write=write)

    @classmethod
    def open_or_create(
        cls, path: str | Path, *, rate: float = DEFAULT_RATE, levels: int = DEFAULT_LEVELS
    ) -> Self:
        """Open a database for writing, or make it; for an existing one `rate` is not looked at.

        The parameters and errors are those of `create` and `open`.
        """
        path = Path(path)
        if (path / MANIFEST).exists():
            return cls.open(path, write=True)
        return cls.create(path, rate=rate, levels=levels)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the catalogue and let the next writer in. Views of positions stay valid."""
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
        *,
        subject: str | None = None,
        session: str = "",
        licence: str = "",
        credit: str = "",
        synthetic: bool = False,
        virtual_markers: bool = False,
        source: str | None = None,
        filled: NDArray[np.bool_] | None = None,
        filled_by: str = "",
    ) -> ClipRecord:
        """Add a clip; once this returns, it survives anything.

        Positions are turned upright, resampled to the database's levels and rounded to
        float32. Gaps stay gaps.

        Parameters
        ----------
        clip : Clip
            The clip, at any rate and with any axis up.
        subject : str, optional
            Whose motion it is; by default what the clip says.
        session, licence, credit : str
            Recording session, terms of use, whom to name.
        synthetic : bool
            Whether the motion is computed, not recorded.
        synthesised : bool
            Whether the motion was recorded, but the markers were placed on a skeleton.
        source : str, optional
            Name of the file that it comes from; by default as the clip says.
        filled : ndarray [shape=(frames, markers), bool], optional
            Samples of the clip that were synthesised, not measured; by default those that the
            clip's file says are.
        filled_by : str
            By what.

        Returns
        -------
        ClipRecord
            The new row. Where it is the filled version of a clip that was there with its gaps,
            it has taken the place of that.

        Raises
        ------
        DuplicateClipError
            Where a clip with the same content is there, or another version of the same
            recording that has as much.
        ClipError
            Where no marker is ever seen, or the clip is static, too short or of too low a rate.
        OptionError
            Where `filled` does not have the shape of the clip.
        DatabaseError
            Where the database was opened for reading.
        """
        if filled is None and clip.source is not None:
            filled, filled_by = clip.source.interpolated, FROM_FILE
        blocks, entry = self._made_ready(clip, filled, filled_by)
        record = replace(
            entry.record,
            subject=clip.subject if subject is None else subject,
            session=session,
            licence=licence,
            credit=credit,
            synthetic=synthetic,
            virtual_markers=virtual_markers,
            source=entry.record.source if source is None else source,
        )
        entry = replace(entry, record=record)
        return self._store(blocks, entry, self._to_be_replaced(entry, accepted=False))

    def accept(
        self,
        clip: Clip,
        filled: NDArray[np.bool_],
        *,
        filled_by: str,
        subject: str | None = None,
        session: str = "",
        licence: str = "",
        credit: str = "",
    ) -> Accepted:
        """Add a filled clip in the place of the versions of it that are there.

        Parameters
        ----------
        clip : Clip
            With its gaps filled.
        filled : ndarray [shape=(frames, markers), bool]
            Which samples were filled.
        filled_by : str
            The method.
        subject, session, licence, credit
            As for `add`; where not given, those of the version replaced.

        Returns
        -------
        Accepted
            The new row and those that it replaced.

        Raises
        ------
        DuplicateClipError
            Where the same clip with the same mask is there, or a version in which samples were
            measured that are filled here.
        ClipError, OptionError, DatabaseError
            As for `add`.
        """
        blocks, entry = self._made_ready(clip, filled, filled_by)
        replaced = self._to_be_replaced(entry, accepted=True)
        former = replaced[0] if replaced else entry.record
        record = replace(
            entry.record,
            subject=(former.subject or clip.subject) if subject is None else subject,
            session=session or former.session,
            licence=licence or former.licence,
            credit=credit or former.credit,
            synthetic=former.synthetic,
            virtual_markers=former.virtual_markers,
        )
        return Accepted(self._store(blocks, replace(entry, record=record), replaced), replaced)

    def _made_ready(
        self, clip: Clip, filled: NDArray[np.bool_] | None, filled_by: str
    ) -> tuple[list[bytes], Entry]:
        """Return a clip as it will be stored, and what the catalogue will say of it."""
        # scipy takes longer to import than a database to open, and only adding needs it
        from priorfill.markers.definitions import recognise

        self._writing()
        if filled is not None and filled.shape != clip.missing.shape:
            raise OptionError(
                f"{clip.name}: the mask of filled samples has shape {filled.shape}; "
                f"{clip.missing.shape} is needed"
            )
        levels = levels_of(clip, self.rate, self.levels)
        mask = None
        if filled is not None and (filled & ~clip.missing).any():
            mask = filled_at_level_0(clip, filled, self.rate) & ~np.isnan(levels[0][..., 0])
            mask = mask if mask.any() else None  # too short for this database's rate
        present, measured = counts(levels[0], mask)
        markerset = recognise(clip.labels)
        blocks = [level.tobytes() for level in levels]
        record = ClipRecord(
            content=content_hash(clip),
            name=clip.name,
            subject=clip.subject,
            session="",
            source=clip.source.path.name if clip.source is not None else "",
            licence="",
            credit="",
            original_rate=float(clip.rate),
            original_frames=clip.frames,
            rate=self.rate,
            frames=tuple(len(level) for level in levels),
            labels=clip.labels,
            marker_set=markerset.name if markerset is not None else "",
            filled_by="" if mask is None else filled_by or "unknown",
            present=present,
            measured=measured,
            added=datetime.now(UTC).isoformat(timespec="seconds"),
            version=metadata.version("priorfill"),
            synthetic=False,
            segment=0,
            offset=0,
            checksums=tuple(checksum(block) for block in blocks),
        )
        packed = None if mask is None else pack(mask)
        return blocks, Entry(record, packed, sketch(clip.positions))

    def _writing(self) -> SegmentWriter:
        if self._lock is None:
            raise DatabaseError(f"{self.path}: is open for reading; open it with write=True")
        self._find_out()
        assert self._writer is not None
        return self._writer

    def _find_out(self) -> None:
        """Find out, after a change that failed, what is on the disk."""
        if self._lock is not None and self._writer is None:
            self._catalogue.reopen()
            self._prepare_to_write(read_manifest(self.path))

    def _to_be_replaced(self, entry: Entry, *, accepted: bool) -> tuple[ClipRecord, ...]:
        """Return the versions of a clip that it will replace, or refuse it for one of them."""
        new = entry.record
        versions = {new.content: self._catalogue.find(new.content)}
        for content, (shared, size) in self._catalogue.sharing(entry.sketch).items():
            if shared < FEWEST_SHARED:
                continue
            old = self._catalogue.find(content)
            same_length = old is not None and old.original_frames == new.original_frames
            if is_version(shared, len(entry.sketch), size, same_length=same_length):
                versions[content] = old
        found = [old for _, old in sorted(versions.items()) if old is not None]
        for old in found:
            reason = reason_to_keep(old, new, accepted=accepted)
            if reason:
                raise DuplicateClipError(f"{new.name}: {reason}")
        return tuple(found)

    def _store(
        self, blocks: Sequence[bytes], entry: Entry, replaced: Iterable[ClipRecord]
    ) -> ClipRecord:
        writer = self._writing()
        with self._one_change():
            segment, offset = writer.append(blocks)
            record = replace(entry.record, segment=segment, offset=offset)
            self._catalogue.change(add=[replace(entry, record=record)], remove=replaced)
            writer.commit(segment, offset + record.nbytes)
        return record

    @contextmanager
    def _one_change(self) -> Iterator[None]:
        """Make a change; if it fails, the next one first finds out what is on the disk.

        What is said to have failed may have been done: a disk can fail, or a user interrupt,
        right after the commit.
        """
        try:
            yield
        except BaseException:
            self._writer = None
            self._catalogue.doubt()
            raise
        finally:
            self._records = None

    def remove(self, records: Iterable[ClipRecord]) -> None:
        """Remove clips, all of them in one commit.

        The disk space is given back by `compact`.

        Parameters
        ----------
        records : iterable of ClipRecord
            Some of `clips`.

        Raises
        ------
        DatabaseError
            Where one is not there any more, or the database was opened for reading.
        """
        self._writing()
        with self._one_change():
            self._catalogue.change(remove=list(records))

    def compact(self, progress: Callable[[int, int], None] | None = None) -> int:
        """Give back the disk space of removed clips.

        All clips are written anew; at any moment either the old or the new database is there.
        It takes as much free space as the clips have.

        Parameters
        ----------
        progress : callable, optional
            Called with (clips done, clips in all).

        Returns
        -------
        int
            Bytes given back.

        Raises
        ------
        DatabaseCorruptError
            Where a clip is damaged; remove it first.
        DatabaseError
            Where the database was opened for reading.
        """
        before = self._segment_bytes()
        writer = self._writing()
        records = self.clips()
        if self._segment_bytes() == sum(record.nbytes for record in records):
            return before - self._segment_bytes()
        entries = []
        with self._one_change():
            writer.begin_new()
            for done, record in enumerate(records, start=1):
                self.check(record)
                entry = self._catalogue.entry(record)
                segment, offset = writer.append(self._blocks(record))
                moved = replace(record, segment=segment, offset=offset)
                writer.commit(segment, offset + record.nbytes)
                entries.append(replace(entry, record=moved))
                if progress is not None:
                    progress(done, len(records))
            self._catalogue.replace(entries)
            self._reader.close()
            self._reader = SegmentReader(self._folder)
            self._prepare_to_write(read_manifest(self.path))
        return before - self._segment_bytes()

    def merge(
        self, other: PriorDatabase, progress: Callable[[int, int], None] | None = None
    ) -> Merged:
        """Add the clips of another database, as they are.

        Parameters
        ----------
        other : PriorDatabase
            Open, of the same rate and levels.
        progress : callable, optional
            Called with (clips done, clips in all).

        Returns
        -------
        Merged
            What was added, what was there already, and what is damaged over there.

        Raises
        ------
        OptionError
            Where rates or levels differ.
        DatabaseError
            Where this database was opened for reading.
        """
        self._writing()
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
                entry = other._catalogue.entry(record)
                replaced = self._to_be_replaced(entry, accepted=False)
                added.append(self._store(other._blocks(record), entry, replaced))
            except DuplicateClipError:
                skipped.append(record)
            except DatabaseCorruptError as error:
                damaged.append(str(error))
            if progress is not None:
                progress(done, len(records))
        return Merged(tuple(added), tuple(skipped), tuple(damaged))

    def _blocks(self, record: ClipRecord) -> list[bytes]:
        return [self.positions(record, level).tobytes() for level in range(len(record.frames))]

    def versions(self, clip: Clip) -> tuple[ClipRecord, ...]:
        """Return the clips that hold samples of the same recording.

        Other versions, parts, and what came of it in another format, with its samples rounded.
        """
        sharing = self._catalogue.sharing(sketch(clip.positions))
        contents = {content for content, (shared, _) in sharing.items() if shared >= FEWEST_SHARED}
        contents.add(content_hash(clip))
        contents |= self._exported_otherwise(clip, contents)
        return tuple(record for record in self.clips() if record.content in contents)

    def _exported_otherwise(self, clip: Clip, known: set[str]) -> set[str]:
        """Return the contents of clips that are as long and move the same, beside known ones."""
        as_long = [
            record
            for record in self.clips()
            if record.content not in known
            and record.original_frames == clip.frames
            and abs(record.original_rate / clip.rate - 1) <= RATE_ERROR
        ]
        found = set()
        for record in as_long:
            # the same frames at the same times, though one of the rates was rounded
            alike = replace(clip, rate=record.original_rate)
            with suppress(ClipError, DatabaseCorruptError):  # none that is here; said when checked
                coarse = levels_of(alike, self.rate, self.levels)[-1]
                stored = self.positions(record, len(record.frames) - 1)
                if same_motion(coarse, clip.labels, stored, record.labels):
                    found.add(record.content)
        return found

    def clips(self) -> tuple[ClipRecord, ...]:
        """Return every clip, in an order that does not depend on how the database grew.

        Clips whose rows are damaged are left out; see `damaged`.
        """
        if self._records is None:
            self._find_out()
            self._records = self._read_records()
        return self._records

    def _read_records(self) -> tuple[ClipRecord, ...]:
        records = self._catalogue.records()
        if self._catalogue.is_version_1:
            records = [self._counted(record) for record in records]
        return tuple(records)

    @property
    def damaged(self) -> tuple[str, ...]:
        """Names of clips whose rows in the catalogue are damaged."""
        self.clips()
        return tuple(self._catalogue.damaged)

    def _counted(self, record: ClipRecord) -> ClipRecord:
        """Return a record with the counts that format version 1 did not keep."""
        try:
            present, measured = counts(self.positions(record), self.filled(record))
        except DatabaseCorruptError:  # will be said when it is checked
            return record
        return replace(record, present=present, measured=measured)

    def positions(self, record: ClipRecord, level: int = 0) -> NDArray[np.float32]:
        """Return a clip's positions at a level.

        Parameters
        ----------
        record : ClipRecord
            One of `clips`.
        level : int
            Which resolution; its rate is that of the database / 2^level.

        Returns
        -------
        ndarray [shape=(frames, markers, 3), mm]
            Upright (+Z up), NaN where missing; a read-only view of the file, not checked
            (see `check`).

        Raises
        ------
        OptionError
            Where there is no such level.
        DatabaseCorruptError
            Where the file ends before.
        """
        if not 0 <= level < len(record.frames):
            raise OptionError(
                f"level {level} is not in the database; it has 0 to {len(record.frames) - 1}"
            )
        offset, shape = self._place(record, level)
        return self._reader.read(record.segment, offset, math.prod(shape)).reshape(shape)

    def sound_positions(self, record: ClipRecord, level: int = 0) -> NDArray[np.float32]:
        """Return a copy of a clip's positions at a level, checked; else as `positions`.

        Raises
        ------
        DatabaseCorruptError
            Where the level does not fit its checksum, or the file ends before.
        """
        offset, shape = self._place(record, level)
        values, found = self._reader.copy(record.segment, offset, math.prod(shape))
        self._compare(record, level, found)
        return values.reshape(shape)

    def _check_positions(self, record: ClipRecord) -> None:
        for level in range(len(record.frames)):
            offset, shape = self._place(record, level)
            nbytes = math.prod(shape) * DTYPE.itemsize
            self._compare(record, level, self._reader.checksum(record.segment, offset, nbytes))

    def _compare(self, record: ClipRecord, level: int, found: int) -> None:
        """Raise an error where a level's checksum is another than that found."""
        if found != record.checksums[level]:
            raise DatabaseCorruptError(
                f"{self.path}: positions of clip {record.name} are damaged (level {level}); "
                "restore the database from a copy, or remove the clip"
            )

    def _place(self, record: ClipRecord, level: int) -> tuple[int, tuple[int, int, int]]:
        """Return where in its segment a level of a clip begins (bytes), and its shape."""
        markers = len(record.labels)
        before = sum(record.frames[:level]) * markers * 3 * DTYPE.itemsize
        return record.offset + before, (record.frames[level], markers, 3)

    def filled(self, record: ClipRecord, level: int = 0) -> NDArray[np.bool_] | None:
        """Return which samples of a clip were synthesised [shape=(frames, markers)].

        None where all were measured. A sample of level 0 counts as synthesised where one of the
        recording's samples that surround its time is; one of another level where that of level 0
        at its time is.

        Raises
        ------
        DatabaseCorruptError
            Where what is stored of it is damaged.
        """
        packed = self._catalogue.filled(record.content)
        if packed is None:
            return None
        try:
            mask = unpack(packed, (record.frames[0], len(record.labels)))
        except (zlib.error, ValueError) as error:
            raise DatabaseCorruptError(
                f"{self.path}: the mask of filled samples of clip {record.name} is damaged; "
                "restore the database from a copy, or remove the clip"
            ) from error
        return mask[:: 2**level]

    def info(self) -> DatabaseInfo:
        """Return the database in figures."""
        records = self.clips()
        files = [path for path in self.path.rglob("*") if path.is_file()]
        return DatabaseInfo(
            path=self.path,
            version=self._version,
            rate=self.rate,
            levels=self.levels,
            clips=len(records),
            synthetic=sum(record.synthetic for record in records),
            virtual_markers=sum(record.virtual_markers for record in records),
            subjects=len({record.subject for record in records} - {""}),
            frames=sum(record.frames[0] for record in records),
            seconds=sum(record.duration for record in records),
            bytes=sum(path.stat().st_size for path in files),
            removed_bytes=self._segment_bytes() - sum(record.nbytes for record in records),
            marker_sets=dict(sorted(Counter(record.marker_set for record in records).items())),
            licences=dict(sorted(Counter(record.licence for record in records).items())),
            credits=dict(sorted(Counter(record.credit for record in records).items())),
        )

    def check(self, record: ClipRecord) -> None:
        """Compare what is stored of a clip with its checksums.

        Raises
        ------
        DatabaseCorruptError
            Where they differ.
        """
        if not self._catalogue.check(self._as_stored(record)):
            raise DatabaseCorruptError(
                f"{self.path}: the catalogue's row of clip {record.name} is damaged; "
                "restore the database from a copy"
            )
        self._check_positions(record)

    def _as_stored(self, record: ClipRecord) -> ClipRecord:
        """Return a record as the catalogue holds it."""
        if not self._catalogue.is_version_1:
            return record
        everywhere = (record.frames[0],) * len(record.labels)
        return replace(record, present=everywhere, measured=everywhere)

    def verify(self, progress: Callable[[int, int], None] | None = None) -> list[str]:
        """Check the catalogue and every clip.

        Parameters
        ----------
        progress : callable, optional
            Called with (clips done, clips in all).

        Returns
        -------
        list of str
            What is damaged, a line each; empty if nothing is.

        Raises
        ------
        DatabaseCorruptError
            Where the catalogue cannot be read at all.
        """
        records = self.clips()
        problems = [
            f"{self.path}: the catalogue's row of clip {name} is damaged; "
            "restore the database from a copy"
            for name in self._catalogue.damaged
        ]
        for done, record in enumerate(records, start=1):
            try:
                self.check(record)
            except DatabaseCorruptError as error:
                problems.append(str(error))
            if progress is not None:
                progress(done, len(records))
        try:
            self._catalogue.check_file()
        except DatabaseCorruptError as error:
            problems.append(str(error))
        return problems

    def _segment_bytes(self) -> int:
        return sum(path.stat().st_size for path in self._folder.glob("*.f32"))
