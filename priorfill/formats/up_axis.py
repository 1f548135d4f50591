"""Which axis of a file points up."""

from __future__ import annotations

import re
import warnings

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import OptionError
from priorfill.geometry.axes import UP_AXES

__all__ = ["find_up_axis"]

_LEVELS = (
    # bottom to top; names without the letters and signs that tell the sides
    re.compile(
        r"HEE|HEEL|TOE|ANK|ANKLE|MT\W?_?[1-5]|CAL|CALC|FOOT|MALL?|LM|MM|HLX|HALLUX|[PD][15]M"
    ),
    re.compile(r"KNE|KNEE|LEPI|MEPI|KNJNTLN|TUBTIB|TIB|SHN|SHANK_?\d?"),
    re.compile(r"ASI|ASIS|PSI|PSIS|SACR|SACRUM|SAC|[FB]WT|GTR|TROCH"),
    re.compile(r"C_?7|CV_?7|T\d+|TV\d+|TH\d+|CLAV|STRN|STERNUM|IJ|PX|XP|SHO|SHOULDER|ACR|ACROMION"),
    re.compile(r"[FBMT]?HD\d?|.*HEAD.*|VERTEX"),
)
"""Names of markers by their height on a standing body: foot, knee, pelvis, trunk, head."""

_SIDE = re.compile(r"^(LEFT|RIGHT|[LR])?[_ .-]?(.+?)[_ .-]?(LEFT|RIGHT|[_ .-][LR])?$")

_UPRIGHT = 0.8
"""Least mean share of the foot-to-head direction along the axis taken: upright most of the
time. On 330 recordings that name their markers it is 0.85 and more along the right axis, but
for lying down, where it is mostly below 0.65 along any."""

_RESTING = 0.01
_TALLER = 1.2
_RESTS_LEAD = 1.5
_RESTS_LEAST = 0.4
"""The floor: the lowest marker stays within this share of the body's extent, the body is so many
times longer along this axis than along any other, and the lowest marker rests in so many
times more frames than the outermost marker at the other end, and in so many of all. Without
the markers' names, of 331 recordings these find the right axis in 209 and a wrong one in 1."""


def find_up_axis(
    positions: NDArray[np.float64],
    labels: tuple[str, ...],
    declared: str,
    option: str | None,
    default: str = "+Z",
) -> tuple[str, str, list[str]]:
    """Find which axis points up.

    The option is believed; then the data where they are plain, then the file's Y_SCREEN (the
    axis shown upwards), then the floor, then +Z.

    C3DParameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    labels : tuple of str
        The markers' names.
    screen_up : str
        The file's POINT:Y_SCREEN, empty if absent.
    option : str or None
        The axis that the user says, one of `UP_AXES`.

    Returns
    -------
    up : str
        One of `UP_AXES`.
    found_from : str
        ``"option"``, ``"data"``, ``"file"`` or ``"default"``.
    notes : list of str
        What the user should know about the choice.

    Raises
    ------
    OptionError
        If `option` is unknown.
    """
    if option is not None:
        up = _axis_name(option)
        if up is None:
            raise OptionError(f"up axis {option!r} is unknown; use one of {' '.join(UP_AXES)}")
        return up, "option", []
    from_file = _axis_name(declared)
    from_names = up_from_names(positions, labels)
    if from_file is not None:
        if from_names in (None, from_file):
            return from_file, "file", []
        note = f"The file says that {from_file} is up, but the body stands along {from_names}."
        return str(from_names), "data", [note]
    if from_names is not None:
        return from_names, "data", []
    # weaker than names, so it only speaks where the file is silent
    from_floor = up_from_floor(positions)
    if from_floor is not None:
        note = f"Up is taken to be {from_floor}, as the lowest markers rest there (see --up)."
        return from_floor, "data", [note]
    return default, "default", [f"Nothing tells which axis is up; {default} is assumed (see --up)."]


def up_from_names(positions: NDArray[np.float64], labels: tuple[str, ...]) -> str | None:
    """Return the axis from the lowest to the highest named part of the body.

    C3DParameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), any unit]
        NaN where missing.
    labels : tuple of str
        The markers' names.

    Returns
    -------
    str or None
        One of `UP_AXES`; None if names tell nothing or the body is not upright enough.
    """
    levels = np.array([_level(label) for label in labels])
    seen = [level for level in range(len(_LEVELS)) if (levels == level).any()]
    if len(seen) < 2:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames that lack a part
        low = np.nanmean(positions[:, levels == seen[0]], axis=1)
        high = np.nanmean(positions[:, levels == seen[-1]], axis=1)
    body = high - low
    length = np.linalg.norm(body, axis=1)
    use = length > 0  # false where NaN
    if not use.any():
        return None
    direction = (body[use] / length[use, None]).mean(axis=0)
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) < _UPRIGHT:
        return None
    return _name(axis, bool(direction[axis] < 0))


def up_from_floor(positions: NDArray[np.float64]) -> str | None:
    """Return the axis along which the body is longest and rests at one end.

    Feet stand on the floor in most frames; the top of the head moves.

    C3DParameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), any unit]
        NaN where missing.

    Returns
    -------
    str or None
        One of `UP_AXES`; None if no end of an axis stands out.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without any marker
        lowest = np.nanmin(positions, axis=1)
        highest = np.nanmax(positions, axis=1)
    seen = ~np.isnan(lowest).any(axis=1)
    if not seen.any():
        return None
    lowest, highest = lowest[seen], highest[seen]
    extents = np.median(highest - lowest, axis=0)
    *_, second, axis = np.argsort(extents)
    width = _RESTING * float(extents[axis])
    # ends of all axes: rows lower and upper, columns X, Y, Z
    rests = np.array(
        [[_resting_share(end[:, k], width) for k in range(3)] for end in (lowest, highest)]
    )
    best, other = rests[:, axis].max(), rests[:, axis].min()
    if (
        extents[axis] < _TALLER * extents[second]
        or best < max(_RESTS_LEAST, _RESTS_LEAD * other)
        or best < rests.max()
    ):
        return None
    return _name(int(axis), bool(rests[1, axis] > rests[0, axis]))


def _resting_share(heights: NDArray[np.float64], width: float) -> float:
    """Return the largest share of the values that lies within `width` of each other."""
    ordered = np.sort(heights)
    within = np.searchsorted(ordered, ordered + width, side="right") - np.arange(ordered.size)
    return float(within.max() / ordered.size)


def _level(label: str) -> int:
    """Return the height of a marker's place on the body as an index of `_LEVELS`, or -1."""
    upper = label.upper()
    side = _SIDE.match(upper)
    names = {upper, side.group(2)} if side else {upper}
    return next(
        (
            level
            for level, pattern in enumerate(_LEVELS)
            if any(pattern.fullmatch(name) for name in names)
        ),
        -1,
    )


def _axis_name(text: str) -> str | None:
    """Return an axis as `UP_AXES` spells it; a missing sign is plus."""
    text = text.strip().upper()
    name = text if text[:1] in ("+", "-") else f"+{text}"
    return name if name in UP_AXES else None


def _name(axis: int, negative: bool) -> str:
    """Return the name of an axis by its number."""
    return ("-" if negative else "+") + "XYZ"[axis]
