"""The two strategies: which markers are missing together, and which others predict them.

These are functions of arrays. `gloersen2016_fill` applies them to a task, and
`priorfill.methods.tits2018` uses `consecutive` as one of its models.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gloersen2016.weighted_pca import (
    ColumnMoments,
    mean_distances,
    regression,
)
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["Gloersen2016Options", "MissingMarkers", "PcaFrames", "consecutive", "simultaneous"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MIN_FRAMES = 2
"""Training frames: the standard deviation of one is undefined."""

MIN_POSITIVE = 1e-6
"""Smallest σ (mm) and weight; both are divisors."""


@dataclass(frozen=True)
class Gloersen2016Options:
    """Constants of Gløersen and Federolf 2016.

    Attributes
    ----------
    sigma : float
        mm. σ of the weights exp(-d² / 2σ²) of markers at a mean distance d from the nearest missing
        marker (``WeightScale`` in the authors' program).
    missing_weight : float
        w_mm, the weight of missing markers (``MMweight``). It is small, so that they hardly
        influence the components, which must be similar without them.
    distal_threshold : float
        Θ_D (``DistalThreshold``). ``r2`` omits other markers with gaps whose distance exceeds this
        share of the mean distance to all markers.
    min_singular_share : float
        Θ_λ (``MinCumSV``). Share of the sum of the singular values that the components kept must
        reach.

    Raises
    ------
    OptionError
        Where a value is outside its range.

    Examples
    --------
    >>> Gloersen2016Options(min_singular_share=0.95).sigma
    200.0
    """

    sigma: float = 200.0
    missing_weight: float = 0.02
    distal_threshold: float = 0.5
    min_singular_share: float = 0.99

    def __post_init__(self) -> None:
        check_at_least(self, MIN_POSITIVE, "sigma", "missing_weight")
        check_at_least(self, 0.0, "distal_threshold")
        check_between(self, 0.0, 1.0, "min_singular_share")


@dataclass(frozen=True, eq=False)
class MissingMarkers:
    """Markers that are missing together, and the markers that predict them.

    Attributes
    ----------
    markers : ndarray of int [shape=(missing,)]
        The missing markers.
    used : ndarray of bool [shape=(markers,)]
        The markers used, including the missing ones.
    distances : ndarray [shape=(markers,), mm]
        Mean distance from the nearest missing marker.
    """

    markers: NDArray[np.intp]
    used: Mask
    distances: Array


class PcaFrames:
    """The frames of a clip, as training data and to be filled.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Relative to an origin that moves with the subject; NaN where missing. Every marker is
        visible in some frame.

    Attributes
    ----------
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    constant : ndarray of bool [shape=(markers,)]
        Which markers are visible in every frame.
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

    def predict(
        self, missing: MissingMarkers, options: Gloersen2016Options
    ) -> tuple[NDArray[np.intp], Array] | None:
        """Predict missing markers from the others, by Eq. (1).

        Parameters
        ----------
        missing : MissingMarkers
            What is missing and what is used.
        options : Gloersen2016Options
            Weights and number of components.

        Returns
        -------
        frames : ndarray of int [shape=(frames with gaps,)]
            The frames in which any of the missing markers is missing.
        positions : ndarray [shape=(frames with gaps, missing, 3), mm]
            Their predictions. None in place of both where fewer than `MIN_FRAMES` frames show all
            markers used.
        """
        shown = np.asarray(self.valid[:, missing.used].all(axis=1))
        if shown.sum() < MIN_FRAMES:
            return None
        used = np.repeat(missing.used, 3)
        hidden = np.repeat(np.isin(np.flatnonzero(missing.used), missing.markers), 3)
        weights = np.repeat(np.exp(-((missing.distances / options.sigma) ** 2) / 2), 3)[used]
        weights[hidden] = options.missing_weight
        mean, covariance = self._moments.over(shown, used)
        slopes = regression(covariance, weights, hidden, options.min_singular_share)
        gaps = np.flatnonzero(~self.valid[:, missing.markers].all(axis=1))
        found = mean[hidden] + (self._columns[gaps][:, used][:, ~hidden] - mean[~hidden]) @ slopes
        return gaps, found.reshape(len(gaps), -1, 3) + self._centre[missing.markers]


def simultaneous(frames: PcaFrames, options: Gloersen2016Options) -> Iterator[MissingMarkers]:
    """Yield all markers with gaps, missing together."""
    markers = np.flatnonzero(~frames.constant)
    if len(markers):
        every = np.ones(len(frames.constant), dtype=bool)
        yield MissingMarkers(markers, every, frames.distances(markers).min(axis=0))


def consecutive(frames: PcaFrames, options: Gloersen2016Options) -> Iterator[MissingMarkers]:
    """Yield each marker with gaps, missing alone."""
    markers = np.flatnonzero(~frames.constant)
    for marker, distances in zip(markers, frames.distances(markers), strict=True):
        mean_distance = distances[np.isfinite(distances)].mean()
        near = distances <= options.distal_threshold * mean_distance
        in_all_gaps = frames.valid[~frames.valid[:, marker]].all(axis=0)
        used = frames.constant | (near & in_all_gaps)
        used[marker] = True
        yield MissingMarkers(np.array([marker]), used, distances)
