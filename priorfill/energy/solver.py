"""Minimise the energy: scheduled descent, and the exact minimum by a banded solve.

Both find the free samples of a window while all others are fixed. Differences across the edge of a
gap use the measured samples there, which joins the fill to the measured signal without a seam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.energy.targets import Prior
from priorfill.energy.terms import (
    BandedSystem,
    banded_system,
    energy,
    marker_energies,
)
from priorfill.errors import OptionError
from priorfill.runtime.lapack import solve_positive_banded

__all__ = ["DescentOptions", "Solution", "minimise", "solve_exactly"]


@dataclass(frozen=True)
class DescentOptions:
    """Options of the scheduled descent.

    Attributes
    ----------
    tolerance : float
        A level ends when the energy decreases by less than this fraction: 1 % in Baumann et al.
        2011, section 4.3. A round ends early when a step adds less than this fraction.
    min_move : float
        mm. A block is skipped if no frame would move farther to the block's own minimum.
    min_gain_ratio : float
        A block is worked on if its gain is at least this fraction of the largest one. In the middle
        of a long gap all gains are a hundredth of those at its edges, since the weights are.
    max_steps : int
        Descent steps per round.
    max_rounds : int
        Rounds per level; a safeguard, far above what real gaps need.
    block_frames : int
        Frames of a block, which are solved together. The stiffest prior spreads an offset over a
        tenth of a second. The default is ten times that at 240 Hz, so blocks interact only near
        their ends. 1: every frame on its own, as in the paper.

    Raises
    ------
    OptionError
        If a value is out of range.
    """

    tolerance: float = 0.01
    min_move: float = 1e-3
    min_gain_ratio: float = 0.01
    max_steps: int = 6
    max_rounds: int = 10_000
    block_frames: int = 256

    def __post_init__(self) -> None:
        if not 0 <= self.tolerance < 1:
            raise OptionError(f"tolerance is {self.tolerance:g}; give at least 0 and less than 1")
        if not self.min_move >= 0:
            raise OptionError(f"min_move is {self.min_move:g} mm; give 0 or more")
        if not 0 <= self.min_gain_ratio <= 1:
            raise OptionError(
                f"min_gain_ratio is {self.min_gain_ratio:g}; give a number from 0 to 1"
            )
        for name in ("max_steps", "max_rounds", "block_frames"):
            if getattr(self, name) < 1:
                raise OptionError(f"{name} is {getattr(self, name)}; give 1 or more")


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of a solver.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The positions; fixed samples are unchanged.
    energy : float
        mm². Their energy.
    updates : int
        Number of times the position of a frame was changed; 0 for the banded solve.
    """

    positions: NDArray[np.float64]
    energy: float
    updates: int


def _start(
    positions: NDArray[np.float64], free: NDArray[np.bool_], system: BandedSystem
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the chains [shape=(markers, 3, frames)], and which free samples have a term."""
    x = np.ascontiguousarray(positions.transpose(1, 2, 0))
    return np.nan_to_num(x), np.ascontiguousarray(free.T) & (system.diagonal > 0)


def _padded(count: int, *columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stack columns of a system, and pad them with frames of zeros.

    Parameters
    ----------
    count : int
        Frames of padding at either end.
    columns : ndarrays [shape=(markers, frames)]

    Returns
    -------
    ndarray [shape=(markers, count + frames + count, columns)]
    """
    markers, frames = columns[0].shape
    padded = np.zeros((markers, frames + 2 * count, len(columns)))
    for number, column in enumerate(columns):
        padded[:, count : count + frames, number] = column
    return padded


def _block_bands(
    system: BandedSystem, solvable: NDArray[np.bool_], block_frames: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return A[t, t], A[t, t-1], A[t, t-2]; 0 for fixed samples and across blocks."""
    number = np.arange(solvable.shape[1]) // block_frames

    def before(step: int, band: NDArray[np.float64]) -> NDArray[np.float64]:
        near = np.zeros_like(band)
        together = solvable[:, step:] & solvable[:, :-step] & (number[step:] == number[:-step])
        near[:, step:] = np.where(together, band[:, :-step], 0.0)
        return near

    diagonal = np.where(solvable, system.diagonal, 0.0)
    return diagonal, before(1, system.off1), before(2, system.off2)


def minimise(
    positions: NDArray[np.float64],
    free: NDArray[np.bool_],
    prior: Prior,
    options: DescentOptions | None = None,
) -> Solution:
    """Minimise the energy by scheduled descent.

    Each round works on the blocks of frames with the largest gains, where the gain of a block is
    the decrease of the energy at the block's own minimum. On these blocks it takes a few conjugate
    gradient steps of exact length, preconditioned by the blocks, so that stiff priors do not slow
    the descent down. Markers are independent of each other, and the iterates do not depend on the
    directions of the axes.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Starting point; samples that are not ``free`` are fixed. NaN only where no term with a
        weight involves the sample.
    free : ndarray of bool [shape=(frames, markers)]
        The samples to be found.
    prior : Prior
        Targets and weights over the same window.
    options : DescentOptions, optional
        Block size and stopping rules.

    Returns
    -------
    Solution
        Free samples without any term are unchanged.

    See Also
    --------
    solve_exactly : The minimum itself.
    priorfill.energy.multiresolution.solve_levels : Calls a solver at each level.

    Notes
    -----
    Baumann et al. 2011, section 4.3, descend along the gradient and schedule single frames.
    Conjugate directions, preconditioned by the blocks of A, reach the same minimum in fewer steps,
    and the same stopping rule ends closer to it: Saad, Iterative Methods for Sparse Linear Systems,
    2003, doi:10.1137/1.9780898718003, algorithm 9.1, with the blocks of section 4.1.1.
    """
    from priorfill.energy.descent_kernels import PADDING, descend_chains

    options = options or DescentOptions()
    system = banded_system(prior)
    x, solvable = _start(positions, free, system)
    x = _padded(PADDING, *x.swapaxes(0, 1))
    frames = x.shape[1]
    updates = descend_chains(
        x,
        _padded(PADDING, system.diagonal, system.off1, system.off2),
        _padded(PADDING, *_block_bands(system, solvable, options.block_frames)),
        _padded(PADDING, *system.rhs.swapaxes(0, 1)),
        marker_energies(positions, prior),
        options.block_frames,
        options.tolerance,
        options.min_move,
        options.min_gain_ratio,
        options.max_steps,
        options.max_rounds,
        np.zeros(-(-frames // options.block_frames)),
        np.zeros(frames, dtype=np.int64),
        np.zeros((4, frames, 3)),
    )
    solved = x[:, PADDING : frames - PADDING].swapaxes(0, 1)
    found = np.where(solvable.T[..., None], solved, positions)
    return Solution(found, energy(found, prior), int(updates))


def solve_exactly(
    positions: NDArray[np.float64], free: NDArray[np.bool_], prior: Prior
) -> Solution:
    """Minimise the energy exactly by banded Cholesky factorisation.

    Parameters and return value are those of `minimise`.
    """
    system = banded_system(prior)
    x, solvable = _start(positions, free, system)
    found = positions.copy()
    for m in range(x.shape[0]):
        unknown = solvable[m]
        if not unknown.any():
            continue
        fixed = np.where(unknown, 0.0, x[m])  # (3, frames)
        off1, off2 = system.off1[m], system.off2[m]
        # the terms of fixed samples move to the right-hand side
        rhs = system.rhs[m] - system.diagonal[m] * fixed
        rhs[:, 1:] -= off1[:-1] * fixed[:, :-1]
        rhs[:, :-1] -= off1[:-1] * fixed[:, 1:]
        rhs[:, 2:] -= off2[:-2] * fixed[:, :-2]
        rhs[:, :-2] -= off2[:-2] * fixed[:, 2:]
        # a fixed sample has a row of the identity
        bands = np.zeros((3, len(unknown)))
        bands[2] = np.where(unknown, system.diagonal[m], 1.0)
        bands[1, 1:] = np.where(unknown[:-1] & unknown[1:], off1[:-1], 0.0)
        bands[0, 2:] = np.where(unknown[:-2] & unknown[2:], off2[:-2], 0.0)
        solved = solve_positive_banded(bands, np.where(unknown, rhs, 0.0).T)
        found[unknown, m] = solved[unknown]
    return Solution(found, energy(found, prior), 0)
