"""Predictions have no more jitter than the measured trajectory."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.errors import OptionError
from priorfill.signal.smoothing import (
    DIFFERENCE_ORDER,
    SmoothingOptions,
    jitter_power,
    low_pass,
    smooth_jitter,
)

RATE = 120.0
OPTIONS = SmoothingOptions()
LARGE_RMS = np.full((200, 1), 100.0)


def movement(frames=200, seed=0):
    """One marker of a body (frames, 3): slow sines of a few Hz."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames) / RATE
    wave = [rng.uniform(0.3, 2.5), rng.uniform(0.3, 2.5), rng.uniform(0.3, 2.5)]
    return 200.0 * np.sin(2.0 * np.pi * time[:, None] * wave + rng.uniform(0, 6, 3))


@settings(deadline=None, max_examples=20)
@given(st.integers(DIFFERENCE_ORDER + 1, 60), st.floats(3.0, 40.0), st.integers(0, 2**31))
def test_the_low_pass_is_the_minimum(frames, cut, seed):
    path = np.random.default_rng(seed).normal(0.0, 10.0, (frames, 3))
    difference = np.diff(np.eye(frames), DIFFERENCE_ORDER, axis=0)
    penalty = (2.0 * np.sin(np.pi * cut / RATE)) ** (-2.0 * DIFFERENCE_ORDER)
    naive = np.linalg.solve(np.eye(frames) + penalty * difference.T @ difference, path)
    np.testing.assert_allclose(low_pass(path, RATE, cut), naive, atol=1e-5)


def test_the_low_pass_halves_its_frequency_and_keeps_parabolas():
    time = np.arange(1200) / RATE
    sine = np.sin(2.0 * np.pi * 10.0 * time)[:, None] * np.ones(3)
    middle = slice(400, 800)
    np.testing.assert_allclose(low_pass(sine, RATE, 10.0)[middle], 0.5 * sine[middle], atol=1e-3)
    parabola = (time**2 * 50.0 - time)[:, None] * np.ones(3)
    np.testing.assert_allclose(low_pass(parabola, RATE, 10.0), parabola, atol=1e-4)


def test_noise_has_jitter_and_slow_movement_has_none():
    slow = movement()
    noisy = slow + np.random.default_rng(0).normal(0.0, 0.5, slow.shape)
    assert jitter_power(noisy, RATE) > 100.0 * jitter_power(slow, RATE)


def test_gaps_add_no_jitter():
    noisy = movement() + np.random.default_rng(0).normal(0.0, 0.5, (200, 3))
    holes = noisy.copy()
    holes[60:80] = np.nan
    assert jitter_power(holes, RATE) == pytest.approx(jitter_power(noisy, RATE), rel=0.3)
    holes[OPTIONS.min_frames - 1 :] = np.nan
    assert np.isnan(jitter_power(holes, RATE))


def test_jitter_is_unknown_at_a_low_rate():
    assert np.isnan(jitter_power(movement(), 2.0 * OPTIONS.body_frequency))


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31), st.floats(0.5, 5.0))
def test_jitter_is_removed_without_moving_the_path(seed, noise):
    rng = np.random.default_rng(seed)
    slow = movement(seed=seed % 1000)
    measured = jitter_power(slow + rng.normal(0.0, 0.3, slow.shape), RATE)
    jittery = slow + rng.normal(0.0, noise, slow.shape)
    found = smooth_jitter(jittery[:, None], LARGE_RMS, np.array([measured]), RATE)[:, 0]
    assert jitter_power(found, RATE) <= max(OPTIONS.max_jitter_ratio * measured, 1e-2)
    off = [np.linalg.norm(x - slow, axis=1).mean() for x in (found, jittery)]
    assert off[0] < off[1]


def test_a_jump_is_spread_over_a_few_frames():
    path = movement()
    measured = jitter_power(path + np.random.default_rng(0).normal(0.0, 0.2, path.shape), RATE)
    jump = path + np.where(np.arange(200) < 100, 0.0, 30.0)[:, None]
    found = smooth_jitter(jump[:, None], LARGE_RMS, np.array([measured]), RATE)[:, 0]
    step = np.linalg.norm(np.diff(found - path, axis=0), axis=1).max()
    assert step < 0.4 * 30.0 * np.sqrt(3.0)


def test_paths_without_jitter_are_unchanged():
    slow = np.stack([movement(seed=1), movement(seed=2)], axis=1)
    noisy = slow + np.random.default_rng(0).normal(0.0, 1.0, slow.shape)
    measured = np.array([jitter_power(noisy[:, 0], RATE), np.nan])
    large_rms = np.full((200, 2), 100.0)
    np.testing.assert_array_equal(smooth_jitter(slow, large_rms, measured, RATE), slow)
    found = smooth_jitter(noisy, large_rms, measured * [0.1, 1.0], RATE)
    np.testing.assert_array_equal(found[:, 1], noisy[:, 1])  # its measured jitter is unknown
    assert (found[:, 0] != noisy[:, 0]).any()


def test_short_paths_are_unchanged():
    few = movement(frames=OPTIONS.min_frames - 1)[:, None]
    assert smooth_jitter(few, LARGE_RMS[: OPTIONS.min_frames - 1], np.array([0.0]), RATE) is few


def test_accurate_predictions_keep_their_jitter():
    noise = np.random.default_rng(0).normal(0.0, 2.0, (200, 3))
    jittery = (movement() + noise)[:, None]
    measured = np.array([0.01])
    np.testing.assert_array_equal(
        smooth_jitter(jittery, np.full((200, 1), 0.1), measured, RATE), jittery
    )
    some = smooth_jitter(jittery, np.full((200, 1), 7.0), measured, RATE)
    assert (some != jittery).any()
    moved = np.sqrt(((some - jittery) ** 2).sum(axis=2).mean())
    assert moved <= OPTIONS.max_shift * 7.0


def test_the_shift_of_a_low_pass_is_limited():
    """By half of its expected error, on the mean over its frames."""
    rng = np.random.default_rng(3)
    jittery = (movement() + rng.normal(0.0, 2.0, (200, 3)))[:, None]
    weakest = low_pass(jittery, RATE, OPTIONS.cutoffs[0])
    moved = np.sqrt(((weakest - jittery) ** 2).sum(axis=2).mean())
    size = rng.uniform(0.5, 2.0, (200, 1))
    size *= moved / OPTIONS.max_shift / np.sqrt((size**2).mean())
    measured = np.array([1e-6])
    np.testing.assert_array_equal(smooth_jitter(jittery, 0.999 * size, measured, RATE), jittery)
    np.testing.assert_array_equal(smooth_jitter(jittery, 1.001 * size, measured, RATE), weakest)


def test_the_highest_sufficient_cutoff_is_used():
    jittery = (movement() + np.random.default_rng(4).normal(0.0, 2.0, (200, 3)))[:, None]
    smoothed = [low_pass(jittery, RATE, cut) for cut in OPTIONS.cutoffs]
    assert sorted(OPTIONS.cutoffs, reverse=True) == list(OPTIONS.cutoffs)
    for smooth in smoothed:
        measured = np.array([jitter_power(smooth[:, 0], RATE) / OPTIONS.max_jitter_ratio])
        found = smooth_jitter(jittery, LARGE_RMS, 1.001 * measured, RATE)
        np.testing.assert_array_equal(found, smooth)
    # 20 Hz is too close to half of a rate of 50 Hz
    enough, stronger = (low_pass(jittery, 50.0, cut) for cut in OPTIONS.cutoffs[:2])
    measured = np.array([1.001 * jitter_power(enough[:, 0], 50.0) / OPTIONS.max_jitter_ratio])
    np.testing.assert_array_equal(smooth_jitter(jittery, LARGE_RMS, measured, 50.0), stronger)


def test_jitter_power_is_a_mean_squared_second_difference():
    path = movement(70) + np.random.default_rng(5).normal(0.0, 1.0, (70, 3))
    path[[20, 20 + OPTIONS.min_frames]] = np.nan  # runs of 20 frames, one too short, and the rest
    squares = []
    for start, stop in ((0, 20), (21 + OPTIONS.min_frames, 70)):
        fast = path[start:stop] - low_pass(path[start:stop], RATE, OPTIONS.body_frequency)
        squares += [(x**2).sum() for x in np.diff(fast, 2, axis=0)]
    assert jitter_power(path, RATE) == pytest.approx(np.mean(squares))


def test_the_shortest_run_and_the_lowest_rate():
    few = movement(OPTIONS.min_frames)
    assert np.isfinite(jitter_power(few, RATE))
    assert np.isnan(jitter_power(movement(), OPTIONS.body_frequency / OPTIONS.max_cutoff_per_rate))
    assert np.isfinite(
        jitter_power(movement(), 1.001 * OPTIONS.body_frequency / OPTIONS.max_cutoff_per_rate)
    )
    jittery = (few + np.random.default_rng(6).normal(0.0, 2.0, few.shape))[:, None]
    assert (
        smooth_jitter(jittery, LARGE_RMS[: OPTIONS.min_frames], np.array([1e-6]), RATE) != jittery
    ).any()


@pytest.mark.parametrize(
    "wrong", [{"max_cutoff_per_rate": 0.5}, {"min_frames": 3}, {"cutoffs": (10.0, 0.0)}]
)
def test_options_out_of_range_are_rejected(wrong):
    (name,) = wrong
    with pytest.raises(OptionError, match=f"SmoothingOptions.{name} "):
        SmoothingOptions(**wrong)


def test_without_cutoffs_nothing_is_smoothed():
    jittery = (movement() + np.random.default_rng(7).normal(0.0, 2.0, (200, 3)))[:, None]
    none = SmoothingOptions(cutoffs=())
    measured = np.array([1e-6])
    found = smooth_jitter(jittery, LARGE_RMS, measured, RATE, none)
    np.testing.assert_array_equal(found, jittery)


@pytest.mark.parametrize("rate", [5_000.0, 20_000.0, 1e6])
def test_high_rates(rate):
    """λ is too large there for the differences of single frames."""
    for frames in (12, 200, 5000):
        time = np.arange(frames)[:, None] / frames
        parabola = 900.0 + np.hstack([time, time**2, -time])
        smooth = low_pass(parabola, rate, 10.0)
        np.testing.assert_allclose(smooth, parabola, atol=1e-2)
        noise = np.random.default_rng(0).normal(0.0, 1.0, (frames, 3))
        assert (low_pass(noise, rate, 10.0) ** 2).mean() < 0.5
        # a constant has no jitter
        assert jitter_power(np.full((frames, 3), 900.0), rate) < 1e-15
        power = jitter_power(noise, rate)
        assert 0.5 * 18 < power < 1.5 * 18
