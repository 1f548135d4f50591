"""Segment files: positions as little-endian float32, one clip after the other.

A segment begins with a header that names its database and its number. Each clip is followed by a
mark of random bytes.
"""

from __future__ import annotations

import os
import secrets
import threading
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from priorfill.database.segment_list import Segment, SegmentList, Unused
from priorfill.errors import DatabaseCorruptError, DatabaseError
from priorfill.runtime.disk_flush import flush_file, flush_folder
from priorfill.runtime.held_files import is_held, retry_while_held

__all__ = [
    "DTYPE",
    "HEADER_BYTES",
    "MARK_BYTES",
    "SEGMENT_BYTES",
    "Place",
    "SegmentReader",
    "SegmentWriter",
    "check_end",
    "first_bytes",
    "header",
    "open_segment",
    "read_at",
    "segment_path",
    "segment_paths",
]

DTYPE = np.dtype("<f4")
"""Type of a stored coordinate."""

SEGMENT_BYTES = 1 << 30
"""Maximum size of a segment, unless one clip is larger; a copy, a backup or a compaction then never
moves more than 1 GiB at a time."""

CHUNK_BYTES = 1 << 22
"""Bytes read at a time for checksums."""

HEADER_BYTES = 64
"""Size of a header, a multiple of the size of a coordinate."""

MARK_BYTES = 8
"""Size of a mark; two that were drawn at random are equal once in 10^19 cases."""


_SEEKING = threading.Lock()


@dataclass(frozen=True)
class Place:
    """Where a clip will be written.

    Attributes
    ----------
    segment, offset : int
        Number of the segment, and its byte at which the clip begins.
    end : int
        Size of the segment afterwards.
    """

    segment: int
    offset: int
    end: int


class SegmentWriter:
    """Appends to the last segment.

    Parameters
    ----------
    folder : Path
        The folder of the segments, which agree with the list.
    identity : str
        The database's identity.
    segments : SegmentList
        The committed segments, and what could not be removed.

    Attributes
    ----------
    listed : SegmentList
        The segments with all that was appended.
    """

    def __init__(self, folder: Path, identity: str, segments: SegmentList) -> None:
        self._folder = folder
        self._identity = identity
        self.listed = segments
        self._last = max(segments.segments, default=0)
        if self._last in segments.unused:  # what follows its committed bytes could not be cut off
            self.begin_new()

    def begin_new(self) -> None:
        """Continue with a segment whose number neither the list nor a file has."""
        self._last = self._unused_number(self._last)

    def place(self, size: int, before: Place | None = None) -> Place:
        """Return where a clip of a size (bytes) goes, after another one that is placed already."""
        if before is not None:
            number, end = before.segment, before.end
        else:
            number = self._last or self._unused_number(0)
            one = self.listed.segments.get(number)
            end = HEADER_BYTES if one is None else one.size
        if end > HEADER_BYTES and end + size + MARK_BYTES > SEGMENT_BYTES:
            number, end = self._unused_number(number), HEADER_BYTES
        return Place(number, end, end + size + MARK_BYTES)

    def _unused_number(self, after: int) -> int:
        there = [number for number, _ in segment_paths(self._folder)]
        return max([*self.listed.segments, *self.listed.unused, *there, after]) + 1

    def announcing(self, places: Iterable[Place], files: tuple[str, ...] = ()) -> SegmentList:
        """Return the list with the places, and files, that are about to be written."""
        unused = {
            place.segment: Unused(place.end, zlib.crc32(header(self._identity, place.segment)))
            for place in places
        }
        return replace(
            self.listed,
            unused={**self.listed.unused, **unused},
            files=(*self.listed.files, *files),
        )

    def check(self, place: Place) -> None:
        """Check that the segment of a place is as the list describes it.

        Raises
        ------
        DatabaseCorruptError
            If it was exchanged.
        """
        before = self.listed.segments.get(place.segment)
        if before is not None:
            path = segment_path(self._folder, place.segment)
            with _opened(path, "rb") as file:
                check_end(file, path, header(self._identity, place.segment), before)

    def append(self, blocks: Sequence[bytes], place: Place) -> None:
        """Write blocks one after the other to a place, and flush them to the disk.

        Raises
        ------
        DatabaseCorruptError
            If the segment is not as the list describes it.
        """
        path = segment_path(self._folder, place.segment)
        start = header(self._identity, place.segment)
        before = self.listed.segments.get(place.segment)
        if before is None:
            before = Segment(HEADER_BYTES, zlib.crc32(start), "")
        is_new = place.offset == HEADER_BYTES
        mark = secrets.token_bytes(MARK_BYTES)
        checksum = before.checksum
        # "x" never replaces a file that another program has put there
        with _opened(path, "x+b" if is_new else "r+b") as file:
            if is_new:
                file.write(start)
            else:
                check_end(file, path, start, before)
                file.seek(place.offset)
            for block in (*blocks, mark):
                file.write(block)
                checksum = zlib.crc32(block, checksum)
            file.flush()
            flush_file(file.fileno())
        if is_new:
            flush_folder(self._folder)
        entry = Segment(place.end, checksum, mark.hex())
        self.listed = replace(self.listed, segments={**self.listed.segments, place.segment: entry})
        self._last = place.segment


def open_segment(path: Path, mode: str = "rb", *, buffering: int = -1) -> BinaryIO:
    """Open a segment; a folder or a pipe in its place counts as missing."""
    if path.exists() and not path.is_file():
        raise FileNotFoundError(f"{path} is no regular file")
    try:
        return cast(BinaryIO, retry_while_held(lambda: path.open(mode, buffering)))
    except OSError as error:
        if not is_held(error):
            raise
        raise DatabaseError(
            f"{path}: another program has it open for itself alone, or it is write-protected; "
            "end that program, or check the file's permissions, and try again"
        ) from error


def _opened(path: Path, mode: str) -> BinaryIO:
    try:
        return open_segment(path, mode)
    except FileNotFoundError:
        raise DatabaseCorruptError(
            f"{path}: is missing; restore the database from a copy"
        ) from None


def check_end(file: BinaryIO, path: Path, start: bytes, entry: Segment) -> int:
    """Compare a segment's header and the mark at its committed end; return the file's size.

    Raises
    ------
    DatabaseCorruptError
        If they differ, or the file is too short.
    """
    size = os.fstat(file.fileno()).st_size
    if size < entry.size:
        raise DatabaseCorruptError(
            f"{path}: has {size} bytes, but the catalogue counts {entry.size}; "
            "restore the database from a copy, or merge its undamaged clips into a new one"
        )
    file.seek(0)
    if file.read(HEADER_BYTES) != start:
        raise DatabaseCorruptError(
            f"{path}: is not the segment of this database; restore the database from a copy, or "
            "merge its undamaged clips into a new one"
        )
    file.seek(entry.size - MARK_BYTES)
    if file.read(MARK_BYTES).hex() != entry.mark:
        raise DatabaseCorruptError(
            f"{path}: does not belong to this catalogue (one of them was exchanged or restored "
            "alone); restore the whole database from a copy, or merge its undamaged clips into a "
            "new one"
        )
    return size


class SegmentReader:
    """Reads segments, and keeps them open.

    Bytes are read, not mapped. Windows shortens no file that is mapped, and a map of a file on a
    share ends the program when the connection breaks.

    Parameters
    ----------
    folder : Path
        The folder of the segments.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[int, BinaryIO] = {}
        self._opening = threading.Lock()

    def close(self) -> None:
        """Close the files."""
        for file in self._files.values():
            file.close()
        self._files.clear()

    def hold(self, segments: set[int]) -> bool:
        """Open segments now, so that they stay readable even if a compaction replaces them.

        Returns
        -------
        bool
            Whether all of them exist.
        """
        for segment in segments:
            try:
                self._file(segment)
            except DatabaseCorruptError:
                return False
        return True

    def read(self, segment: int, offset: int, nbytes: int) -> bytes:
        """Return bytes of a segment.

        Raises
        ------
        DatabaseCorruptError
            If the segment does not exist or is too short.
        """
        data = read_at(self._file(segment), offset, nbytes)
        if len(data) != nbytes:
            raise DatabaseCorruptError(
                f"{segment_path(self._folder, segment)}: is shorter than the catalogue states; "
                "restore the database from a copy"
            )
        return data

    def checksum(self, segment: int, offset: int, nbytes: int) -> int:
        """Return the CRC-32 of bytes of a segment, reading a few at a time.

        Raises
        ------
        DatabaseCorruptError
            As for `read`.
        """
        result = 0
        for start in range(offset, offset + nbytes, CHUNK_BYTES):
            size = min(CHUNK_BYTES, offset + nbytes - start)
            result = zlib.crc32(self.read(segment, start, size), result)
        return result

    def _file(self, segment: int) -> BinaryIO:
        with self._opening:  # a second file would replace, and close, one another thread reads
            file = self._files.get(segment)
            if file is None:
                path = segment_path(self._folder, segment)
                try:
                    file = open_segment(path, buffering=0)  # a buffer could hold what changed
                except FileNotFoundError as error:
                    raise DatabaseCorruptError(
                        f"{path}: is missing; restore the database from a copy"
                    ) from error
                self._files[segment] = file
            return file


def read_at(file: BinaryIO, offset: int, size: int) -> bytes:
    """Return bytes of an open file without a buffer, from any thread; fewer if it ends before."""
    parts: list[bytes] = []
    while size and (part := _read_some(file, offset, size)):
        parts.append(part)
        offset += len(part)
        size -= len(part)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _read_some(file: BinaryIO, offset: int, size: int) -> bytes:
    if hasattr(os, "pread"):
        return os.pread(file.fileno(), size, offset)
    with _SEEKING:  # Windows: another thread would read from the wrong place
        file.seek(offset)
        return file.read(size)


def header(identity: str, segment: int) -> bytes:
    """Return the header of a segment."""
    return f"priorfill segment {segment:07d} of {identity}".encode().ljust(HEADER_BYTES - 1) + b"\n"


def first_bytes(path: Path) -> bytes:
    """Return the start of a segment, as long as its header."""
    with open_segment(path) as file:
        return file.read(HEADER_BYTES)


def segment_path(folder: Path, segment: int) -> Path:
    """Return the path of a segment."""
    return folder / f"{segment:06d}.f32"


def segment_paths(folder: Path) -> list[tuple[int, Path]]:
    """Return the numbers and paths of the files that have the name of a segment."""
    found = [(int(path.stem), path) for path in folder.glob("*.f32") if _is_number(path.stem)]
    return sorted(one for one in found if one[1] == segment_path(folder, one[0]))


def _is_number(stem: str) -> bool:
    return stem.isascii() and stem.isdigit() and len(stem) <= 9
