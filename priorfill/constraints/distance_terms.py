"""Markers on springs: the least squares in which predictions and distances pull at each other.

What is predicted pulls each missing marker to its place, and edges pull at pairs of markers whose
distance is known. `priorfill.constraints.segment_lengths` and `priorfill.constraints.floor` choose
the edges and take the steps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms

__all__ = [
    "LEAST_LENGTH",
    "STIFF",
    "DistanceTerm",
    "coordinate_variance",
    "energy",
    "normal_equations",
    "step",
]

STIFF = 15.0
"""mm. Distances that vary by more (rms) have no spring."""

LEAST_LENGTH = 1.0
"""mm. Markers nearer to each other have no direction."""

DistanceTerm = tuple[int, int, NDArray[np.float64] | float, NDArray[np.float64]]
"""Columns of two markers, the first of them missing; length (mm) and weight (1 / mm²) by frame."""


def coordinate_variance(expected_rms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance of a coordinate (mm²) by the rms Euclidean error (mm)."""
    variance: NDArray[np.float64] = np.maximum(expected_rms**2, 1e-6) / 3.0
    return variance


def normal_equations(
    points: NDArray[np.float64],
    predicted: NDArray[np.float64],
    variance: NDArray[np.float64],
    springs: Sequence[DistanceTerm],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return matrix and right-hand side of a Gauss-Newton step.

    Parameters
    ----------
    points : ndarray [shape=(frames, missing and visible markers, 3), mm]
        Where they are; the missing markers come first.
    predicted : ndarray [shape=(frames, missing markers, 3), mm]
        Where they are predicted.
    variance : ndarray [shape=(frames, missing markers), mm²]
        Of a coordinate of what is predicted.
    springs : sequence of Spring

    Returns
    -------
    matrix : ndarray [shape=(frames, missing markers, 3, missing markers, 3)]
    force : ndarray [shape=(frames, missing markers, 3)]
    """
    frames, markers = predicted.shape[:2]
    matrix = np.zeros((frames, markers, 3, markers, 3))
    for i in range(markers):
        matrix[:, i, :, i, :] = np.eye(3) / variance[:, i, None, None]
    force = (predicted - points[:, :markers]) / variance[..., None]
    for one, other, length, weight in springs:
        apart = points[:, one] - points[:, other]
        far = np.maximum(norms(apart), LEAST_LENGTH)
        along = apart / far[:, None]
        stiffness = weight[:, None, None] * along[:, :, None] * along[:, None, :]
        pull = (weight * (length - far))[:, None] * along
        matrix[:, one, :, one, :] += stiffness
        force[:, one] += pull
        if other < markers:
            matrix[:, other, :, other, :] += stiffness
            matrix[:, one, :, other, :] -= stiffness
            matrix[:, other, :, one, :] -= stiffness
            force[:, other] -= pull
    return matrix, force


def energy(
    points: NDArray[np.float64],
    predicted: NDArray[np.float64],
    variance: NDArray[np.float64],
    springs: Sequence[DistanceTerm],
) -> NDArray[np.float64]:
    """Return the sum of squares that the steps of `normal_equations` lessen [shape=(frames,)]."""
    away = points[:, : predicted.shape[1]] - predicted
    total: NDArray[np.float64] = (away**2 / variance[..., None]).sum(axis=(1, 2))
    for one, other, length, weight in springs:
        far = norms(points[:, one] - points[:, other])
        total += weight * (far - length) ** 2
    return total


def step(matrix: NDArray[np.float64], force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve for a step [shape=(frames, missing markers, 3), mm]."""
    frames, markers = force.shape[:2]
    square = matrix.reshape(frames, markers * 3, markers * 3)
    solved = np.linalg.solve(square, force.reshape(frames, -1, 1))
    return solved.reshape(frames, markers, 3).astype(np.float64, copy=False)
