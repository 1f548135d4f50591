"""Compiled loops of the solver. Arrays in, arrays out: no options, no checks, no I/O.

A chain is padded with `PADDING` frames of zeros at either end, so that no loop has to check its
ends, and its three coordinates are adjacent in memory. It is cut into *blocks* of equal length. The
matrix of a block, without its fixed frames, is factored as L D Lᵀ, so that the move to the block's
own minimum costs two loops over it. A fixed frame has 1 / D = 0.

The loops compile on first use, while the user waits. Work arrays are passed in and ``max`` is
avoided, because compiling an allocation or an array method takes as long as compiling a loop. They
run on one thread: distributing the chains of a gap over threads takes longer than solving them,
and three more seconds to compile.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled

__all__ = ["PADDING", "descend_chains"]

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

PADDING = 2
"""Frames of zeros at either end of a chain: a second difference spans two steps."""

MIN_PIVOT_RATIO = 1e-12
"""Pivots below this fraction of the diagonal are rounding errors."""


@compiled()
def _product_at(t: int, i: int, bands: Float64Array, x: Float64Array) -> float:
    """Return (A x)[t] for one coordinate."""
    total: float = (
        bands[t, 0] * x[t, i]
        + bands[t - 1, 1] * x[t - 1, i]
        + bands[t - 2, 2] * x[t - 2, i]
        + bands[t, 1] * x[t + 1, i]
        + bands[t, 2] * x[t + 2, i]
    )
    return total


@compiled()
def _factor(factor: Float64Array) -> None:
    """Factor the blocks of a chain in place, in the form of `descend_chains`."""
    for t in range(PADDING, factor.shape[0] - PADDING):
        diagonal = factor[t, 0]
        if diagonal > 0.0:
            far = factor[t, 2]
            near = factor[t, 1] - far * factor[t - 1, 1]
            factor[t, 1] = near * factor[t - 1, 0]
            factor[t, 2] = far * factor[t - 2, 0]
            pivot = diagonal - near * factor[t, 1] - far * factor[t, 2]
            if pivot < MIN_PIVOT_RATIO * diagonal:
                # only rounding is left: use the frame alone, which still is a descent direction
                factor[t, 1] = factor[t, 2] = 0.0
                pivot = diagonal
            factor[t, 0] = 1.0 / pivot


@compiled()
def _find_gains(
    x: Float64Array,
    bands: Float64Array,
    factor: Float64Array,
    rhs: Float64Array,
    block_frames: int,
    min_move: float,
    residual: Float64Array,
    move: Float64Array,
    gain: Float64Array,
) -> None:
    """Compute all residuals b - Ax, and the gain of each block at its own minimum.

    The gain is 0 if no frame of the block would move farther than ``min_move``.
    """
    for b in range(gain.size):
        gain[b] = 0.0
    for t in range(PADDING, x.shape[0] - PADDING):
        if factor[t, 0] > 0.0:
            for i in range(3):
                residual[t, i] = rhs[t, i] - _product_at(t, i, bands, x)
                move[t, i] = (
                    residual[t, i] - factor[t, 1] * move[t - 1, i] - factor[t, 2] * move[t - 2, i]
                )
                gain[(t - PADDING) // block_frames] += move[t, i] * move[t, i] * factor[t, 0]
    # relative to an energy near 0 every gain is large, so the distances moved count as well; with
    # a stiff prior single frames hardly move, but a block may
    far = False
    for t in range(x.shape[0] - PADDING - 1, PADDING - 1, -1):
        if factor[t, 0] > 0.0:
            square = 0.0
            for i in range(3):
                move[t, i] = (
                    factor[t, 0] * move[t, i]
                    - factor[t + 1, 1] * move[t + 1, i]
                    - factor[t + 2, 2] * move[t + 2, i]
                )
                square += move[t, i] * move[t, i]
            if square > min_move * min_move:
                far = True
        if (t - PADDING) % block_frames == 0:
            if not far:
                gain[(t - PADDING) // block_frames] = 0.0
            far = False


@compiled()
def _list_active(
    factor: Float64Array,
    block_frames: int,
    gain: Float64Array,
    min_gain_ratio: float,
    active: IndexArray,
) -> int:
    """List the free frames of the blocks to work on, and return their number."""
    largest = 0.0
    for b in range(gain.size):
        if gain[b] > largest:
            largest = gain[b]
    count = 0
    for t in range(PADDING, factor.shape[0] - PADDING):
        block_gain = gain[(t - PADDING) // block_frames]
        if factor[t, 0] > 0.0 and block_gain > 0.0 and block_gain >= min_gain_ratio * largest:
            active[count] = t
            count += 1
    return count


@compiled()
def _descend_active(
    x: Float64Array,
    bands: Float64Array,
    factor: Float64Array,
    active: IndexArray,
    count: int,
    tolerance: float,
    max_steps: int,
    residual: Float64Array,
    direction: Float64Array,
    product: Float64Array,
    move: Float64Array,
) -> tuple[float, int]:
    """Take conjugate gradient steps of exact length on the active frames, block-preconditioned.

    ``residual`` is b - Ax, half the negative gradient, and invalid afterwards. ``direction`` is 0
    on entry and on return. Returns the decrease of the energy and the number of frame updates.
    """
    updates = 0
    gained = 0.0
    length = 0.0
    norm = np.inf
    for _ in range(max_steps):
        # apply the previous step; the first time its length is 0
        new_norm = 0.0
        for a in range(count):
            t = active[a]
            for i in range(3):
                x[t, i] += length * direction[t, i]
                residual[t, i] -= length * product[t, i]
                move[t, i] = (
                    residual[t, i] - factor[t, 1] * move[t - 1, i] - factor[t, 2] * move[t - 2, i]
                )
                new_norm += move[t, i] * move[t, i] * factor[t, 0]
        ratio = new_norm / norm
        norm = new_norm
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


@compiled()
def descend_chains(
    x: Float64Array,
    bands: Float64Array,
    factor: Float64Array,
    rhs: Float64Array,
    energies: Float64Array,
    block_frames: int,
    tolerance: float,
    min_move: float,
    min_gain_ratio: float,
    max_steps: int,
    max_rounds: int,
    gain: Float64Array,
    active: IndexArray,
    work: Float64Array,
) -> int:
    """Minimise the energy of every marker's chain.

    Schedule and steps depend on lengths of vectors only, never on single coordinates, so the result
    does not depend on the directions of the axes.

    Parameters
    ----------
    x : ndarray [shape=(markers, frames, 3), mm]
        Positions, finite everywhere; free samples are changed in place.
    bands : ndarray [shape=(markers, frames, 3)]
        A[t, t], A[t, t+1] and A[t, t+2].
    factor : ndarray [shape=(markers, frames, 3)]
        A[t, t], A[t, t-1] and A[t, t-2]; 0 for fixed frames and across blocks. Replaced by
        1 / D[t], L[t, t-1] and L[t, t-2].
    rhs : ndarray [shape=(markers, frames, 3)]
        b.
    energies : ndarray [shape=(markers,), mm²]
        Initial energy of each chain.
    block_frames : int
        Frames per block; the first block begins after the padding.
    tolerance : float
        A chain ends when a round over all its frames decreases its energy by less than this
        fraction, and a round when a step gains less than this fraction of the round's gain.
    min_move : float
        mm. A block is skipped if no frame would move farther.
    min_gain_ratio : float
        A block is worked on if its gain is at least this fraction of the largest one.
    max_steps : int
        Descent steps per round.
    max_rounds : int
        Maximum number of rounds.
    gain : ndarray [shape=(blocks,)]
        Work array, initially 0, as the next two.
    active : ndarray of int [shape=(frames,)]
        Work array for a list of frames.
    work : ndarray [shape=(4, frames, 3)]
        Work array for residuals, directions, products and moves.

    Returns
    -------
    int
        Number of frame updates, over all chains.
    """
    updates = 0
    residual, direction, product, move = work[0], work[1], work[2], work[3]
    for m in range(x.shape[0]):
        energy = energies[m]
        _factor(factor[m])
        all_blocks = False
        for _ in range(max_rounds):
            _find_gains(
                x[m], bands[m], factor[m], rhs[m], block_frames, min_move, residual, move, gain
            )
            count = _list_active(
                factor[m], block_frames, gain, 0.0 if all_blocks else min_gain_ratio, active
            )
            if count == 0:
                break
            gained, updated = _descend_active(
                x[m],
                bands[m],
                factor[m],
                active,
                count,
                tolerance,
                max_steps,
                residual,
                direction,
                product,
                move,
            )
            updates += updated
            # a round over some blocks that gains too little is followed by one over all; only that
            # one may end the level, so that no frame is left unexamined
            enough = gained > tolerance * energy
            if all_blocks and not enough:
                break
            all_blocks = not enough
            energy -= gained
    return updates
