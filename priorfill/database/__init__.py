"""The prior database on disk: clips of clean motion, found again for filling gaps.

A database is a directory::

    priorfill-database.json   what it is: format version, rate, levels; written once
    catalogue.sqlite          one row a clip; a clip exists from the moment its row is committed
    catalogue.seal            checksum of the catalogue as the last writer left it
    segments/000001.f32 ...   positions, little-endian float32, append-only, memory-mapped
    lock                      held by the one writer

Bytes of a segment beyond the last committed row are what a writer left behind that did not come
to its commit; the next writer overwrites them.
"""

from priorfill.database.manifest import FORMAT_VERSION
from priorfill.database.record import (
    Accepted,
    ClipRecord,
    DatabaseInfo,
    Merged,
)
from priorfill.database.selection import Selection
from priorfill.database.store import DEFAULT_LEVELS, DEFAULT_RATE, PriorDatabase

__all__ = [
    "DEFAULT_LEVELS",
    "DEFAULT_RATE",
    "FORMAT_VERSION",
    "Accepted",
    "ClipRecord",
    "DatabaseInfo",
    "Merged",
    "PriorDatabase",
    "Selection",
]
