"""The soft skeleton constraint on a filled marker's distances from its three references.

A distance outside two quantiles of the measured distances is moved to the nearer quantile, along
the line through marker and reference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["bounds", "constrain"]

Array = NDArray[np.float64]

MIN_DISTANCE = 1e-9
"""mm. Nearer to a reference, the direction in which to move the marker is undefined."""


def bounds(distances: Array, low: float, high: float) -> tuple[Array, Array]:
    """Return the quantiles of measured distances.

    Sample k of n is the quantile (k - 1/2) / n; between samples they are interpolated linearly.

    Parameters
    ----------
    distances : ndarray [shape=(frames, references), mm]
        NaN where not measured.
    low, high : float
        The quantiles, 0 to 1.

    Returns
    -------
    shortest, longest : ndarray [shape=(references,), mm]
        Lower and upper bounds; 0 and infinity where nothing was measured.
    """
    shortest = np.zeros(distances.shape[1])
    longest = np.full(distances.shape[1], np.inf)
    for reference, column in enumerate(distances.T):
        measured = column[~np.isnan(column)]
        if len(measured):
            shortest[reference], longest[reference] = np.quantile(
                measured, [low, high], method="hazen"
            )
    return shortest, longest


def constrain(
    points: Array, references: Array, shortest: Array, longest: Array, rounds: int
) -> Array:
    """Move points until their distances are within bounds.

    Each round starts with the last reference, whose distance varies most, and ends with the first,
    whose bounds therefore hold exactly.

    Parameters
    ----------
    points : ndarray [shape=(frames, 3), mm]
        Predicted positions of the marker.
    references : ndarray [shape=(frames, references, 3), mm]
        NaN where missing; such references have no effect.
    shortest, longest : ndarray [shape=(references,), mm]
        See `bounds`.
    rounds : int
        Maximum number of rounds.

    Returns
    -------
    ndarray [shape=(frames, 3), mm]
        Points whose distances are all within bounds are unchanged.
    """
    points = points.copy()
    moving = np.arange(len(points))
    for _ in range(rounds):
        distance = np.linalg.norm(points[moving, None] - references[moving], axis=2)
        moving = moving[((distance < shortest) | (distance > longest)).any(axis=1)]
        if not len(moving):
            break
        for reference in reversed(range(references.shape[1])):
            origin = references[moving, reference]
            away = points[moving] - origin
            length = np.linalg.norm(away, axis=1)
            outside = (length < shortest[reference]) | (length > longest[reference])
            outside &= length > MIN_DISTANCE
            at = moving[outside]
            wanted = np.clip(length[outside], shortest[reference], longest[reference])
            points[at] = origin[outside] + away[outside] * (wanted / length[outside])[:, None]
    return points
