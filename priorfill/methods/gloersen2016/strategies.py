"""The two strategies: which markers are lost together, and what they are told from.

Arrays only: `methods` has the task, and `priorfill.methods.tits2018` a model that is `one_by_one`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gloersen2016.weighted_pca import ColumnMoments, mean_distances, regression

__all__ = ["Gloersen2016Options", "MissingMarkers", "PcaFrames", "at_once", "one_by_one"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEWEST_FRAMES = 2
"""Frames to learn from: one has no deviation."""


@dataclass(frozen=True)
class Gloersen2016Options:
    """Constants of the publication; the names are those of its program.

    Attributes
    ----------
    sigma : float
        mm; ``WeightScale``. How fast weights fall with the distance from a lost marker.
    lost_weight : float
        ``MMweight``, w_mm. Weight of lost markers: small, so that they hardly shape the
        components, which the frames without them must give as well.
    cutoff : float
        ``DistalThreshold``. In ``r2`` other markers with gaps are left out beyond this share of
        the mean distance to all markers.
    explained : float
        ``MinCumSV``. Share of the sum of singular values that the components kept must reach.
    """

    sigma: float = 200.0
    lost_weight: float = 0.02
    cutoff: float = 0.5
    explained: float = 0.99


@dataclass(frozen=True, eq=False)
class MissingMarkers:
    """Markers lost together, and what they are told from.

    Attributes
    ----------
    markers : ndarray of int [shape=(lost,)]
        The lost ones.
    used : ndarray of bool [shape=(markers,)]
        The markers looked at, the lost ones among them.
    distances : ndarray [shape=(markers,), mm]
        From the nearest lost marker.
    """

    markers: NDArray[np.intp]
    used: Mask
    distances: Array


class PcaFrames:
    """Frames to learn from and to fill, and their moments.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        From an origin that moves with the body; NaN where missing. Every marker is seen somewhere.

    Attributes
    ----------
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    constant : ndarray of bool [shape=(markers,)]
        Which markers are seen in every frame.
    """

    def __init__(self, positions: Array) -> None:
        self.valid = ~np.isnan(positions[..., 0])
        self.constant: Mask = np.asarray(self.valid.all(axis=0))
        self._shown = np.where(self.valid[..., None], positions, 0.0)
        self._centre = self._shown.sum(axis=0) / self.valid.sum(axis=0)[:, None]
        offsets = np.where(self.valid[..., None], self._shown - self._centre, 0.0)
        self._columns = offsets.reshape(len(offsets), -1)
        self._moments = ColumnMoments(self._columns, np.asarray(self.valid.all(axis=1)))

    def distances(self, markers: NDArray[np.intp]) -> Array:
        """Return the mean distances of some markers from all; see `mean_distances`."""
        return mean_distances(self._shown, self.valid, markers)

    def told(
        self, lost: MissingMarkers, options: Gloersen2016Options
    ) -> tuple[NDArray[np.intp], Array] | None:
        """Tell lost markers from the others.

        Returns
        -------
        frames : ndarray of int [shape=(gappy,)]
            Those in which any of the lost markers is missing.
        positions : ndarray [shape=(gappy, lost, 3), mm]
            None of both where fewer than `FEWEST_FRAMES` show all that is used.
        """
        shown = np.asarray(self.valid[:, lost.used].all(axis=1))
        if shown.sum() < FEWEST_FRAMES:
            return None
        used = np.repeat(lost.used, 3)
        hidden = np.repeat(np.isin(np.flatnonzero(lost.used), lost.markers), 3)
        weights = np.repeat(np.exp(-((lost.distances / options.sigma) ** 2) / 2), 3)[used]
        weights[hidden] = options.lost_weight
        mean, covariance = self._moments.over(shown, used)
        slopes = regression(covariance, weights, hidden, options.explained)
        gaps = np.flatnonzero(~self.valid[:, lost.markers].all(axis=1))
        found = mean[hidden] + (self._columns[gaps][:, used][:, ~hidden] - mean[~hidden]) @ slopes
        return gaps, found.reshape(len(gaps), -1, 3) + self._centre[lost.markers]


def at_once(frames: PcaFrames, options: Gloersen2016Options) -> Iterator[MissingMarkers]:
    """All markers with gaps lost together."""
    lost = np.flatnonzero(~frames.constant)
    if len(lost):
        every = np.ones(len(frames.constant), dtype=bool)
        yield MissingMarkers(lost, every, frames.distances(lost).min(axis=0))


def one_by_one(frames: PcaFrames, options: Gloersen2016Options) -> Iterator[MissingMarkers]:
    """Each marker with gaps lost alone."""
    lost = np.flatnonzero(~frames.constant)
    for marker, distances in zip(lost, frames.distances(lost), strict=True):
        near = distances <= options.cutoff * distances[np.isfinite(distances)].mean()
        beside = frames.valid[~frames.valid[:, marker]].all(axis=0)
        used = frames.constant | (near & beside)
        used[marker] = True
        yield MissingMarkers(np.array([marker]), used, distances)
