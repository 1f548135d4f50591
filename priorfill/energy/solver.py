"""Minimise the energy: scheduled gradient descent, and the exact minimum by a banded solve.

Both find the free samples of a window while all others stay as they are; differences that
reach over a gap's edge use the measured neighbours there, which is what joins the fill to the
measured signal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from priorfill.energy.targets import Prior
from priorfill.energy.terms import (
    BandedSystem,
    banded_system,
    energy,
    marker_energies,
)
from priorfill.errors import OptionError

__all__ = ["Descent", "Solution", "minimise", "solve_exactly"]


@dataclass(frozen=True)
class Descent:
    """Options of the scheduled gradient descent.

    Attributes
    ----------
    tolerance : float
        A level ends when the energy improves by less than this part: 1 % in Baumann et al.
        2011, section 4.3. A schedule ends early when a step adds less than this part.
    precision : float
        mm; a block that would move none of its frames by more is not worked on.
    share : float
        A block is worked on when it promises at least this part of what the best one does. In the
        middle of a long gap all promises are a hundredth of those at its edges, as weights are.
    steps : int
        Descent steps on a set of blocks at most, before the schedule is made anew.
    rounds : int
        Bound on the schedules of a level; a guard, far above what real gaps need.
    block : int
        Frames that are moved together, towards their minimum while all others stay. The stiffest
        prior spreads an offset over a tenth of a second; blocks of ten times that, as the default
        is at 240 Hz, feel each other at their seams only. 1: each frame by itself.
    """

    tolerance: float = 0.01
    precision: float = 1e-3
    share: float = 0.01
    steps: int = 6
    rounds: int = 10_000
    block: int = 256

    def __post_init__(self) -> None:
        if not 0 <= self.tolerance < 1:
            raise OptionError(f"tolerance is {self.tolerance:g}; give a number from 0 to 1")
        if not self.precision >= 0:
            raise OptionError(f"precision is {self.precision:g} mm; give 0 or more")
        if not 0 <= self.share <= 1:
            raise OptionError(f"share is {self.share:g}; give a number from 0 to 1")
        if self.steps < 1 or self.rounds < 1 or self.block < 1:
            raise OptionError("steps, rounds and block must be 1 or more")


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solver came to.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The positions, fixed samples as they were.
    energy : float
        Their energy, mm².
    updates : int
        Frame updates it took (coordinates of a frame changed once); 0 for the banded solve.
    """

    positions: NDArray[np.float64]
    energy: float
    updates: int


def _start(
    positions: NDArray[np.float64], free: NDArray[np.bool_], chains: BandedSystem
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return chains x [shape=(markers, 3, frames)] and what is free and reached by a term."""
    x = np.ascontiguousarray(positions.transpose(1, 2, 0))
    return np.nan_to_num(x), np.ascontiguousarray(free.T) & (chains.diagonal > 0)


def _between_zeros(count: int, *columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Put columns of chains beside each other, and frames of zeros at either end.

    Parameters
    ----------
    count : int
        Frames of zeros.
    columns : ndarrays [shape=(markers, frames)]

    Returns
    -------
    ndarray [shape=(markers, count + frames + count, columns)]
    """
    markers, frames = columns[0].shape
    laid = np.zeros((markers, frames + 2 * count, len(columns)))
    for number, column in enumerate(columns):
        laid[:, count : count + frames, number] = column
    return laid


def _within_blocks(
    chains: BandedSystem, reached: NDArray[np.bool_], block: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return A[t, t], A[t, t-1], A[t, t-2], 0 for what is fixed or in different blocks."""
    number = np.arange(reached.shape[1]) // block

    def before(step: int, band: NDArray[np.float64]) -> NDArray[np.float64]:
        near = np.zeros_like(band)
        together = reached[:, step:] & reached[:, :-step] & (number[step:] == number[:-step])
        near[:, step:] = np.where(together, band[:, :-step], 0.0)
        return near

    diagonal = np.where(reached, chains.diagonal, 0.0)
    return diagonal, before(1, chains.first), before(2, chains.second)


def minimise(
    positions: NDArray[np.float64],
    free: NDArray[np.bool_],
    prior: Prior,
    options: Descent | None = None,
) -> Solution:
    """Minimise the energy by scheduled gradient descent.

    A round works on the blocks of frames that promise the greatest decrease of the energy; on
    them it takes a few descent steps of exact length, in conjugate directions. A block promises
    g² / A, A being its own matrix, and the direction of its steps is that to its own minimum, so
    that what is stiff does not slow the descent down. Markers are independent of each other, and
    the path down does not depend on the directions of the axes.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Where to start; fixed where not ``free``. NaN only where no term reaches.
    free : ndarray of bool [shape=(frames, markers)]
        The samples to be found.
    prior : Prior
        Targets and weights over the same window.
    options : Descent, optional
        When to stop and what to work on.

    Returns
    -------
    Solution
        Free samples that no term reaches stay as they were.

    Notes
    -----
    Baumann et al. 2011, section 4.3, descend along the gradient, and schedule single frames.
    Conjugate directions, preconditioned by the blocks of A, reach the same minimum in fewer
    steps, and by the same rule end nearer to it: Saad, Iterative Methods for Sparse Linear
    Systems, 2003, doi:10.1137/1.9780898718003, algorithm 9.1, with the blocks of section 4.1.1.
    """
    # numba takes half a second to import, which only a fill should pay
    from priorfill.energy.descent_kernels import REACH, descend_chains

    options = options or Descent()
    chains = banded_system(prior)
    x, reached = _start(positions, free, chains)
    x = _between_zeros(REACH, *x.swapaxes(0, 1))
    frames = x.shape[1]
    updates = descend_chains(
        x,
        _between_zeros(REACH, chains.diagonal, chains.first, chains.second),
        _between_zeros(REACH, *_within_blocks(chains, reached, options.block)),
        _between_zeros(REACH, *chains.right.swapaxes(0, 1)),
        marker_energies(positions, prior),
        options.block,
        options.tolerance,
        options.precision,
        options.share,
        options.steps,
        options.rounds,
        np.zeros(-(-frames // options.block)),
        np.zeros(frames, dtype=np.int64),
        np.zeros((4, frames, 3)),
    )
    moved = x[:, REACH : frames - REACH].swapaxes(0, 1)
    found = np.where(reached.T[..., None], moved, positions)
    return Solution(found, energy(found, prior), int(updates))


def solve_exactly(
    positions: NDArray[np.float64], free: NDArray[np.bool_], prior: Prior
) -> Solution:
    """Minimise the energy exactly by banded Cholesky factorisation.

    Parameters and return value are those of `minimise`.
    """
    chains = banded_system(prior)
    x, reached = _start(positions, free, chains)
    found = positions.copy()
    for m in range(x.shape[0]):
        loose = reached[m]
        if not loose.any():
            continue
        fixed = np.where(loose, 0.0, x[m])  # (3, frames)
        first, second = chains.first[m], chains.second[m]
        # what the fixed samples pull with goes to the right-hand side
        right = chains.right[m] - chains.diagonal[m] * fixed
        right[:, 1:] -= first[:-1] * fixed[:, :-1]
        right[:, :-1] -= first[:-1] * fixed[:, 1:]
        right[:, 2:] -= second[:-2] * fixed[:, :-2]
        right[:, :-2] -= second[:-2] * fixed[:, 2:]
        # a fixed sample keeps a row of the identity
        bands = np.zeros((3, len(loose)))
        bands[2] = np.where(loose, chains.diagonal[m], 1.0)
        bands[1, 1:] = np.where(loose[:-1] & loose[1:], first[:-1], 0.0)
        bands[0, 2:] = np.where(loose[:-2] & loose[2:], second[:-2], 0.0)
        solved = solveh_banded(bands, np.where(loose, right, 0.0).T)
        found[loose, m] = solved[loose]
    return Solution(found, energy(found, prior), 0)
