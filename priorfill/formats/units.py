"""Units of length as files spell them, and millimetres."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import ClipError, OptionError

__all__ = ["UNITS", "find_unit"]

UNITS = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
"""Millimetres in one unit, by the name that the option takes."""

_SPELLINGS = {
    "mm": ("mm", "mms", "millimeter", "millimeters", "millimetre", "millimetres", "mill"),
    "cm": ("cm", "cms", "centimeter", "centimeters", "centimetre", "centimetres", "cent"),
    "dm": ("dm", "decimeter", "decimeters", "decimetre", "decimetres"),
    # old programs cut parameters to four characters
    "m": ("m", "mete", "metr", "meter", "meters", "metre", "metres"),
    "in": ("in", "inch", "inches", '"'),
    "ft": ("ft", "foot", "feet"),
}

_NAMES = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}

_SMALLEST = 30.0
"""Extent (mm) below which markers are not those of a body, nor of a hand or a face."""

_LARGEST = 60_000.0
"""Extent (mm) at one moment above which markers fit into no capture volume."""

_METRES_BELOW = 10.0
_CENTIMETRES_BELOW = 250.0
"""Extents (units unknown) below which a body's markers are taken to be in m and in cm."""


def find_unit(
    positions: NDArray[np.float64], spelled: str, option: str | None, name: str
) -> tuple[str, float, list[str]]:
    """Find the unit that positions are in.

    C3DParameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), file units]
        NaN where missing.
    spelled : str
        The unit as the file spells it, empty if it does not.
    option : str or None
        The unit that the user says, one of `UNITS`; believed without a check.
    name : str
        What to call the file in messages.

    Returns
    -------
    unit : str
        The unit, one of `UNITS`.
    mm_per_unit : float
        Millimetres in it.
    notes : list of str
        What the user should know about the choice.

    Raises
    ------
    OptionError
        If `option` is unknown.
    ClipError
        If the markers lie too close together or too far apart for the file's unit.
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
        said = f"The unit {spelled!r} of the file is unknown" if spelled else "The file has no unit"
        return unit, UNITS[unit], [f"{said}; taken as {unit} from the spread of the markers."]
    in_mm = extent * UNITS[unit]
    if 0 < in_mm < _SMALLEST or in_mm > _LARGEST:
        likely = _by_size(extent)
        if likely != unit:
            raise ClipError(
                f"{name}: the markers spread over {in_mm:.3g} mm if the unit is {unit} as the "
                f"file says, which looks like {_word(likely)}; say the right unit "
                f"(--unit {likely})"
            )
    return unit, UNITS[unit], []


def _word(unit: str) -> str:
    """Return a unit's name in full."""
    return {"m": "metres", "cm": "centimetres", "mm": "millimetres"}[unit]


def _by_size(extent: float) -> str:
    """Return the unit in which a body has this extent."""
    if 0 < extent < _METRES_BELOW:
        return "m"
    return "cm" if 0 < extent < _CENTIMETRES_BELOW else "mm"


def _extent(positions: NDArray[np.float64]) -> float:
    """Return how far apart the markers are at one moment, 0 if never two are seen at once.

    The median over the frames of the largest side of the box around the markers.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without any marker
        sides = np.nanmax(positions, axis=1) - np.nanmin(positions, axis=1)
        extent = np.nanmedian(sides.max(axis=1))
    return float(np.nan_to_num(extent))
