"""Check that a skeleton is a human body, and that markers were placed on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import ClipError
from priorfill.skeleton.marker_sites import MarkerSite
from priorfill.skeleton.part_names import SIDES
from priorfill.skeleton.skeleton_body import SkeletonBody, unit_vectors

__all__ = [
    "UNITS",
    "check_body",
    "check_markers",
    "find_unit",
    "is_mirrored",
    "knees_bend_forwards",
]

UNITS = {
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "in": 25.4,
    "dm": 100.0,
    "ft": 304.8,
    "ASF's": 25.4 / 0.45,
}
"""Millimetres in units of length of skeletons, the usual ones first; few files state theirs."""

USUAL_UNITS = 4
"""How many of `UNITS` are common."""

MIN_HEIGHT, MAX_HEIGHT = 800.0, 2300.0
"""mm. Heights of people, from small children to giants."""

MIN_ADULT, ADULT_HEIGHT, MAX_ADULT = 1300.0, 1700.0, 2100.0
"""mm. Heights of adults."""

HEIGHT_RATIO = 1.284
"""Height relative to leg and trunk, from hip to ankle and from hip to shoulder (Winter,
Biomechanics and Motor Control of Human Movement, 4th ed., Figure 4.1)."""

LENGTHS = {
    "thigh": ("thigh", "shank", 0.245),
    "shank": ("shank", "foot", 0.246),
    "upper arm": ("upper_arm", "forearm", 0.186),
    "forearm": ("forearm", "hand", 0.146),
}
"""Usual lengths of bones relative to the height (Winter, Figure 4.1)."""

MIN_LENGTH_RATIO, MAX_LENGTH_RATIO = 0.5, 1.8
"""Lengths relative to the usual ones: people differ, and so do places of joints in skeletons."""

MAX_SIDE_RATIO = 1.3
"""Largest ratio of the same bone on both sides."""

WIDTHS = {"hips": ("thigh", 0.02, 0.3), "shoulders": ("upper_arm", 0.08, 0.45)}
"""Smallest and largest distances of joints of both sides relative to the height."""

FOLDED = {"hip": 120.0, "knee": 155.0, "elbow": 170.0}
"""deg. A joint that is never bent less is folded through the body."""

LOW_HEAD = 0.15
"""Depth of the joint of the head below the shoulders, relative to the trunk, as in no person."""

BENT = np.sin(np.deg2rad(30.0))
"""Sine of the flexion of a knee that shows which way it bends."""

WRONG_WAY = -0.5
"""Mean cosine below which knees bend the wrong way."""

MAX_SPEED = 12_000.0
"""mm/s. Median speed of the pelvis: nobody runs as fast."""

MAX_AWAY = 0.16
"""Distance of a marker from the bone that carries it, relative to the height."""

MAX_CHECKED = 400
"""Frames in which markers are checked."""

_Floats = NDArray[np.float64]


def height(body: SkeletonBody) -> float:
    """Return the height of a body, estimated from legs and trunk (in its unit of length)."""
    return HEIGHT_RATIO * (body.leg + body.trunk)


def find_unit(body: SkeletonBody, stated: float | None, file: str) -> tuple[float, str]:
    """Return the millimetres in the unit of a skeleton, and a note if it was found from the body.

    Parameters
    ----------
    body : SkeletonBody
        The body, in its own unit.
    stated : float or None
        Millimetres in a unit as the user or the file states it.
    file : str
        Name of the file for messages.

    Raises
    ------
    ClipError
        If the body does not have the size of a person in this unit, or in any.
    """
    units = height(body)
    if not 0.0 < units < np.inf:
        raise ClipError(f"{file}: its legs and trunk have no length; check the file")
    fitting = {name: mm for name, mm in UNITS.items() if MIN_HEIGHT <= units * mm <= MAX_HEIGHT}
    usual = [
        name for name in list(UNITS)[:USUAL_UNITS] if MIN_ADULT <= units * UNITS[name] <= MAX_ADULT
    ]
    best = min(
        usual or list(fitting),
        key=lambda name: abs(np.log(units * fitting[name] / ADULT_HEIGHT)),
        default="",
    )
    if stated is not None and MIN_HEIGHT <= units * stated <= MAX_HEIGHT:
        return stated, ""
    if stated is not None:
        remedy = (
            f"in {best} it would be {_metres(units * fitting[best])} tall, give that unit (`unit`, "
            f"also as a number of mm, {fitting[best]:g})"
            if best
            else "check the file, or give the right unit (`unit`, also a number of mm)"
        )
        raise ClipError(
            f"{file}: the body is {_metres(units * stated)} tall if a unit is {stated:.4g} mm; "
            f"{remedy}"
        )
    if not best:
        raise ClipError(
            f"{file}: the body is {units:.4g} units tall, which no usual unit makes the height of "
            "a person; give the unit (`unit`, also a number of mm) or check the file"
        )
    return fitting[best], f"unit {best}, found from the height of the body (else give `unit`)"


def _metres(mm: float) -> str:
    return f"{mm / 1000.0:.3g} m"


def is_mirrored(body: SkeletonBody) -> bool:
    """Return whether toes or knees show that left and right are exchanged."""
    left = body.frames["pelvis"].axes[:, :, 1] / body.size
    cues = []
    for side in SIDES:
        toes = body.tip(f"{side}_foot")
        if toes is not None:
            # relative to the shank: toes of a person who kneels point backwards
            ahead = body.frames[f"{side}_shank"].axes[:, :, 2] / body.size
            cues.append(float(np.einsum("fi,fi->f", toes, ahead).mean()))
        hinge = _knee_hinge(body, side)
        bent = np.linalg.norm(hinge, axis=1) > BENT
        if bent.any():
            cues.append(0.5 * float(np.einsum("fi,fi->f", hinge[bent], left[bent]).mean()))
    return bool(cues) and float(np.mean(cues)) < 0.0


def knees_bend_forwards(body: SkeletonBody) -> bool:
    """Return whether a skeleton's knees bend like no person's where they are bent most."""
    cosines = []
    for side in SIDES:
        hinge = _knee_hinge(body, side)
        bent = np.linalg.norm(hinge, axis=1)
        left = body.frames[f"{side}_thigh"].axes[:, :, 1] / body.size
        if bent.max() > BENT:
            cosines.append(np.einsum("f,fi,fi->", bent, unit_vectors(hinge), left) / bent.sum())
    return bool(cosines) and min(cosines) < WRONG_WAY


def _knee_hinge(body: SkeletonBody, side: str) -> _Floats:
    """Return the axis about which a knee is bent, times the sine of the angle."""
    hip, knee, ankle = (body.at(f"{side}_{limb}") for limb in ("thigh", "shank", "foot"))
    hinge: _Floats = np.cross(unit_vectors(knee - hip), unit_vectors(ankle - knee))
    return hinge


def check_body(body: SkeletonBody, rate: float, file: str) -> None:
    """Check the proportions and the motion of a body.

    Parameters
    ----------
    body : SkeletonBody
        The body, in mm.
    rate : float
        Frames per second (Hz).
    file : str
        Name of the file for messages.

    Raises
    ------
    ClipError
        If they are not those of a person.
    """
    tall = height(body)
    for name, (start, end, usual) in LENGTHS.items():
        found = [body.length(f"{side}_{start}", f"{side}_{end}") for side in SIDES]
        for side, length in zip(SIDES, found, strict=True):
            if not MIN_LENGTH_RATIO < length / (usual * tall) < MAX_LENGTH_RATIO:
                raise ClipError(
                    f"{file}: the {side} {name} is {length:.0f} mm long in a body of "
                    f"{_metres(tall)}, not as in a person; {_REMEDY}"
                )
        if max(found) > MAX_SIDE_RATIO * min(found):
            raise ClipError(
                f"{file}: the left {name} is {found[0]:.0f} mm long, the right one "
                f"{found[1]:.0f} mm; {_REMEDY}"
            )
    for name, (limb, least, most) in WIDTHS.items():
        width = body.length(f"left_{limb}", f"right_{limb}")
        if not least < width / tall < most:
            raise ClipError(
                f"{file}: the {name} are {width:.0f} mm wide in a body of {_metres(tall)}, not as "
                f"in a person; {_REMEDY}"
            )
    _check_posture(body, file)
    steps = np.linalg.norm(np.diff(body.midpoint("thigh"), axis=0), axis=1)
    if len(steps) and float(np.median(steps)) * rate > MAX_SPEED:
        raise ClipError(
            f"{file}: the pelvis moves at {np.median(steps) * rate / 1000.0:.3g} m/s in half of "
            "the frames, faster than any person; check the rate (`rate`), and the unit of positions"
        )


_REMEDY = "check the file, or name its joints (`joints`)"


def _check_posture(body: SkeletonBody, file: str) -> None:
    """Check that the body is not folded through itself, and that left is left."""
    folds = {"hip": body.hip_flexion}
    for joint, limbs in (
        ("knee", ("thigh", "shank", "foot")),
        ("elbow", ("upper_arm", "forearm", "hand")),
    ):
        for side in SIDES:
            start, middle, end = (body.at(f"{side}_{limb}") for limb in limbs)
            cosine = np.einsum("fi,fi->f", unit_vectors(middle - start), unit_vectors(end - middle))
            folds[f"{side} {joint}"] = np.arccos(np.clip(cosine, -1.0, 1.0))
    for name, angles in folds.items():
        limit = FOLDED[name.split()[-1]]
        if np.rad2deg(angles.min()) > limit:
            raise ClipError(
                f"{file}: the {name} is bent by more than {limit:.0f} degrees in every frame, "
                "as in no person; the file may hold no motion but its rest pose, check it"
            )
    head = body.at("head") - body.midpoint("upper_arm")
    if np.median(np.einsum("fi,fi->f", head, body.up)) < -LOW_HEAD * body.trunk:
        raise ClipError(f"{file}: the head is below the shoulders; {_REMEDY}")
    shoulders = body.at("left_upper_arm") - body.at("right_upper_arm")
    hips = body.at("left_thigh") - body.at("right_thigh")
    if np.einsum("fi,fi->f", unit_vectors(shoulders), unit_vectors(hips)).mean() < 0.0:
        raise ClipError(
            f"{file}: the left shoulder is above the right hip, as in no person; {_REMEDY}"
        )
    if is_mirrored(body):
        raise ClipError(
            f"{file}: toes and knees show that left and right are exchanged, or that the file is a "
            "mirror image; export it with right-handed axes, or name the joints (`joints`)"
        )


def check_markers(
    positions: _Floats,
    sites: Mapping[str, Sequence[MarkerSite]],
    body: SkeletonBody,
    file: str,
) -> None:
    """Check that each marker is near the bone that carries it.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The markers.
    sites : mapping of str to sequence of MarkerSite
        The sites of each marker, in the same order.
    body : SkeletonBody
        The body, in mm.
    file : str
        Name of the file for messages.

    Raises
    ------
    ClipError
        If one is not.
    """
    rows = slice(None, None, max(1, len(positions) // MAX_CHECKED))
    limit = MAX_AWAY * height(body)
    for marker, (label, of_marker) in enumerate(sites.items()):
        part = max(of_marker, key=lambda site: site.weight).part
        start, end = _bone(body, part)
        away = _distance(positions[rows, marker], start[rows], end[rows])
        if not away.max() <= limit:
            frame = int(np.argmax(away)) * (rows.step or 1) + 1
            raise ClipError(
                f"{file}: frame {frame}: marker {label} would be {away.max():.0f} mm from the bone "
                f"({part.replace('_', ' ')}) that carries it; {_REMEDY}"
            )


def _bone(body: SkeletonBody, part: str) -> tuple[_Floats, _Floats]:
    """Return the ends of a part's bone, from joints alone."""
    side, _, limb = part.partition("_")
    follows = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shank", "shank": "foot"}
    if part == "pelvis":
        return body.at("left_thigh"), body.at("right_thigh")
    if part == "thorax":
        return body.midpoint("thigh"), body.midpoint("upper_arm")
    if limb == "wrist":
        return body.at(f"{side}_forearm"), body.at(f"{side}_hand")
    if limb == "shoulder":
        return body.at(f"{side}_upper_arm"), body.at(f"{side}_upper_arm")
    start = body.at(part)
    return start, body.at(f"{side}_{follows[limb]}") if limb in follows else start


def _distance(points: _Floats, start: _Floats, end: _Floats) -> _Floats:
    """Return the distance of points from line segments [shape=(frames,), mm]."""
    along = end - start
    square = np.einsum("fi,fi->f", along, along)
    share = np.einsum("fi,fi->f", points - start, along) / np.where(square > 0.0, square, 1.0)
    nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
    away: _Floats = np.linalg.norm(points - nearest, axis=1)
    return away
