"""Interpolation of short gaps over time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from priorfill.gp.kernels import Matern52
from priorfill.gp.process import GaussianProcess
from priorfill.signal.gp_interpolation import InterpolationOptions, interpolate_gap

RATE = 100.0
MAX_SECONDS = InterpolationOptions().max_seconds


def smooth(seed, frames=200):
    """Everyday movement: a constant velocity, and oscillations that get smaller with frequency."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames)[:, None] / RATE
    positions = rng.normal(0, 800, 3) + rng.normal(0, 800, 3) * time
    for frequency in np.arange(0.3, 5.0, 0.3):
        size = 150.0 / (1 + frequency**2) * rng.normal(size=3)
        positions = positions + size * np.sin(2 * np.pi * frequency * time + rng.uniform(0, 6, 3))
    return positions


def without(positions, start, stop):
    gappy = positions.copy()
    gappy[start:stop] = np.nan
    return gappy


def rms(values):
    return float(np.sqrt((values**2).sum(axis=1).mean()))


def test_a_known_curve():
    time = np.arange(200)[:, None] / RATE
    curve = np.concatenate(
        [900 + 200 * np.sin(5 * time), 1000 * time, 80 * np.cos(7 * time + 1)], axis=1
    )
    found, expected_rms = interpolate_gap(without(curve, 90, 120), 90, 120, RATE)
    assert np.abs(found - curve[90:120]).max() < 2.5
    assert expected_rms.shape == (30,)
    assert expected_rms.argmax() in range(12, 18)
    assert expected_rms[0] < expected_rms[15] / 10


@given(st.integers(0, 2**31), st.integers(1, 50), st.floats(20, 500))
@settings(deadline=None, max_examples=40)
def test_straight_movement_is_interpolated_exactly(seed, frames, rate):
    rng = np.random.default_rng(seed)
    if frames / rate > MAX_SECONDS:
        frames = int(MAX_SECONDS * rate)
    line = rng.normal(0, 3000, 3) + rng.normal(0, 10, 3) * np.arange(300)[:, None]
    found, _ = interpolate_gap(without(line, 100, 100 + frames), 100, 100 + frames, rate)
    np.testing.assert_allclose(found, line[100 : 100 + frames], atol=1e-4)


@pytest.mark.parametrize("frames", [25, 50])
def test_better_than_a_cubic_spline(frames):
    ours, splines = [], []
    for seed in range(60):
        curve = smooth(seed)
        start, stop = 80, 80 + frames
        found, _ = interpolate_gap(without(curve, start, stop), start, stop, RATE)
        known = np.setdiff1d(np.arange(len(curve)), np.arange(start, stop))
        spline = CubicSpline(known, curve[known])(np.arange(start, stop))
        ours.append(rms(found - curve[start:stop]))
        splines.append(rms(spline - curve[start:stop]))
    assert np.mean(ours) < 0.9 * np.mean(splines)
    assert np.mean(np.array(ours) < np.array(splines)) > 0.6


def test_expected_error_has_the_size_of_the_error():
    ratios = []
    for seed in range(60):
        curve = smooth(seed)
        found, expected_rms = interpolate_gap(without(curve, 80, 120), 80, 120, RATE)
        ratios.append(rms(found - curve[80:120]) / np.sqrt((expected_rms**2).mean()))
    assert 0.3 < np.median(ratios) < 3.0


def test_noise_of_the_samples_is_not_amplified():
    rng = np.random.default_rng(0)
    for seed in range(20):
        curve = smooth(seed)
        noisy = curve + rng.normal(0, 0.3, curve.shape)
        clean, _ = interpolate_gap(without(curve, 80, 105), 80, 105, RATE)
        found, _ = interpolate_gap(without(noisy, 80, 105), 80, 105, RATE)
        assert rms(found - clean) < 30.0


def test_moves_and_turns_with_the_movement():
    curve, turn = smooth(5), np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    found, expected_rms = interpolate_gap(without(curve, 80, 110), 80, 110, RATE)
    moved = curve @ turn + [4000, -2000, 100]
    found_there, expected_there = interpolate_gap(without(moved, 80, 110), 80, 110, RATE)
    np.testing.assert_allclose(found_there, found @ turn + [4000, -2000, 100], atol=1e-5)
    np.testing.assert_allclose(expected_there, expected_rms, rtol=1e-3)


def test_too_long_gaps_are_refused():
    curve = smooth(0)
    assert interpolate_gap(without(curve, 70, 120), 70, 120, RATE) is not None
    assert interpolate_gap(without(curve, 70, 121), 70, 121, RATE) is None


@pytest.mark.parametrize(("start", "stop"), [(0, 10), (1, 10), (190, 200), (189, 199)])
def test_gaps_at_the_ends_are_refused(start, stop):
    assert interpolate_gap(without(smooth(0), start, stop), start, stop, RATE) is None


def test_gaps_with_too_few_adjacent_samples_are_refused():
    gappy = without(smooth(0), 80, 100)
    gappy[:79] = np.nan
    assert interpolate_gap(gappy, 80, 100, RATE) is None
    gappy = without(smooth(0), 80, 100)
    gappy[101:] = np.nan
    assert interpolate_gap(gappy, 80, 100, RATE) is None
    gappy = without(smooth(0), 80, 100)
    gappy[:78] = gappy[102:] = np.nan
    found, expected_rms = interpolate_gap(gappy, 80, 100, RATE)
    assert np.isfinite(found).all()
    assert np.isfinite(expected_rms).all()


def test_a_marker_that_stands_still():
    still = np.tile([100.0, 200.0, 300.0], (60, 1))
    found, expected_rms = interpolate_gap(without(still, 20, 40), 20, 40, RATE)
    np.testing.assert_allclose(found, still[20:40], atol=1e-6)
    assert np.isfinite(expected_rms).all()
    assert expected_rms.max() < 0.1


def test_options_set_the_length_and_the_time_scale():
    gappy = without(smooth(3), 80, 90)
    assert interpolate_gap(gappy, 80, 90, RATE, InterpolationOptions(max_seconds=0.09)) is None
    short = InterpolationOptions(process=GaussianProcess(Matern52(0.05), 1e-7))
    found, expected_rms = interpolate_gap(gappy, 80, 90, RATE)
    with_short_scale, less_certain = interpolate_gap(gappy, 80, 90, RATE, short)
    assert np.abs(found - with_short_scale).max() > 0.01
    assert less_certain.max() > 2.0 * expected_rms.max()


def test_at_high_rates_the_samples_are_thinned(monkeypatch):
    time = np.arange(12_000)[:, None] / 20_000.0
    path = 100.0 * np.sin(3.0 * time + [0.0, 1.0, 2.0])
    gappy = path.copy()
    gappy[5900:6100] = np.nan
    samples = []
    fit = GaussianProcess.fit

    def counted(self, train, targets, **options):
        samples.append(len(targets))
        return fit(self, train, targets, **options)

    monkeypatch.setattr(GaussianProcess, "fit", counted)
    found, _ = interpolate_gap(gappy, 5900, 6100, 20_000.0)
    assert samples == [600]
    np.testing.assert_allclose(found, path[5900:6100], atol=0.1)
