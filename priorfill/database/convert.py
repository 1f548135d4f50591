"""Convert a database of an older format version: all its clips are written anew.

Older versions have no identity, and their catalogues do not account for the segments. They are read
as they are; the first writer converts them. The new manifest comes first, and names the version
that is converted; until the new catalogue is in place, the old one counts.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from priorfill.database.catalogue import Catalogue, successor
from priorfill.database.create_catalogue import create_catalogue
from priorfill.database.create_database import SEGMENTS
from priorfill.database.manifest import FORMAT_VERSION, Manifest, new_identity, write_manifest
from priorfill.database.recovery import remove_file
from priorfill.database.segment_list import Segment, SegmentList, Unused
from priorfill.database.segments import (
    SegmentWriter,
    first_bytes,
    header,
    segment_path,
    segment_paths,
)
from priorfill.errors import DatabaseCorruptError

if TYPE_CHECKING:
    from priorfill.database.prior_database import PriorDatabase

__all__ = ["convert", "replaced_segments", "unaccounted_bytes"]


def convert(old: PriorDatabase, manifest: Manifest, catalogue: Catalogue) -> Manifest:
    """Convert a database that is open for reading, and locked; return its new manifest.

    Parameters
    ----------
    old : PriorDatabase
        The database.
    manifest : Manifest
        Its manifest.
    catalogue : Catalogue
        Its catalogue.

    Raises
    ------
    DatabaseCorruptError
        If something is damaged; nothing is changed then.
    """
    problems = old.verify()
    if problems:
        raise DatabaseCorruptError(problems[0])
    identity = manifest.identity or new_identity()
    new = Manifest(FORMAT_VERSION, manifest.rate, manifest.levels, identity)
    if not catalogue.identity:
        write_manifest(old.path, replace(new, converted_from=catalogue.version))
        _write_anew(old, new, catalogue)
    write_manifest(old.path, new)
    return new


def _write_anew(old: PriorDatabase, new: Manifest, catalogue: Catalogue) -> None:
    """Write all clips to new segments and a new catalogue."""
    folder = old.path / SEGMENTS
    folder.mkdir(exist_ok=True)
    ends = catalogue.end()
    unused = {}
    for number, path in segment_paths(folder):
        if number not in ends and _is_unfinished(path, number, new.identity):
            left = Unused(path.stat().st_size, zlib.crc32(first_bytes(path)))
            if not remove_file(path):
                unused[number] = left
    writer = SegmentWriter(folder, new.identity, SegmentList())
    writer.begin_new()
    rows = []
    for record in old.clips():
        place = writer.place(record.nbytes)
        blocks = [old.positions(record, level).tobytes() for level in range(old.levels)]
        writer.append(blocks, place)
        moved = replace(record, segment=place.segment, offset=place.offset)
        rows.append(replace(catalogue.row(record), record=moved))
    before = SegmentList({number: Segment(end, 0, "") for number, end in ends.items()}, unused)
    segments = replaced_segments(folder, before, writer.listed.segments, catalogue.path.name)
    create_catalogue(successor(catalogue.path), new, rows, segments)


def replaced_segments(
    folder: Path, old: SegmentList, new: Mapping[int, Segment], catalogue: str
) -> SegmentList:
    """Return a list of new segments that names the old ones, and their catalogue, as unused.

    Parameters
    ----------
    folder : Path
        The folder of the segments.
    old : SegmentList
        The segments that are replaced, and what was unused before.
    new : mapping of int to Segment
        The segments that replace them.
    catalogue : str
        Name of the catalogue that is replaced.
    """
    unused = dict(old.unused)
    for number, segment in old.segments.items():
        tail = old.unused.get(number)
        size = segment.size if tail is None else max(segment.size, tail.size)
        start = zlib.crc32(first_bytes(segment_path(folder, number)))
        unused[number] = Unused(size, start)
    return SegmentList(new, unused, (*old.files, catalogue))


def unaccounted_bytes(folder: Path, ends: Mapping[int, int], identity: str) -> list[str]:
    """Return a message for each segment of an older version with bytes that no clip accounts for.

    Parameters
    ----------
    folder : Path
        The folder of the segments.
    ends : mapping of int to int
        By number, the end of the segment's last clip.
    identity : str
        The identity that the database will have, if it is being converted; else empty.
    """
    return [
        f"{path}: has {path.stat().st_size} bytes, but the catalogue counts "
        f"{ends.get(number, 0)}: a writer was killed, or the catalogue is older than the segment; "
        "restore both from the same copy, or merge the clips into a new database"
        for number, path in segment_paths(folder)
        if path.is_file()
        and path.stat().st_size > ends.get(number, 0)
        and not (number not in ends and _is_unfinished(path, number, identity))
    ]


def _is_unfinished(path: Path, number: int, identity: str) -> bool:
    """Return whether a segment was left by a conversion that was killed, perhaps in its header."""
    return bool(identity) and header(identity, number).startswith(first_bytes(path))
