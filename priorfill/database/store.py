"""The prior database: clips in, positions out."""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from priorfill.axes import to_upright
from priorfill.clip import Clip
from priorfill.database.catalogue import Catalogue
from priorfill.database.lock import WriterLock
from priorfill.database.record import ClipRecord, DatabaseInfo
from priorfill.database.segments import (
    DTYPE,
    SegmentReader,
    SegmentWriter,
    checksum,
    sync_folder,
)
from priorfill.errors import (
    ClipError,
    DatabaseCorruptError,
    DatabaseError,
    DatabaseFormatError,
    DatabaseNotFoundError,
    DuplicateClipError,
    OptionError,
)

__all__ = [
    "DEFAULT_LEVELS",
    "DEFAULT_RATE",
    "FORMAT_VERSION",
    "PriorDatabase",
]

FORMAT_VERSION = 1
"""Version of the form on disk."""

DEFAULT_RATE = 30.0
"""Hz of level 0. Body movement is below 10 Hz; [B11] keeps its database at 30 Hz."""

DEFAULT_LEVELS = 3
"""Resolutions: 30, 15 and 7.5 Hz. The coarsest still has several frames a step."""

MIN_RATE_SHARE = 0.5
"""A clip whose rate is below this share of the database's is refused: more than half of
its samples would be invented."""

MIN_FRAMES = 2
"""Frames that a clip needs at the coarsest level: below, it has no velocity there."""

STATIC_RANGE = 10.0
"""mm. A clip in which no marker leaves a box with this diagonal shows no motion; someone who
stands still sways more within a few seconds."""

_IDENTITY = "priorfill-database.json"
_FORMAT = "priorfill prior database"
_CATALOGUE = "catalogue.sqlite"
_SEGMENTS = "segments"
_LOCK = "lock"


@dataclass(frozen=True)
class _Identity:
    """What the identity file says."""

    version: int
    rate: float
    levels: int


class PriorDatabase:
    """A prior database that is open; a context manager that closes it.

    Made by `open`, `create` and `open_or_create`. A reader sees the clips that were there when
    it was opened.

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
        identity = _read_identity(path)
        self.rate = identity.rate
        self.levels = identity.levels
        self._version = identity.version
        self._records: tuple[ClipRecord, ...] | None = None
        folder = path / _SEGMENTS
        catalogue = path / _CATALOGUE
        if not catalogue.exists() and any(folder.glob("*.f32")):
            raise DatabaseCorruptError(
                f"{catalogue}: is gone, but there are segments; restore the database from a copy"
            )
        if write:
            self._lock = WriterLock(path / _LOCK)
        try:
            self._catalogue = Catalogue(catalogue, identity.rate, write=write)
            self._reader = SegmentReader(folder)
            self._writer: SegmentWriter | None = None
            if write:
                folder.mkdir(exist_ok=True)
                sync_folder(path)
                self._writer = SegmentWriter(folder, *self._catalogue.end())
        except BaseException:
            self.close()
            raise

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
        temporary = path / f"{_IDENTITY}.new"
        for other in sorted(path.iterdir()):
            if other != temporary:
                raise DatabaseFormatError(
                    f"{path}: has other files in it ({other.name}); "
                    "give an empty or a new folder for a new database"
                )
        content = {
            "format": _FORMAT,
            "version": FORMAT_VERSION,
            "rate": float(rate),
            "levels": int(levels),
            "unit": "mm",
            "up": "+Z",
        }
        with temporary.open("w", encoding="utf-8") as file:
            file.write(json.dumps(content, indent=2) + "\n")
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path / _IDENTITY)
        sync_folder(path)
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
            Whether clips will be added. Only one process can write at a time.

        Raises
        ------
        DatabaseNotFoundError
            Where there is no such directory.
        DatabaseFormatError
            Where the directory is no database, or one of another format version.
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
        if (path / _IDENTITY).exists():
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
        filled: NDArray[np.bool_] | None = None,
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
        filled : ndarray [shape=(frames, markers), bool], optional
            Samples of the clip that were synthesised, not measured.

        Returns
        -------
        ClipRecord
            The new row.

        Raises
        ------
        DuplicateClipError
            Where a clip with the same content is there.
        ClipError
            Where no marker is ever seen, or the clip is static, too short or of too low a rate.
        OptionError
            Where `filled` does not have the shape of the clip.
        DatabaseError
            Where the database was opened for reading.
        """
        # scipy takes longer to import than a database to open, and only adding needs it
        from priorfill.markerset import recognise

        if self._writer is None or self._lock is None:
            raise DatabaseError(f"{self.path}: is open for reading; open it with write=True")
        if filled is not None and filled.shape != clip.missing.shape:
            raise OptionError(
                f"{clip.name}: the mask of filled samples has shape {filled.shape}; "
                f"{clip.missing.shape} is needed"
            )
        content = _content_hash(clip)
        known = self._catalogue.has(content)
        if known is not None:
            raise DuplicateClipError(
                f"{clip.name}: is in the database already (as {known}); nothing to do"
            )
        levels = self._levels(clip)
        packed = None
        if filled is not None and filled.any():
            packed = _pack(self._filled_at_level_0(clip, filled))
        markerset = recognise(clip.labels)
        blocks = [level.tobytes() for level in levels]
        segment, offset = self._writer.append(blocks)
        record = ClipRecord(
            content=content,
            name=clip.name,
            subject=clip.subject if subject is None else subject,
            session=session,
            source=clip.source.path.name if clip.source is not None else "",
            licence=licence,
            credit=credit,
            original_rate=clip.rate,
            rate=self.rate,
            frames=tuple(len(level) for level in levels),
            labels=clip.labels,
            marker_set=markerset.name if markerset is not None else "",
            has_filled=packed is not None,
            added=datetime.now(UTC).isoformat(timespec="seconds"),
            version=metadata.version("priorfill"),
            synthetic=synthetic,
            segment=segment,
            offset=offset,
            checksums=tuple(checksum(block) for block in blocks),
        )
        self._catalogue.insert(record, packed)
        self._writer.commit(segment, offset + record.nbytes)
        self._records = None
        return record

    def clips(self) -> tuple[ClipRecord, ...]:
        """Return every clip, in an order that does not depend on how the database grew."""
        if self._records is None:
            self._records = tuple(self._catalogue.records())
        return self._records

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
        markers = len(record.labels)
        before = sum(record.frames[:level]) * markers * 3 * DTYPE.itemsize
        frames = record.frames[level]
        values = self._reader.read(record.segment, record.offset + before, frames * markers * 3)
        return values.reshape(frames, markers, 3)

    def filled(self, record: ClipRecord) -> NDArray[np.bool_] | None:
        """Return which samples of a clip were synthesised [shape=(frames, markers)], at level 0.

        None where all were measured. A sample counts as synthesised where one of the recording's
        samples that surround its time is.

        Raises
        ------
        DatabaseCorruptError
            Where what is stored of it is damaged.
        """
        packed = self._catalogue.filled(record.content)
        if packed is None:
            return None
        try:
            return _unpack(packed, (record.frames[0], len(record.labels)))
        except (zlib.error, ValueError) as error:
            raise DatabaseCorruptError(
                f"{self.path}: the mask of filled samples of clip {record.name} is damaged; "
                "restore the database from a copy"
            ) from error

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
            subjects=len({record.subject for record in records} - {""}),
            frames=sum(record.frames[0] for record in records),
            seconds=sum(record.duration for record in records),
            bytes=sum(path.stat().st_size for path in files),
            marker_sets=dict(sorted(Counter(record.marker_set for record in records).items())),
        )

    def check(self, record: ClipRecord) -> None:
        """Compare what is stored of a clip with its checksums.

        Raises
        ------
        DatabaseCorruptError
            Where they differ.
        """
        if not self._catalogue.check(record):
            raise DatabaseCorruptError(
                f"{self.path}: the catalogue's row of clip {record.name} is damaged; "
                "restore the database from a copy"
            )
        for level, expected in enumerate(record.checksums):
            if checksum(self.positions(record, level)) != expected:
                raise DatabaseCorruptError(
                    f"{self.path}: positions of clip {record.name} are damaged (level {level}); "
                    "restore the database from a copy"
                )

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
            Where the catalogue as a whole cannot be used.
        """
        self._catalogue.check_file()
        records = self.clips()
        problems = []
        for done, record in enumerate(records, start=1):
            try:
                self.check(record)
            except DatabaseCorruptError as error:
                problems.append(str(error))
            if progress is not None:
                progress(done, len(records))
        return problems

    def _levels(self, clip: Clip) -> list[NDArray[np.float32]]:
        """Return a clip's positions at every level as they are stored, or refuse it."""
        from priorfill.resample import pyramid, resample

        missing = clip.missing
        if missing.all():
            raise ClipError(f"{clip.name}: no marker is ever seen; there is nothing to add")
        if clip.rate < MIN_RATE_SHARE * self.rate:
            raise ClipError(
                f"{clip.name}: has {clip.rate:g} Hz, too few for a database of {self.rate:g} Hz; "
                f"add clips of {MIN_RATE_SHARE * self.rate:g} Hz or more"
            )
        seen = ~missing.all(axis=0)
        extent = np.nanmax(clip.positions[:, seen], axis=0) - np.nanmin(
            clip.positions[:, seen], axis=0
        )
        fine = resample(to_upright(clip.positions, clip.up), clip.rate, self.rate)
        levels = [level.positions.astype(DTYPE) for level in pyramid(fine, self.rate, self.levels)]
        if len(levels[-1]) < MIN_FRAMES:
            raise ClipError(
                f"{clip.name}: is too short ({clip.duration:.2f} s) for the database's coarsest "
                f"level of {self.rate / 2 ** (self.levels - 1):g} Hz; add a longer clip"
            )
        if np.linalg.norm(extent, axis=1).max() < STATIC_RANGE:
            raise ClipError(
                f"{clip.name}: is static (no marker moves by {STATIC_RANGE:g} mm); "
                "add clips with motion"
            )
        return levels

    def _filled_at_level_0(self, clip: Clip, filled: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which samples of level 0 have a synthesised sample beside them."""
        from priorfill.resample import resample

        marked = np.where(filled[:, :, None], np.nan, np.zeros(3))
        # resample makes a sample missing where one that surrounds its time is: the rule wanted
        result: NDArray[np.bool_] = np.isnan(resample(marked, clip.rate, self.rate)[:, :, 0])
        return result


def _read_identity(path: Path) -> _Identity:
    if not path.exists():
        raise DatabaseNotFoundError(
            f"{path}: there is no database; make one with: priorfill db add --database {path} ..."
        )
    if not path.is_dir():
        raise DatabaseNotFoundError(f"{path}: is a file; give the folder of a database")
    file = path / _IDENTITY
    if not file.exists():
        raise DatabaseFormatError(
            f"{path}: is not a priorfill database (it has no {_IDENTITY}); "
            "give the folder of a database"
        )
    try:
        content: Any = json.loads(file.read_text(encoding="utf-8"))
        is_ours = content["format"] == _FORMAT
        version = int(content["version"])
    except (ValueError, KeyError, TypeError) as error:
        raise DatabaseFormatError(
            f"{file}: is damaged or not of priorfill; restore it from a copy"
        ) from error
    if not is_ours:
        raise DatabaseFormatError(f"{file}: is not of priorfill; give the folder of a database")
    if version != FORMAT_VERSION:
        raise DatabaseFormatError(
            f"{path}: has format version {version}, this priorfill needs {FORMAT_VERSION}; "
            + (
                "install a newer priorfill"
                if version > FORMAT_VERSION
                else "make the database again from its clips"
            )
        )
    try:
        return _Identity(version, float(content["rate"]), int(content["levels"]))
    except (ValueError, KeyError, TypeError) as error:
        raise DatabaseFormatError(
            f"{file}: has no valid rate and levels; restore it from a copy"
        ) from error


def _content_hash(clip: Clip) -> str:
    """Return the SHA-256 of a clip's labels, rate and positions."""
    digest = hashlib.sha256()
    digest.update(json.dumps([clip.labels, clip.rate]).encode())
    # NaN has many bit patterns; all of them mean missing
    positions = np.where(np.isnan(clip.positions), np.nan, clip.positions)
    digest.update(np.ascontiguousarray(positions, dtype="<f8").tobytes())
    return digest.hexdigest()


def _pack(mask: NDArray[np.bool_]) -> bytes:
    return zlib.compress(np.packbits(mask).tobytes())


def _unpack(packed: bytes, shape: tuple[int, int]) -> NDArray[np.bool_]:
    bits = np.frombuffer(zlib.decompress(packed), dtype=np.uint8)
    return np.unpackbits(bits, count=shape[0] * shape[1]).reshape(shape).astype(bool)
