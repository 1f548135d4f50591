"""Multi-resolution synthesis: solve coarse, refine, solve again, down to the clip's own rate.

Baumann et al. 2011, section 4.3: long gaps get their shape at a low rate, where a few frames
span them; each finer level starts from the coarser one's solution and adds detail.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from priorfill.energy.solver import Solution
from priorfill.energy.targets import Prior
from priorfill.gaps import GapGroup

__all__ = ["Solver", "levels_for", "solve_levels"]

LOWEST_RATE = 12.0
"""Hz. Coarsest level worth solving at: human movement has little above 6 Hz."""

MARGIN = 2
"""Level frames around a gap group that its differences reach."""

Solver = Callable[[NDArray[np.float64], NDArray[np.bool_], Prior], Solution]
"""Finds the free samples of a window: (positions, free, prior) -> solution."""


class Resolved(Protocol):
    """One resolution of a recording: `priorfill.signal.resample.Level` or `Resolution`."""

    @property
    def rate(self) -> float:
        """Frames per second (Hz)."""

    @property
    def step(self) -> int:
        """Frames of the finest resolution per frame of this one."""

    @property
    def frames(self) -> int:
        """Number of frames."""

    def window(self, first: int, last: int, markers: Sequence[int]) -> NDArray[np.float64]:
        """Return some markers in frames ``first <= frame < last``, for the caller to keep."""


AnyLevel = TypeVar("AnyLevel", bound=Resolved)


def levels_for(rate: float) -> int:
    """How many levels r_max / 2^i a clip has that are not below `LOWEST_RATE`."""
    return 1 + max(0, int(np.floor(np.log2(rate / LOWEST_RATE))))


def _within_known(prior: Prior, known: NDArray[np.bool_]) -> Prior:
    """Take the weight from terms that touch samples [frames, markers] which stay unknown."""
    both = np.zeros_like(known)
    both[1:-1] = known[:-2] & known[2:]
    return replace(
        prior,
        pose_weight=np.where(known, prior.pose_weight, 0.0),
        velocity_weight=np.where(both, prior.velocity_weight, 0.0),
        acceleration_weight=np.where(both & known, prior.acceleration_weight, 0.0),
    )


def _refine(
    coarse: NDArray[np.float64], coarse_frames: NDArray[np.intp], frames: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Bring a coarser solution to a finer level's frames by linear interpolation.

    Parameters
    ----------
    coarse : ndarray [shape=(coarse frames, markers, 3), mm]
        NaN where unknown.
    coarse_frames, frames : ndarray of int
        Frame numbers, in frames of the clip.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        NaN where the coarse level knows nothing of the marker.
    """
    fine = np.full((len(frames), *coarse.shape[1:]), np.nan)
    for marker in range(coarse.shape[1]):
        known = ~np.isnan(coarse[:, marker, 0])
        if known.any():
            for i in range(3):
                fine[:, marker, i] = np.interp(
                    frames, coarse_frames[known], coarse[known, marker, i]
                )
    return fine


def solve_levels(
    levels: Sequence[AnyLevel],
    group: GapGroup,
    prior_at: Callable[[AnyLevel, NDArray[np.intp]], Prior],
    solver: Solver,
) -> NDArray[np.float64]:
    """Synthesise the missing markers of a gap group, coarse to fine.

    Parameters
    ----------
    levels : sequence of Level or Resolution
        The clip's resolutions, finest first; NaN where missing.
    group : GapGroup
        What to fill.
    prior_at : callable
        Called with a level and frame numbers of that level; gives the prior of these frames
        for the group's markers. Samples without a pose weight cannot be filled.
    solver : Solver
        Minimises the energy on each level.

    Returns
    -------
    ndarray [shape=(group's frames, group's markers, 3), mm]
        Measured samples as they are; NaN where the prior says nothing.
    """
    markers = list(group.markers)
    solution: NDArray[np.float64] | None = None
    solved_frames = np.empty(0, dtype=np.intp)
    window = np.empty(0, dtype=np.intp)
    for level in reversed(levels):
        first = max(group.start // level.step - MARGIN, 0)
        last = min(-(-group.stop // level.step) + MARGIN, level.frames)
        window = np.arange(first, last)
        positions = level.window(first, last, markers)
        missing = np.isnan(positions[..., 0])
        if not missing.any():
            continue
        prior = prior_at(level, window)
        free = missing & (prior.pose_weight > 0)
        frames = window * level.step
        start = prior.pose
        if solution is not None:
            refined = _refine(solution, solved_frames, frames)
            start = np.where(np.isnan(refined), start, refined)
        positions = np.where(free[..., None], start, positions)
        prior = _within_known(prior, ~missing | free)
        solution = solver(positions, free, prior).positions
        solved_frames = frames
    assert solution is not None, "a gap group has a gap at the finest level"
    inside = (window >= group.start) & (window < group.stop)
    return solution[inside]
