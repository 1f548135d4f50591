"""WPCA: the weighted PCA of Gløersen and Federolf 2016, one marker after the other.

Components of the frames that show everything are matched to those of the same frames without the
missing marker; a frame's scores on the latter rebuild the marker by the former.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.tits2018.options import Options, spread_evenly

__all__ = ["predict"]

Array = NDArray[np.float64]

FEWEST_ROWS = 2
"""Whole frames, without which there are no components."""


def predict(positions: Array, options: Options) -> Array:
    """Predict every marker that has gaps, each from the measured samples alone.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        About their centre; NaN where missing.
    options : Options
        Weights and components.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        NaN where measured, and where no whole frame is left to learn from.
    """
    missing = np.isnan(positions[..., 0])
    gapped = missing.any(axis=0)
    distance = _mean_distances(positions, np.flatnonzero(gapped), options)
    out = np.full(positions.shape, np.nan)
    for marker in np.flatnonzero(gapped):
        own = missing[:, marker]
        far = distance[marker] > options.pca_cut * _mean_of_known(distance[marker])
        # markers with gaps take part if they are near and seen throughout the gaps of this one
        used = ~(gapped & (far | missing[own].any(axis=0)))
        used[marker] = True
        others = np.flatnonzero(used & (np.arange(len(used)) != marker))
        whole = ~missing[:, used].any(axis=1)
        if whole.sum() < FEWEST_ROWS or not len(others):
            continue
        weight = np.exp(-(distance[marker, others] ** 2) / (2.0 * options.pca_sigma**2))
        out[own, marker] = _rebuilt(
            positions[np.ix_(np.flatnonzero(whole), others)],
            positions[whole, marker],
            positions[np.ix_(np.flatnonzero(own), others)],
            weight,
            options,
        )
    return out


def _mean_of_known(values: Array) -> float:
    return float(values[np.isfinite(values)].mean())


def _mean_distances(positions: Array, of: NDArray[np.intp], options: Options) -> Array:
    """Return mean distances of some markers from all; infinite for markers never seen together."""
    frames, markers = positions.shape[:2]
    most = options.pca_distance_rows
    rows = (
        spread_evenly(frames, most) if frames < 2 * most else np.arange(0, frames, frames // most)
    )
    some = positions[rows]
    distance = np.full((markers, markers), np.inf)
    for marker in of:
        between = np.linalg.norm(some - some[:, marker : marker + 1], axis=2)
        known = ~np.isnan(between)
        count = known.sum(axis=0)
        total = np.where(known, between, 0.0).sum(axis=0)
        distance[marker] = np.where(count > 0, total / np.maximum(count, 1), np.inf)
    return distance


def _rebuilt(others: Array, own: Array, asked: Array, weight: Array, options: Options) -> Array:
    """Rebuild a marker from the others.

    Parameters
    ----------
    others, own : ndarray [shapes=(rows, others, 3), (rows, 3), mm]
        Whole frames.
    asked : ndarray [shape=(asked, others, 3), mm]
        The others where the marker is missing.
    weight : ndarray [shape=(others,)]
        How much each of them counts.
    options : Options
        Weight of the marker itself, and components.

    Returns
    -------
    ndarray [shape=(asked, 3), mm]
        The marker.
    """
    known = others.reshape(len(others), -1)
    mean, deviation = known.mean(axis=0), _deviation(known)
    scale = np.repeat(weight, 3) / deviation
    own_mean, own_scale = own.mean(axis=0), options.pca_own / _deviation(own)
    full = np.column_stack([(known - mean) * scale, (own - own_mean) * own_scale])
    width = known.shape[1]
    gram = full.T @ full
    bases = [_components(gram), _components(gram[:width, :width])]
    count = max(_needed(values, options.pca_kept) for values, _ in bases)
    whole, part = (vectors[:, :count] for _, vectors in bases)
    count = min(whole.shape[1], part.shape[1])
    whole, part = whole[:, :count], part[:, :count]
    # scores on the part's components, each handed to the whole's component of the same rank
    scores = (asked.reshape(len(asked), -1) - mean) * scale @ part
    alike = np.einsum("pc,pc->c", whole[:width], part)
    return np.asarray(scores * alike @ whole[width:].T / own_scale + own_mean)


def _deviation(rows: Array) -> Array:
    """Return the deviation of each column; 1 for constant ones."""
    deviation = rows.std(axis=0)
    return np.where(deviation > 0.0, deviation, 1.0)


def _components(gram: Array) -> tuple[Array, Array]:
    """Return singular values, the largest first, and components of rows by their Gram matrix."""
    values, vectors = np.linalg.eigh(gram)
    return np.sqrt(np.maximum(values[::-1], 0.0)), vectors[:, ::-1]


def _needed(values: Array, share: float) -> int:
    """Return how many singular values reach a share of their sum."""
    total = np.cumsum(values)
    return int(np.searchsorted(total, share * total[-1])) + 1
