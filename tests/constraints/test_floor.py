"""No prediction lies below the floor."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from naive import turned
from scipy.optimize import least_squares

from priorfill.constraints.floor import (
    FloorOptions,
    enforce_floor,
)
from priorfill.errors import OptionError
from priorfill.formats import read
from priorfill.geometry.axes import to_upright
from priorfill.geometry.floor_heights import (
    FloorHeightOptions,
    floor_heights,
    is_stood_on,
)

RATE = 100.0
OPTIONS = FloorOptions()
HEIGHTS = FloorHeightOptions()


def leg(frames=60, seed=0):
    """Hip, knee, ankle, heel and toe of a leg over a floor at a height of 20 mm (frames, 5, 3)."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames) / RATE
    height = 20.0 + 80.0 * np.maximum(np.sin(2.0 * np.pi * time + rng.uniform(0, 6)), 0.0)
    points = np.zeros((frames, 5, 3))
    points[:, :, 0] = [0.0, 120.0, 0.0, -60.0, 140.0]
    points[:, :, 2] = np.array([820.0, 420.0, 80.0, 20.0, 0.0])
    points[:, 1:, 2] += height[:, None]
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


def corrected(predicted, hip, expected_rms=40.0, floor=FLOOR):
    deviations = np.full(predicted.shape[:2], expected_rms)
    return enforce_floor(predicted, deviations, hip, SPREAD, floor, RATE)


def test_a_foot_stays_above_its_floor_and_a_knee_has_none():
    clip = leg(frames=300)
    floor = floor_heights(clip, np.full(5, -1))
    assert floor[0] == floor[1] == -np.inf  # hip and knee are far above the ground
    np.testing.assert_allclose(floor[2:], FLOOR[1:], atol=1.0)


def test_one_bad_sample_does_not_lower_the_floor():
    clip = leg(frames=300)
    clip[17, 4, 2] = -400.0
    clip[18:40, 4] = np.nan
    assert floor_heights(clip, np.full(5, -1))[4] == pytest.approx(20.0, abs=1.0)


def test_a_marker_that_swings_low_has_no_floor():
    clip = np.concatenate([leg(frames=300), leg(frames=300)[:, :1]], axis=1)
    time = np.arange(300) / RATE
    clip[:, 5, 2] = 400.0 - 350.0 * np.maximum(np.sin(2.0 * np.pi * time), 0.0) ** 20
    assert clip[:, 5, 2].min() < HEIGHTS.max_height
    assert (clip[:, 5, 2] < clip[:, 5, 2].min() + HEIGHTS.rest_tolerance).mean() < 0.1
    clip[:, 5, 2][clip[:, 5, 2] < 60.0] += np.linspace(0.0, 300.0, (clip[:, 5, 2] < 60.0).sum())
    assert floor_heights(clip, np.full(6, -1))[5] == -np.inf


def test_a_hardly_visible_foot_has_the_floor_of_the_other_one():
    clip = np.concatenate([leg(frames=300), leg(frames=300)], axis=1)
    clip[10:, 9] = np.nan
    contralateral = np.r_[5:10, 0:5]
    floor = floor_heights(clip, contralateral)
    assert floor[9] == floor[4]
    assert floor_heights(clip, np.full(10, -1))[9] == -np.inf


def test_the_lower_foot_sets_the_floor_of_both():
    clip = np.concatenate([leg(frames=300), leg(frames=300)], axis=1)
    clip[:, 5:, 2] += 7.0
    floor = floor_heights(clip, np.r_[5:10, 0:5])
    np.testing.assert_array_equal(floor[:5], floor[5:])


def test_feet_stand_still_also_on_a_treadmill_and_where_frames_are_blank():
    clip = leg(frames=300)
    floor = floor_heights(clip, np.full(5, -1))
    assert is_stood_on(clip, floor, RATE)
    clip[..., 0] += 1300.0 * np.arange(300)[:, None] / RATE
    clip[1::2] = np.nan
    assert is_stood_on(clip, floor, RATE)
    assert not is_stood_on(clip, np.full(5, -np.inf), RATE)
    clip[:, 2:] = np.nan
    assert not is_stood_on(clip, floor, RATE)


def test_a_body_in_free_flight_stands_nowhere():
    time = np.arange(60) / RATE
    thrown = np.zeros((60, 5, 3))
    thrown[..., 2] = (4905.0 * (time - 0.3) ** 2)[:, None] + 30.0 * np.arange(5)
    floor = floor_heights(thrown, np.full(5, -1))
    assert np.isfinite(floor).all()
    assert not is_stood_on(thrown, floor, RATE)
    # two samples at the lowest point are slow; a third one makes 4 %
    thrown[:5] = thrown[30]
    assert not is_stood_on(thrown, floor, RATE)
    thrown[5] = thrown[30]
    assert is_stood_on(thrown, floor, RATE)
    blank = np.full((120, 5, 3), np.nan)
    blank[::2] = thrown
    assert is_stood_on(blank, floor, 2 * RATE)
    thrown[6:8] = thrown[30]
    assert is_stood_on(thrown, floor - 9.0, RATE)
    assert not is_stood_on(thrown, floor - 11.0, RATE)


@pytest.mark.realdata
@pytest.mark.parametrize(
    "name",
    ["gait/HC040A40.c3d", "cmu/127_07.c3d", "hdm05/HDM_dg_06-03_03_120.c3d", "walkl/WalkL.c3d"],
)
def test_recorded_feet_stand_on_the_floor(data, name):
    """The recording of each folder whose feet stand for the shortest time."""
    clip = read(data / name)
    positions = to_upright(clip.positions, clip.up)
    floor = floor_heights(positions, np.full(len(clip.labels), -1))
    assert is_stood_on(positions, floor, clip.rate)
    assert is_stood_on(positions[::2], floor, clip.rate / 2)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**31), st.floats(1.0, 60.0), st.floats(10.0, 80.0))
def test_nothing_stays_below_the_floor(seed, depth, expected_rms):
    clip = leg(seed=seed % 1000)
    rng = np.random.default_rng(seed)
    predicted = clip[:, 1:] + rng.normal(0.0, 3.0, (1, 4, 3))
    predicted[..., 2] -= min(depth, OPTIONS.max_penetration_std * expected_rms) * rng.uniform(
        0.0, 1.0, (60, 1)
    )
    found = corrected(predicted, clip[:, :1], expected_rms)
    # the soft floor yields a little to the predictions of all four markers
    yielding = 4 * (depth + 10.0) / (expected_rms**2 / 3.0)
    assert (found[..., 2] > FLOOR - 1.0 - yielding * OPTIONS.floor_std**2).all()


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31))
def test_what_is_above_the_floor_stays(seed):
    clip = leg(seed=seed % 1000)
    predicted = clip[:, 1:] + [0.0, 0.0, 1e-9]
    assert corrected(predicted, clip[:, :1]) is predicted
    sunk = predicted.copy()
    sunk[30, 3, 2] = 5.0
    found = corrected(sunk, clip[:, :1])
    moved = (found != sunk).any(axis=(1, 2))
    assert moved[30]
    assert not moved[:24].any()
    assert not moved[37:].any()
    assert (found[30, 3, 2] - 20.0) > -1.0


def test_the_limb_follows_and_keeps_its_lengths():
    clip = leg()
    sunk = clip[:, 1:].copy()
    sunk[:, 1:, 2] -= 30.0  # a leg that is too long, foot and all
    found = corrected(sunk, clip[:, :1])

    def lengths(points):
        return np.linalg.norm(np.diff(points[:, 1:], axis=1), axis=2)

    np.testing.assert_allclose(lengths(found), lengths(sunk), atol=2.0)
    shin = [np.linalg.norm(x[:, 0] - x[:, 1], axis=1) for x in (found, sunk)]
    assert np.abs(shin[0] - shin[1]).mean() < 0.4 * 30.0
    assert np.linalg.norm(found[:, 0] - sunk[:, 0], axis=1).max() > 1.0  # the knee gives way


def test_the_correction_turns_and_moves_with_the_body():
    clip = leg()
    rng = np.random.default_rng(3)
    predicted = clip[:, 1:] + rng.normal(0.0, 10.0, (60, 4, 3))
    shift = np.array([500.0, -2000.0, 0.0])
    found = corrected(predicted, clip[:, :1])
    assert (found != predicted).any()
    moved = corrected(turned(predicted, 1.1, shift), turned(clip[:, :1], 1.1, shift))
    np.testing.assert_allclose(moved, turned(found, 1.1, shift), atol=1e-7)


def test_predictions_far_below_the_floor_are_not_corrected():
    clip = leg()
    lower = clip[:, 1:] - [
        0.0,
        0.0,
        OPTIONS.max_penetration + OPTIONS.max_penetration_std * 5.0 + 1.0 + 80.0,
    ]
    assert corrected(lower, clip[:, :1], expected_rms=5.0) is lower


# the same seeds each time: 2 in 1000 of these legs need more steps than are made
@settings(deadline=None, max_examples=10, derandomize=True)
@given(st.integers(0, 2**31))
@example(336234)
def test_the_result_minimises_the_least_squares(seed):
    rng = np.random.default_rng(seed)
    clip = leg(frames=1, seed=seed % 1000)
    predicted = clip[:, 1:] + rng.normal(0.0, 5.0, (1, 4, 3)) - [0.0, 0.0, 40.0]
    expected_rms = rng.uniform(30.0, 60.0, (1, 4))
    found = enforce_floor(predicted, expected_rms, clip[:, :1], SPREAD, FLOOR, RATE)[0]
    pairs = [(i, j) for i, j in np.argwhere(SPREAD < 15.0) if j > i]

    def terms(x):
        points = np.concatenate([x.reshape(4, 3), clip[0, :1]])
        origin = np.concatenate([predicted[0], clip[0, :1]])
        off = [
            (np.linalg.norm(points[i] - points[j]) - np.linalg.norm(origin[i] - origin[j]))
            / max(SPREAD[i, j], OPTIONS.min_spread)
            for i, j in pairs
        ]
        sunk = np.maximum(FLOOR[1:] - points[1:4, 2], 0.0) / OPTIONS.floor_std
        away = (points[:4] - predicted[0]) / (expected_rms[0] / np.sqrt(3.0))[:, None]
        return np.concatenate([away.ravel(), off, sunk])

    best = least_squares(terms, found.ravel(), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert (terms(found.ravel()) ** 2).sum() < 1.1 * 2.0 * best.cost + 1e-3


def test_missing_markers_impose_no_distances():
    clip = leg()
    sunk = clip[:, 1:] - [0.0, 0.0, 25.0]
    found = corrected(sunk, np.full((60, 1, 3), np.nan))
    assert np.isfinite(found).all()
    assert (found[..., 2] > FLOOR - 2.0).all()


def test_a_raised_toe_does_not_tilt_the_heel_into_the_floor():
    foot = np.zeros((1, 3, 3))  # ankle with a small expected error, heel and toe
    foot[0, :, 0] = [0.0, -60.0, 140.0]
    foot[0, :, 2] = [100.0, 20.0, -20.0]
    expected_rms = np.array([[5.0, 60.0, 60.0]])

    def found(heel, spread=OPTIONS.min_spread):
        floor, spreads = np.array([-np.inf, heel, 10.0]), np.full((3, 3), spread)
        return enforce_floor(foot, expected_rms, np.empty((1, 0, 3)), spreads, floor, RATE)[0, :, 2]

    assert found(20.0)[2] > 9.0
    assert found(20.0)[1] > 19.0
    assert found(-np.inf)[1] < 15.0  # a heel without a floor turns about the ankle
    np.testing.assert_array_equal(found(20.0, 0.0), found(20.0))  # no distance is held more tightly
    assert (np.abs(found(20.0, 2.0 * OPTIONS.min_spread) - found(20.0)) > 1e-3).any()


def test_the_limit_of_the_penetration():
    clip = leg()
    depth = OPTIONS.max_penetration + OPTIONS.max_penetration_std * 5.0
    for more, stays in ((-0.01, False), (0.01, True)):
        sunk = clip[:, 1:].copy()
        sunk[30, 3, 2] = FLOOR[3] - depth - more
        found = corrected(sunk, clip[:, :1], expected_rms=5.0)
        assert (found is sunk) == stays


def test_a_marker_far_below_its_floor_is_unchanged_while_others_are_raised():
    clip = leg()
    sunk = clip[:, 1:].copy()
    sunk[30, 3, 2] -= 1000.0  # more than the limit
    sunk[10, 2, 2] = FLOOR[2] - 15.0
    rms = np.full((60, 4), 5.0)
    found = enforce_floor(sunk, rms, clip[:, :1], np.full((4, 5), 99.0), FLOOR, RATE)
    np.testing.assert_allclose(found[:, 3], sunk[:, 3], atol=1e-9)
    assert found[10, 2, 2] > FLOOR[2] - 3.0


def test_a_floor_needs_samples_at_rest():
    none = np.full(3, -1)
    clip = np.zeros((100, 3, 3))
    clip[..., 2] = 500.0
    clip[:, 0, 2] = 10.0
    rest = round(HEIGHTS.min_rest_share * 100)
    clip[: rest - 1, 1, 2] = 10.0 + HEIGHTS.max_height  # too few
    clip[:rest, 2, 2] = 10.0 + HEIGHTS.max_height
    np.testing.assert_allclose(
        floor_heights(clip, none), [10.0, -np.inf, 10.0 + HEIGHTS.max_height]
    )
    clip[..., 2] = 10.0 + HEIGHTS.max_height * np.array([0.0, 0.999, 1.001])  # too high
    np.testing.assert_allclose(
        floor_heights(clip, none), [10.0, 10.0 + 0.999 * HEIGHTS.max_height, -np.inf]
    )
    clip[HEIGHTS.min_samples :, 0] = np.nan
    assert floor_heights(clip, none)[2] == -np.inf
    clip[0, 0] = np.nan  # too few samples for a floor, or for the ground
    expected = [-np.inf, *(10.0 + HEIGHTS.max_height * np.array([0.999, 1.001]))]
    np.testing.assert_allclose(floor_heights(clip, none), expected)


def test_the_correction_is_smooth_in_time():
    rate = 200.0
    reach = round(OPTIONS.ramp_seconds * rate)
    heights = np.full(60, 50.0)
    heights[[30, 33]] = 5.0, 14.0
    predicted = np.zeros((60, 1, 3))
    predicted[:, 0, 2] = heights
    unsure = np.full((60, 1), 1e4)
    found = enforce_floor(
        predicted, unsure, np.empty((60, 0, 3)), np.zeros((1, 1)), np.array([20.0]), rate
    )
    below = np.maximum(20.0 - heights, 0.0)
    greatest = [below[max(t - reach, 0) : t + reach + 1].max() for t in range(60)]
    window = np.sin(np.pi * np.arange(1, 2 * reach + 2) / (2 * reach + 2)) ** 2
    for t in range(2 * reach, 60 - 2 * reach):
        wanted = np.average(greatest[t - reach : t + reach + 1], weights=window)
        assert wanted >= below[t]
        assert found[t, 0, 2] == pytest.approx(heights[t] + wanted, abs=1e-5)


@pytest.mark.parametrize("wrong", [{"floor_std": 0.0}, {"max_penetration": -1.0}])
def test_floor_options_out_of_range_are_rejected(wrong):
    (name,) = wrong
    with pytest.raises(OptionError, match=f"FloorOptions.{name} is"):
        FloorOptions(**wrong)


def test_floor_options_are_used():
    clip = leg()
    sunk = clip[:, 1:].copy()
    sunk[30, 3, 2] = 5.0
    rms = np.full((60, 4), 40.0)

    def raised(**options):
        options = FloorOptions(**options)
        return enforce_floor(sunk, rms, clip[:, :1], SPREAD, FLOOR, RATE, options)

    assert raised(max_penetration_std=0.0, max_penetration=14.0) is sunk
    assert raised()[30, 3, 2] > raised(floor_std=50.0)[30, 3, 2] + 1.0
    changed = [(raised(ramp_seconds=s) != sunk).any(axis=(1, 2)).sum() for s in (0.0, 0.1)]
    assert changed[0] == 1
    assert changed[1] > 20
