"""What the page needs besides the result to write decisions that a fill repeats."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from priorfill.methods import ALIASES, DEFAULT_METHOD, METHODS, get_options
from priorfill.methods.options import flattened

if TYPE_CHECKING:
    from priorfill.filling.provenance import Provenance
    from priorfill.filling.result import Result

__all__ = ["decision_data", "fill_settings", "method_options"]


def decision_data(result: Result) -> dict[str, Any]:
    """Return names as the file has them, what decisions are made for, and aliases of methods.

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    return {
        "subjects_raw": [one.clip.subject for one in result.by_subject],
        "aliases": dict(ALIASES),
        "settings": fill_settings(result.provenance),
        "made_for": asdict(result.provenance.made_for),
    }


def fill_settings(provenance: Provenance) -> list[list[Any]]:
    """Return options of the command ``fill`` and their values, for the same fill again.

    Parameters
    ----------
    provenance : Provenance
        Of the result. Recordings of the same subject have the names of their files.

    Returns
    -------
    list of [str, str or True]
        Those that differ from the defaults; True: the option has no value.
    """
    one, selection, wanted = provenance, provenance.selection, provenance.gap_filter
    reading = dict(one.reading)
    # the files' own states of samples are the defaults
    reading["keep-zeros"] = not reading.pop("zeros_missing", True)
    frames = wanted.frames and ":".join("" if end is None else str(end) for end in wanted.frames)
    given: list[tuple[str, Any]] = [
        *((name.replace("_", "-"), value) for name, value in reading.items()),
        ("method", one.method if one.method != DEFAULT_METHOD else None),
        ("database", one.database and one.database.path),
        *(("same-subject", other.file) for other in one.same_subject),
        ("marker-set", one.marker_set),
        *(("set", f"{name}={_typed(value)}") for name, value in one.options.items()),
        ("markers", ",".join(wanted.markers)),
        ("frames", frames),
        ("max-gap", wanted.max_gap),
        ("skip-edges", wanted.skip_edges),
        ("extrapolate", one.extrapolate),
        ("max-error", one.max_error),
        ("reject-artefacts", one.reject_artefacts),
        *(("exclude-motion", pattern) for pattern in selection.not_names),
        *(("exclude-subject", pattern) for pattern in selection.not_subjects),
        *(("only-subject", pattern) for pattern in selection.subjects),
        ("trust-filled", one.trust_filled),
    ]
    return [[name, value if value is True else str(value)] for name, value in given if value]


def _typed(value: Any) -> str:
    """Return the value of an option as it is typed."""
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


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
