"""Detection of the axis that points up."""

from __future__ import annotations

import re
import warnings

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import OptionError
from priorfill.geometry.axes import UP_AXES

__all__ = ["find_up_axis"]

_LEVELS = (
    # bottom to top; names without the letters of the sides
    re.compile(
        r"HEE|HEEL|TOE|ANK|ANKLE|MT\W?_?[1-5]|CAL|CALC|FOOT|MALL?|LM|MM|HLX|HALLUX|[PD][15]M"
        r"|FAL|TAM|FCC|FM[125]|DP1"
    ),
    re.compile(r"KNE|KNEE|LEPI|MEPI|KNJNTLN|TUBTIB|TIB|SHN|SHANK_?\d?|FLE|FME|FAX|TTC"),
    re.compile(r"ASI|ASIS|PSI|PSIS|SACR|SACRUM|SAC|[FB]WT|GTR|TROCH|IAS|IPS|FTC|PELVIS\w*"),
    re.compile(
        r"C_?7|CV_?7|T\d+|TV\d+|TH\d+|CLAV|STRN|STERNUM|IJ|PX|XP|SHO|SHOULDER|ACR|ACROMION"
        r"|SJN|SXS|SAE"
    ),
    re.compile(r"[FBMT]?HD\d?|.*HEAD.*|VERTEX|SGL"),
)
"""Marker names by height on a standing body: foot, knee, pelvis, trunk, head. Names such as
FAL and IAS are those of the CAST protocol, which Qualisys uses."""

_SIDE = re.compile(r"^(LEFT|RIGHT|[LR])?[_ .-]?(.+?)[_ .-]?(LEFT|RIGHT|[_ .-][LR])?$")

_MIN_UPRIGHT = 0.8
"""Minimum mean component of the foot-to-head direction along the chosen axis. In 330 recordings
with named markers it is at least 0.85 along the right axis, except for subjects lying down, where
it is mostly below 0.65 along any axis."""

_MIN_TRAVEL = 0.25
"""Minimum travel of the middle of the body perpendicular to its length, as a share of its length,
that shows it to be standing. Of 310 recordings of people on their feet, 177 exceed it; people lying
down stay where they are."""

_REST_TOLERANCE = 0.01
"""Share of the body's extent within which the outermost marker at one end counts as resting."""

_MIN_ELONGATION = 1.2
"""Minimum ratio of the body's extent along the vertical to that along any other axis."""

_MIN_REST_RATIO = 1.5
_MIN_REST_SHARE = 0.4
"""Minimum share of frames in which the lowest marker rests, as a ratio to the opposite end and as a
share of all frames. Without marker names, the four rules find the right axis in 209 of 331
recordings and a wrong one in 1."""


def find_up_axis(
    positions: NDArray[np.float64],
    labels: tuple[str, ...],
    declared: str,
    option: str | None,
    default: str = "+Z",
    *,
    sign_declared: bool = True,
) -> tuple[str, str, list[str]]:
    """Find the axis that points up.

    In order of precedence: the option; the named markers of a body that stands; the axis declared
    by the file; the end of the longest axis where markers rest; the default. The direction from the
    feet to the head is horizontal if the body lies. So if it is perpendicular to the declared axis,
    or is a customary horizontal one, or points down, it counts only if the body moves as one that
    stands.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    labels : tuple of str
        The markers' names.
    declared : str
        The axis declared by the file (POINT:Y_SCREEN in C3D); empty if absent.
    option : str or None
        The axis given by the user, one of `UP_AXES`.
    default : str
        The axis assumed if nothing else determines it.
    sign_declared : bool
        Whether the program that wrote the file gives the sign of its axis a meaning.

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
        return check_up(option), "option", []
    from_file = _axis_name(declared)
    from_names = up_from_names(positions, labels)
    if from_file is not None:
        return _weigh_file(positions, from_file, from_names, sign_declared)
    if from_names is not None:
        if from_names[1] != "X" or _travels(positions, from_names):
            return from_names, "data", []
        # no laboratory has X up, so the body lies there
        note = f"The body lies along {from_names}; {default} is assumed to be up (see `up`)."
        return default, "default", [note]
    # less reliable than names, so only used if the file declares no axis
    from_floor = up_from_floor(positions)
    if from_floor is not None:
        note = (
            f"Up is assumed to be {from_floor}, because the lowest markers rest there (see `up`)."
        )
        return from_floor, "data", [note]
    return default, "default", [f"The up axis is unknown; {default} is assumed (see `up`)."]


def _weigh_file(
    positions: NDArray[np.float64], declared: str, from_names: str | None, sign_declared: bool
) -> tuple[str, str, list[str]]:
    """Choose between the axis that a file declares and the one along which the body extends.

    Parameters and results are those of `find_up_axis`.
    """
    if from_names == declared:
        return declared, "file", []
    stated = f"The file states that {declared} is up"
    if from_names is not None and from_names[1] == declared[1]:
        if from_names[0] == "-" and not _travels(positions, from_names):
            # no program writes a plus for an axis that points down, but people do handstands
            note = f"The body is upside down; {declared} of the file is used (see `up`)."
            return declared, "file", [note]
        return from_names, "data", [f"{stated}, but the body stands along {from_names}."]
    if from_names is not None and _travels(positions, from_names):
        note = f"{stated}, but the body stands along {from_names} and moves about (see `up`)."
        return from_names, "data", [note]
    notes: list[str] = []
    up = declared
    from_floor = up_from_floor(positions) if from_names is None else None
    if from_floor is not None and from_floor[1] != declared[1]:
        # people who lie rest along a horizontal axis, too, but do not travel
        if _travels(positions, from_floor):
            note = (
                f"{stated}, but the lowest markers rest along {from_floor} and the body moves "
                "about (see `up`)."
            )
            return from_floor, "data", [note]
        notes = [f"The lowest markers rest along {from_floor}; {up} of the file is used."]
    if declared[0] == "-":  # upside down: the program's habit, or an unusual calibration
        positive = f"+{declared[1]}"
        if not sign_declared:
            up = positive
            notes = [
                f"{stated}; programs of Qualisys write this where {positive} is up, so "
                f"{positive} is used (see `up`)."
            ]
        elif (from_floor or up_from_floor(positions)) == positive:
            up = positive
            notes = [f"{stated}, but the lowest markers rest along {positive} (see `up`)."]
    if from_names is not None:
        notes.append(f"The body lies along {from_names}; {up} of the file is used (see `up`).")
    return up, "file" if up == declared else "data", notes


def _travels(positions: NDArray[np.float64], up: str) -> bool:
    """Check whether the body moves perpendicular to `up` as only a standing body does."""
    axis = "XYZ".index(up[1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without markers
        middle = np.nanmedian(positions, axis=1)
        length = np.nanmedian(
            np.nanmax(positions[..., axis], 1) - np.nanmin(positions[..., axis], 1)
        )
        travel = np.delete(np.nanmax(middle, axis=0) - np.nanmin(middle, axis=0), axis)
    return bool(travel.max() > _MIN_TRAVEL * length)


def up_from_names(positions: NDArray[np.float64], labels: tuple[str, ...]) -> str | None:
    """Return the axis from the lowest to the highest named part of the body.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), any unit]
        NaN where missing.
    labels : tuple of str
        The markers' names.

    Returns
    -------
    str or None
        One of `UP_AXES`; None if names do not suffice or the body is not upright enough.
    """
    levels = np.array([_level(label) for label in labels])
    seen = [level for level in range(len(_LEVELS)) if (levels == level).any()]
    if len(seen) < 2:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without markers of a level
        low = np.nanmean(positions[:, levels == seen[0]], axis=1)
        high = np.nanmean(positions[:, levels == seen[-1]], axis=1)
    body = high - low
    length = np.linalg.norm(body, axis=1)
    use = length > 0  # False where NaN
    if not use.any():
        return None
    direction = (body[use] / length[use, None]).mean(axis=0)
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) < _MIN_UPRIGHT:
        return None
    return _name(axis, bool(direction[axis] < 0))


def up_from_floor(positions: NDArray[np.float64]) -> str | None:
    """Return the axis along which the body is longest and rests at one end.

    The feet are on the floor in most frames; the top of the head moves.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), any unit]
        NaN where missing.

    Returns
    -------
    str or None
        One of `UP_AXES`; None if no end of an axis stands out.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without markers
        lowest = np.nanmin(positions, axis=1)
        highest = np.nanmax(positions, axis=1)
    seen = ~np.isnan(lowest).any(axis=1)
    if not seen.any():
        return None
    lowest, highest = lowest[seen], highest[seen]
    extents = np.median(highest - lowest, axis=0)
    *_, second, axis = np.argsort(extents)
    width = _REST_TOLERANCE * float(extents[axis])
    # rows: lower and upper end; columns: X, Y, Z
    rests = np.array(
        [[_resting_share(end[:, k], width) for k in range(3)] for end in (lowest, highest)]
    )
    best, other = rests[:, axis].max(), rests[:, axis].min()
    if (
        extents[axis] < _MIN_ELONGATION * extents[second]
        or best < max(_MIN_REST_SHARE, _MIN_REST_RATIO * other)
        or best < rests.max()
    ):
        return None
    return _name(int(axis), bool(rests[1, axis] > rests[0, axis]))


def _resting_share(heights: NDArray[np.float64], width: float) -> float:
    """Return the largest share of values within `width` of each other."""
    ordered = np.sort(heights)
    within = np.searchsorted(ordered, ordered + width, side="right") - np.arange(ordered.size)
    return float(within.max() / ordered.size)


def _level(label: str) -> int:
    """Return the level of a marker on the body as an index of `_LEVELS`, or -1."""
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


def check_up(text: str) -> str:
    """Return an axis given by the user as spelled in `UP_AXES`.

    Raises
    ------
    OptionError
        If there is no such axis.
    """
    up = _axis_name(text)
    if up is None:
        raise OptionError(f"up axis {text!r} is unknown; use one of {' '.join(UP_AXES)}")
    return up


def _axis_name(text: str) -> str | None:
    """Return an axis as spelled in `UP_AXES`; a missing sign means plus."""
    text = text.strip().upper()
    name = text if text[:1] in ("+", "-") else f"+{text}"
    return name if name in UP_AXES else None


def _name(axis: int, negative: bool) -> str:
    """Return the name of an axis by its number."""
    return ("-" if negative else "+") + "XYZ"[axis]
