"""How loops are compiled.

They are compiled when they are first needed, while somebody waits for it: what is left out here
takes as long as a loop.
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
"""Options of numba's `njit` for functions that Python calls: without a way in from C, and without
a check of each division."""

HELPER: dict[str, Any] = {**ENTRY, "no_cpython_wrapper": True}
"""The same for functions that only compiled ones call: without a way in from Python either."""
