"""How far markers are from each other, and how much that varies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "MIN_COMMON_POSES",
    "PairStatistics",
    "median_distances",
    "norms",
    "pair_distances",
    "pair_statistics",
    "pooled_distances",
]

MAX_POSES = 1000
"""Poses used, evenly spaced; a mean and a standard deviation gain nothing from more."""

MIN_COMMON_POSES = 5
"""Poses that must show both markers of a pair for its distance to be known."""


def norms(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of vectors; of three coordinates, what numpy does takes six times as long.

    Parameters
    ----------
    vectors : ndarray [shape=(..., 3)]

    Returns
    -------
    ndarray [shape=(...)]
    """
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    lengths: NDArray[np.float64] = np.sqrt(x**2 + y**2 + z**2)
    return lengths


@dataclass(frozen=True, eq=False)
class PairStatistics:
    """Statistics of the distance of each pair of markers.

    Attributes
    ----------
    count : ndarray [shape=(markers, markers)]
        Poses that show both markers.
    rms, spread : ndarray [shape=(markers, markers), mm]
        Root mean square and standard deviation of the distance over these poses; infinite where
        there are none.
    """

    count: NDArray[np.float64]
    rms: NDArray[np.float64]
    spread: NDArray[np.float64]

    def of_common(self, min_common: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return rms and spread, infinite for pairs seen together in fewer poses."""
        enough = self.count >= max(min_common, 1)
        return np.where(enough, self.rms, np.inf), np.where(enough, self.spread, np.inf)


def pair_statistics(positions: NDArray[np.floating]) -> PairStatistics:
    """Measure the distance of each pair of markers, and how much it varies.

    Parameters
    ----------
    positions : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing. At most `MAX_POSES` poses are used, evenly spaced.
    """
    some = positions[:: max(1, -(-len(positions) // MAX_POSES))].astype(np.float64)
    markers = some.shape[1]
    valid = ~np.isnan(some[..., 0])
    together = valid.T.astype(np.float64) @ valid.astype(np.float64)
    rms = np.full((markers, markers), np.inf)
    spread = np.full((markers, markers), np.inf)
    for marker in range(markers):
        between = norms(some - some[:, marker : marker + 1])
        between = np.where(np.isnan(between), 0.0, between)
        seen = together[marker] > 0
        count = np.where(seen, together[marker], 1.0)
        square = (between**2).sum(axis=0) / count
        mean = between.sum(axis=0) / count
        rms[marker] = np.where(seen, np.sqrt(square), np.inf)
        # rounding can make the variance of a rigid pair negative
        variance = np.maximum(square - mean**2, 0.0)
        spread[marker] = np.where(seen, np.sqrt(variance), np.inf)
    return PairStatistics(together, rms, spread)


def pair_distances(
    positions: NDArray[np.floating], min_common: int = MIN_COMMON_POSES
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the rms distance of each pair of markers, and its standard deviation.

    Parameters
    ----------
    positions : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing.
    min_common : int
        Poses that must show both markers of a pair.

    Returns
    -------
    distance, spread : ndarray [shape=(markers, markers), mm]
        Symmetric; infinite for pairs seen together in fewer than ``min_common`` poses.
    """
    return pair_statistics(positions).of_common(min_common)


def median_distances(
    poses: NDArray[np.float64], one: NDArray[np.intp], other: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Median distance of pairs of markers.

    Parameters
    ----------
    poses : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing.
    one, other : ndarray of int [shape=(pairs,)]
        The markers of each pair.

    Returns
    -------
    ndarray [shape=(pairs,), mm]
        NaN where no pose shows a pair; the lower one of two in the middle.
    """
    between = np.sort(norms(poses[:, one] - poses[:, other]), axis=0)  # NaN last
    count = (~np.isnan(between)).sum(axis=0)
    median: NDArray[np.float64] = between[np.maximum(count - 1, 0) // 2, np.arange(len(one))]
    return median


def pooled_distances(
    recordings: Sequence[NDArray[np.float64]], markers: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rms distance of some markers to all in several recordings, and how much it varies in one.

    Parameters
    ----------
    recordings : sequence of ndarray [shape=(poses, all markers, 3), mm]
        NaN where missing.
    markers : ndarray of int [shape=(markers,)]
        Those that are looked at.

    Returns
    -------
    distance, deviation : ndarray [shape=(markers, all markers), mm]
        Infinite where no recording shows a pair. The deviation is from each recording's own mean.
    """
    total = recordings[0].shape[1] if recordings else 0
    count = np.zeros((len(markers), total))
    square, varied = np.zeros_like(count), np.zeros_like(count)
    for poses in recordings:
        between = norms(poses[:, markers, None] - poses[:, None])
        known = ~np.isnan(between)
        between = np.where(known, between, 0.0)
        here = known.sum(axis=0)
        mean = between.sum(axis=0) / np.maximum(here, 1)
        count += here
        square += (between**2).sum(axis=0)
        varied += np.where(known, (between - mean) ** 2, 0.0).sum(axis=0)
    unknown = count == 0
    count[unknown] = 1.0
    return (
        np.where(unknown, np.inf, np.sqrt(square / count)),
        np.where(unknown, np.inf, np.sqrt(varied / count)),
    )
