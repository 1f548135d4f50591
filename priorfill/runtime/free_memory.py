"""Give memory that is free back to the system."""

from __future__ import annotations

import ctypes
import sys

__all__ = ["release_free_memory"]

MIN_BYTES = 50_000_000
"""Arrays for which memory is given back; to take it again takes a millisecond for some MB."""


def release_free_memory(needed: int) -> None:
    """Give free memory of the C library back, before large arrays are made.

    The C library of Linux (glibc) keeps what was freed for smaller blocks, and takes large arrays
    from the system. Without this, the peak of a fill of ten minutes by two threads is 0.2 GB
    higher. Elsewhere nothing is done: other libraries do not keep as much.

    Parameters
    ----------
    needed : int
        Bytes of the arrays; nothing is done for less than `MIN_BYTES`.
    """
    if needed < MIN_BYTES or not sys.platform.startswith("linux"):
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none
    if trim is not None:
        trim(0)
