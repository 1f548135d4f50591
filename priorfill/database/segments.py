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

__all__ = [
    "DTYPE",
    "SEGMENT_BYTES",
    "SegmentReader",
    "SegmentWriter",
    "checksum",
    "segment_path",
    "sync_folder",
]

DTYPE = np.dtype("<f4")
"""How a coordinate is stored."""

SEGMENT_BYTES = 1 << 30
"""A segment that would grow beyond this is left and a new one begun, so that a copy, a
backup or a compaction never has to move more than 1 GiB at a time."""


CHUNK = 1 << 22
"""Bytes that are read at a time to be checked."""


class SegmentWriter:
    """Appends to the last segment.

    Parameters
    ----------
    folder : Path
        The folder of the segments.
    used : set of int
        Numbers of the segments that hold clips; others were never committed and are removed.
    segment, end : int
        Number of the segment to go on with, and the bytes of it that are committed. What
        lies beyond was never committed and is cut off.

    Raises
    ------
    DatabaseCorruptError
        Where the file is shorter than what is committed.
    """

    def __init__(self, folder: Path, used: set[int], segment: int, end: int) -> None:
        self._folder = folder
        self._segment = segment
        self._end = end
        self.remove_all_but(used)
        path = segment_path(folder, segment)
        size = path.stat().st_size if path.exists() else 0
        if size < end:
            raise DatabaseCorruptError(
                f"{path}: has {size} bytes where the catalogue counts {end}; "
                "restore the database from a copy"
            )
        if size > end:
            os.truncate(path, end)

    def remove_all_but(self, used: set[int]) -> None:
        """Remove the segments of other numbers. Memory maps of them stay as they are."""
        for path in self._folder.glob("*.f32"):
            if path.stem.isdigit() and int(path.stem) not in used:
                path.unlink()

    def begin_new(self) -> None:
        """Go on with a segment of a number that was not used before."""
        self._segment += 1
        self._end = 0

    def append(self, blocks: Sequence[bytes]) -> tuple[int, int]:
        """Write blocks one after the other, down to the disk.

        Nothing counts until `commit`: the next append begins at the same place otherwise.

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
            sync_folder(self._folder)
        return self._segment, self._end

    def commit(self, segment: int, end: int) -> None:
        """Count everything up to `end` of `segment` as written."""
        self._segment = segment
        self._end = end


class SegmentReader:
    """Gives views of the segments' memory maps. Several threads may read.

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
        """Map segments now, so that they stay as they are even if their files are removed.

        Returns whether all of them are there.
        """
        for segment in segments:
            try:
                self._map(segment)
            except DatabaseCorruptError:
                return False
        return True

    def read(self, segment: int, offset: int, count: int) -> NDArray[np.float32]:
        """Return `count` values from byte `offset` on, read-only and without copying.

        Raises
        ------
        DatabaseCorruptError
            Where the segment is not there or ends before.
        """
        first = offset // DTYPE.itemsize
        values = self._maps.get(segment)
        # a segment may have grown since it was mapped
        if values is None or len(values) < first + count:
            values = self._map(segment)
        if len(values) < first + count:
            raise self._ends_early(segment)
        return values[first : first + count]

    def copy(self, segment: int, offset: int, count: int) -> tuple[NDArray[np.float32], int]:
        """Return a copy of `count` values from byte `offset` on, read-only, and its checksum.

        Read, not mapped: a large database shall not fill the memory.

        Raises
        ------
        DatabaseCorruptError
            Where the segment is not there or ends before.
        """
        self.read(segment, offset, count)
        data = os.pread(self._files[segment].fileno(), count * DTYPE.itemsize, offset)
        if len(data) != count * DTYPE.itemsize:
            raise self._ends_early(segment)
        return np.frombuffer(data, dtype=DTYPE), zlib.crc32(data)

    def checksum(self, segment: int, offset: int, nbytes: int) -> int:
        """Return the checksum of bytes as they are in the file.

        They are read, not mapped: a large database shall not fill the memory to be checked.

        Raises
        ------
        DatabaseCorruptError
            Where the segment is not there or ends before.
        """
        self.read(segment, offset, nbytes // DTYPE.itemsize)
        handle = self._files[segment].fileno()
        result = 0
        for start in range(offset, offset + nbytes, CHUNK):
            chunk = os.pread(handle, min(CHUNK, offset + nbytes - start), start)
            result = zlib.crc32(chunk, result)
        return result

    def _ends_early(self, segment: int) -> DatabaseCorruptError:
        return DatabaseCorruptError(
            f"{segment_path(self._folder, segment)}: ends before the catalogue says; "
            "restore the database from a copy"
        )

    def _map(self, segment: int) -> NDArray[np.float32]:
        path = segment_path(self._folder, segment)
        try:
            with self._opening:  # a file opened twice would be closed while another reads it
                if segment not in self._files:
                    self._files[segment] = path.open("rb")
                file = self._files[segment]
            count = os.fstat(file.fileno()).st_size // DTYPE.itemsize
            # an empty file cannot be mapped
            values = np.memmap(file, dtype=DTYPE, mode="r", shape=(count,)).view(np.ndarray)
        except (FileNotFoundError, ValueError) as error:
            raise DatabaseCorruptError(
                f"{path}: is not there or empty; restore the database from a copy"
            ) from error
        self._maps[segment] = values
        return values


def segment_path(folder: Path, segment: int) -> Path:
    """Return the path of a segment by its number."""
    return folder / f"{segment:06d}.f32"


def checksum(data: bytes) -> int:
    """Return the CRC-32 by which stored bytes are checked."""
    return zlib.crc32(data)


def sync_folder(folder: Path) -> None:
    """Bring a folder's entries (new and renamed files) down to the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
