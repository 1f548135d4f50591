"""Units of length: their spellings in files, and conversion to millimetres."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import ClipError, OptionError

__all__ = ["UNITS", "find_unit", "mm_per_unit"]

UNITS = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
"""Millimetres per unit, by the name used in options."""

_SPELLINGS = {
    "mm": ("mm", "mms", "millimeter", "millimeters", "millimetre", "millimetres", "mill"),
    "cm": ("cm", "cms", "centimeter", "centimeters", "centimetre", "centimetres", "cent"),
    "dm": ("dm", "decimeter", "decimeters", "decimetre", "decimetres"),
    # old programs truncate parameters to four characters
    "m": ("m", "mete", "metr", "meter", "meters", "metre", "metres"),
    "in": ("in", "inch", "inches", '"'),
    "ft": ("ft", "foot", "feet"),
}

_NAMES = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}

_MIN_EXTENT = 30.0
"""mm. Markers of a body, a hand or a face spread over more."""

_MAX_EXTENT = 60_000.0
"""mm. No capture volume is larger."""

_MIN_BODY, _MAX_BODY = 1000.0, 5000.0
"""mm. A body spreads over more and less; several in one file may spread farther."""

_MAX_METRES = 10.0
_MAX_CENTIMETRES = 250.0
"""Extents, in an unknown unit, below which the unit is assumed to be m or cm."""

_SAMPLED_FRAMES = 2000
"""Evenly spaced frames from which the extent is found; the median of more is hardly different."""


def mm_per_unit(spelled: str) -> float | None:
    """Return the millimetres of a unit as spelled in a file; None if it is unknown."""
    unit = _NAMES.get(spelled.strip().lower().rstrip("."))
    return None if unit is None else UNITS[unit]


def find_unit(
    positions: NDArray[np.float64], spelled: str, option: str | None, name: str
) -> tuple[str, float, list[str]]:
    """Find the unit of positions.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), file units]
        NaN where missing.
    spelled : str
        The unit as spelled in the file; empty if absent.
    option : str or None
        The unit given by the user, one of `UNITS`; used without a check.
    name : str
        The file's name in messages.

    Returns
    -------
    unit : str
        The unit, one of `UNITS`.
    mm_per_unit : float
        Millimetres per unit.
    notes : list of str
        What the user should know about the choice.

    Raises
    ------
    OptionError
        If `option` is unknown.
    ClipError
        If the markers' spread is implausible in the file's unit, and another unit fits.
    """
    if option is not None:
        unit = _NAMES.get(option.strip().lower())
        if unit is None:
            raise OptionError(f"unit {option!r} is unknown; use one of {' '.join(UNITS)}")
        return unit, UNITS[unit], []
    extent = _extent(positions)
    unit = _NAMES.get(spelled.strip().lower().rstrip("."))
    if unit is None:
        unit = _by_size(extent)
        reason = f"The unit {spelled!r} is unknown" if spelled else "No unit is stated"
        return unit, UNITS[unit], [f"{reason}; {unit} is assumed from the spread of the markers."]
    in_mm = extent * UNITS[unit]
    if 0 < in_mm < _MIN_EXTENT or in_mm > _MAX_EXTENT:
        likely = _by_size(extent)
        if likely != unit:
            raise ClipError(
                f"{name}: the markers spread over {in_mm:.3g} mm if the unit is {unit}, as the "
                f"file states, which looks like {_word(likely)}; give the right unit "
                f"(`unit` {likely})"
            )
    likely = _by_size(extent)
    in_likely = extent * UNITS[likely]
    if in_mm > _MAX_BODY and likely != unit and in_likely > _MIN_BODY:
        note = (
            f"The markers spread over {in_mm / 1000:.3g} m if the unit is {unit}, as the file "
            f"states, and over {in_likely / 1000:.3g} m if it is {likely} (see `unit`)."
        )
        return unit, UNITS[unit], [note]
    return unit, UNITS[unit], []


def _word(unit: str) -> str:
    """Return a unit's name in full."""
    return {"m": "metres", "cm": "centimetres", "mm": "millimetres"}[unit]


def _by_size(extent: float) -> str:
    """Return the unit in which a body has this extent."""
    if 0 < extent < _MAX_METRES:
        return "m"
    return "cm" if 0 < extent < _MAX_CENTIMETRES else "mm"


def _extent(positions: NDArray[np.float64]) -> float:
    """Return the median over frames of the longest side of the markers' bounding box.

    0 if no frame shows two markers.
    """
    positions = positions[:: max(1, len(positions) // _SAMPLED_FRAMES)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without markers
        sides = np.nanmax(positions, axis=1) - np.nanmin(positions, axis=1)
        extent = np.nanmedian(sides.max(axis=1))
    return float(np.nan_to_num(extent))
