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

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_PLACES = {
    "DEFAULT_LEVELS": "prior_database",
    "DEFAULT_RATE": "prior_database",
    "FORMAT_VERSION": "manifest",
    "AcceptResult": "record",
    "ClipOrigin": "record",
    "ClipRecord": "record",
    "DatabaseInfo": "record",
    "MergeResult": "record",
    "PriorDatabase": "prior_database",
    "Selection": "selection",
}
"""The module of each name, imported when the name is first used: fills without a database need
a few of the 24 modules."""


def __getattr__(name: str) -> Any:
    """Load a name of the package when it is first used."""
    if name not in _PLACES:
        raise AttributeError(f"module 'priorfill.database' has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
