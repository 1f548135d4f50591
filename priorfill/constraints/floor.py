"""Keep feet out of the floor: no marker is predicted lower than where the floor stops it.

Where a marker rests on the floor, or on the shoe that does, its lowest measured height is as low as
it gets. The floor is found from the clip itself, marker by marker. Predictions below it are lifted
by the least squares

    sum_i |x_i - p_i|² / σ_i²  +  sum_ij (|x_i - x_j| - |p_i - p_j|)² / s_ij²
                               +  sum_i max(0, h_i - z_i)² / s²

in each frame: p_i is what was predicted, with deviation σ_i a coordinate; h_i is the height that a
marker is to have at least: the floor's, and just before and after it was too low a little more than
was predicted. Distances that hardly vary stay as predicted, so a lifted toe takes the foot along,
and bends the knee. A frame near which nothing is too low stays as it is. The minimum is found by
Gauss-Newton steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, maximum_filter1d

from priorfill.constraints.distance_terms import (
    LEAST_LENGTH,
    STIFF,
    DistanceTerm,
    coordinate_variance,
    normal_equations,
    step,
)
from priorfill.geometry.distances import norms

__all__ = ["enforce_floor"]


FIRMNESS = 1.0
"""mm. How far the floor gives way, against predictions that err by centimetres."""

LEAST_SPREAD = 1.0
"""mm. A lift keeps no distance better than this: it need not."""

ROUND_SECONDS = 0.025
"""s. A lift comes and goes over so long, that feet do not stop dead. Longer ones cost accuracy."""

DISBELIEF = 3.0
"""A marker that is predicted lower than its floor by more deviations than this, and by `ANYHOW`,
is where the clip shows no floor: on a stair, say. It is left alone."""

ANYHOW = 20.0
"""mm."""

STEPS = 12
"""Gauss-Newton steps; with half of them straight legs can be a tenth above the minimum."""

SHORTER = (1.0, 0.5, 0.25, 0.1)
"""Of a step, what lowers the sum of squares the most is taken: a straight leg bends either way, and
a floor that is met on the way turns the step."""

AT_ONCE = 200
"""Frames lifted at once: the matrices of a whole body take 250 kB a frame."""


def enforce_floor(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    visible: NDArray[np.float64],
    spread: NDArray[np.float64],
    floor: NDArray[np.float64],
    rate: float,
) -> NDArray[np.float64]:
    """Lift what is predicted below the floor.

    Parameters
    ----------
    predicted : ndarray [shape=(frames, missing markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(frames, missing markers), mm]
        Expected rms Euclidean error.
    visible : ndarray [shape=(frames, visible markers, 3), mm]
        Measured ones that missing ones may be tied to; NaN where they are not measured.
    spread : ndarray [shape=(missing markers, missing and visible markers), mm]
        How much each distance varies.
    floor : ndarray [shape=(missing markers,), mm]
        As `floor_heights` gives it.
    rate : float
        Hz.

    Returns
    -------
    ndarray [shape=(frames, missing markers, 3), mm]
        ``predicted`` itself where nothing is too low.
    """
    below = np.maximum(floor - predicted[..., 2], 0.0)  # mm
    absent = (below > DISBELIEF * expected_rms + ANYHOW).any(axis=0)
    below[:, absent] = 0.0
    if not below.any():
        return predicted
    wanted = _rounded(below, rate)
    # what a lift tilts must not sink for that
    raised = predicted[..., 2] + wanted
    least = np.where(wanted > 0, raised, np.where(absent, -np.inf, floor))
    frames = np.flatnonzero(wanted.any(axis=1))
    lifted = predicted.copy()
    for some in np.array_split(frames, -(-len(frames) // AT_ONCE)):
        lifted[some] = _lifted(
            predicted[some], expected_rms[some], visible[some], spread, least[some]
        )
    return lifted


def _rounded(below: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """Return a lift (frames, markers; mm) that is smooth in time and nowhere less than asked."""
    reach = round(ROUND_SECONDS * rate)
    window = np.hanning(2 * reach + 3)
    # the mean of a greatest value over the same window is no less than the value
    greatest = maximum_filter1d(below, 2 * reach + 1, axis=0, mode="nearest")
    smooth: NDArray[np.float64] = convolve1d(
        greatest, window[1:-1] / window.sum(), axis=0, mode="nearest"
    )
    return smooth


def _lifted(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    visible: NDArray[np.float64],
    spread: NDArray[np.float64],
    least: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Minimise the least squares; parameters as for `enforce_floor`, and the least heights (mm)."""
    frames, markers = predicted.shape[:2]
    variance = coordinate_variance(expected_rms)
    points = np.concatenate([predicted, visible], axis=1)
    pairs = [(i, j) for i, j in np.argwhere(spread < STIFF) if j > i]
    edges: list[DistanceTerm] = []
    for one, other in pairs:
        apart = points[:, one] - points[:, other]
        length = norms(apart)
        known = np.isfinite(length)
        weight = np.where(known, 1.0 / max(spread[one, other], LEAST_SPREAD) ** 2, 0.0)
        edges.append((one, other, np.where(known, length, LEAST_LENGTH), weight))
    points = np.where(np.isnan(points), 0.0, points)

    def squares(found: NDArray[np.float64]) -> NDArray[np.float64]:
        whole = np.concatenate([found, points[:, markers:]], axis=1)
        sums: NDArray[np.float64] = ((found - predicted) ** 2 / variance[..., None]).sum((1, 2))
        sums += (np.maximum(least - found[..., 2], 0.0) ** 2).sum(axis=1) / FIRMNESS**2
        for one, other, length, weight in edges:
            far = norms(whole[:, one] - whole[:, other])
            sums += weight * (far - length) ** 2
        return sums

    for _ in range(STEPS):
        matrix, force = normal_equations(points, predicted, variance, edges)
        sunk = np.maximum(least - points[:, :markers, 2], 0.0)
        firm = (sunk > 0) / FIRMNESS**2
        for i in range(markers):
            matrix[:, i, 2, i, 2] += firm[:, i]
        force[..., 2] += firm * sunk
        ahead = step(matrix, force)
        tried = [points[:, :markers] + part * ahead for part in SHORTER]
        best = np.argmin([squares(one) for one in tried], axis=0)
        points[:, :markers] = np.array(tried)[best, np.arange(frames)]
    found: NDArray[np.float64] = points[:, :markers]
    return found
