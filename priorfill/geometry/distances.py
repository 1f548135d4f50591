"""Distances between markers, and how much they vary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "MIN_COMMON_POSES",
    "PairStatistics",
    "distances_of",
    "median_distances",
    "norms",
    "pair_distances",
    "pair_statistics",
    "pooled_distances",
]

MAX_POSES = 1000
"""Poses used, evenly spaced; more do not improve a mean and a standard deviation."""

MIN_COMMON_POSES = 5
"""Poses that must show both markers of a pair."""


BLOCK = 10_000
"""Points whose differences are computed at once: they stay in the processor's cache."""


def norms(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Euclidean norms of 3-vectors; about six times as fast as `numpy.linalg.norm`.

    Parameters
    ----------
    vectors : ndarray [shape=(..., 3)]

    Returns
    -------
    ndarray [shape=(...)]

    Examples
    --------
    >>> norms(np.array([[3.0, 0.0, 4.0]]))
    array([5.])
    """
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    lengths: NDArray[np.float64] = np.sqrt(x**2 + y**2 + z**2)
    return lengths


def distances_of(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point from the other one, without an array of the differences.

    Parameters
    ----------
    one, other : ndarray [shape=(points, 3)]

    Returns
    -------
    ndarray [shape=(points,)]

    Examples
    --------
    >>> distances_of(np.zeros((1, 3)), np.array([[3.0, 0.0, 4.0]]))
    array([5.])
    """
    lengths = np.empty(len(one))
    for start in range(0, len(one), BLOCK):
        some = slice(start, start + BLOCK)
        lengths[some] = norms(one[some] - other[some])
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
        """Return rms and spread [mm]; infinite for pairs seen together in fewer poses."""
        enough = self.count >= max(min_common, 1)
        return np.where(enough, self.rms, np.inf), np.where(enough, self.spread, np.inf)


def pair_statistics(positions: NDArray[np.floating]) -> PairStatistics:
    """Compute statistics of the distance of each pair of markers.

    Parameters
    ----------
    positions : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing. At most `MAX_POSES` poses are used, evenly spaced.

    Returns
    -------
    PairStatistics

    See Also
    --------
    pair_distances : Distances and their spread only.
    """
    sample = positions[:: max(1, -(-len(positions) // MAX_POSES))].astype(np.float64)
    markers = sample.shape[1]
    valid = ~np.isnan(sample[..., 0])
    common = valid.T.astype(np.float64) @ valid.astype(np.float64)
    rms = np.full((markers, markers), np.inf)
    spread = np.full((markers, markers), np.inf)
    x, y, z = np.ascontiguousarray(np.moveaxis(sample, 2, 0))
    for marker in range(markers):
        # of two columns at least: NumPy adds up a single one in another order
        others = slice(max(min(marker, markers - 2), 0), markers)
        own = slice(marker, marker + 1)
        distance = np.sqrt(
            (x[:, others] - x[:, own]) ** 2
            + (y[:, others] - y[:, own]) ** 2
            + (z[:, others] - z[:, own]) ** 2
        )
        distance[np.isnan(distance)] = 0.0
        seen = common[marker, others] > 0
        count = np.where(seen, common[marker, others], 1.0)
        square = (distance**2).sum(axis=0) / count
        mean = distance.sum(axis=0) / count
        # rounding can make the variance of a rigid pair negative
        variance = np.maximum(square - mean**2, 0.0)
        for result, value in ((rms, square), (spread, variance)):
            result[marker, others] = result[others, marker] = np.where(seen, np.sqrt(value), np.inf)
    return PairStatistics(common, rms, spread)


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

    See Also
    --------
    pooled_distances : The same over several recordings.

    Examples
    --------
    >>> positions = np.zeros((10, 2, 3))
    >>> positions[:, 1, 0] = 300.0 + np.arange(10) % 2  # 300 or 301 mm
    >>> distance, spread = pair_distances(positions)
    >>> round(float(distance[0, 1]), 1), round(float(spread[0, 1]), 1)
    (300.5, 0.5)
    """
    return pair_statistics(positions).of_common(min_common)


def median_distances(
    poses: NDArray[np.float64], first: NDArray[np.intp], second: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return the median distance of pairs of markers.

    Parameters
    ----------
    poses : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing.
    first, second : ndarray of int [shape=(pairs,)]
        The markers of each pair.

    Returns
    -------
    ndarray [shape=(pairs,), mm]
        NaN where no pose shows the pair. Of an even number of distances, the lower middle one.

    See Also
    --------
    pair_distances : Rms distances of all pairs.
    """
    ordered = np.sort(norms(poses[:, first] - poses[:, second]), axis=0)  # NaN last
    count = (~np.isnan(ordered)).sum(axis=0)
    median: NDArray[np.float64] = ordered[np.maximum(count - 1, 0) // 2, np.arange(len(first))]
    return median


def pooled_distances(
    recordings: Sequence[NDArray[np.float64]], markers: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rms distances of some markers from all over several recordings, and their spread.

    Parameters
    ----------
    recordings : sequence of ndarray [shape=(poses, all markers, 3), mm]
        NaN where missing.
    markers : ndarray of int [shape=(markers,)]
        The markers.

    Returns
    -------
    distance, spread : ndarray [shape=(markers, all markers), mm]
        Infinite where no recording shows a pair. ``spread`` is the standard deviation within
        recordings, about the mean of each.

    See Also
    --------
    pair_distances : The same for one recording.
    """
    total = recordings[0].shape[1] if recordings else 0
    count = np.zeros((len(markers), total))
    squared_distance, squared_deviation = np.zeros_like(count), np.zeros_like(count)
    for poses in recordings:
        distance = norms(poses[:, markers, None] - poses[:, None])
        known = ~np.isnan(distance)
        distance = np.where(known, distance, 0.0)
        shown = known.sum(axis=0)
        mean = distance.sum(axis=0) / np.maximum(shown, 1)
        count += shown
        squared_distance += (distance**2).sum(axis=0)
        squared_deviation += np.where(known, (distance - mean) ** 2, 0.0).sum(axis=0)
    unknown = count == 0
    count[unknown] = 1.0
    return (
        np.where(unknown, np.inf, np.sqrt(squared_distance / count)),
        np.where(unknown, np.inf, np.sqrt(squared_deviation / count)),
    )
