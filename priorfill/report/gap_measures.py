"""What a fill looks like next to the measured motion: the figures that warnings are made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms
from priorfill.geometry.step_lengths import step_lengths
from priorfill.report.clip_motion import ClipMotion

__all__ = ["GapMeasures", "LengthError", "measure_gap"]


@dataclass(frozen=True)
class LengthError:
    """The distance between two markers of one segment where it deviates most.

    Attributes
    ----------
    marker : int
        The other marker.
    frame : int
        The frame.
    length : float
        mm. The distance.
    usual, low, high : float
        mm. The mean of the measured distances, the smallest, and the greatest.
    beyond : float
        mm. How far it is outside the range of the measured ones.
    """

    marker: int
    frame: int
    length: float
    usual: float
    low: float
    high: float
    beyond: float


@dataclass(frozen=True)
class GapMeasures:
    """A filled gap next to the measured motion of the clip.

    Attributes
    ----------
    jump, usual_jump : float
        mm. Greatest change of the step across an edge of the fill, and what is usual: the greatest
        measured one of the marker and of its contralateral marker, or of neighbours at that time.
    jump_frame : int
        The edge: the first filled frame, or the first after the fill.
    speed, usual_speed : float
        m/s. Likewise for the speed within the fill.
    below_floor : float
        mm. Greatest depth below the floor; 0 where there is none.
    length : LengthError or None
        The worst length; None where no pair is known to be rigid.
    beyond_measured : int
        Filled frames before the first or after the last measured sample of the marker.
    nearest, nearest_marker : float, int
        mm. Mean distance from the nearest other marker in the gap, and which.
    """

    jump: float = 0.0
    usual_jump: float = math.inf
    jump_frame: int = -1
    speed: float = 0.0
    usual_speed: float = math.inf
    below_floor: float = 0.0
    length: LengthError | None = None
    beyond_measured: int = 0
    nearest: float = math.inf
    nearest_marker: int = -1


def measure_gap(motion: ClipMotion, marker: int, start: int, stop: int) -> GapMeasures:
    """Return the figures of one gap.

    Parameters
    ----------
    motion : ClipMotion
        Of the subject.
    marker : int
        The marker.
    start, stop : int
        Frames ``start <= frame < stop`` of the gap.
    """
    filled = motion.filled[start:stop, marker]
    frames = start + np.flatnonzero(filled)
    if len(frames) == 0:
        return GapMeasures()
    jump, usual_jump, jump_frame = _jump(motion, marker, frames)
    speed = _per_second(motion, motion.steps(marker, frames[0], frames[-1] + 1, 1))
    usual = max(motion.greatest(marker, 1), motion.around(marker, frames[0], frames[-1] + 1, 1))
    known = np.flatnonzero(motion.measured[:, marker])
    outside = len(frames)
    if len(known):
        outside = int(((frames < known[0]) | (frames > known[-1])).sum())
    nearest, nearest_marker = motion.nearest_distance(marker, int(frames[0]), int(frames[-1]) + 1)
    return GapMeasures(
        jump,
        usual_jump,
        jump_frame,
        speed,
        _per_second(motion, np.array([usual])),
        max(float(motion.floor[marker] - motion.positions[frames, marker, 2].min()), 0.0),
        _worst_length(motion, marker, frames),
        outside,
        nearest,
        nearest_marker,
    )


def _per_second(motion: ClipMotion, steps: NDArray[np.float64]) -> float:
    """Return the greatest of some steps as a speed (m/s)."""
    greatest = float(steps.max(initial=0.0))
    return greatest * motion.rate / motion.step / 1000.0


def _jump(motion: ClipMotion, marker: int, frames: NDArray[np.intp]) -> tuple[float, float, int]:
    """Return the greatest change of the step across an edge, the usual one, and the edge."""
    step, last = motion.step, len(motion.positions) - 1
    state = motion.filled[:, marker]
    edges = [
        edge
        for edge in range(int(frames[0]), int(frames[-1]) + 2)
        if 0 < edge <= last and state[edge - 1] != state[edge]
    ]
    worst = (0.0, math.inf, -1)
    own = motion.greatest(marker, 2)
    for edge in edges:
        # changes of the step whose three samples are on both sides of the edge
        first = max(edge - 2 * step, 0)
        change = step_lengths(motion.positions[first : edge + 2 * step, marker], step, 2)
        change = change[~np.isnan(change)]
        if len(change) and float(change.max()) > worst[0]:
            usual = max(own, motion.around(marker, edge - 1, edge + 1, 2))
            worst = (float(change.max()), usual, edge)
    return worst


def _worst_length(motion: ClipMotion, marker: int, frames: NDArray[np.intp]) -> LengthError | None:
    """Return the distance within the segment that deviates most from the measured ones."""
    worst: LengthError | None = None
    for partner in motion.partners(marker):
        length = norms(motion.positions[frames, marker] - motion.positions[frames, partner.marker])
        beyond = np.maximum(length - partner.high, partner.low - length)
        if np.isnan(beyond).all():
            continue
        place = int(np.nanargmax(beyond))
        if worst is None or beyond[place] > worst.beyond:
            worst = LengthError(
                partner.marker,
                int(frames[place]),
                float(length[place]),
                partner.mean,
                partner.low,
                partner.high,
                max(float(beyond[place]), 0.0),
            )
    return worst
