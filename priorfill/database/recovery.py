"""Compare the segment files with the catalogue, and remove what a killed writer left.

Nothing is cut off or removed that the catalogue does not account for: see
`priorfill.database.segment_list`.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from pathlib import Path

from priorfill.database.catalogue_checksum import SUFFIXES
from priorfill.database.segment_list import Segment, SegmentList, Unused
from priorfill.database.segments import (
    CHUNK_BYTES,
    HEADER_BYTES,
    check_end,
    first_bytes,
    header,
    open_segment,
    segment_path,
    segment_paths,
)
from priorfill.errors import DatabaseCorruptError, DatabaseError
from priorfill.runtime.held_files import is_held

__all__ = [
    "check_checksums",
    "file_size",
    "find_problems",
    "remove_file",
    "remove_unused",
    "unused_bytes",
]


def find_problems(folder: Path, identity: str, listed: SegmentList) -> dict[int, str]:
    """Return how the segments differ from the list, without reading all of them.

    Parameters
    ----------
    folder : Path
        The folder of the segments.
    identity : str
        The database's identity.
    listed : SegmentList
        What the catalogue accounts for.

    Returns
    -------
    dict of int to str
        A message for each segment that differs, by its number.
    """
    problems = {}
    for number, entry in listed.segments.items():
        path = segment_path(folder, number)
        try:
            with open_segment(path) as file:
                size = check_end(file, path, header(identity, number), entry)
        except FileNotFoundError:
            problems[number] = f"{path}: is missing; restore the database from a copy"
            continue
        except DatabaseCorruptError as error:
            problems[number] = str(error)
            continue
        unused = listed.unused.get(number)
        if size > (entry.size if unused is None else max(entry.size, unused.size)):
            problems[number] = (
                f"{path}: has {size} bytes, but the catalogue counts {entry.size}: the catalogue "
                "is older than the segment; restore both from the same copy, or merge the clips "
                "into a new database"
            )
    return problems | dict(_unlisted(folder, identity, listed))


def _unlisted(folder: Path, identity: str, listed: SegmentList) -> Iterator[tuple[int, str]]:
    """Yield number and message for each segment of this database that its catalogue does not list.

    Other files are none of its business.
    """
    for number, path in segment_paths(folder):
        if number in listed.segments or number in listed.unused or not path.is_file():
            continue
        if first_bytes(path) == header(identity, number):
            yield (
                number,
                f"{path}: is a segment of this database that the catalogue does not list: the "
                "catalogue is older than the segment; restore both from the same copy, or merge "
                "the clips into a new database",
            )


def check_checksums(folder: Path, listed: SegmentList, known: set[int]) -> list[str]:
    """Compare every committed byte with the checksums of the segments.

    Parameters
    ----------
    folder, listed
        As for `find_problems`.
    known : set of int
        Segments in which clips are damaged already.

    Returns
    -------
    list of str
        One message for each damage.
    """
    problems = []
    for number, entry in listed.segments.items():
        if number in known:
            continue
        path = segment_path(folder, number)
        checksum = 0
        try:
            with open_segment(path) as file:
                left = entry.size
                while left and (chunk := file.read(min(CHUNK_BYTES, left))):
                    checksum = zlib.crc32(chunk, checksum)
                    left -= len(chunk)
        except OSError:
            continue  # `find_problems` names it
        if checksum != entry.checksum and not left:
            problems.append(
                f"{path}: bytes that belong to no clip are damaged; "
                "restore the database from a copy, or merge its clips into a new one"
            )
    return problems


def remove_unused(folder: Path, identity: str, listed: SegmentList) -> SegmentList:
    """Cut off, and remove, what the list names as unused; return the list of what is left.

    Windows neither cuts off nor removes what another process has open or mapped. The next writer
    tries again. The caller has made sure that there are no problems.

    Parameters
    ----------
    folder, identity, listed
        As for `find_problems`.
    """
    unused = {
        number: one
        for number, one in listed.unused.items()
        if not _remove_bytes(segment_path(folder, number), one, listed.segments.get(number))
    }
    files = tuple(name for name in listed.files if not _remove_catalogue(folder.parent / name))
    return SegmentList(listed.segments, unused, files)


def _remove_bytes(path: Path, unused: Unused, entry: Segment | None) -> bool:
    """Remove the unused bytes of a segment; return False if they are held."""
    if not path.is_file():
        return True
    size = path.stat().st_size
    if entry is not None:
        return not entry.size < size <= unused.size or _cut_off(path, entry.size)
    try:
        is_ours = size <= unused.size and _is_that_file(path, size, unused.start)
    except DatabaseError:  # a program has it open for itself alone
        return False
    return not is_ours or remove_file(path)


def _remove_catalogue(path: Path) -> bool:
    """Remove a catalogue, its journal and its checksum file; return False if one is held.

    As long as the catalogue is there, a reader may need the others.
    """
    stem = path.name.partition(".")[0]
    checksums = (f"{stem}{suffix}{new}" for suffix in SUFFIXES for new in ("", ".new"))
    others = (f"{path.name}-journal", *checksums)
    return remove_file(path) and all(remove_file(path.with_name(name)) for name in others)


def remove_file(path: Path) -> bool:
    """Remove a file, if it exists; return False if another process holds it."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        if not is_held(error):
            raise
        return False
    return True


def _cut_off(path: Path, size: int) -> bool:
    """Shorten a file; return False if another process has mapped or locked it."""
    try:
        os.truncate(path, size)
    except OSError as error:
        if not is_held(error):
            raise
        return False
    return path.stat().st_size == size  # wine reports success where a map forbids it


def unused_bytes(folder: Path, listed: SegmentList) -> int:
    """Return the number of bytes on the disk that the list names as unused.

    Parameters
    ----------
    folder, listed
        As for `find_problems`.
    """
    result = 0
    for number, unused in listed.unused.items():
        entry = listed.segments.get(number)
        size = file_size(segment_path(folder, number))
        if size <= unused.size:
            result += max(0, size - (0 if entry is None else entry.size))
    return result + sum(file_size(folder.parent / name) for name in listed.files)


def file_size(path: Path) -> int:
    """Return the size of a file; 0 if another process has removed it."""
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _is_that_file(path: Path, size: int, start: int) -> bool:
    """Return whether a file begins as expected, or was not written far enough to tell."""
    return size < HEADER_BYTES or zlib.crc32(first_bytes(path)) == start
