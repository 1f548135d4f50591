import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_priors import random_prior

from priorfill.energy.solver import DescentOptions, minimise, solve_exactly
from priorfill.energy.targets import Prior
from priorfill.energy.terms import energy, gradient
from priorfill.errors import OptionError

THOROUGH = DescentOptions(tolerance=1e-13)
"""Stops only when a round gains next to nothing."""

seeds = st.integers(0, 2**31)


def problem(seed, frames, markers, scales):
    rng = np.random.default_rng(seed)
    prior = random_prior(rng, frames, markers, scales)
    positions = rng.normal(0, 100, (frames, markers, 3))
    free = rng.random((frames, markers)) < 0.7
    return positions, free, prior


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(3, 40), st.integers(1, 3))
def test_banded_solve_is_the_least_squares_solution(seed, frames, markers):
    positions, free, prior = problem(seed, frames, markers, (1.0, 3.0, 5.0))
    found = solve_exactly(positions, free, prior)
    expected = naive.least_squares_minimum(positions, free, prior)
    np.testing.assert_allclose(found.positions, expected, atol=1e-6)
    np.testing.assert_array_equal(found.positions[~free], positions[~free])
    np.testing.assert_allclose(gradient(found.positions, prior)[free], 0, atol=1e-6)


@settings(deadline=None, max_examples=60)
@given(
    seeds,
    st.integers(3, 120),
    st.integers(1, 3),
    st.sampled_from([(1.0, 1.0, 1.0), (1.0, 30.0, 150.0), (5.0, 0.1, 0.0)]),
)
def test_descent_reaches_the_exact_minimum(seed, frames, markers, scales):
    positions, free, prior = problem(seed, frames, markers, scales)
    exact = solve_exactly(positions, free, prior)
    found = minimise(positions, free, prior, THOROUGH)
    assert found.energy <= exact.energy * (1 + 1e-6) + 1e-9
    np.testing.assert_allclose(found.positions, exact.positions, atol=0.1)
    np.testing.assert_array_equal(found.positions[~free], positions[~free])


@settings(deadline=None, max_examples=15)
@given(
    seeds,
    st.integers(3, 25),
    st.sampled_from([0.0, 0.1, 0.5]),
    st.integers(1, 6),
    st.sampled_from([1, 2, 7, 64]),
)
def test_descent_equals_its_naive_implementation(seed, frames, share, steps, block):
    positions, free, prior = problem(seed, frames, 2, (1.0, 5.0, 10.0))
    options = DescentOptions(min_gain_ratio=share, max_steps=steps, block_frames=block)
    found = minimise(positions, free, prior, options)
    expected, updates = naive.scheduled_descent(positions, free, prior, options)
    np.testing.assert_allclose(found.positions, expected, atol=1e-6)
    assert found.updates == updates


@settings(deadline=None, max_examples=30)
@given(seeds, st.floats(0, 0.5))
def test_descent_never_climbs_and_more_tolerance_is_less_work(seed, share):
    positions, free, prior = problem(seed, 60, 2, (1.0, 5.0, 10.0))
    start = energy(positions, prior)
    quick = minimise(positions, free, prior, DescentOptions(tolerance=0.01, min_gain_ratio=share))
    thorough = minimise(
        positions, free, prior, DescentOptions(tolerance=1e-9, min_gain_ratio=share)
    )
    assert thorough.energy <= quick.energy <= start
    assert quick.updates <= thorough.updates


def test_samples_without_a_term_are_unchanged():
    positions, free, prior = problem(1, 20, 2, (1.0, 1.0, 1.0))
    free[:] = True
    for weight in (prior.pose_weight, prior.velocity_weight, prior.acceleration_weight):
        weight[:, 1] = 0.0
    positions[:, 1] = np.nan
    for found in (minimise(positions, free, prior), solve_exactly(positions, free, prior)):
        assert np.isnan(found.positions[:, 1]).all()
        assert np.isfinite(found.positions[:, 0]).all()


def test_scheduling_saves_updates_where_the_work_is_in_one_place():
    """With one bump in a long chain, descent on all frames updates many that need no change."""
    rng = np.random.default_rng(0)
    prior = random_prior(rng, 600, 1, (1.0, 10.0, 30.0))
    free = np.ones((600, 1), dtype=bool)
    positions = solve_exactly(np.zeros((600, 1, 3)), free, prior).positions
    positions[300:310] += 80.0
    options = {"tolerance": 1e-6, "min_move": 0.0, "block_frames": 4}
    scheduled = minimise(positions, free, prior, DescentOptions(**options, min_gain_ratio=0.01))
    plain = minimise(positions, free, prior, DescentOptions(**options, min_gain_ratio=0.0))
    assert scheduled.energy == pytest.approx(plain.energy, rel=1e-6)
    assert scheduled.updates < 0.7 * plain.updates


def test_a_gain_ratio_of_one_still_reaches_the_minimum():
    positions, free, prior = problem(3, 40, 2, (1.0, 5.0, 10.0))
    options = DescentOptions(tolerance=1e-9, min_gain_ratio=1.0, block_frames=4)
    found = minimise(positions, free, prior, options)
    exact = solve_exactly(positions, free, prior)
    np.testing.assert_allclose(found.positions, exact.positions, atol=0.1)


def test_blocks_solve_stiff_priors():
    """A prior that spreads an offset over ten frames costs single frames step after step."""
    rng = np.random.default_rng(0)
    prior = random_prior(rng, 600, 1, (1.0, 0.0, 10.0**4))
    positions = rng.normal(0, 100, (600, 1, 3))
    free = np.ones((600, 1), dtype=bool)
    free[[0, 1, -2, -1]] = False
    exact = solve_exactly(positions, free, prior).positions
    blocks = minimise(positions, free, prior)
    frames = minimise(positions, free, prior, DescentOptions(block_frames=1))
    assert blocks.updates < 0.2 * frames.updates
    block_error, frame_error = (
        np.linalg.norm(f.positions - exact, axis=2).max() for f in (blocks, frames)
    )
    assert block_error < 0.1 * frame_error


def test_a_smooth_offset_is_removed_though_single_frames_hardly_move():
    """All frames are off by a millimetre, between measured frames; the prior is stiff."""
    nothing, ones = np.zeros((600, 1, 3)), np.ones((600, 1))
    prior = Prior(nothing, nothing, nothing, ones, 0.0 * ones, 1e4 * ones, 0.0 * ones)
    free = np.ones((600, 1), dtype=bool)
    free[[0, 1, -2, -1]] = False
    start = np.where(free[..., None], 1.0, nothing)
    assert np.abs(minimise(start, free, prior).positions).max() < 0.01


@pytest.mark.parametrize(
    "options",
    [
        {"tolerance": -1},
        {"tolerance": 1},
        {"min_gain_ratio": 2},
        {"max_steps": 0},
        {"max_rounds": 0},
        {"block_frames": 0},
        {"min_move": -1},
    ],
)
def test_values_out_of_range_are_rejected(options):
    with pytest.raises(OptionError):
        DescentOptions(**options)
