"""Free libraries of recordings: which there are, and how to get them.

`fetch` alone asks a network for something, and only when it is called.
"""

from __future__ import annotations

from priorfill.libraries.catalogue import Library, LibraryFile, find_library, known_libraries
from priorfill.libraries.download import Manners
from priorfill.libraries.fetch import Fetched, fetch

__all__ = [
    "Fetched",
    "Library",
    "LibraryFile",
    "Manners",
    "fetch",
    "find_library",
    "known_libraries",
]
