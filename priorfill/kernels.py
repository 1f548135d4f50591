"""Compiled loops of the solver. Arrays in, arrays out: no options, no checks, no I/O.

A chain lies between `REACH` frames of zeros at either end, so that no loop has to ask where it
ends, and its three coordinates are beside each other. Frames that are not to be found have a
scale of 0.

The loops are compiled when something is first solved, while somebody waits for it. They are
given the room they work in, and compare without ``max``: to compile an allocation or a method of
an array takes as long as to compile a whole loop. They run on one thread: to share out the chains
of a gap among threads takes longer than to solve them, and four seconds more to compile.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["REACH", "descend_chains"]

Reals = NDArray[np.float64]
Places = NDArray[np.int64]

REACH = 2
"""Frames to either side that a frame's differences touch."""

HELPER: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
"""Of functions that only compiled ones call: without a way in from Python, and without a check of
each division, they compile faster."""


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
def _list_worthy(scale: Reals, gain: Reals, share: float, active: Places) -> int:
    """List the frames worth working on and those their derivatives touch; return how many."""
    most = 0.0
    for t in range(gain.size):
        if gain[t] > most:
            most = gain[t]
    count = 0
    listed = -1
    for t in range(gain.size):
        if gain[t] > 0.0 and gain[t] >= share * most:
            for s in range(t - REACH, t + REACH + 1):
                if s > listed:
                    listed = s
                    if scale[s] > 0.0:
                        active[count] = s
                        count += 1
    return count


@njit(**HELPER)
def _look(
    x: Reals,
    bands: Reals,
    scale: Reals,
    right: Reals,
    precision: float,
    active: Places,
    count: int,
    residual: Reals,
    gain: Reals,
) -> None:
    """Find residual and gain of the frames that a change of the active ones touches."""
    looked = -1
    for a in range(count):
        for t in range(active[a] - REACH, active[a] + REACH + 1):
            if t > looked:
                looked = t
                if scale[t] > 0.0:
                    square = 0.0
                    for i in range(3):
                        residual[t, i] = right[t, i] - _product_at(t, i, bands, x)
                        square += residual[t, i] * residual[t, i]
                    # near an energy of 0, no gain is small beside it: mind how far frames move too
                    moves = square * scale[t] * scale[t] > precision * precision
                    gain[t] = square * scale[t] if moves else 0.0


@njit(**HELPER)
def _descend_active(
    x: Reals,
    bands: Reals,
    scale: Reals,
    active: Places,
    count: int,
    steps: int,
    residual: Reals,
    direction: Reals,
    product: Reals,
) -> float:
    """Take conjugate gradient steps with exact step lengths on the active frames.

    ``residual`` is b - Ax, half the negative gradient; it is of no use afterwards. ``direction``
    is 0 on entry and on return. Returns the energy gained.
    """
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
                renewed += residual[t, i] * residual[t, i] * scale[t]
        ratio = renewed / norm
        norm = renewed
        for a in range(count):
            t = active[a]
            for i in range(3):
                direction[t, i] = residual[t, i] * scale[t] + ratio * direction[t, i]
        curvature = 0.0
        for a in range(count):
            t = active[a]
            for i in range(3):
                product[t, i] = _product_at(t, i, bands, direction)
                curvature += product[t, i] * direction[t, i]
        length = norm / curvature if curvature > 0.0 else 0.0
        gained += length * norm
        if length == 0.0:
            break
    for a in range(count):
        t = active[a]
        for i in range(3):
            x[t, i] += length * direction[t, i]
            direction[t, i] = 0.0
    return gained


@njit(cache=True, nogil=True, error_model="numpy")
def descend_chains(
    x: Reals,
    bands: Reals,
    scale: Reals,
    right: Reals,
    energies: Reals,
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
        Positions, changed in place where the scale is not 0; finite everywhere.
    bands : ndarray [shape=(markers, frames, 3)]
        A[t, t], A[t, t+1] and A[t, t+2].
    scale : ndarray [shape=(markers, frames)]
        1 / A[t, t] of the samples to be found, 0 of all others.
    right : ndarray [shape=(markers, frames, 3)]
        b.
    energies : ndarray [shape=(markers,), mm²]
        Energy of each chain at the start.
    tolerance : float
        A chain ends when a round over all its frames gains less than this part of its energy.
    precision : float
        mm; a frame that would move by less is left alone.
    share : float
        A frame is worked on when it promises at least this part of what the best frame does.
    steps : int
        Descent steps a round.
    rounds : int
        Bound on the rounds.
    gain : ndarray [shape=(markers, frames)]
        Room to work in, of zeros, as the others.
    active : ndarray of int [shape=(frames,)]
        Room for a list of frames.
    room : ndarray [shape=(3, frames, 3)]
        Room for residuals, directions and products.

    Returns
    -------
    int
        Frame updates made, over all chains.
    """
    updates = 0
    residual, direction, product = room[0], room[1], room[2]
    for m in range(x.shape[0]):
        energy = energies[m]
        count = _list_worthy(scale[m], scale[m], 0.0, active)  # all
        everything = False
        for _ in range(rounds):
            _look(x[m], bands[m], scale[m], right[m], precision, active, count, residual, gain[m])
            count = _list_worthy(scale[m], gain[m], 0.0 if everything else share, active)
            if count == 0:
                break
            gained = _descend_active(
                x[m], bands[m], scale[m], active, count, steps, residual, direction, product
            )
            updates += count * steps
            # A round over some frames that gains too little is followed by one over all; only
            # that one may end the level, so that no frame is given up unseen.
            enough = gained > tolerance * energy
            if everything and not enough:
                break
            everything = not enough
            energy -= gained
    return updates
