"""Feet stay out of the floor."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from naive import turned
from scipy.optimize import least_squares

from priorfill.floor import (
    ANYHOW,
    DISBELIEF,
    FIRMNESS,
    LEAST_SPREAD,
    NEAR,
    STANDING,
    floor_heights,
    lift,
)

RATE = 100.0


def leg(frames=60, seed=0):
    """Hip, knee, ankle, heel and toe of a leg over a floor at a height of 20 mm (frames, 5, 3)."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames) / RATE
    lifted = 20.0 + 80.0 * np.maximum(np.sin(2.0 * np.pi * time + rng.uniform(0, 6)), 0.0)
    points = np.zeros((frames, 5, 3))
    points[:, :, 0] = [0.0, 120.0, 0.0, -60.0, 140.0]
    points[:, :, 2] = np.array([820.0, 420.0, 80.0, 20.0, 0.0])
    points[:, 1:, 2] += lifted[:, None]
    return points


SPREAD = np.array(  # of knee, ankle, heel and toe, with these and the hip
    [
        [0.0, 5.0, 30.0, 30.0, 5.0],
        [5.0, 0.0, 2.0, 2.0, 40.0],
        [30.0, 2.0, 0.0, 2.0, 40.0],
        [30.0, 2.0, 2.0, 0.0, 40.0],
    ]
)
FLOOR = np.array([-np.inf, 100.0, 40.0, 20.0])


def lifted(predicted, hip, deviation=40.0, floor=FLOOR):
    deviations = np.full(predicted.shape[:2], deviation)
    return lift(predicted, deviations, hip, SPREAD, floor, RATE)


def test_a_foot_stays_above_its_floor_and_a_knee_has_none():
    clip = leg(frames=300)
    floor = floor_heights(clip, np.full(5, -1))
    assert floor[0] == floor[1] == -np.inf  # hip and knee are far above the ground
    np.testing.assert_allclose(floor[2:], FLOOR[1:], atol=1.0)


def test_one_bad_sample_is_no_floor():
    clip = leg(frames=300)
    clip[17, 4, 2] = -400.0
    clip[18:40, 4] = np.nan
    assert floor_heights(clip, np.full(5, -1))[4] == pytest.approx(20.0, abs=1.0)


def test_what_swings_low_for_a_moment_has_no_floor():
    clip = np.concatenate([leg(frames=300), leg(frames=300)[:, :1]], axis=1)
    time = np.arange(300) / RATE
    clip[:, 5, 2] = 400.0 - 350.0 * np.maximum(np.sin(2.0 * np.pi * time), 0.0) ** 20
    assert clip[:, 5, 2].min() < STANDING
    assert (clip[:, 5, 2] < clip[:, 5, 2].min() + NEAR).mean() < 0.1
    clip[:, 5, 2][clip[:, 5, 2] < 60.0] += np.linspace(0.0, 300.0, (clip[:, 5, 2] < 60.0).sum())
    assert floor_heights(clip, np.full(6, -1))[5] == -np.inf


def test_a_foot_that_is_hardly_seen_has_its_partners_floor():
    clip = np.concatenate([leg(frames=300), leg(frames=300)], axis=1)
    clip[10:, 9] = np.nan
    partner = np.r_[5:10, 0:5]
    floor = floor_heights(clip, partner)
    assert floor[9] == floor[4]
    assert floor_heights(clip, np.full(10, -1))[9] == -np.inf


def test_the_lower_of_two_feet_says_how_low_both_go():
    clip = np.concatenate([leg(frames=300), leg(frames=300)], axis=1)
    clip[:, 5:, 2] += 7.0
    floor = floor_heights(clip, np.r_[5:10, 0:5])
    np.testing.assert_array_equal(floor[:5], floor[5:])


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**31), st.floats(1.0, 60.0), st.floats(10.0, 80.0))
def test_nothing_stays_below_the_floor(seed, depth, deviation):
    clip = leg(seed=seed % 1000)
    rng = np.random.default_rng(seed)
    predicted = clip[:, 1:] + rng.normal(0.0, 3.0, (1, 4, 3))
    predicted[..., 2] -= min(depth, DISBELIEF * deviation) * rng.uniform(0.0, 1.0, (60, 1))
    found = lifted(predicted, clip[:, :1], deviation)
    # the floor gives way a little against the pull of what was predicted of all four markers
    pull = 4 * (depth + 10.0) / (deviation**2 / 3.0)
    assert (found[..., 2] > FLOOR - 1.0 - pull * FIRMNESS**2).all()


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31))
def test_what_is_above_the_floor_stays(seed):
    clip = leg(seed=seed % 1000)
    predicted = clip[:, 1:] + [0.0, 0.0, 1e-9]
    assert lifted(predicted, clip[:, :1]) is predicted
    sunk = predicted.copy()
    sunk[30, 3, 2] = 5.0
    found = lifted(sunk, clip[:, :1])
    moved = (found != sunk).any(axis=(1, 2))
    assert moved[30]
    assert not moved[:24].any()
    assert not moved[37:].any()
    assert (found[30, 3, 2] - 20.0) > -1.0


def test_the_limb_follows_and_keeps_its_lengths():
    clip = leg()
    sunk = clip[:, 1:].copy()
    sunk[:, 1:, 2] -= 30.0  # a leg that is too long, foot and all
    found = lifted(sunk, clip[:, :1])

    def lengths(points):
        return np.linalg.norm(np.diff(points[:, 1:], axis=1), axis=2)

    np.testing.assert_allclose(lengths(found), lengths(sunk), atol=2.0)
    shin = [np.linalg.norm(x[:, 0] - x[:, 1], axis=1) for x in (found, sunk)]
    assert np.abs(shin[0] - shin[1]).mean() < 0.4 * 30.0
    assert np.linalg.norm(found[:, 0] - sunk[:, 0], axis=1).max() > 1.0  # the knee gives way


def test_a_lift_turns_and_moves_with_the_body_over_the_floor():
    clip = leg()
    rng = np.random.default_rng(3)
    predicted = clip[:, 1:] + rng.normal(0.0, 10.0, (60, 4, 3))
    shift = np.array([500.0, -2000.0, 0.0])
    found = lifted(predicted, clip[:, :1])
    assert (found != predicted).any()
    moved = lifted(turned(predicted, 1.1, shift), turned(clip[:, :1], 1.1, shift))
    np.testing.assert_allclose(moved, turned(found, 1.1, shift), atol=1e-7)


def test_a_stair_is_no_floor():
    clip = leg()
    lower = clip[:, 1:] - [0.0, 0.0, ANYHOW + DISBELIEF * 5.0 + 1.0 + 80.0]
    assert lifted(lower, clip[:, :1], deviation=5.0) is lower


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**31))
@example(336234)
def test_it_is_the_minimum_of_its_least_squares(seed):
    rng = np.random.default_rng(seed)
    clip = leg(frames=1, seed=seed % 1000)
    predicted = clip[:, 1:] + rng.normal(0.0, 5.0, (1, 4, 3)) - [0.0, 0.0, 40.0]
    deviation = rng.uniform(30.0, 60.0, (1, 4))
    found = lift(predicted, deviation, clip[:, :1], SPREAD, FLOOR, RATE)[0]
    pairs = [(i, j) for i, j in np.argwhere(SPREAD < 15.0) if j > i]

    def terms(x):
        points = np.concatenate([x.reshape(4, 3), clip[0, :1]])
        origin = np.concatenate([predicted[0], clip[0, :1]])
        off = [
            (np.linalg.norm(points[i] - points[j]) - np.linalg.norm(origin[i] - origin[j]))
            / max(SPREAD[i, j], LEAST_SPREAD)
            for i, j in pairs
        ]
        sunk = np.maximum(FLOOR[1:] - points[1:4, 2], 0.0) / FIRMNESS
        away = (points[:4] - predicted[0]) / (deviation[0] / np.sqrt(3.0))[:, None]
        return np.concatenate([away.ravel(), off, sunk])

    best = least_squares(terms, found.ravel(), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert (terms(found.ravel()) ** 2).sum() < 1.1 * 2.0 * best.cost + 1e-3


def test_markers_that_are_not_measured_take_no_part():
    clip = leg()
    sunk = clip[:, 1:] - [0.0, 0.0, 25.0]
    found = lifted(sunk, np.full((60, 1, 3), np.nan))
    assert np.isfinite(found).all()
    assert (found[..., 2] > FLOOR - 2.0).all()
