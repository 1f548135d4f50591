"""Short gaps: estimates over time, their expected errors, and the stop rule."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

import priorfill as pf
from priorfill.clip import Clip
from priorfill.gaps import Gap
from priorfill.geometry.distances import pair_distances
from priorfill.methods.gpr import predict
from priorfill.methods.gpr.short_gaps import estimate
from priorfill.methods.gpr.short_gaps.estimate import estimate_short_gaps
from priorfill.methods.gpr.short_gaps.options import ShortGapOptions

OPTIONS = ShortGapOptions()
RATE = 100.0
FRAMES = 300


def smooth(rng: np.random.Generator, width: float, columns: int) -> np.ndarray:
    """Smooth noise of standard deviation 1."""
    path = gaussian_filter1d(rng.normal(size=(FRAMES, columns)), width, axis=0)
    return path / path.std(axis=0)


def gaps_of(rng: np.random.Generator, markers: range) -> list[Gap]:
    """Gaps of 1 to 12 frames, at least 15 frames apart."""
    gaps = []
    for marker in markers:
        start = 15 + 3 * marker
        while start < FRAMES - 30:
            stop = start + int(rng.integers(1, 13))
            gaps.append(Gap(start, stop, marker))
            start = stop + int(rng.integers(15, 30))
    return gaps


def hidden(truth: np.ndarray, gaps: list[Gap]) -> np.ndarray:
    positions = truth.copy()
    for gap in gaps:
        positions[gap.start : gap.stop, gap.marker] = np.nan
    return positions


@lru_cache
def turning(noise: float = 0.05, width: float = 4.0) -> tuple[np.ndarray, list[Gap]]:
    """A rigid body of eight markers that turns fast; slowly with a larger width."""
    rng = np.random.default_rng(1)
    body = rng.uniform(-120.0, 120.0, (8, 3))
    angle = smooth(rng, width, 1)[:, 0]
    turn = np.zeros((FRAMES, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 0, 1], turn[:, 1, 0], turn[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    truth = body @ turn
    return truth + rng.normal(0.0, noise, truth.shape), gaps_of(rng, range(7))


def estimated(truth: np.ndarray, gaps: list[Gap], options: ShortGapOptions = OPTIONS):
    """Return errors, expected rms errors and bounds of all estimated samples (mm)."""
    positions = hidden(truth, gaps)
    found = estimate_short_gaps(positions, gaps, RATE, pair_distances(positions), options)
    assert {one.gap for one in found} == set(gaps)
    away = [one.positions - truth[one.gap.start : one.gap.stop, one.gap.marker] for one in found]
    error = np.linalg.norm(np.concatenate(away), axis=1)
    expected = np.concatenate([one.expected_rms for one in found])
    return error, expected, np.concatenate([one.expected_rms * one.bound_factor for one in found])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def test_expected_errors_and_bounds_are_those_of_the_estimates():
    error, expected, bound = estimated(*turning())
    assert 0.8 < rms(expected) / rms(error) < 1.25
    assert 0.86 < (error < bound).mean() < 0.96
    assert np.corrcoef(np.log(expected), np.log(error))[0, 1] > 0.2


def test_expected_errors_are_found_on_blocks_that_are_left_out(monkeypatch):
    """Noise that the processes underestimate is found in the blocks only."""
    truth, gaps = turning(noise=1.0)
    error, expected, _ = estimated(truth, gaps)
    assert 0.8 < rms(expected) / rms(error) < 1.25
    monkeypatch.setattr(estimate, "calibrate", lambda *_: (1.0, 1.6))
    smallest = ShortGapOptions(processes=OPTIONS.processes[:1])
    kept, far = estimated(truth, gaps, smallest)[:2]
    assert 0.7 < rms(far) / rms(kept) < 1.4  # the factor of each candidate


def test_paths_relative_to_rigid_neighbours_are_smoother(monkeypatch):
    near, _, _ = estimated(*turning())
    monkeypatch.setattr(estimate.LocalPaths, "at", no_frames)
    world, expected, _ = estimated(*turning())
    assert rms(near) < 0.4 * rms(world)
    assert 0.7 < rms(expected) / rms(world) < 1.4


def test_a_gap_whose_neighbours_are_missing_too_is_estimated_in_the_world():
    truth, _ = turning()
    gaps = [Gap(100, 106, 0), Gap(200, 206, 0)]
    positions = hidden(truth, gaps)
    positions[103:150, 1:] = np.nan
    found = estimate_short_gaps(positions, gaps, RATE, pair_distances(positions), OPTIONS)
    without, with_neighbours = (one.rms for one in found)
    assert without > 2.0 * with_neighbours


def no_frames(_: object, markers: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    shape = (len(markers), frames.shape[1])
    return np.full((*shape, 3), np.nan), np.full((*shape, 3, 3), np.nan)


@pytest.mark.parametrize("noise, kept", [(0.0, slice(2, None)), (1.0, slice(0, 1))])
def test_noise_variances_are_weighted_by_the_errors_of_the_clip(noise, kept):
    truth, gaps = turning(noise)
    unfit = ShortGapOptions(processes=OPTIONS.processes[kept])
    assert rms(estimated(truth, gaps)[0]) < 0.9 * rms(estimated(truth, gaps, unfit)[0])


def test_a_gap_in_a_fast_movement_has_a_larger_expected_error():
    """The scale of the samples around a gap is part of its expected error."""
    rng = np.random.default_rng(2)
    truth = rng.uniform(-120.0, 120.0, (5, 3)) + rng.normal(0.0, 0.01, (FRAMES, 5, 3))
    truth[150:, 0] += 100.0 * smooth(rng, 3.0, 3)[150:]
    gaps = [Gap(start, start + 5, 0) for start in (60, 90, 200, 230)]
    _, expected, _ = estimated(truth, gaps)
    assert rms(expected[10:]) > 5.0 * rms(expected[:10])


# --- the stop rule ---


@lru_cache
def coupled() -> tuple[np.ndarray, list[Gap]]:
    """Marker 7 moves fast and in proportion to marker 6, in a body that is at rest."""
    rng = np.random.default_rng(5)
    truth = rng.uniform(-120.0, 120.0, (8, 3)) + rng.normal(0.0, 0.05, (FRAMES, 8, 3))
    fast = smooth(rng, 1.5, 3)
    truth[:, 6] += 15.0 * fast
    truth[:, 7] += 20.0 * fast
    return truth, gaps_of(rng, range(7, 8))


def filled(monkeypatch, truth: np.ndarray, gaps: list[Gap], **options: float):
    """Fill gaps; return the mean error (mm), and the number of segments with a regression."""
    made = []

    def counted(*arguments: Any):
        steps = np.diff(arguments[0][0].query.time) * RATE
        made.append(1 + np.count_nonzero(np.abs(steps - 1.0) > 0.5))  # runs of frames
        return regress(*arguments)

    regress = predict.regress
    monkeypatch.setattr(predict, "regress", counted)
    settings = {f"short_gaps.{name}": value for name, value in options.items()}
    clip = Clip(hidden(truth, gaps), tuple(f"M{i}" for i in range(truth.shape[1])), RATE)
    result = pf.fill(clip, options=pf.FillOptions(method_options=settings))
    monkeypatch.undo()
    assert result.filled.sum() == clip.missing.sum()
    away = np.linalg.norm(result.clip.positions - truth, axis=2)[clip.missing]
    return away.mean(), sum(made)


def test_no_regression_is_made_where_the_estimates_are_as_good(monkeypatch):
    truth, gaps = turning(0.02, 40.0)
    error, made = filled(monkeypatch, truth, gaps)
    assert made <= 2
    few = gaps[::20]  # without estimates
    slow, made = filled(monkeypatch, truth, few, max_seconds=0.0)
    assert made >= len(few)
    assert error < 2.0 * max(slow, 0.05)


def test_the_noise_of_the_measurement_ends_the_search(monkeypatch):
    """Any error is below this noise: the fill is that of the estimates, which is worse."""
    truth, gaps = coupled()
    best, made = filled(monkeypatch, truth, gaps)
    assert made >= 0.6 * len(gaps)
    worse, none = filled(monkeypatch, truth, gaps, measurement_noise=100.0)
    assert none == 0
    assert worse > 3.0 * best


def test_estimates_that_a_regression_would_beat_are_not_kept(monkeypatch):
    truth, gaps = coupled()
    best, _ = filled(monkeypatch, truth, gaps)
    worse, _ = filled(monkeypatch, truth, gaps, regression_share=1e9)
    assert worse > 3.0 * best
