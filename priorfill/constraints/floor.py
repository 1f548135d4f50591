"""Keep feet out of the floor: no marker may be predicted below the height where the floor stops it.

A marker that rests on the floor, or on a shoe that does, gets no lower than its lowest measured
height. That height is found in the clip itself, marker by marker
(`priorfill.geometry.floor_heights`). Where a prediction lies below it, all missing markers of the
frame are moved to the minimum of

    sum_i |x_i - p_i|² / σ_i²  +  sum_ij (|x_i - x_j| - |p_i - p_j|)² / s_ij²
                               +  sum_i max(0, h_i - z_i)² / s²

p_i is the predicted position with standard deviation σ_i per coordinate, s_ij the standard
deviation of a distance that hardly varies, h_i the least height of a marker, and s the field
``floor_std`` of `FloorOptions`. h_i is the height of the floor, and shortly before and after a
penetration a little more than the predicted height, so that the correction has no jumps. Since the
distances keep their predicted lengths, a raised toe takes the foot along and bends the knee. Frames
away from any penetration are left unchanged. The minimum is found by Gauss-Newton steps with a
line search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.constraints.distance_terms import (
    MAX_CONSTRAINED_SPREAD,
    MIN_DISTANCE,
    DistanceTerms,
    coordinate_variance,
    energy,
    gauss_newton_step,
    normal_equations,
)
from priorfill.geometry.distances import norms
from priorfill.runtime.option_checks import check_at_least
from priorfill.signal.running import running_maximum, symmetric_filter

__all__ = ["FloorOptions", "enforce_floor"]

ITERATIONS = 12
"""Gauss-Newton steps; after half of them straight legs can be a tenth above the minimum."""

STEP_FRACTIONS = (1.0, 0.5, 0.25, 0.1)
"""The fraction of a step that reduces the sum of squares most is taken: a straight leg can bend
either way, and the floor constraint switches on in the middle of a step."""

BATCH_SIZE = 200
"""Frames solved together: the matrices of a complete body take 250 kB per frame."""


@dataclass(frozen=True)
class FloorOptions:
    """When and how strongly the floor constraint acts.

    Attributes
    ----------
    floor_std : float
        mm. Tolerance of the floor; small against predictions that err by centimetres.
    max_spread : float
        mm. Distances with a larger standard deviation in the clip do not tie markers together.
    min_spread : float
        mm. Least tolerance of a distance; a correction needs no more.
    ramp_seconds : float
        s. Half-width of the window over which a correction fades in and out, so that feet do not
        stop abruptly. Longer windows cost accuracy.
    max_penetration_std, max_penetration : float
        A marker predicted lower below its floor than ``max_penetration_std`` expected errors plus
        ``max_penetration`` mm probably stands on something else, such as a stair, and is not
        corrected.
    """

    floor_std: float = 1.0
    max_spread: float = MAX_CONSTRAINED_SPREAD
    min_spread: float = 1.0
    ramp_seconds: float = 0.025
    max_penetration_std: float = 3.0
    max_penetration: float = 20.0

    def __post_init__(self) -> None:
        check_at_least(self, 1e-6, "floor_std", "min_spread")
        check_at_least(
            self, 0.0, "max_spread", "ramp_seconds", "max_penetration_std", "max_penetration"
        )


def enforce_floor(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    visible: NDArray[np.float64],
    spread: NDArray[np.float64],
    floor: NDArray[np.float64],
    rate: float,
    options: FloorOptions = FloorOptions(),
) -> NDArray[np.float64]:
    """Raise predictions that lie below the floor.

    Parameters
    ----------
    predicted : ndarray [shape=(frames, missing markers, 3), mm]
        Upright (+Z up).
    expected_rms : ndarray [shape=(frames, missing markers), mm]
        Expected rms Euclidean error of the predictions.
    visible : ndarray [shape=(frames, visible markers, 3), mm]
        Positions of measured markers that missing ones may be tied to; NaN where missing.
    spread : ndarray [shape=(missing markers, missing and visible markers), mm]
        Standard deviation of each distance.
    floor : ndarray [shape=(missing markers,), mm]
        As returned by `priorfill.geometry.floor_heights.floor_heights`.
    rate : float
        Hz.
    options : FloorOptions

    Returns
    -------
    ndarray [shape=(frames, missing markers, 3), mm]
        ``predicted`` itself where nothing is below the floor.

    See Also
    --------
    priorfill.geometry.floor_heights.floor_heights : Finds the floor.
    priorfill.constraints.segment_lengths.hold_lengths : Holds the distances within segments.
    """
    penetration = np.maximum(floor - predicted[..., 2], 0.0)  # mm
    limit = options.max_penetration_std * expected_rms + options.max_penetration
    off_floor = (penetration > limit).any(axis=0)
    penetration[:, off_floor] = 0.0
    if not penetration.any():
        return predicted
    correction = _ramped(penetration, round(options.ramp_seconds * rate))
    # the floor applies to all markers of a corrected frame, since raising one can tilt another down
    min_height = np.where(
        correction > 0,
        predicted[..., 2] + correction,
        np.where(off_floor, -np.inf, floor),
    )
    frames = np.flatnonzero(correction.any(axis=1))
    raised = predicted.copy()
    for batch in np.array_split(frames, -(-len(frames) // BATCH_SIZE)):
        terms = _constant_distances(predicted[batch], visible[batch], spread, options)
        raised[batch] = _raise_batch(
            predicted[batch],
            coordinate_variance(expected_rms[batch]),
            np.where(np.isnan(visible[batch]), 0.0, visible[batch]),
            terms,
            min_height[batch],
            options.floor_std,
        )
    return raised


def _ramped(penetration: NDArray[np.float64], half_width: int) -> NDArray[np.float64]:
    """Return corrections (frames, markers; mm) smooth in time and no less than the penetration."""
    window = np.hanning(2 * half_width + 3)
    # the weighted mean of a running maximum over the same window is no less than the value itself
    maximum = running_maximum(penetration, half_width)
    padded = np.pad(maximum, ((half_width, half_width), (0, 0)), mode="edge")
    inside = np.arange(half_width, half_width + len(maximum))
    return symmetric_filter(padded, window[1:-1] / window.sum(), inside)


def _constant_distances(
    predicted: NDArray[np.float64],
    visible: NDArray[np.float64],
    spread: NDArray[np.float64],
    options: FloorOptions,
) -> DistanceTerms:
    """Return the terms that keep nearly constant distances as predicted."""
    points = np.concatenate([predicted, visible], axis=1)
    first, second = np.nonzero(np.triu(spread < options.max_spread, 1))
    length = norms(points[:, first] - points[:, second]).T  # (terms, frames)
    known = np.isfinite(length)
    tolerance = np.maximum(spread[first, second], options.min_spread)[:, None]
    return DistanceTerms(
        first,
        second,
        np.where(known, length, MIN_DISTANCE),
        np.where(known, 1.0 / tolerance**2, 0.0),
    )


def _raise_batch(
    predicted: NDArray[np.float64],
    variance: NDArray[np.float64],
    visible: NDArray[np.float64],
    terms: DistanceTerms,
    min_height: NDArray[np.float64],
    floor_std: float,
) -> NDArray[np.float64]:
    """Minimise the least squares for a batch of frames; ``min_height`` (frames, markers) in mm."""
    frames, markers = predicted.shape[:2]
    points = np.concatenate([predicted, visible], axis=1)

    def total(candidate: NDArray[np.float64]) -> NDArray[np.float64]:
        everything = np.concatenate([candidate, visible], axis=1)
        sunk = np.maximum(min_height - candidate[..., 2], 0.0)
        floor_term: NDArray[np.float64] = (sunk**2).sum(axis=1) / floor_std**2
        return energy(everything, predicted, variance, terms) + floor_term

    for _ in range(ITERATIONS):
        matrix, rhs = normal_equations(points, predicted, variance, terms)
        sunk = np.maximum(min_height - points[:, :markers, 2], 0.0)
        active = (sunk > 0) / floor_std**2
        for i in range(markers):
            matrix[:, i, 2, i, 2] += active[:, i]
        rhs[..., 2] += active * sunk
        step = gauss_newton_step(matrix, rhs)
        candidates = [points[:, :markers] + fraction * step for fraction in STEP_FRACTIONS]
        best = np.argmin([total(candidate) for candidate in candidates], axis=0)
        points[:, :markers] = np.array(candidates)[best, np.arange(frames)]
    return points[:, :markers]
