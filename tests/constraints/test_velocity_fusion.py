"""Positions and velocities are fused."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.constraints.velocity_fusion import (
    VelocityFusionOptions,
    fuse_velocity,
)
from priorfill.gp.velocities import (
    VelocityErrorOptions,
    VelocityPrediction,
    error_by_speed,
)

OPTIONS = VelocityFusionOptions()


def some(seed, frames=12, markers=2):
    """Return predicted positions, predicted velocities and measured samples at 100 Hz."""
    rng = np.random.default_rng(seed)
    positions = rng.normal(0, 100, (frames, markers, 3)).cumsum(axis=0)
    motion = VelocityPrediction(
        rng.normal(0, 500, (frames, markers, 3)),
        rng.uniform(100, 500, (frames, markers)),
        rng.uniform(5, 50, markers),
    )
    measured = positions + rng.normal(0, 30, positions.shape)
    measured[rng.random((frames, markers)) < 0.8] = np.nan
    return positions, motion, measured


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**31))
def test_the_result_minimises_the_least_squares(seed):
    """Against a dense least squares, a coordinate at a time."""
    positions, motion, measured = some(seed)
    found = fuse_velocity(positions, motion, measured, 100.0)
    frames, markers = positions.shape[:2]
    for m in range(markers):
        for i in range(3):
            equations, side = [], []
            slope = np.gradient(positions[:, m, i]) * 100.0
            expected = motion.expected_rms[:, m]
            ratio = expected / (motion.position_rms[m] / OPTIONS.error_time)
            of_velocity = 1 / (expected**2 * (1 + (ratio / OPTIONS.half_weight_ratio) ** 2))
            of_derivative = (OPTIONS.error_time / motion.position_rms[m]) ** 2
            of_derivative /= 1 + (motion.position_rms[m] / OPTIONS.slow_error) ** 2
            u = (of_velocity * motion.velocity[:, m, i] + of_derivative * slope) / (
                of_velocity + of_derivative
            )
            for t in range(frames):
                known = not np.isnan(measured[t, m, i])
                error = OPTIONS.measured_std if known else motion.position_rms[m]
                equations.append(np.eye(frames)[t] / error)
                side.append((measured if known else positions)[t, m, i] / error)
                if t + 1 < frames:
                    weight = np.sqrt((of_velocity[t] + of_velocity[t + 1]) / 2 + of_derivative)
                    equations.append((np.eye(frames)[t + 1] - np.eye(frames)[t]) * 100 * weight)
                    side.append((u[t] + u[t + 1]) / 2 * weight)
            expected = np.linalg.lstsq(np.array(equations), np.array(side), rcond=None)[0]
            np.testing.assert_allclose(found[:, m, i], expected, rtol=1e-6, atol=1e-4)


def test_a_standing_foot_stays_where_it_is_measured():
    """Positions are off by 30 mm in changing directions, but the foot is known to stand."""
    t = np.arange(60)
    wrong = 30.0 * np.stack([np.cos(t / 6), np.sin(t / 6), 0.0 * t], axis=1)[:, None]
    measured = np.full((60, 1, 3), np.nan)
    measured[:3] = measured[-3:] = 0.0
    motion = VelocityPrediction(np.zeros((60, 1, 3)), np.full((60, 1), 10.0), np.array([30.0]))
    found = fuse_velocity(wrong, motion, measured, 100.0)
    assert np.linalg.norm(found, axis=2).max() < 6.0
    unsure = VelocityPrediction(motion.velocity, np.full((60, 1), 1e4), motion.position_rms)
    assert np.linalg.norm(fuse_velocity(wrong, unsure, measured, 100.0), axis=2)[10:50].min() > 20.0


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**31))
def test_measured_samples_are_held(seed):
    positions, motion, measured = some(seed)
    found = fuse_velocity(positions, motion, measured, 100.0)
    known = ~np.isnan(measured)
    np.testing.assert_allclose(found[known], measured[known], atol=2.0)


def test_consistent_predictions_are_unchanged():
    t = np.arange(20)[:, None, None] / 100.0
    velocity = np.broadcast_to([100.0, -50.0, 20.0], (20, 1, 3))
    motion = VelocityPrediction(velocity, np.full((20, 1), 30.0), np.array([10.0]))
    positions = velocity * t
    nothing = np.full_like(positions, np.nan)
    np.testing.assert_allclose(
        fuse_velocity(positions, motion, nothing, 100.0), positions, atol=1e-6
    )


def test_a_clip_that_stands_still_has_no_errors():
    positions = np.ones((5, 1, 3))
    still = VelocityPrediction(np.zeros((5, 1, 3)), np.zeros((5, 1)), np.zeros(1))
    nothing = np.full_like(positions, np.nan)
    np.testing.assert_allclose(fuse_velocity(positions, still, nothing, 100.0), 1.0)
    one = VelocityPrediction(np.zeros((1, 1, 3)), np.zeros((1, 1)), np.zeros(1))
    np.testing.assert_array_equal(fuse_velocity(positions[:1], one, nothing[:1], 100.0), 1.0)


def test_slow_markers_have_smaller_errors():
    rng = np.random.default_rng(0)
    fast = np.repeat([False, True], 200)
    predicted = np.where(fast, 1000.0, 0.0)[:, None, None] * np.array([1.0, 0, 0])
    wrong = rng.normal(0, 1, (400, 1, 3)) * np.where(fast, 200.0, 10.0)[:, None, None]
    velocity = np.array([[[0.0, 0, 0]], [[0, 1000.0, 0]], [[50000.0, 0, 0]]])
    slow, quick, unseen = error_by_speed(velocity, predicted, wrong)[:, 0]
    assert slow == pytest.approx(10.0 * np.sqrt(3), rel=0.2)
    assert quick == pytest.approx(200.0 * np.sqrt(3), rel=0.2)
    assert unseen == pytest.approx(np.sqrt((wrong**2).sum(axis=2).mean()))


@given(st.integers(0, 2**31))
@settings(deadline=None, max_examples=25)
def test_errors_by_speed_are_a_weighted_mean(seed):
    rng = np.random.default_rng(seed)
    velocity, predicted, wrong = (rng.normal(0, 300, (n, 2, 3)) for n in (4, 9, 9))
    found = error_by_speed(velocity, predicted, wrong)
    for m in range(2):
        speeds = [np.linalg.norm(v) for v in predicted[:, m]]
        width = max(
            VelocityErrorOptions.relative_bandwidth * np.median(speeds),
            VelocityErrorOptions.min_bandwidth,
        )
        for q in range(4):
            weights = [
                np.exp(-(((np.linalg.norm(velocity[q, m]) - s) / width) ** 2) / 2) + 1e-6
                for s in speeds
            ]
            square = np.average([x @ x for x in wrong[:, m]], weights=weights)
            assert found[q, m] == pytest.approx(np.sqrt(square))


def test_poses_are_compared_in_batches():
    rng = np.random.default_rng(2)
    velocity, predicted, wrong = (rng.normal(0, 300, (n, 2, 3)) for n in (11, 9, 9))
    complete = error_by_speed(velocity, predicted, wrong)
    with mock.patch("priorfill.gp.velocities.BATCH_SIZE", 4):
        np.testing.assert_array_equal(error_by_speed(velocity, predicted, wrong), complete)
