"""Where a marker's path breaks: steps that its partners do not make.

Between two frames the path that is led on from before, half a frame, should meet the path that is
led back from after. By how far they miss is the step,

    s(t) = v(t) - (v(t-1) + v(t+1)) / 2,    v(t) = x(t+1) - x(t),

a third difference: of a body's own motion it holds hardly anything, of a jump all. What a marker's
partners do at the same time, as in the hit of a foot, is no step of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.reference_markers import ReferenceMarkers

__all__ = ["Steps", "against_partners", "find_breaks", "steps"]

LEAST = 10.0
"""mm. Smaller steps are no trouble but noise, or soft tissue: half a marker's width. In a minute
and a half of real HDM05 takes at 120 Hz no step against the partners is above 2 mm."""

ACCELERATION = 60e3
"""mm/s². What one frame of it makes of a path is no step: in 50 Hz 24 mm, in 120 Hz 4 mm. Markers
of a segment are accelerated against each other by less, but for hits."""

NOISE = 8.0
"""Times the step that nine in ten of the marker's own stay below: where a clip shakes, or was
measured badly as a whole, more is needed."""

USUAL = 0.9
"""The quantile of a marker's own steps that its noise is told by."""

SAMPLES = 500
"""Frames, spread evenly, by which the noise is told."""

AT_ONCE = 4000
"""Frames whose steps are taken at once: a long clip's take several times its memory."""

EDGE = 3.0
"""Times as much is needed beside a gap, where only one side's speed is known."""

ECHO = 1.5
"""A step is echoed in the frames beside it by half of it: one that is so many times smaller than
its neighbour is an echo."""


@dataclass(frozen=True)
class Steps:
    """The steps of a clip that are breaks.

    Attributes
    ----------
    broken : ndarray of bool [shape=(frames - 1, markers)]
        Whether a path breaks between a frame and the next.
    size : ndarray [shape=(frames - 1, markers), mm]
        How large the step is against the partners', where it is broken; 0 elsewhere.
    """

    broken: NDArray[np.bool_]
    size: NDArray[np.float64]


def steps(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how far the path before and the path after miss each other.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.

    Returns
    -------
    ndarray [shape=(frames - 1, markers, 3), mm]
        Between each frame and the next. Where the frame before or after these is missing, the path
        is led on from the other side only; NaN where both are, or one of the two themselves.
    """
    step = np.full((len(positions) - 1, *positions.shape[1:]), np.nan)
    if len(step) < 2:
        return step
    for start in range(0, len(step), AT_ONCE):
        stop = min(start + AT_ONCE, len(step))
        # a step depends on the speeds beside its own
        first, last = max(start - 1, 0), min(stop + 1, len(step))
        some = _steps(positions[first : last + 1])
        step[start:stop] = some[start - first : stop - first]
    return step


def _steps(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Do the same for three frames or more, all at once."""
    speed = positions[1:] - positions[:-1]
    step = speed.copy()
    step[1:-1] -= 0.5 * (speed[:-2] + speed[2:])
    step[0] -= speed[1]
    step[-1] -= speed[-2]
    lost = np.isnan(step[..., 0]) & ~np.isnan(speed[..., 0])
    frame, marker = np.nonzero(lost)
    beyond = np.full((1, *speed.shape[1:]), np.nan)
    around = np.concatenate([beyond, speed, beyond])
    before, after = around[frame, marker], around[frame + 2, marker]
    step[frame, marker] = speed[frame, marker] - np.where(np.isnan(before), after, before)
    return step


def against_partners(
    step: NDArray[np.float64],
    partners: ReferenceMarkers,
    frame: NDArray[np.intp],
    marker: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Return how large some steps are against the partners'.

    Parameters
    ----------
    step : ndarray [shape=(frames - 1, markers, 3), mm]
        As from `steps`.
    partners : Partners
        Who judges whom.
    frame, marker : ndarray of int [shape=(steps,)]
        Which steps.

    Returns
    -------
    ndarray [shape=(steps,), mm]
        Against that partner, or none, against which it is least; NaN where there is no step.
    """
    own = step[frame, marker]
    least: NDArray[np.float64] = np.sqrt((own**2).sum(axis=1))
    other = step[frame[:, None], partners.others[marker]]
    against = np.sqrt(((own[:, None] - other) ** 2).sum(axis=2))
    against[~partners.known[marker]] = np.nan
    for column in range(against.shape[1]):
        least = np.fmin(least, against[:, column])
    return least


def find_breaks(positions: NDArray[np.float64], partners: ReferenceMarkers, rate: float) -> Steps:
    """Return where paths break.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    partners : Partners
        Who judges whom.
    rate : float
        Hz.
    """
    step = steps(positions)
    shape = step.shape[:2]
    size = np.zeros(shape)
    if shape[0] == 0:
        return Steps(size > 0, size)
    least = np.maximum(max(LEAST, ACCELERATION / rate**2), NOISE * _usual(step, partners))
    # a step against the partners is never larger than without them: most frames are done with here
    square = np.einsum("fmc,fmc->fm", step, step)
    with np.errstate(invalid="ignore"):
        frame, marker = np.nonzero(square > least**2)
    last = shape[0] - 1
    earlier, later = np.maximum(frame - 1, 0), np.minimum(frame + 1, last)
    here, before, after = (
        np.nan_to_num(against_partners(step, partners, at, marker))
        for at in (frame, earlier, later)
    )
    edge = (frame == 0) | (frame == last)
    gone = np.isnan(positions[:, :, 0])
    edge |= gone[earlier, marker] | gone[np.minimum(frame + 2, last + 1), marker]
    stays = here > least[marker] * np.where(edge, EDGE, 1.0)
    stays &= np.maximum(before, after) <= ECHO * here
    size[frame[stays], marker[stays]] = here[stays]
    return Steps(size > 0, size)


def _usual(step: NDArray[np.float64], partners: ReferenceMarkers) -> NDArray[np.float64]:
    """Return the step that most of each marker's stay below [shape=(markers,), mm]."""
    frames, markers = step.shape[:2]
    some = np.linspace(0, frames - 1, min(frames, SAMPLES)).astype(np.intp)
    frame, marker = np.repeat(some, markers), np.tile(np.arange(markers), len(some))
    size = np.sort(
        against_partners(step, partners, frame, marker).reshape(len(some), markers), axis=0
    )
    count = (~np.isnan(size)).sum(axis=0)
    at = (USUAL * np.maximum(count - 1, 0)).astype(np.intp)
    return np.where(count > 0, size[at, np.arange(markers)], 0.0)
