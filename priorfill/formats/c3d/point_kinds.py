"""Which points of a C3D file are markers, and why the others are not.

Programs store joint angles, forces, centres of mass and the axes of body segments among the
points. A point is left out only for a reason that can be named; in doubt it is a marker.
A marker that is never seen in the clip stays one: it is to be filled.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.formats.c3d.parameters import Parameters

__all__ = ["find_model_points", "split_label"]

_GROUPS = (
    *("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "BONES"),
    "MODELED_MARKERS",
)
"""POINT parameters that list model outputs; TYPE_GROUPS may name more."""

_NOT_OUTPUTS = frozenset({"MARKERS", "POINTS", "LABELS", "TYPE_GROUPS", "DESCRIPTIONS"})
"""Names in TYPE_GROUPS that would list measured points."""

_UNLABELLED = re.compile(
    r"""\*\d*                       # Vicon: *12, and its virtual points *0
    | (?:C_|U_?)\*\d* | uname\*?\d*   # and so in other programs
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
"""Points of the Oxford foot model that belong to no axes; looked for beside its forefoot axes."""

_OXFORD_FOREFOOT = re.compile(r"[LR]FOF[0-3]")

_PLUG_IN_GAIT = ("O", "A", "L", "P")
_NUMBERED = ("0", "1", "2", "3")
"""Suffixes of a segment's origin and the ends of its three axes."""

_SEGMENT = re.compile(r"[A-Z]{3}")
"""Base name of a segment of Plug-in Gait: PEL, LFE, ..."""

_VIRTUAL_COPY = "v"
"""Suffix of the reconstructed twin of a marker: LSTLv beside LSTL."""

_SQUARE = 0.01
"""Largest cosine between computed axes: real markers are never so square in every frame, and
integer files round the ends of 50 mm axes by up to 0.1 mm."""

_MOST_CENTRES = 500
"""Points of a file beyond which the centre of numbered axes is not looked for among them all: no
model has so many, and the time grows with their square."""

_FRAMES_CHECKED = 50
"""Frames, spread over the clip, in which axes are checked."""


def split_label(label: str, prefixes: Iterable[str]) -> tuple[str, str]:
    """Split a label into subject and name.

    Parameters
    ----------
    label : str
        The label as the file has it.
    prefixes : iterable of str
        What the file declares as prefixes, the separator included.

    Returns
    -------
    tuple of str
        The subject, empty if there is none, and the marker's name.
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
    parameters: Parameters,
) -> dict[int, str]:
    """Find the points that are not markers.

    Parameters
    ----------
    names : sequence of str
        Each point's name without prefix.
    labels : sequence of str
        Each point's label as the file has it.
    positions : ndarray [shape=(frames, points, 3), any unit]
        NaN where missing.
    parameters : Parameters
        The file's parameters.

    Returns
    -------
    dict of int to str
        The reason for each point that is not a marker.
    """
    reasons: dict[int, str] = {}
    declared = _declared(parameters)
    present = set(names)
    for point, name in enumerate(names):
        reason = _reason(name, present)
        for known in (labels[point].strip(), name):
            if known in declared:
                reason = f"model output (POINT:{declared[known]})"
        if reason:
            reasons[point] = reason
    for point, reason in _axis_points(names, positions).items():
        reasons.setdefault(point, reason)
    return reasons


def _declared(parameters: Parameters) -> dict[str, str]:
    """Return the labels that the file itself lists as model outputs, with the parameter."""
    groups = dict.fromkeys((*_GROUPS, *parameters.texts("POINT", "TYPE_GROUPS")))
    return {
        label: group
        for group in groups
        if group not in _NOT_OUTPUTS
        for label in parameters.texts("POINT", group.upper())
        if label
    }


def _reason(name: str, present: set[str]) -> str:
    """Return why a point of this name is no marker; empty if it is one."""
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
            return f"virtual twin of {twin}"
    if _OXFORD_FOOT.fullmatch(name) and any(_OXFORD_FOREFOOT.fullmatch(n) for n in present):
        return "computed by the Oxford foot model"
    return ""


def _axis_points(names: Sequence[str], positions: NDArray[np.float64]) -> dict[int, str]:
    """Return the origins and axis ends of segments: families of names at right angles.

    Names alone do for Plug-in Gait's where the clip does not show a whole family; numbers are
    too common among markers.
    """
    where = {name: point for point, name in enumerate(names)}
    chosen = np.unique(np.linspace(0, len(positions) - 1, _FRAMES_CHECKED).astype(int))
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
                # numbered axes may start at a point of another name, such as a joint centre
                family = axes
                computed = (
                    suffixes == _NUMBERED
                    and len(names) <= _MOST_CENTRES
                    and bool(_is_square(sample, axes, list(range(len(names)))))
                )
            if computed:
                found.update(dict.fromkeys(family, f"axis of the computed segment {base}"))
    return found


def _is_square(sample: NDArray[np.float64], axes: list[int], centres: list[int]) -> bool | None:
    """Tell if three points lie at right angles about one of the centres in every frame.

    None where no frame shows all of them; an axis of length 0 is no direction.
    """
    # frames, centres, 3 ends, 3 coordinates
    arms = sample[:, None, axes] - sample[:, centres, None]
    length = np.linalg.norm(arms, axis=3)
    known = (length > 0).all(axis=2)  # false where NaN
    if not known.any():
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = arms / length[..., None]
        cosines = np.abs(np.einsum("fcid,fcid->fci", unit, np.roll(unit, 1, axis=2))).max(axis=2)
    worst = np.where(known, cosines, 0.0).max(axis=0)
    return bool(((worst < _SQUARE) & known.any(axis=0)).any())
