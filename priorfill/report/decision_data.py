"""What the page needs besides the result to write decisions that a fill repeats."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from priorfill.methods import ALIASES, METHODS, get_options
from priorfill.methods.options import flattened

if TYPE_CHECKING:
    from priorfill.filling.result import Result

__all__ = ["decision_data", "method_options"]


def decision_data(result: Result) -> dict[str, Any]:
    """Return names as the file has them, what decisions are made for, and aliases of methods.

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    provenance = result.provenance
    clip, database = provenance.clips[0], provenance.database
    return {
        "subjects_raw": [one.clip.subject for one in result.by_subject],
        "aliases": dict(ALIASES),
        "made_for": {
            "file": clip.file or clip.name,
            "sha256": clip.sha256,
            "method": provenance.method,
            "database": "" if database is None else database.content,
        },
    }


def method_options() -> dict[str, list[list[Any]]]:
    """Return names and defaults of the options of each method that are a number or a word."""
    found = {}
    for method in METHODS:
        options = get_options(method)
        values = {} if options is None else flattened(options)
        found[method] = [[name, value] for name, value in values.items() if _is_plain(value)]
    return found


def _is_plain(value: Any) -> bool:
    """Return whether a value can be typed in, and JSON has it."""
    return isinstance(value, (bool, int, str)) or (
        isinstance(value, float) and math.isfinite(value)
    )
