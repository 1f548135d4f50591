"""How far markers are from each other, and how much that varies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["pair_distances"]

MAX_POSES = 1000
"""Poses looked at, spread evenly; a mean and a standard deviation gain nothing from more."""


def pair_distances(
    positions: NDArray[np.floating], fewest: int = 5
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rms and standard deviation of the distance of each pair of markers.

    Parameters
    ----------
    positions : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing.
    fewest : int
        Poses that must hold both markers of a pair.

    Returns
    -------
    distance, deviation : ndarray [shape=(markers, markers), mm]
        Symmetric; infinite for pairs seen together in fewer than ``fewest`` poses.
    """
    some = positions[:: max(1, -(-len(positions) // MAX_POSES))].astype(np.float64)
    markers = some.shape[1]
    valid = ~np.isnan(some[..., 0])
    together = valid.T.astype(np.float64) @ valid.astype(np.float64)
    distance = np.full((markers, markers), np.inf)
    deviation = np.full((markers, markers), np.inf)
    for marker in range(markers):
        between = np.linalg.norm(some - some[:, marker : marker + 1], axis=2)
        known = ~np.isnan(between)
        between = np.where(known, between, 0.0)
        enough = together[marker] >= max(fewest, 1)
        count = np.where(enough, together[marker], 1.0)
        square = (between**2).sum(axis=0) / count
        mean = between.sum(axis=0) / count
        distance[marker] = np.where(enough, np.sqrt(square), np.inf)
        # rounding can make the variance of a rigid pair negative
        variance = np.maximum(square - mean**2, 0.0)
        deviation[marker] = np.where(enough, np.sqrt(variance), np.inf)
    return distance, deviation
