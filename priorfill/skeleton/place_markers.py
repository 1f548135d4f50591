"""Place a marker set on a skeleton's motion: a clip that was never recorded as markers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import ClipError
from priorfill.geometry.axes import UP_AXES
from priorfill.markers.marker_set import MarkerSet, same_markers
from priorfill.skeleton.body import Body
from priorfill.skeleton.joints import Motion, forward
from priorfill.skeleton.markers import known_sites, positions_of

__all__ = ["RATE", "place"]

RATE = 120.0
"""Hz. AMC files do not say it; those of CMU and HDM05 have this."""

LEG = 830.0
"""mm. From hip to ankle, a grown-up person's."""

CHILD, GIANT = 0.5, 1.35
"""A leg is between these parts of `LEG`."""

UNITS = {"mm": 1.0, "cm": 10.0, "inches": 25.4, "ASF's": 25.4 / 0.45, "dm": 100.0, "m": 1000.0}
"""Millimetres in a unit of length that a BVH file may have; no file says which."""

LEAST = 10
"""Markers; with fewer on the body the clip is no help."""

JUMP = 20_000.0
"""mm/s. Faster than anybody moves: the first frame is then a pose to measure the skeleton by."""


def place(
    motion: Motion,
    marker_set: MarkerSet,
    *,
    name: str,
    file: str,
    rate: float | None = None,
    mm_per_unit: float | None = None,
    up: str | None = None,
    subject: str = "",
) -> Clip:
    """Place a marker set on a skeleton's motion.

    Parameters
    ----------
    motion : Motion
        The motion.
    marker_set : MarkerSet
        Those of its markers are placed of which it is known where they sit.
    name : str
        What to call the clip.
    file : str
        What to call the file in messages.
    rate : float, optional
        Frames per second (Hz); by default as the motion says, or `RATE`.
    mm_per_unit : float, optional
        Millimetres in the skeleton's unit of length; by default as the skeleton says, or that
        of `UNITS` with which its legs have the length of a person's.
    up : str, optional
        Which axis points up; by default that along which the rest pose stands.
    subject : str
        Whose motion it is.

    Raises
    ------
    ClipError
        Where the skeleton is of no kind that is known, or not of a person's size, or the set
        has hardly a marker that can be placed.
    """
    sites = known_sites()
    here, there = same_markers(marker_set.labels, tuple(sites), marker_set)
    if len(here) < LEAST:
        raise ClipError(
            f"{file}: of marker set {marker_set.name} only {len(here)} markers can be placed on "
            "skeletons; take another set, such as baumann41 (--as 41)"
        )
    known = list(sites.values())
    wanted = {marker_set.labels[i]: known[j] for i, j in zip(here, there, strict=True)}
    skeleton = motion.skeleton
    scale = mm_per_unit or skeleton.mm_per_unit or _unit(Body(skeleton, file).leg)
    body = Body(skeleton, file, scale)
    if not CHILD < body.leg / LEG < GIANT:
        raise ClipError(
            f"{file}: the skeleton's legs are {body.leg:.4g} mm long from hip to ankle, if a "
            f"unit is {scale:.4g} mm; say the right unit (--unit)"
        )
    placed = forward(motion)
    hertz = rate or motion.rate or RATE
    positions = positions_of(wanted, body, placed, scale)
    positions = positions[_first_of_motion(positions, hertz) :]
    return Clip(
        positions,
        tuple(wanted),
        hertz,
        up=up or _axis(body.up),
        name=name,
        subject=subject,
    )


def _unit(leg: float) -> float:
    """Return the millimetres in the unit in which a leg's length is most like a person's."""
    return min(UNITS.values(), key=lambda mm: abs(np.log(leg * mm / LEG)))


def _axis(direction: NDArray[np.float64]) -> str:
    """Return the axis nearest to a direction."""
    shares = [(1.0 if axis[0] == "+" else -1.0) * direction["XYZ".index(axis[1])]
              for axis in UP_AXES]  # fmt: skip
    return UP_AXES[int(np.argmax(shares))]


def _first_of_motion(positions: NDArray[np.float64], rate: float) -> int:
    """Return 1 where the first frame is far from the second, else 0."""
    if len(positions) < 2:
        return 0
    step = np.linalg.norm(positions[1] - positions[0], axis=1).max()
    return int(step * rate > JUMP)
