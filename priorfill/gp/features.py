"""Features: how poses are aligned, which markers weigh how much, and time-lag features."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["ALIGNMENT_FLOOR", "Moment", "View"]

ALIGNMENT_FLOOR = 1e-3
"""Least weight of a visible marker in the alignment, so that few near ones cannot leave it
undetermined."""


@dataclass(frozen=True)
class View:
    """How poses are aligned and visible markers weighted.

    Attributes
    ----------
    frame : {"rigid", "heading"}
        Whether the whole rotation is taken out or only the heading.
    reach : float
        mm; weights fall with distance from the missing markers as exp(-D² / 2 reach²).
    floor : float
        Least weight of a feature.
    slack : float or None
        mm; markers whose distance to the missing ones varies by this much count half. None:
        whatever their distance does.
    """

    frame: Literal["rigid", "heading"]
    reach: float
    floor: float
    slack: float | None = None


@dataclass(frozen=True)
class Moment:
    """What of the movement around a pose is a feature beside the pose itself.

    Attributes
    ----------
    seconds : float
        How long before and after.
    weight : float
        How much it counts, beside 1 for the pose.
    velocity : bool
        Whether the way from before to after is the feature; else both positions are.
    """

    seconds: float
    weight: float
    velocity: bool = False
