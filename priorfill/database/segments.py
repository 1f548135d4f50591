"""Segment files: positions as little-endian float32, one clip after the other."""

from __future__ import annotations

import os
import threading
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import DatabaseCorruptError
from priorfill.runtime.atomic_file import flush_folder

__all__ = ["DTYPE", "SEGMENT_BYTES", "SegmentReader", "SegmentWriter", "segment_path"]

DTYPE = np.dtype("<f4")
"""Type of a stored coordinate."""

SEGMENT_BYTES = 1 << 30
"""Maximum size of a segment, unless one clip is larger; a copy, a backup or a compaction then never
moves more than 1 GiB at a time."""

CHUNK_BYTES = 1 << 22
"""Bytes read at a time for checksums."""


class SegmentWriter:
    """Appends to the last segment.

    Parameters
    ----------
    folder : Path
        The folder of the segments.
    used : set of int
        Numbers of the segments that hold clips; others were never committed and are removed.
    segment, end : int
        Number of the segment to append to, and its committed bytes. Bytes beyond were never
        committed and are cut off.

    Raises
    ------
    DatabaseCorruptError
        If the file is shorter than its committed bytes.
    """

    def __init__(self, folder: Path, used: set[int], segment: int, end: int) -> None:
        self._folder = folder
        self._segment = segment
        self._end = end
        self._remove_all_but(used)
        path = segment_path(folder, segment)
        size = path.stat().st_size if path.exists() else 0
        if size < end:
            raise DatabaseCorruptError(
                f"{path}: has {size} bytes, but the catalogue counts {end}; "
                "restore the database from a copy"
            )
        if size > end:
            os.truncate(path, end)

    def _remove_all_but(self, used: set[int]) -> None:
        """Remove the segments of other numbers. Their memory maps stay valid."""
        for path in self._folder.glob("*.f32"):
            if path.stem.isdigit() and int(path.stem) not in used:
                path.unlink()

    def begin_new(self) -> None:
        """Continue with a segment of an unused number."""
        self._segment += 1
        self._end = 0

    def append(self, blocks: Sequence[bytes]) -> tuple[int, int]:
        """Write blocks one after the other and flush them to the disk.

        They count only after `commit`; until then the next call overwrites them.

        Returns
        -------
        segment, offset : int
            Where the blocks begin.
        """
        size = sum(len(block) for block in blocks)
        if self._end and self._end + size > SEGMENT_BYTES:
            self.begin_new()
        path = segment_path(self._folder, self._segment)
        is_new = not path.exists()
        with path.open("wb" if is_new else "r+b") as file:
            file.seek(self._end)
            for block in blocks:
                file.write(block)
            file.flush()
            os.fsync(file.fileno())
        if is_new:
            flush_folder(self._folder)
        return self._segment, self._end

    def commit(self, segment: int, end: int) -> None:
        """Count everything up to byte `end` of `segment` as written."""
        self._segment = segment
        self._end = end


class SegmentReader:
    """Reads segments through memory maps.

    Parameters
    ----------
    folder : Path
        The folder of the segments.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[int, BinaryIO] = {}
        self._maps: dict[int, NDArray[np.float32]] = {}
        self._opening = threading.Lock()

    def close(self) -> None:
        """Close the files. Views stay valid."""
        for file in self._files.values():
            file.close()
        self._files.clear()

    def hold(self, segments: set[int]) -> bool:
        """Map segments now, so that they stay readable even if their files are removed.

        Returns
        -------
        bool
            Whether all of them exist.
        """
        for segment in segments:
            try:
                self._map(segment)
            except DatabaseCorruptError:
                return False
        return True

    def read(self, segment: int, offset: int, count: int) -> NDArray[np.float32]:
        """Return a read-only view of `count` values from byte `offset` on.

        Raises
        ------
        DatabaseCorruptError
            If the segment does not exist or is too short.
        """
        first = offset // DTYPE.itemsize
        values = self._maps.get(segment)
        # a segment may have grown since it was mapped
        if values is None or len(values) < first + count:
            values = self._map(segment)
        if len(values) < first + count:
            raise self._too_short(segment)
        return values[first : first + count]

    def copy(self, segment: int, offset: int, count: int) -> tuple[NDArray[np.float32], int]:
        """Return a read-only copy of `count` values from byte `offset` on, and its CRC-32.

        The bytes are read, not mapped, so that a large database does not fill the memory.

        Raises
        ------
        DatabaseCorruptError
            If the segment does not exist or is too short.
        """
        self.read(segment, offset, count)
        data = os.pread(self._files[segment].fileno(), count * DTYPE.itemsize, offset)
        if len(data) != count * DTYPE.itemsize:
            raise self._too_short(segment)
        return np.frombuffer(data, dtype=DTYPE), zlib.crc32(data)

    def checksum(self, segment: int, offset: int, nbytes: int) -> int:
        """Return the CRC-32 of bytes of the file.

        They are read, not mapped, so that checking a large database does not fill the memory.

        Raises
        ------
        DatabaseCorruptError
            If the segment does not exist or is too short.
        """
        self.read(segment, offset, nbytes // DTYPE.itemsize)
        handle = self._files[segment].fileno()
        result = 0
        for start in range(offset, offset + nbytes, CHUNK_BYTES):
            chunk = os.pread(handle, min(CHUNK_BYTES, offset + nbytes - start), start)
            result = zlib.crc32(chunk, result)
        return result

    def _too_short(self, segment: int) -> DatabaseCorruptError:
        return DatabaseCorruptError(
            f"{segment_path(self._folder, segment)}: is shorter than the catalogue states; "
            "restore the database from a copy"
        )

    def _map(self, segment: int) -> NDArray[np.float32]:
        path = segment_path(self._folder, segment)
        try:
            with self._opening:  # a second file would replace, and close, one another thread reads
                if segment not in self._files:
                    self._files[segment] = path.open("rb")
                file = self._files[segment]
            count = os.fstat(file.fileno()).st_size // DTYPE.itemsize
            # an empty file cannot be mapped
            values = np.memmap(file, dtype=DTYPE, mode="r", shape=(count,)).view(np.ndarray)
        except (FileNotFoundError, ValueError) as error:
            raise DatabaseCorruptError(
                f"{path}: is missing or empty; restore the database from a copy"
            ) from error
        self._maps[segment] = values
        return values


def segment_path(folder: Path, segment: int) -> Path:
    """Return the path of a segment."""
    return folder / f"{segment:06d}.f32"
