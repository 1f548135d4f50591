"""The prior database on disk: clips of clean motion that gaps are filled from.

A database is a directory::

    priorfill-database.json   manifest: identity, format version, rate, levels; written once
    catalogue.sqlite          one row per clip; a clip exists once its row is committed
    catalogue.checksum        checksum of the catalogue as its last writer closed it
    segments/000001.f32 ...   positions, little-endian float32, append-only
    lock                      held by the one writer

The catalogue lists the segments, and announces what will be appended. Announced bytes that were
never committed were left by a writer that was killed; the next writer cuts them off.
"""

from priorfill.database.manifest import FORMAT_VERSION
from priorfill.database.prior_database import DEFAULT_LEVELS, DEFAULT_RATE, PriorDatabase
from priorfill.database.record import (
    AcceptResult,
    ClipOrigin,
    ClipRecord,
    DatabaseInfo,
    MergeResult,
)
from priorfill.database.selection import Selection

__all__ = [
    "DEFAULT_LEVELS",
    "DEFAULT_RATE",
    "FORMAT_VERSION",
    "AcceptResult",
    "ClipOrigin",
    "ClipRecord",
    "DatabaseInfo",
    "MergeResult",
    "PriorDatabase",
    "Selection",
]
