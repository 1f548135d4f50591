"""Normalisation of coordinates: centred, divided by standard deviations, weighted by distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.li2020 import eigenspaces
from priorfill.methods.li2020.li2020_options import Li2020Options

__all__ = ["Normalisation", "coordinates", "marker_weights", "mean_distances", "normalise"]

Array = NDArray[np.float64]

BATCH_FRAMES = 256
"""Frames whose distances are computed at once; limits the memory to a few MB."""


@dataclass(frozen=True, eq=False)
class Normalisation:
    """Mean and scale of coordinates.

    Attributes
    ----------
    mean : ndarray [shape=(1, columns), mm]
        Mean of the training data.
    scale : ndarray [shape=(columns,)]
        Weight divided by standard deviation.
    """

    mean: Array
    scale: Array

    def apply(self, rows: Array, ones: Array | float = 1.0) -> Array:
        """Return normalised rows; ``ones`` are those of rows of a triangular factor."""
        normalised: Array = (rows - ones * self.mean) * self.scale
        return normalised


def coordinates(positions: Array) -> Array:
    """Return positions [shape=(frames, markers, 3)] as rows [shape=(frames, 3 * markers)]."""
    return positions.reshape(len(positions), -1)


def normalise(rows: Sequence[Array], ones: Sequence[Array], weights: Array) -> Normalisation:
    """Return the normalisation of training data.

    Parameters
    ----------
    rows : sequence of ndarray [shape=(n_i, columns), mm]
        Frames, or the rows of triangular factors of them.
    ones : sequence of ndarray [shape=(n_i, 1)]
        Ones, or the column of the factor that has their products.
    weights : ndarray [shape=(markers,)]
        See `marker_weights`.
    """
    frames = sum(float((one**2).sum()) for one in ones)
    mean = np.sum([one.T @ some for one, some in zip(ones, rows, strict=True)], axis=0) / frames
    centred = [some - one @ mean for one, some in zip(ones, rows, strict=True)]
    squares = np.sum([(some**2).sum(axis=0) for some in centred], axis=0)
    sd = np.sqrt(squares / max(frames - 1.0, 1.0))
    # the standard deviation of a constant coordinate is a rounding error
    sd[sd <= eigenspaces.MIN_SINGULAR_RATIO * max(sd.max(), 1.0)] = 1.0
    return Normalisation(mean, np.repeat(weights, 3) / sd)


def marker_weights(template: NDArray[np.bool_], distances: Array, options: Li2020Options) -> Array:
    """Return the weights of markers: less, the farther they are from those with gaps.

    Parameters
    ----------
    template : ndarray of bool [shape=(markers,)]
        Markers with gaps.
    distances : ndarray [shape=(markers, markers), mm]
        See `mean_distances`.
    options : Li2020Options
        ``sigma`` and ``gap_weight``.
    """
    distance = distances[template].min(axis=0)
    weights: Array = np.where(
        template, options.gap_weight, np.exp(-(distance**2) / (2.0 * options.sigma**2))
    )
    return weights


def mean_distances(windows: Sequence[Array]) -> Array:
    """Return the mean distances of markers over all frames of some windows (mm)."""
    markers = windows[0].shape[1]
    total = np.zeros((markers, markers))
    for window in windows:
        for start in range(0, len(window), BATCH_FRAMES):
            some = window[start : start + BATCH_FRAMES]
            total += np.linalg.norm(some[:, :, None] - some[:, None], axis=3).sum(axis=0)
    distances: Array = total / sum(len(window) for window in windows)
    return distances
