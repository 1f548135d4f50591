"""The least squares of predicted positions and distances, against finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from priorfill.constraints.distance_terms import (
    MIN_DISTANCE,
    DistanceTerms,
    coordinate_variance,
    energy,
    gauss_newton_step,
    normal_equations,
)

FRAMES, MISSING = 3, 3


def joined(terms):
    """The terms of a list, each with its markers, length and weight."""
    first, second, length, weight = zip(*terms, strict=True)
    frames = len(weight[0])
    length = [np.broadcast_to(each, frames) for each in length]
    return DistanceTerms(*map(np.array, (first, second, length, weight)))


def case(seed=0):
    """Points of three missing and two visible markers, predictions, variances, distance terms."""
    rng = np.random.default_rng(seed)
    points = rng.normal(0.0, 100.0, (FRAMES, MISSING + 2, 3))
    predicted = points[:, :MISSING] + rng.normal(0.0, 20.0, (FRAMES, MISSING, 3))
    variance = rng.uniform(10.0, 400.0, (FRAMES, MISSING))
    terms = [  # between missing markers, in both orders, and to visible ones
        (0, 1, 120.0, rng.uniform(0.01, 1.0, FRAMES)),
        (2, 0, rng.uniform(50.0, 200.0, FRAMES), rng.uniform(0.01, 1.0, FRAMES)),
        (1, 3, 80.0, rng.uniform(0.01, 1.0, FRAMES)),
        (2, 4, 150.0, np.array([0.5, 0.0, 0.3])),
    ]
    return points, predicted, variance, terms


def residuals(x, frame, points, predicted, variance, terms):
    """All terms of a frame, their squares to be summed, for missing markers at x (9,)."""
    places = [*x.reshape(MISSING, 3), *points[frame, MISSING:]]
    found = []
    for m in range(MISSING):
        found += list((places[m] - predicted[frame, m]) / np.sqrt(variance[frame, m]))
    for one, other, length, weight in terms:
        wanted = np.broadcast_to(length, FRAMES)[frame]
        apart = np.sqrt(sum((a - b) ** 2 for a, b in zip(places[one], places[other], strict=True)))
        found.append(np.sqrt(weight[frame]) * (apart - wanted))
    return np.array(found)


def jacobian(x, *arguments):
    columns = []
    for i in range(len(x)):
        ahead, behind = x.copy(), x.copy()
        ahead[i] += 1e-3
        behind[i] -= 1e-3
        columns.append((residuals(ahead, *arguments) - residuals(behind, *arguments)) / 2e-3)
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_energy_and_gauss_newton_step(seed):
    points, predicted, variance, terms = case(seed)
    total = energy(points, predicted, variance, joined(terms))
    matrix, rhs = normal_equations(points, predicted, variance, joined(terms))
    ahead = gauss_newton_step(matrix, rhs)
    for frame in range(FRAMES):
        x = points[frame, :MISSING].ravel()
        arguments = frame, points, predicted, variance, terms
        off, slope = residuals(x, *arguments), jacobian(x, *arguments)
        assert total[frame] == pytest.approx(off @ off)
        np.testing.assert_allclose(
            matrix[frame].reshape(9, 9), slope.T @ slope, rtol=1e-6, atol=1e-8
        )
        np.testing.assert_allclose(rhs[frame].ravel(), -slope.T @ off, rtol=1e-6, atol=1e-7)
        best = np.linalg.lstsq(slope, -off, rcond=None)[0]
        np.testing.assert_allclose(ahead[frame].ravel(), best, rtol=1e-5, atol=1e-6)


def test_variance_of_a_coordinate():
    np.testing.assert_allclose(coordinate_variance(np.array([[3.0, 0.6]])), [[3.0, 0.12]])
    assert coordinate_variance(np.zeros((1, 1)))[0, 0] == pytest.approx(1e-6 / 3.0)


def test_the_direction_between_close_markers_is_damped():
    points = np.zeros((1, 2, 3))
    points[0, 0, 0] = 0.5 * MIN_DISTANCE
    matrix, rhs = normal_equations(
        points, points[:, :1], np.ones((1, 1)), joined([(0, 1, 10.0, np.array([4.0]))])
    )
    # half a direction of the x axis, and the distance counts as 1 mm
    np.testing.assert_allclose(matrix[0, 0, :, 0], np.diag([1.0 + 4.0 * 0.25, 1.0, 1.0]))
    np.testing.assert_allclose(rhs[0, 0], [4.0 * 9.0 * 0.5, 0.0, 0.0])
