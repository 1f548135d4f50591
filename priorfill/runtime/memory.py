"""Memory that is free, but not given back to the system."""

from __future__ import annotations

import ctypes
import sys

__all__ = ["give_back"]


def give_back() -> None:
    """Give memory that is no longer used back to the system.

    The C library of Linux keeps up to 100 MB for each thread that ever needed as much, against the
    day that it does again. What comes next may need it in one piece, or in another thread. Other
    systems do better, or cannot be told.
    """
    if not sys.platform.startswith("linux"):
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # only glibc has it
    if trim is not None:
        trim(0)
