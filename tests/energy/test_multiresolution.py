import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.energy.multiresolution import MIN_LEVEL_RATE, levels_for, solve_levels
from priorfill.energy.solver import minimise, solve_exactly
from priorfill.energy.targets import Prior
from priorfill.gaps import gap_groups, runs
from priorfill.signal.resample import pyramid

SOLVERS = [minimise, solve_exactly]


def smooth(frames, markers, rate, seed=0):
    """Slow movement of some markers (frames, markers, 3), mm."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames)[:, None, None] / rate
    positions = rng.normal(0, 500, (markers, 3)) + 300 * time
    for frequency in (0.4, 1.0, 1.7):
        phase = rng.uniform(0, 6, (markers, 3))
        positions = positions + 60 * np.sin(2 * np.pi * frequency * time + phase)
    return positions


def truth_prior(truth, rate, count, markers, blind=()):
    """A prior equal to the truth, without weight for the blind markers."""
    levels = {
        level.step: level.positions[:, list(markers)] for level in pyramid(truth, rate, count)
    }

    def prior_at(level, window):
        positions = levels[level.step]
        ahead = positions[np.minimum(window + 1, len(positions) - 1)]
        behind = positions[np.maximum(window - 1, 0)]
        here = positions[window]
        weight = np.ones(here.shape[:2])
        weight[:, [markers.index(m) for m in blind]] = 0.0
        return Prior(
            here,
            0.5 * (ahead - behind),
            ahead - 2 * here + behind,
            weight,
            weight.copy(),
            weight.copy(),
            np.zeros_like(weight),
        )

    return prior_at


def fill(truth, missing, rate, solver, blind=()):
    """Fill each gap group with the truth as prior; the filled clip."""
    positions = np.where(missing[..., None], np.nan, truth)
    count = levels_for(rate)
    levels = pyramid(positions, rate, count)
    for group in gap_groups(missing):
        prior_at = truth_prior(truth, rate, count, group.markers, set(blind) & set(group.markers))
        inside = solve_levels(levels, group, prior_at, solver)
        assert inside.shape == (group.stop - group.start, len(group.markers), 3)
        measured = ~missing[group.start : group.stop][:, group.markers]
        before = positions[group.start : group.stop, list(group.markers)]
        np.testing.assert_array_equal(inside[measured], before[measured])
        positions[group.start : group.stop, list(group.markers)] = inside
    return positions


@pytest.mark.parametrize(
    ("rate", "count"), [(10, 1), (12, 1), (23.9, 1), (24, 2), (100, 4), (120, 4), (240, 5)]
)
def test_levels(rate, count):
    assert levels_for(rate) == count
    assert rate / 2 ** (count - 1) >= min(rate, MIN_LEVEL_RATE)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("rate", [20.0, 60.0, 120.0, 500.0])
def test_a_prior_equal_to_the_truth_gives_the_truth(solver, rate):
    truth = smooth(200, 3, rate)
    missing = np.zeros((200, 3), dtype=bool)
    missing[40:120, 0] = True
    missing[100:160, 1] = True
    found = fill(truth, missing, rate, solver)
    np.testing.assert_allclose(found, truth, atol=0.05)


@settings(deadline=None, max_examples=40)
@given(
    st.integers(0, 2**31),
    st.integers(1, 60),
    st.integers(1, 4),
    st.floats(0.05, 0.95),
    st.sampled_from([15.0, 100.0, 250.0]),
)
def test_any_pattern_of_gaps(seed, frames, markers, share, rate):
    rng = np.random.default_rng(seed)
    truth = smooth(frames, markers, rate, seed)
    missing = rng.random((frames, markers)) < share
    found = fill(truth, missing, rate, solve_exactly)
    np.testing.assert_array_equal(found[~missing], truth[~missing])
    np.testing.assert_allclose(found, truth, atol=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
def test_markers_without_a_prior_stay_missing(solver):
    truth = smooth(120, 3, 100.0)
    missing = np.zeros((120, 3), dtype=bool)
    missing[30:70, 0] = missing[50:90, 1] = True
    found = fill(truth, missing, 100.0, solver, blind=[1])
    assert np.isnan(found[50:90, 1]).all()
    np.testing.assert_array_equal(np.isnan(found[..., 0]).sum(axis=0), [0, 40, 0])
    np.testing.assert_allclose(found[:, 0], truth[:, 0], atol=0.05)


def test_frames_without_a_prior_stay_missing_and_do_not_affect_others():
    truth, rate = smooth(160, 1, 100.0), 100.0
    missing = np.zeros((160, 1), dtype=bool)
    missing[40:120] = True
    count = levels_for(rate)
    levels = pyramid(np.where(missing[..., None], np.nan, truth), rate, count)
    (group,) = gap_groups(missing)
    true_prior = truth_prior(truth, rate, count, group.markers)

    def prior_at(level, window):
        prior = true_prior(level, window)
        unknown = (window * level.step >= 70) & (window * level.step < 90)
        prior.pose_weight[unknown] = 0.0
        prior.pose[unknown] = 1e9
        return prior

    for solver in SOLVERS:
        inside = solve_levels(levels, group, prior_at, solver)
        assert list(runs(np.isnan(inside[:, 0, 0]))) == [(30, 50)]
        seen = ~np.isnan(inside[:, 0, 0])
        np.testing.assert_allclose(inside[seen], truth[40:120][seen], atol=0.05)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("span", [(0, 30), (130, 160), (0, 160)])
def test_gaps_at_the_ends(solver, span):
    truth = smooth(160, 2, 120.0)
    missing = np.zeros((160, 2), dtype=bool)
    missing[slice(*span), 0] = True
    np.testing.assert_allclose(fill(truth, missing, 120.0, solver), truth, atol=0.05)


@pytest.mark.parametrize("frames", [1, 2, 3, 7, 8, 9, 17])
@pytest.mark.parametrize("solver", SOLVERS)
def test_clip_shorter_than_a_coarse_step(solver, frames):
    truth = smooth(frames, 2, 240.0)
    missing = np.zeros((frames, 2), dtype=bool)
    missing[frames // 2, 0] = True
    np.testing.assert_allclose(fill(truth, missing, 240.0, solver), truth, atol=0.05)


@pytest.mark.parametrize("start", range(30, 46))
def test_gaps_that_vanish_on_coarse_levels(start):
    truth = smooth(100, 1, 240.0)
    missing = np.zeros((100, 1), dtype=bool)
    missing[start] = True
    np.testing.assert_allclose(fill(truth, missing, 240.0, minimise), truth, atol=1e-3)


def test_the_fill_joins_the_measured_signal():
    """A prior that is off by a constant is bent to the measured neighbours at both edges."""
    truth, rate = smooth(200, 1, 100.0), 100.0
    missing = np.zeros((200, 1), dtype=bool)
    missing[60:140] = True
    count = levels_for(rate)
    levels = pyramid(np.where(missing[..., None], np.nan, truth), rate, count)
    (group,) = gap_groups(missing)
    true_prior = truth_prior(truth, rate, count, group.markers)

    def prior_at(level, window):
        prior = true_prior(level, window)
        prior.pose[:] += 30.0
        prior.velocity_weight[:] *= 1000.0
        prior.acceleration_weight[:] *= 1000.0
        return prior

    inside = solve_levels(levels, group, prior_at, solve_exactly)
    off = np.abs(inside - truth[60:140])[:, 0]
    assert off[[0, -1]].max() < 1.0
    assert off[40].min() > 10.0
