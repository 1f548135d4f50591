"""Soft distance constraints: the least squares shared by segment lengths and the floor.

In each frame the missing markers x are placed at the minimum of

    sum_i |x_i - p_i|² / σ_i²  +  sum_ij w_ij (|x_i - x_j| - L_ij)²

where p_i is the predicted position with standard deviation σ_i per coordinate, and each of the
`DistanceTerms` keeps two markers about L_ij apart with weight w_ij. This module computes the sum,
its Gauss-Newton normal equations and their solution; `priorfill.constraints.segment_lengths` and
`priorfill.constraints.floor` choose the terms and iterate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms
from priorfill.gp.linalg import solve_blocks

__all__ = [
    "MAX_CONSTRAINED_SPREAD",
    "MIN_DISTANCE",
    "DistanceTerms",
    "coordinate_variance",
    "energy",
    "gauss_newton_step",
    "normal_equations",
]

MAX_CONSTRAINED_SPREAD = 15.0
"""mm. Pairs of markers whose distance has a larger standard deviation are not constrained."""

MIN_DISTANCE = 1.0
"""mm. Closer markers count as this far apart, since the direction between them is undefined."""


class DistanceTerms(NamedTuple):
    """Soft constraints on the distances of pairs of markers, in each frame.

    Attributes
    ----------
    first, second : ndarray [shape=(terms,)]
        Columns of the two markers. The missing markers come before the visible ones, and
        ``first`` is a missing one.
    length : ndarray [shape=(terms, frames) or (terms, 1), mm]
        The distances wanted.
    weight : ndarray [shape=(terms, frames), 1 / mm²]
        Inverse variances of these distances; 0 where the constraint does not apply.
    """

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    length: NDArray[np.float64]
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
    terms: DistanceTerms,
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
    terms : DistanceTerms

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
    # frames are adjacent in memory: each sum below is one loop over them
    blocks = np.zeros((markers, 3, markers, 3, frames))
    for i in range(markers):
        blocks[i, :, i] = np.eye(3)[..., None] / variance[:, i]
    force = ((predicted - points[:, :markers]) / variance[..., None]).transpose(1, 2, 0).copy()
    difference = _differences(points, terms)
    distance = np.maximum(_lengths(difference), MIN_DISTANCE)
    direction = difference / distance[:, None]
    pull = (terms.weight * (terms.length - distance))[:, None] * direction
    weighted = terms.weight[:, None] * direction
    for term, (first, second) in enumerate(zip(terms.first, terms.second, strict=True)):
        curvature = weighted[term, :, None] * direction[term, None]
        blocks[first, :, first] += curvature
        force[first] += pull[term]
        if second < markers:
            blocks[second, :, second] += curvature
            blocks[first, :, second] -= curvature
            blocks[second, :, first] -= curvature
            force[second] -= pull[term]
    return blocks.transpose(4, 0, 1, 2, 3), force.transpose(2, 0, 1)


def energy(
    points: NDArray[np.float64],
    predicted: NDArray[np.float64],
    variance: NDArray[np.float64],
    terms: DistanceTerms,
) -> NDArray[np.float64]:
    """Return the sum of squares minimised by the steps [shape=(frames,)].

    Parameters as for `normal_equations`.
    """
    offset = points[:, : predicted.shape[1]] - predicted
    total: NDArray[np.float64] = (offset**2 / variance[..., None]).sum(axis=(1, 2))
    distance = _lengths(_differences(points, terms))
    for of_term in terms.weight * (distance - terms.length) ** 2:
        total += of_term  # one by one: the order of the sum is the same for any number of frames
    return total


def _differences(points: NDArray[np.float64], terms: DistanceTerms) -> NDArray[np.float64]:
    """Return the vectors between the markers of each term [shape=(terms, 3, frames), mm]."""
    by_marker = points.transpose(1, 2, 0).copy()
    difference: NDArray[np.float64] = by_marker[terms.first] - by_marker[terms.second]
    return difference


def _lengths(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of the vectors between markers [shape=(terms, frames), mm]."""
    return norms(np.moveaxis(vectors, 1, 2))


def gauss_newton_step(matrix: NDArray[np.float64], rhs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve `normal_equations` for a step [shape=(frames, missing markers, 3), mm]."""
    frames, markers = rhs.shape[:2]
    square = matrix.reshape(frames, markers * 3, markers * 3)
    return solve_blocks(square, rhs.reshape(frames, -1, 1)).reshape(frames, markers, 3)
