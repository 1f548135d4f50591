"""Resampling: pass band, stop band, gaps and invariances."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from priorfill.errors import OptionError
from priorfill.signal.resample import (
    Resolution,
    _interpolate_inner_gaps,
    pyramid,
    resample,
)

RATES = [(120.0, 30.0), (100.0, 30.0), (240.0, 30.0), (30.0, 120.0), (120.0, 50.0), (59.94, 30.0)]


def column(values: np.ndarray) -> np.ndarray:
    """A clip of one marker whose three coordinates are all `values`."""
    return np.repeat(np.asarray(values, dtype=float)[:, None, None], 3, axis=2)


def wander(seed: int, frames: int, markers: int = 2) -> np.ndarray:
    """A smooth random motion: sines below 2 Hz at 120 Hz, some hundred mm large."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None] / 120
    out = np.zeros((frames, markers, 3))
    for _ in range(3):
        amplitude = rng.normal(0, 100, (1, markers, 3))
        phase = rng.uniform(0, 2 * np.pi, (1, markers, 3))
        out += amplitude * np.sin(2 * np.pi * rng.uniform(0.2, 2, (1, markers, 3)) * t + phase)
    return out


def test_number_of_frames() -> None:
    for frames, rate_from, rate_to, expected in [
        (121, 120, 30, 31),
        (120, 120, 30, 30),
        (1, 120, 30, 1),
        (2, 30, 120, 5),
        (101, 100, 30, 31),
        (100, 100, 30, 30),
        (5, 240, 30, 1),
        (11, 100, 70, 8),  # 10 * 70 / 100 is 7 exactly, a hair below in floating point
        (251, 500, 30, 16),  # so is 250 / (500 / 30)
        (0, 120, 30, 0),
    ]:
        assert resample(np.zeros((frames, 2, 3)), rate_from, rate_to).shape == (expected, 2, 3)


@pytest.mark.parametrize(("rate_from", "rate_to"), RATES)
@pytest.mark.parametrize("frames", [1, 2, 3, 4, 17, 300])
def test_constant_and_linear_pass_exactly(frames: int, rate_from: float, rate_to: float) -> None:
    t = np.arange(frames) / rate_from
    out = resample(column(1234.5 + 987.6 * t), rate_from, rate_to)
    expected = column(1234.5 + 987.6 * np.arange(len(out)) / rate_to)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-9)
    constant = resample(column(np.full(frames, 5000.0)), rate_from, rate_to)
    np.testing.assert_allclose(constant, 5000.0, rtol=0, atol=1e-9)


def test_linear_passes_exactly_next_to_gaps() -> None:
    line = column(10.0 + 3.0 * np.arange(200))
    line[:30] = line[60:75] = line[100:180] = line[199:] = np.nan
    out = resample(line, 120, 30)
    seen = ~np.isnan(out)
    assert seen.any()
    np.testing.assert_allclose(out[seen], column(10.0 + 12.0 * np.arange(50))[seen], atol=1e-9)


def gain(frequency: float, rate_from: float, rate_to: float) -> float:
    """Amplitude with which a tone comes out, away from the ends."""
    frames = int(8 * rate_from)
    tone = np.sin(2 * np.pi * frequency * np.arange(frames) / rate_from + 0.3)
    out = resample(column(tone), rate_from, rate_to)[:, 0, 0]
    middle = out[len(out) // 4 : -len(out) // 4]
    return float(np.abs(middle).max())


@pytest.mark.parametrize(("rate_from", "rate_to"), [(120.0, 30.0), (100.0, 30.0), (240.0, 15.0)])
def test_tone_above_new_nyquist_is_suppressed(rate_from: float, rate_to: float) -> None:
    for times_nyquist in (1.01, 1.3, 2.0, 2.7):
        if times_nyquist * rate_to < rate_from:
            assert gain(times_nyquist * rate_to / 2, rate_from, rate_to) < 0.004  # -48 dB


@pytest.mark.parametrize(("rate_from", "rate_to"), [(120.0, 30.0), (100.0, 30.0), (240.0, 15.0)])
def test_tone_in_the_pass_band_passes(rate_from: float, rate_to: float) -> None:
    for times_nyquist in (0.1, 0.3, 0.48):
        frequency = times_nyquist * rate_to / 2
        frames = int(8 * rate_from)
        wave = lambda t, f=frequency: np.sin(2 * np.pi * f * t + 0.3)  # noqa: E731
        out = resample(column(wave(np.arange(frames) / rate_from)), rate_from, rate_to)[:, 0, 0]
        expected = wave(np.arange(len(out)) / rate_to)
        inner = slice(len(out) // 4, -len(out) // 4)
        assert np.abs(out - expected)[inner].max() < 0.005  # amplitude and phase


def test_going_up_interpolates_with_a_cubic() -> None:
    t = np.arange(40) / 30
    out = resample(column(t**3 - 2 * t), 30, 120)
    fine = np.arange(len(out)) / 120
    np.testing.assert_allclose(out, column(fine**3 - 2 * fine), atol=1e-9)
    np.testing.assert_array_equal(out[::4], column(t**3 - 2 * t))


def test_missing_where_a_surrounding_sample_is_missing() -> None:
    data = column(np.arange(13.0))
    data[4] = np.nan
    down = np.isnan(resample(data, 120, 30))[:, 0, 0]
    np.testing.assert_array_equal(down, [False, True, False, False])
    data = column(np.arange(13.0))
    data[5] = np.nan  # between two new samples: neither coincides with it
    assert not np.isnan(resample(data, 120, 30)).any()
    # 120 -> 80 Hz reads at old frames 0, 1.5, 3, 4.5, 6, 7.5, ...
    off_grid = np.isnan(resample(data, 120, 80))[:, 0, 0]
    np.testing.assert_array_equal(np.flatnonzero(off_grid), [3])
    up = np.isnan(resample(data, 120, 240))[:, 0, 0]
    np.testing.assert_array_equal(np.flatnonzero(up), [9, 10, 11])


def test_marker_missing_throughout_stays_missing() -> None:
    data = wander(0, 100)
    data[:, 1] = np.nan
    out = resample(data, 120, 30)
    assert np.isnan(out[:, 1]).all()
    assert not np.isnan(out[:, 0]).any()


def test_measured_samples_next_to_a_gap_stay_close() -> None:
    data = wander(1, 480, markers=5)
    full = resample(data, 120, 30)
    gappy = data.copy()
    gappy[:60, 0] = gappy[200:210, 1] = gappy[200:320, 2] = gappy[400:, 3] = np.nan
    out = resample(gappy, 120, 30)
    seen = ~np.isnan(out)
    error = np.abs(out - full)[seen]
    speed = np.abs(np.diff(data, axis=0)).max()
    assert error.max() < 0.2 * speed  # linear interpolation gives more than 1
    np.testing.assert_array_equal(out[:, 4], full[:, 4])


def test_pyramid_is_every_second_frame_of_the_low_passed() -> None:
    data = wander(2, 121)
    data[30:50, 0] = np.nan
    levels = pyramid(data, 120, 4)
    assert [level.rate for level in levels] == [120, 60, 30, 15]
    assert [level.step for level in levels] == [1, 2, 4, 8]
    np.testing.assert_array_equal(levels[0].positions, data)
    for level in levels:
        assert len(level.positions) == len(data[:: level.step])
        np.testing.assert_array_equal(np.isnan(level.positions), np.isnan(data[:: level.step]))
        np.testing.assert_array_equal(level.positions, resample(data, 120, level.rate))
        seen = ~np.isnan(level.positions)
        assert np.abs(level.positions - data[:: level.step])[seen].max() < 2.0


def test_level_0_does_not_share_memory() -> None:
    data = wander(3, 10)
    levels = pyramid(data, 120, 1)
    assert not np.shares_memory(levels[0].positions, data)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 10), st.sampled_from([30.0, 15.0, 60.0]))
def test_shifting_the_clip_shifts_the_result(seed: int, shift: int, rate_to: float) -> None:
    """Away from the ends, starting `shift` new frames later changes nothing."""
    data = wander(seed, 700)
    data[300:333, 0] = np.nan
    step = int(120 / rate_to)
    complete = resample(data, 120, rate_to)
    cut = resample(data[shift * step :], 120, rate_to)
    assert len(cut) == len(complete) - shift
    reach = math.ceil(100 / step)
    np.testing.assert_allclose(cut[reach:], complete[shift + reach :], rtol=0, atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 10**6),
    st.floats(-5, 5),
    st.floats(-5, 5),
    st.sampled_from(RATES),
    st.lists(st.integers(0, 59), max_size=30),
)
def test_is_linear(
    seed: int, a: float, b: float, rates: tuple[float, float], gone: list[int]
) -> None:
    x, y = wander(seed, 60), wander(seed + 1, 60)
    x[gone, 0] = y[gone, 0] = np.nan
    expected = a * resample(x, *rates) + b * resample(y, *rates)
    np.testing.assert_allclose(resample(a * x + b * y, *rates), expected, rtol=0, atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.lists(st.integers(0, 59), max_size=59))
def test_markers_are_independent(seed: int, gone: list[int]) -> None:
    x = wander(seed, 60)
    x[gone, 1] = np.nan
    both = resample(x, 100, 30)
    np.testing.assert_array_equal(both[:, :1], resample(x[:, :1], 100, 30))
    np.testing.assert_array_equal(both[:, 1:], resample(x[:, 1:], 100, 30))


@pytest.mark.parametrize("rate", [0.0, -30.0, math.nan, math.inf])
def test_ill_formed_rates(rate: float) -> None:
    data = np.zeros((5, 1, 3))
    for call in (
        lambda: resample(data, rate, 30),
        lambda: resample(data, 30, rate),
    ):
        with pytest.raises(OptionError, match=r"frame rate is .* Hz; give a positive"):
            call()


def test_ill_formed_shapes_and_levels() -> None:
    with pytest.raises(OptionError, match=r"shape \(5, 3\)"):
        resample(np.zeros((5, 3)), 120, 30)
    with pytest.raises(OptionError, match="0 levels"):
        pyramid(np.zeros((5, 1, 3)), 120, 0)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([1, 2, 4, 8]))
def test_a_resolution_equals_the_level(seed: int, step: int) -> None:
    rng = np.random.default_rng(seed)
    frames = int(rng.integers(1, 400))
    positions = np.cumsum(rng.normal(0.0, 5.0, (frames, 3, 3)), axis=0)
    for marker in range(3):
        for start in rng.integers(-20, frames, int(rng.integers(0, 6))):
            positions[max(start, 0) : start + int(rng.integers(1, 60)), marker] = np.nan
    level = pyramid(positions, 120.0, 4)[step.bit_length() - 1]
    lazy = Resolution(positions, 120.0, step)
    assert (lazy.frames, lazy.rate, lazy.step) == (level.frames, level.rate, level.step)
    first, last = sorted(rng.integers(0, level.frames + 1, 2).tolist())
    if first < last:
        np.testing.assert_array_equal(
            lazy.window(first, last, [2, 0]), level.window(first, last, [2, 0])
        )


def test_gaps_are_filled_by_cubic_hermite_polynomials() -> None:
    """Edge slopes are measured; next to an isolated sample the slope of the chord is used."""
    rng = np.random.default_rng(0)
    for valid in ([0, 1, 5, 6, 9, 10], [0, 4, 5, 9], [0, 3, 7, 8, 10], [0, 1, 4, 8, 9]):
        run = rng.normal(0, 100, (valid[-1] + 1, 3))
        expected = run.copy()
        for a, b in itertools.pairwise(valid):
            chord = (run[b] - run[a]) / (b - a)
            slope_a = run[a] - run[a - 1] if a - 1 in valid else chord
            slope_b = run[b + 1] - run[b] if b + 1 in valid else chord
            piece = CubicHermiteSpline([a, b], [run[a], run[b]], [slope_a, slope_b])
            expected[a + 1 : b] = piece(np.arange(a + 1, b))
        found = run.copy()
        found[np.setdiff1d(np.arange(len(run)), valid)] = np.nan
        _interpolate_inner_gaps(found, np.array(valid))
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_small_fractions_of_a_high_rate(monkeypatch) -> None:
    """Only the wanted samples are filtered, with the same result."""
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.normal(0.0, 1.0, (3000, 2, 3)), axis=0)
    path[700:720, 0] = np.nan
    few = pyramid(path, 20_000.0, 10)
    for i in (8, 9):
        window = Resolution(path, 20_000.0, 2**i).window(0, few[i].frames, [0, 1])
        np.testing.assert_array_equal(window, few[i].positions)
    monkeypatch.setattr("priorfill.signal.resample.MAX_DENSE_TAPS", 10**6)
    for one, other in zip(few, pyramid(path, 20_000.0, 10), strict=True):
        np.testing.assert_allclose(one.positions, other.positions, atol=1e-9)


def test_the_time_for_a_small_fraction_of_the_rate_is_that_of_the_wanted_samples(
    monkeypatch,
) -> None:
    def all_of_them(*args, **options):
        raise AssertionError("filters all samples")

    monkeypatch.setattr("scipy.ndimage.correlate1d", all_of_them)
    found = resample(np.ones((3000, 1, 3)), 20_000.0, 20_000.0 / 512)
    np.testing.assert_allclose(found, 1.0)
