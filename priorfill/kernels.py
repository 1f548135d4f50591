"""Compiled loops of the solver. Arrays in, arrays out: no options, no checks, no I/O."""

from __future__ import annotations

import numba
import numpy as np
from numba import njit, prange, set_num_threads
from numpy.typing import NDArray

__all__ = ["descend_chains", "limit_threads"]

REACH = 2
"""Frames to either side that a frame's differences touch."""


def limit_threads(count: int) -> None:
    """Let the loops that are called from this thread use so many threads at most."""
    most: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined] # set at run time
    set_num_threads(min(count, most))


@njit(cache=True)
def _product_at(
    t: int,
    x: NDArray[np.float64],
    diagonal: NDArray[np.float64],
    first: NDArray[np.float64],
    second: NDArray[np.float64],
) -> float:
    """Return (A x)[t]."""
    total: float = diagonal[t] * x[t]
    if t >= 1:
        total += first[t - 1] * x[t - 1]
    if t >= 2:
        total += second[t - 2] * x[t - 2]
    if t + 1 < x.size:
        total += first[t] * x[t + 1]
    if t + 2 < x.size:
        total += second[t] * x[t + 2]
    return total


@njit(cache=True)
def _activate(
    gain: NDArray[np.float64],
    free: NDArray[np.bool_],
    share: float,
    active: NDArray[np.int64],
) -> int:
    """List the frames worth working on and those their derivatives touch; return how many."""
    threshold = share * gain.max()
    count = 0
    listed = -1
    for t in range(gain.size):
        if free[t] and gain[t] >= threshold and gain[t] > 0.0:
            for s in range(max(t - REACH, listed + 1), min(t + REACH + 1, gain.size)):
                if free[s]:
                    active[count] = s
                    count += 1
                listed = s
    return count


@njit(cache=True)
def _descend_active(
    x: NDArray[np.float64],
    residual: NDArray[np.float64],
    active: NDArray[np.int64],
    count: int,
    diagonal: NDArray[np.float64],
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    steps: int,
    direction: NDArray[np.float64],
) -> float:
    """Take conjugate gradient steps with exact step lengths on the active frames.

    ``x``, ``residual`` and ``direction`` have shape (3, frames). ``residual`` is b - Ax, half the
    negative gradient; it is kept right for the active frames only. ``direction`` is 0 on entry
    and on return. Returns the energy gained.
    """
    product = np.empty((3, count))
    norm = 0.0
    for i in range(3):
        for a in range(count):
            t = active[a]
            direction[i, t] = residual[i, t] / diagonal[t]
            norm += residual[i, t] * direction[i, t]
    gained = 0.0
    for _ in range(steps):
        curvature = 0.0
        for i in range(3):
            for a in range(count):
                t = active[a]
                product[i, a] = _product_at(t, direction[i], diagonal, first, second)
                curvature += product[i, a] * direction[i, t]
        if curvature <= 0.0 or norm <= 0.0:
            break
        length = norm / curvature
        gained += length * norm
        renewed = 0.0
        for i in range(3):
            for a in range(count):
                t = active[a]
                x[i, t] += length * direction[i, t]
                residual[i, t] -= length * product[i, a]
                renewed += residual[i, t] * residual[i, t] / diagonal[t]
        ratio = renewed / norm
        norm = renewed
        for i in range(3):
            for a in range(count):
                t = active[a]
                direction[i, t] = residual[i, t] / diagonal[t] + ratio * direction[i, t]
    for a in range(count):
        direction[:, active[a]] = 0.0
    return gained


@njit(cache=True)
def _descend_chain(
    x: NDArray[np.float64],
    free: NDArray[np.bool_],
    diagonal: NDArray[np.float64],
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    right: NDArray[np.float64],
    energy: float,
    tolerance: float,
    precision: float,
    share: float,
    steps: int,
    rounds: int,
) -> int:
    """Descend on one marker's chain in place; return the number of frame updates.

    The schedule and the steps see lengths of vectors only, never single coordinates: where it
    ends does not depend on the directions of the axes.
    """
    frames = x.shape[1]
    residual = np.zeros((3, frames))
    gain = np.zeros(frames)
    direction = np.zeros((3, frames))
    active = np.empty(frames, dtype=np.int64)
    updates = 0
    everything = False
    for _ in range(rounds):
        for t in range(frames):
            gain[t] = 0.0
            if free[t]:
                square = 0.0
                for i in range(3):
                    residual[i, t] = right[i, t] - _product_at(t, x[i], diagonal, first, second)
                    square += residual[i, t] * residual[i, t]
                # near an energy of 0, no gain is small beside it: mind how far frames move too
                if square > (precision * diagonal[t]) ** 2:
                    gain[t] = square / diagonal[t]
        count = _activate(gain, free, 0.0 if everything else share, active)
        if count == 0:
            break
        gained = _descend_active(
            x, residual, active, count, diagonal, first, second, steps, direction
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


@njit(cache=True, parallel=True)
def descend_chains(
    x: NDArray[np.float64],
    free: NDArray[np.bool_],
    diagonal: NDArray[np.float64],
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    right: NDArray[np.float64],
    energies: NDArray[np.float64],
    tolerance: float,
    precision: float,
    share: float,
    steps: int,
    rounds: int,
) -> int:
    """Descend on every marker's chain, chains in parallel; the result knows nothing of the threads.

    Parameters
    ----------
    x : ndarray [shape=(markers, 3, frames), mm]
        Positions, changed in place where ``free``; finite everywhere.
    free : ndarray of bool [shape=(markers, frames)]
        Samples to be found. Their diagonal is positive.
    diagonal, first, second : ndarray [shape=(markers, frames)]
        The bands of A.
    right : ndarray [shape=(markers, 3, frames)]
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

    Returns
    -------
    int
        Frame updates made, over all chains.
    """
    markers = x.shape[0]
    updates = np.zeros(markers, dtype=np.int64)
    for m in prange(markers):
        updates[m] = _descend_chain(
            x[m],
            free[m],
            diagonal[m],
            first[m],
            second[m],
            right[m],
            energies[m],
            tolerance,
            precision,
            share,
            steps,
            rounds,
        )
    total: int = updates.sum()
    return total
