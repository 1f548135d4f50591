"""The soft skeleton constraint: a filled marker keeps its distances from its three references.

A distance may be anything between two quantiles of what was measured; beyond them, the marker
moves along the line to the reference until the distance is one of the two.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["bounds", "constrain"]

Array = NDArray[np.float64]

NO_DIRECTION = 1e-9
"""mm: from a reference as near as this there is no direction to move a marker in."""


def bounds(distances: Array, narrow: float, wide: float) -> tuple[Array, Array]:
    """Return the quantiles of measured distances.

    Sample k of n stands at (k - 1/2) / n, with straight lines between.

    Parameters
    ----------
    distances : ndarray [shape=(frames, references), mm]
        NaN where not measured.
    narrow, wide : float
        The quantiles.

    Returns
    -------
    shortest, longest : ndarray [shape=(references,), mm]
        No bounds, 0 and infinite, where nothing was measured.
    """
    shortest = np.zeros(distances.shape[1])
    longest = np.full(distances.shape[1], np.inf)
    for reference, column in enumerate(distances.T):
        measured = column[~np.isnan(column)]
        if len(measured):
            shortest[reference], longest[reference] = np.quantile(
                measured, [narrow, wide], method="hazen"
            )
    return shortest, longest


def constrain(
    points: Array, references: Array, shortest: Array, longest: Array, rounds: int
) -> Array:
    """Move points until they keep their distances.

    Each round starts with the last reference, whose distance varies most, and ends with the first,
    which therefore is kept best.

    Parameters
    ----------
    points : ndarray [shape=(frames, 3), mm]
        Where the marker is predicted.
    references : ndarray [shape=(frames, references, 3), mm]
        NaN where missing: such a reference moves nothing.
    shortest, longest : ndarray [shape=(references,), mm]
        See `bounds`.
    rounds : int
        How many at most.

    Returns
    -------
    ndarray [shape=(frames, 3), mm]
        Points whose distances are all within bounds are not touched.
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
            outside &= length > NO_DIRECTION
            at = moving[outside]
            wanted = np.clip(length[outside], shortest[reference], longest[reference])
            points[at] = origin[outside] + away[outside] * (wanted / length[outside])[:, None]
    return points
