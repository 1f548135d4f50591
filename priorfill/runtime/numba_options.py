"""Options for numba's `njit`.

Functions compile on first use; omitting unneeded wrappers and checks shortens that wait.
"""

from __future__ import annotations

from typing import Any

__all__ = ["ENTRY", "HELPER"]

ENTRY: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
}
"""For functions called from Python: no C wrapper, no check of each division."""

HELPER: dict[str, Any] = {**ENTRY, "no_cpython_wrapper": True}
"""For functions called only from compiled ones: no Python wrapper either."""
