"""Multi-resolution solution: from the coarsest level to the clip's own rate, Eq. (5) of [B11]_.

A long gap gets its shape at a low rate, where it spans few frames. Each finer level starts from the
interpolated solution of the coarser one and adds detail.

References
----------
.. [B11] Baumann, Krüger, Zinke and Weber, Data-driven completion of motion capture data,
   VRIPHYS 2011, section 4.3.
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

MIN_LEVEL_RATE = 12.0
"""Hz. Rate of the coarsest level at least: human movement has little above 6 Hz."""

MARGIN_FRAMES = 2
"""Frames of a level on either side of a gap group that differences across its edges involve."""

Solver = Callable[[NDArray[np.float64], NDArray[np.bool_], Prior], Solution]
"""Finds the free samples of a window: ``(positions, free, prior) -> solution``."""


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
        """Return a copy of some markers in frames ``first <= frame < last``."""


AnyLevel = TypeVar("AnyLevel", bound=Resolved)


def levels_for(rate: float) -> int:
    """Return the number of levels r_i = r_max / 2^i (Eq. (5)) not below `MIN_LEVEL_RATE`.

    Examples
    --------
    >>> levels_for(120.0)  # 120, 60, 30 and 15 Hz
    4
    """
    return 1 + max(0, int(np.floor(np.log2(rate / MIN_LEVEL_RATE))))


def _within_known(prior: Prior, known: NDArray[np.bool_]) -> Prior:
    """Return the prior without the terms that involve samples (frames, markers) left unknown."""
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
    """Interpolate a coarser solution linearly at the frames of a finer level.

    Parameters
    ----------
    coarse : ndarray [shape=(coarse frames, markers, 3), mm]
        NaN where unknown.
    coarse_frames, frames : ndarray of int
        Frame numbers, in frames of the clip.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        NaN for markers without a known sample at the coarser level.
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
    """Find the missing samples of a gap group, from the coarsest level to the finest.

    Parameters
    ----------
    levels : sequence of Level or Resolution
        The clip's levels, finest first; NaN where missing.
    group : GapGroup
        The gap group.
    prior_at : callable
        Called with a level and frame numbers of that level; returns the prior of these frames for
        the group's markers. Samples without a pose weight cannot be found.
    solver : Solver
        Minimises the energy at each level.

    Returns
    -------
    ndarray [shape=(group's frames, group's markers, 3), mm]
        Measured samples unchanged; NaN where the prior has no pose weight.

    See Also
    --------
    priorfill.energy.solver.minimise, priorfill.energy.solver.solve_exactly : Solvers.
    """
    markers = list(group.markers)
    solution: NDArray[np.float64] | None = None
    solved_frames = np.empty(0, dtype=np.intp)
    window = np.empty(0, dtype=np.intp)
    for level in reversed(levels):
        first = max(group.start // level.step - MARGIN_FRAMES, 0)
        last = min(-(-group.stop // level.step) + MARGIN_FRAMES, level.frames)
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
