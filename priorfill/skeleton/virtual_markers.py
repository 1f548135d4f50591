"""Compute the virtual markers of a marker set from a skeleton's motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import ClipError
from priorfill.geometry.axes import UP_AXES
from priorfill.markers.marker_set import MarkerSet, same_markers
from priorfill.skeleton.joints import SkeletonMotion, forward_kinematics
from priorfill.skeleton.marker_sites import known_sites, marker_positions
from priorfill.skeleton.skeleton_body import SkeletonBody

__all__ = ["DEFAULT_RATE", "compute_virtual_markers"]

DEFAULT_RATE = 120.0
"""Hz. AMC files do not state their rate; those of CMU and HDM05 have this one."""

ADULT_LEG = 830.0
"""mm. Length from an adult's hip to the ankle."""

MIN_LEG_RATIO, MAX_LEG_RATIO = 0.5, 1.35
"""Range of leg lengths, from a child's to a very tall person's, relative to `ADULT_LEG`."""

UNITS = {"mm": 1.0, "cm": 10.0, "inches": 25.4, "ASF's": 25.4 / 0.45, "dm": 100.0, "m": 1000.0}
"""Millimetres in the units of length that a BVH file may have; no file states it."""

MIN_MARKERS = 10
"""Minimum number of markers of a useful clip."""

MAX_SPEED = 20_000.0
"""mm/s. Faster than any body part: a first frame this far from the second is a calibration pose."""


def compute_virtual_markers(
    motion: SkeletonMotion,
    marker_set: MarkerSet,
    *,
    name: str,
    file: str,
    rate: float | None = None,
    mm_per_unit: float | None = None,
    up: str | None = None,
    subject: str = "",
) -> Clip:
    """Compute the markers of a marker set from a skeleton's motion.

    Parameters
    ----------
    motion : SkeletonMotion
        The motion.
    marker_set : MarkerSet
        Its markers whose sites on the body are known are computed.
    name : str
        Name of the clip.
    file : str
        Name of the file for messages.
    rate : float, optional
        Frames per second (Hz); by default the motion's, or `DEFAULT_RATE`.
    mm_per_unit : float, optional
        Millimetres in the skeleton's unit of length; by default the skeleton's, or the one of
        `UNITS` that makes the legs most similar to an adult's.
    up : str, optional
        The axis that points up; by default the one along which the rest pose stands.
    subject : str
        The person recorded.

    Returns
    -------
    Clip
        With the markers in the order of the marker set.

    Raises
    ------
    ClipError
        If the skeleton is of no known kind or does not have the size of a person, or if the sites
        of too few markers are known.
    """
    sites = known_sites()
    here, there = same_markers(marker_set.labels, tuple(sites), marker_set)
    if len(here) < MIN_MARKERS:
        raise ClipError(
            f"{file}: only {len(here)} markers of marker set {marker_set.name} can be computed "
            "from skeletons; take another set, such as baumann41 (--as 41)"
        )
    known = list(sites.values())
    wanted = {marker_set.labels[i]: known[j] for i, j in zip(here, there, strict=True)}
    skeleton = motion.skeleton
    scale = mm_per_unit or skeleton.mm_per_unit or _guess_unit(SkeletonBody(skeleton, file).leg)
    body = SkeletonBody(skeleton, file, scale)
    if not MIN_LEG_RATIO < body.leg / ADULT_LEG < MAX_LEG_RATIO:
        raise ClipError(
            f"{file}: the skeleton's legs are {body.leg:.4g} mm long from hip to ankle if a unit "
            f"is {scale:.4g} mm; give the right unit (`unit`)"
        )
    hertz = rate or motion.rate or DEFAULT_RATE
    positions = marker_positions(wanted, body, forward_kinematics(motion), scale)
    positions = positions[_first_frame(positions, hertz) :]
    return Clip(
        positions,
        tuple(wanted),
        hertz,
        up=up or _nearest_axis(body.up),
        name=name,
        subject=subject,
    )


def _guess_unit(leg: float) -> float:
    """Return the millimetres in the unit that makes a leg most similar to an adult's."""
    return min(UNITS.values(), key=lambda mm: abs(np.log(leg * mm / ADULT_LEG)))


def _nearest_axis(direction: NDArray[np.float64]) -> str:
    """Return the axis nearest to a direction."""
    cosines = [(1.0 if axis[0] == "+" else -1.0) * direction["XYZ".index(axis[1])]
               for axis in UP_AXES]  # fmt: skip
    return UP_AXES[int(np.argmax(cosines))]


def _first_frame(positions: NDArray[np.float64], rate: float) -> int:
    """Return 1 if the first frame is a calibration pose, else 0."""
    if len(positions) < 2:
        return 0
    step = np.linalg.norm(positions[1] - positions[0], axis=1).max()
    return int(step * rate > MAX_SPEED)
