"""Compiled loops of the solver. Arrays in, arrays out: no options, no checks, no I/O.

A chain lies between `REACH` frames of zeros at either end, so that no loop has to ask where it
ends, and its three coordinates are beside each other. It is cut into *blocks* of so many frames.
The matrix of a block, the fixed frames left out, is factored as L D Lᵀ, so that what a block
would move by to its own minimum costs two loops over it. A fixed frame has 0 for 1 / D.

The loops are compiled when something is first solved, while somebody waits for it. They are
given the room they work in, and compare without ``max``: to compile an allocation or a method of
an array takes as long as to compile a whole loop. They run on one thread: to share out the chains
of a gap among threads takes longer than to solve them, and three seconds more to compile.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from priorfill.runtime.numba_options import ENTRY, HELPER

__all__ = ["REACH", "descend_chains"]

Reals = NDArray[np.float64]
Places = NDArray[np.int64]

REACH = 2
"""Frames to either side that a frame's differences touch."""

NOTHING = 1e-12
"""Part of a number below which a difference from it is rounding."""


@njit(**HELPER)
def _product_at(t: int, i: int, bands: Reals, x: Reals) -> float:
    """Return (A x)[t] of a coordinate."""
    total: float = (
        bands[t, 0] * x[t, i]
        + bands[t - 1, 1] * x[t - 1, i]
        + bands[t - 2, 2] * x[t - 2, i]
        + bands[t, 1] * x[t + 1, i]
        + bands[t, 2] * x[t + 2, i]
    )
    return total


@njit(**HELPER)
def _factor(factor: Reals) -> None:
    """Factor a chain's blocks in place; the form is that of `descend_chains`."""
    for t in range(REACH, factor.shape[0] - REACH):
        whole = factor[t, 0]
        if whole > 0.0:
            far = factor[t, 2]
            near = factor[t, 1] - far * factor[t - 1, 1]
            factor[t, 1] = near * factor[t - 1, 0]
            factor[t, 2] = far * factor[t - 2, 0]
            pivot = whole - near * factor[t, 1] - far * factor[t, 2]
            if pivot < NOTHING * whole:
                # what is left is rounding: go by the frame alone, which is still downhill
                factor[t, 1] = factor[t, 2] = 0.0
                pivot = whole
            factor[t, 0] = 1.0 / pivot


@njit(**HELPER)
def _look(
    x: Reals,
    bands: Reals,
    factor: Reals,
    right: Reals,
    block: int,
    precision: float,
    residual: Reals,
    move: Reals,
    gain: Reals,
) -> None:
    """Find all residuals, b - Ax, and what each block would gain at its own minimum.

    Nothing, where it would move none of its frames by more than ``precision`` to get there.
    """
    for b in range(gain.size):
        gain[b] = 0.0
    for t in range(REACH, x.shape[0] - REACH):
        if factor[t, 0] > 0.0:
            for i in range(3):
                residual[t, i] = right[t, i] - _product_at(t, i, bands, x)
                move[t, i] = (
                    residual[t, i] - factor[t, 1] * move[t - 1, i] - factor[t, 2] * move[t - 2, i]
                )
                gain[(t - REACH) // block] += move[t, i] * move[t, i] * factor[t, 0]
    # near an energy of 0, no gain is small beside it: mind how far frames move too. One by one
    # stiff frames hardly move, together they may
    far = False
    for t in range(x.shape[0] - REACH - 1, REACH - 1, -1):
        if factor[t, 0] > 0.0:
            square = 0.0
            for i in range(3):
                move[t, i] = (
                    factor[t, 0] * move[t, i]
                    - factor[t + 1, 1] * move[t + 1, i]
                    - factor[t + 2, 2] * move[t + 2, i]
                )
                square += move[t, i] * move[t, i]
            if square > precision * precision:
                far = True
        if (t - REACH) % block == 0:
            if not far:
                gain[(t - REACH) // block] = 0.0
            far = False


@njit(**HELPER)
def _list_worthy(factor: Reals, block: int, gain: Reals, share: float, active: Places) -> int:
    """List the frames to be found of the blocks worth working on; return how many."""
    most = 0.0
    for b in range(gain.size):
        if gain[b] > most:
            most = gain[b]
    count = 0
    for t in range(REACH, factor.shape[0] - REACH):
        promised = gain[(t - REACH) // block]
        if factor[t, 0] > 0.0 and promised > 0.0 and promised >= share * most:
            active[count] = t
            count += 1
    return count


@njit(**HELPER)
def _descend_active(
    x: Reals,
    bands: Reals,
    factor: Reals,
    active: Places,
    count: int,
    tolerance: float,
    steps: int,
    residual: Reals,
    direction: Reals,
    product: Reals,
    move: Reals,
) -> tuple[float, int]:
    """Take conjugate gradient steps with exact step lengths on the active frames.

    Preconditioned by the blocks. ``residual`` is b - Ax, half the negative gradient; it is of no
    use afterwards. ``direction`` is 0 on entry and on return. Returns the energy gained and the
    frame updates.
    """
    updates = 0
    gained = 0.0
    length = 0.0
    norm = np.inf
    for _ in range(steps):
        # the last step, of which there is none at first
        renewed = 0.0
        for a in range(count):
            t = active[a]
            for i in range(3):
                x[t, i] += length * direction[t, i]
                residual[t, i] -= length * product[t, i]
                move[t, i] = (
                    residual[t, i] - factor[t, 1] * move[t - 1, i] - factor[t, 2] * move[t - 2, i]
                )
                renewed += move[t, i] * move[t, i] * factor[t, 0]
        ratio = renewed / norm
        norm = renewed
        for a in range(count - 1, -1, -1):
            t = active[a]
            for i in range(3):
                move[t, i] = (
                    factor[t, 0] * move[t, i]
                    - factor[t + 1, 1] * move[t + 1, i]
                    - factor[t + 2, 2] * move[t + 2, i]
                )
                direction[t, i] = move[t, i] + ratio * direction[t, i]
        curvature = 0.0
        for a in range(count):
            t = active[a]
            for i in range(3):
                product[t, i] = _product_at(t, i, bands, direction)
                curvature += product[t, i] * direction[t, i]
        length = norm / curvature if curvature > 0.0 else 0.0
        gained += length * norm
        updates += count
        if length * norm <= tolerance * gained:
            break
    for a in range(count):
        t = active[a]
        for i in range(3):
            x[t, i] += length * direction[t, i]
            direction[t, i] = 0.0
    return gained, updates


@njit(**ENTRY)
def descend_chains(
    x: Reals,
    bands: Reals,
    factor: Reals,
    right: Reals,
    energies: Reals,
    block: int,
    tolerance: float,
    precision: float,
    share: float,
    steps: int,
    rounds: int,
    gain: Reals,
    active: Places,
    room: Reals,
) -> int:
    """Descend on every marker's chain.

    The schedule and the steps see lengths of vectors only, never single coordinates: where it
    ends does not depend on the directions of the axes.

    Parameters
    ----------
    x : ndarray [shape=(markers, frames, 3), mm]
        Positions, changed in place where they are to be found; finite everywhere.
    bands : ndarray [shape=(markers, frames, 3)]
        A[t, t], A[t, t+1] and A[t, t+2].
    factor : ndarray [shape=(markers, frames, 3)]
        A[t, t], A[t, t-1] and A[t, t-2], with 0 where a frame is not to be found or the two are
        in different blocks. Replaced by 1 / D[t], L[t, t-1] and L[t, t-2].
    right : ndarray [shape=(markers, frames, 3)]
        b.
    energies : ndarray [shape=(markers,), mm²]
        Energy of each chain at the start.
    block : int
        Frames of a block; the first begins at the first frame that is no zero.
    tolerance : float
        A chain ends when a round over all its frames gains less than this part of its energy, a
        round when a step gains less than this part of what the round did.
    precision : float
        mm; a block that would move none of its frames by more is not worked on.
    share : float
        A block is worked on when it promises at least this part of what the best block does.
    steps : int
        Descent steps a round at most.
    rounds : int
        Bound on the rounds.
    gain : ndarray [shape=(blocks,)]
        Room to work in, of zeros, as the others.
    active : ndarray of int [shape=(frames,)]
        Room for a list of frames.
    room : ndarray [shape=(4, frames, 3)]
        Room for residuals, directions, products and moves.

    Returns
    -------
    int
        Frame updates made, over all chains.
    """
    updates = 0
    residual, direction, product, move = room[0], room[1], room[2], room[3]
    for m in range(x.shape[0]):
        energy = energies[m]
        _factor(factor[m])
        everything = False
        for _ in range(rounds):
            _look(x[m], bands[m], factor[m], right[m], block, precision, residual, move, gain)
            count = _list_worthy(factor[m], block, gain, 0.0 if everything else share, active)
            if count == 0:
                break
            gained, updated = _descend_active(
                x[m],
                bands[m],
                factor[m],
                active,
                count,
                tolerance,
                steps,
                residual,
                direction,
                product,
                move,
            )
            updates += updated
            # A round over some blocks that gains too little is followed by one over all; only
            # that one may end the level, so that no frame is given up unseen.
            enough = gained > tolerance * energy
            if everything and not enough:
                break
            everything = not enough
            energy -= gained
    return updates
