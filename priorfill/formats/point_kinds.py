"""Which points of a file are markers, and why the others are not.

Programs store joint angles, forces, centres of mass and the axes of body segments among the
points. A point is left out only for a reason that can be stated; in doubt it is a marker. A marker
without any sample in the clip remains one, because it is to be filled.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["find_model_points", "split_label"]

_UNLABELLED = re.compile(
    r"""\*\d*                       # Vicon: *12, and its virtual points *0
    | (?:C_|U_?)\*\d* | uname\*?\d*   # other programs
    | (?i:unlabell?ed|unidentified|unknown|phantom|ghost)[\s_:-]*\d*
    """,
    re.VERBOSE,
)

_OUTPUT_WORD = r"(?:Angle|Force|Moment|Power|Torque|Velocity|Height|HeightIndex|Scalar)s?"
_OUTPUT = re.compile(
    rf"""(?:.*[a-z0-9])?{_OUTPUT_WORD}            # LHipAngles, LArchHeight
    | .*[_\s.-](?i:{_OUTPUT_WORD})                # left_knee_angle
    | .*[A-Z]{{2}}(?:ANGLES|FORCES|MOMENTS|POWERS)  # LHIPANGLES
    | .*GRF                                       # ground reaction force
    """,
    re.VERBOSE,
)

_MASS_CENTRE = re.compile(
    r"""(?i:.*cent(?:er|re)[_\s]?of[_\s]?(?:mass|gravity|pressure).*)
    | (?:[LR]|.*[a-z_\s.-])?(?:COM|CoM|COG|CoG|COP|CoP)(?:[_\s]?(?i:floor))?
    """,
    re.VERBOSE,
)

_JOINT_CENTRE = re.compile(
    r"""[LR]?_?(?:[HKASEW]|(?i:hip|knee|ankle|shoulder|elbow|wrist))_?JC
    | (?i:.*joint[_\s]?cent(?:er|re).*)
    """,
    re.VERBOSE,
)

_OXFORD_FOOT = re.compile(r"[LR](?:D1M0|HE1|PROXFF|DISTFF)")
"""Points of the Oxford foot model outside its axes; recognised if its forefoot axes are present."""

_OXFORD_FOREFOOT = re.compile(r"[LR]FOF[0-3]")

_ANGLES = {
    "Plug-in Gait": (("HPA", "KNA", "ANA"), ("FTA",)),
    "the Oxford foot model": (("HFTBA", "FFHFA", "HXFFA"), ("FETBA", "TIBA", "HFTFL", "FFTBA")),
}
"""Names, after L or R, of angles whose names do not tell that they are any, by model. Files declare
them; what is exported from files does not. The first ones must all be there for one to count,
because LANA alone could be a marker."""

_PELVIS_ANGLES = ("PELAng", "PELA")
"""Names of the angles of the pelvis in Plug-in Gait."""

_PLUG_IN_GAIT = ("O", "A", "L", "P")
_NUMBERED = ("0", "1", "2", "3")
"""Suffixes of a segment's origin and of the ends of its three axes."""

_SEGMENT = re.compile(r"[A-Z]{3}")
"""Base name of a segment of Plug-in Gait: PEL, LFE, ..."""

_VIRTUAL_COPY = "v"
"""Suffix of a reconstructed copy of a marker: LSTLv of LSTL."""

_MAX_AXIS_COSINE = 0.01
"""Largest cosine between computed axes. Real markers are not this close to right angles in every
frame, and integer files round the ends of 50 mm axes by up to 0.1 mm."""

_MAX_CENTRES = 500
"""Number of points beyond which the origin of numbered axes is not searched among all points: no
model has this many, and the time grows with the square of their number."""

_CHECKED_FRAMES = 50
"""Frames, spread over the clip, in which axes are checked."""


def split_label(label: str, prefixes: Iterable[str]) -> tuple[str, str]:
    """Split a label into subject and name.

    Parameters
    ----------
    label : str
        The label as spelled in the file.
    prefixes : iterable of str
        Prefixes declared by the file, separator included.

    Returns
    -------
    subject : str
        The subject; empty if there is none.
    name : str
        The marker's name.

    Examples
    --------
    >>> split_label("Anna:LTOE", ())
    ('Anna', 'LTOE')
    """
    label = label.strip()
    for prefix in prefixes:
        if prefix and label.startswith(prefix) and len(label) > len(prefix):
            return prefix.rstrip(": _"), label[len(prefix) :].strip()
    if _UNLABELLED.fullmatch(label):
        return "", label
    subject, _, name = label.rpartition(":")
    return subject.strip(), name.strip()


def find_model_points(
    names: Sequence[str],
    labels: Sequence[str],
    positions: NDArray[np.float64],
    declared: Mapping[str, str],
) -> dict[int, str]:
    """Find the points that are not markers.

    Parameters
    ----------
    names : sequence of str
        Name of each point without prefix.
    labels : sequence of str
        Label of each point as spelled in the file.
    positions : ndarray [shape=(frames, points, 3), any unit]
        NaN where missing.
    declared : mapping of str to str
        Labels that the file declares as model outputs, with the reason.

    Returns
    -------
    dict of int to str
        The reason for each point that is not a marker.
    """
    reasons: dict[int, str] = {}
    where: dict[str, list[int]] = {}
    for point, name in enumerate(names):
        where.setdefault(name, []).append(point)
    present = set(where)
    for point, name in enumerate(names):
        reason = _reason(name, present)
        for known in (labels[point].strip(), name):
            if known in declared:
                reason = declared[known]
        if reason:
            reasons[point] = reason
    for name, reason in _angles(present).items():
        for point in where[name]:
            reasons.setdefault(point, reason)
    for point, reason in _axis_points(names, positions).items():
        reasons.setdefault(point, reason)
    return reasons


def _reason(name: str, present: set[str]) -> str:
    """Return why a point of this name is not a marker; empty if it is one."""
    if not name:
        return "has no label"
    for pattern, reason in (
        (_UNLABELLED, "unlabelled"),
        (_OUTPUT, "model output by its name"),
        (_MASS_CENTRE, "centre of mass or pressure"),
        (_JOINT_CENTRE, "joint centre"),
    ):
        if pattern.fullmatch(name):
            return reason
    if name.endswith(_VIRTUAL_COPY) and name[: -len(_VIRTUAL_COPY)].isupper():
        twin = name[: -len(_VIRTUAL_COPY)].rstrip("_-")
        if twin in present:
            return f"virtual copy of {twin}"
    if _OXFORD_FOOT.fullmatch(name) and any(_OXFORD_FOREFOOT.fullmatch(n) for n in present):
        return "computed by the Oxford foot model"
    return ""


def _angles(present: set[str]) -> dict[str, str]:
    """Return the names of joint angles that are known by their company, with the reason."""
    found: dict[str, str] = {}
    for model, (needed, others) in _ANGLES.items():
        for side in "LR":
            if all(side + name in present for name in needed):
                names = [side + name for name in (*needed, *others)]
                names += _PELVIS_ANGLES if model == "Plug-in Gait" else ()
                found |= {name: f"joint angle of {model}" for name in names if name in present}
    return found


def _axis_points(names: Sequence[str], positions: NDArray[np.float64]) -> dict[int, str]:
    """Return the origins and axis ends of segments: families of names at right angles.

    If no frame shows a complete family, the names alone suffice for Plug-in Gait; numbered names
    are too common among markers.
    """
    where = {name: point for point, name in enumerate(names)}
    chosen = np.unique(np.linspace(0, len(positions) - 1, _CHECKED_FRAMES).astype(int))
    sample = positions[chosen]
    found: dict[int, str] = {}
    for suffixes in (_PLUG_IN_GAIT, _NUMBERED):
        origin, *ends = suffixes
        for base in sorted({name[:-1] for name in names if name.endswith(ends[0])}):
            axes = [where[base + end] for end in ends if base + end in where]
            if len(axes) < len(ends):
                continue
            centre = where.get(base + origin)
            if centre is not None:
                family = [centre, *axes]
                square = _is_square(sample, axes, [centre])
                by_name = suffixes == _PLUG_IN_GAIT and _SEGMENT.fullmatch(base)
                computed = bool(by_name) if square is None else square
            else:
                # numbered axes may start at a point with another name, such as a joint centre
                family = axes
                computed = (
                    suffixes == _NUMBERED
                    and len(names) <= _MAX_CENTRES
                    and bool(_is_square(sample, axes, list(range(len(names)))))
                )
            if computed:
                found.update(dict.fromkeys(family, f"axis of the computed segment {base}"))
    return found


def _is_square(sample: NDArray[np.float64], axes: list[int], centres: list[int]) -> bool | None:
    """Check whether three points lie at right angles about one of the centres in every frame.

    None if no frame shows all of them. Axes of length 0 have no direction and do not count.
    """
    # frames, centres, 3 ends, 3 coordinates
    with np.errstate(invalid="ignore", over="ignore"):  # infinite coordinates
        arms = sample[:, None, axes] - sample[:, centres, None]
        length = np.linalg.norm(arms, axis=3)
    known = (length > 0).all(axis=2)  # False where NaN
    if not known.any():
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = arms / length[..., None]
        cosines = np.abs(np.einsum("fcid,fcid->fci", unit, np.roll(unit, 1, axis=2))).max(axis=2)
    worst = np.where(known, cosines, 0.0).max(axis=0)
    return bool(((worst < _MAX_AXIS_COSINE) & known.any(axis=0)).any())
