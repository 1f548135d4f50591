"""Soft distance constraints: the least squares shared by segment lengths and the floor.

In each frame the missing markers x are placed at the minimum of

    sum_i |x_i - p_i|² / σ_i²  +  sum_ij w_ij (|x_i - x_j| - L_ij)²

where p_i is the predicted position with standard deviation σ_i per coordinate, and every
`DistanceTerm` keeps two markers about L_ij apart with weight w_ij. This module computes the sum,
its Gauss-Newton normal equations and their solution; `priorfill.constraints.segment_lengths` and
`priorfill.constraints.floor` choose the terms and iterate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms
from priorfill.gp.linalg import solve_blocks

__all__ = [
    "MAX_CONSTRAINED_SPREAD",
    "MIN_DISTANCE",
    "DistanceTerm",
    "coordinate_variance",
    "energy",
    "gauss_newton_step",
    "normal_equations",
]

MAX_CONSTRAINED_SPREAD = 15.0
"""mm. Pairs of markers whose distance has a larger standard deviation are not constrained."""

MIN_DISTANCE = 1.0
"""mm. Closer markers count as this far apart, since the direction between them is undefined."""


class DistanceTerm(NamedTuple):
    """One soft constraint on the distance of two markers, in each frame.

    Attributes
    ----------
    first, second : int
        Columns of the two markers. The missing markers come before the visible ones, and
        ``first`` is a missing one.
    length : ndarray [shape=(frames,), mm] or float
        The distance wanted.
    weight : ndarray [shape=(frames,), 1 / mm²]
        Inverse variance of that distance; 0 where the constraint does not apply.
    """

    first: int
    second: int
    length: NDArray[np.float64] | float
    weight: NDArray[np.float64]


def coordinate_variance(expected_rms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance of a single coordinate, given rms Euclidean errors.

    Parameters
    ----------
    expected_rms : ndarray [mm]

    Returns
    -------
    ndarray [shape as given, mm²]
        A third of the squared error, at least a third of (1 µm)².

    Examples
    --------
    >>> coordinate_variance(np.array([3.0, 6.0]))
    array([ 3., 12.])
    """
    variance: NDArray[np.float64] = np.maximum(expected_rms**2, 1e-6) / 3.0
    return variance


def normal_equations(
    points: NDArray[np.float64],
    predicted: NDArray[np.float64],
    variance: NDArray[np.float64],
    terms: Sequence[DistanceTerm],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the matrix and right-hand side of a Gauss-Newton step.

    Parameters
    ----------
    points : ndarray [shape=(frames, missing and visible markers, 3), mm]
        Current positions; the missing markers come first.
    predicted : ndarray [shape=(frames, missing markers, 3), mm]
        Predicted positions.
    variance : ndarray [shape=(frames, missing markers), mm²]
        Variance of a predicted coordinate.
    terms : sequence of DistanceTerm

    Returns
    -------
    matrix : ndarray [shape=(frames, missing markers, 3, missing markers, 3), 1 / mm²]
    rhs : ndarray [shape=(frames, missing markers, 3), 1 / mm]
        Half of the negative gradient of `energy`.

    See Also
    --------
    gauss_newton_step : Solves them.
    """
    frames, markers = predicted.shape[:2]
    matrix = np.zeros((frames, markers, 3, markers, 3))
    for i in range(markers):
        matrix[:, i, :, i, :] = np.eye(3) / variance[:, i, None, None]
    rhs = (predicted - points[:, :markers]) / variance[..., None]
    for first, second, length, weight in terms:
        difference = points[:, first] - points[:, second]
        distance = np.maximum(norms(difference), MIN_DISTANCE)
        direction = difference / distance[:, None]
        curvature = weight[:, None, None] * direction[:, :, None] * direction[:, None, :]
        force = (weight * (length - distance))[:, None] * direction
        matrix[:, first, :, first, :] += curvature
        rhs[:, first] += force
        if second < markers:
            matrix[:, second, :, second, :] += curvature
            matrix[:, first, :, second, :] -= curvature
            matrix[:, second, :, first, :] -= curvature
            rhs[:, second] -= force
    return matrix, rhs


def energy(
    points: NDArray[np.float64],
    predicted: NDArray[np.float64],
    variance: NDArray[np.float64],
    terms: Sequence[DistanceTerm],
) -> NDArray[np.float64]:
    """Return the sum of squares minimised by the steps [shape=(frames,)].

    Parameters as for `normal_equations`.
    """
    offset = points[:, : predicted.shape[1]] - predicted
    total: NDArray[np.float64] = (offset**2 / variance[..., None]).sum(axis=(1, 2))
    for first, second, length, weight in terms:
        distance = norms(points[:, first] - points[:, second])
        total += weight * (distance - length) ** 2
    return total


def gauss_newton_step(matrix: NDArray[np.float64], rhs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve `normal_equations` for a step [shape=(frames, missing markers, 3), mm]."""
    frames, markers = rhs.shape[:2]
    square = matrix.reshape(frames, markers * 3, markers * 3)
    return solve_blocks(square, rhs.reshape(frames, -1, 1)).reshape(frames, markers, 3)
