"""Steps of a marker's path over time, and the greatest that it usually takes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import BLOCK, distances_of, norms

__all__ = ["MIN_STEPS", "greatest_step", "step_lengths"]

FAST_STEPS = 3
"""The third largest step counts as the greatest: a single wrong sample makes two large ones."""

MIN_STEPS = 10
"""Steps that a marker needs for its motion to be known."""


def step_lengths(path: NDArray[np.float64], step: int, order: int) -> NDArray[np.float64]:
    """Return the lengths of the steps of a path, or of the changes from one step to the next.

    Parameters
    ----------
    path : ndarray [shape=(frames, 3), mm]
        NaN where missing.
    step : int
        Frames of a step.
    order : int
        1: the steps; 2: the changes.

    Returns
    -------
    ndarray [shape=(frames - order * step,), mm]
        NaN where an end is missing; empty for a shorter path.

    Examples
    --------
    >>> step_lengths(np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 0.0]]), 1, 1)
    array([5., 0.])
    """
    if order == 1:
        return distances_of(path[step:], path[:-step])
    lengths = np.empty(max(len(path) - 2 * step, 0))
    for start in range(0, len(lengths), BLOCK):
        some = path[start : start + BLOCK + 2 * step]
        lengths[start : start + BLOCK] = norms(
            some[2 * step :] - 2.0 * some[step:-step] + some[: -2 * step]
        )
    return lengths


def greatest_step(lengths: NDArray[np.float64]) -> float:
    """Return the greatest of some steps, but for the few that wrong samples may have made.

    Parameters
    ----------
    lengths : ndarray [shape=(steps,), mm]
        NaN where unknown.

    Returns
    -------
    float
        mm; NaN where fewer than `MIN_STEPS` are known.
    """
    known = lengths[~np.isnan(lengths)]
    if len(known) < MIN_STEPS:
        return math.nan
    return float(np.partition(known, -FAST_STEPS)[-FAST_STEPS])
