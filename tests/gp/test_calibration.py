"""Bounds of errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi, maxwell

from priorfill.gp.calibration import (
    BOUND_COVERAGE,
    BOUND_FACTOR,
    MEAN_FACTOR,
    UNIT_BOUND,
    common_bound,
)


def test_factors_are_those_of_a_normal_error():
    """Against the textbook's moments of the Maxwell distribution (chi with 3 degrees)."""
    assert chi(3).mean() / np.sqrt(3.0) == pytest.approx(MEAN_FACTOR, abs=1e-3)
    assert chi(3).ppf(BOUND_COVERAGE) == pytest.approx(UNIT_BOUND, abs=1e-6)
    assert UNIT_BOUND / np.sqrt(3.0) < BOUND_FACTOR


@pytest.mark.parametrize(
    "bounds",
    [np.ones(5), np.linspace(0.0, 3.0, 50), np.r_[np.ones(90), np.full(10, 40.0)], [7.0]],
)
def test_the_bound_of_a_gap_is_that_of_all_its_samples(bounds):
    bounds = np.asarray(bounds)
    errors = np.linalg.norm(np.random.default_rng(1).normal(size=(20000, 3)), axis=1)
    below = (np.outer(errors, bounds / UNIT_BOUND) < common_bound(bounds)).mean()
    assert below == pytest.approx(0.9, abs=0.006)
    assert common_bound(3.0 * bounds) == pytest.approx(3.0 * common_bound(bounds))


def test_the_bound_of_samples_that_are_certain():
    assert common_bound(np.zeros(4)) == pytest.approx(0.0, abs=1e-6)


def test_factors_are_those_of_the_maxwell_distribution():
    assert pytest.approx(maxwell.ppf(BOUND_COVERAGE), abs=1e-6) == UNIT_BOUND
    # to all the digits that it is given with
    assert pytest.approx(maxwell.mean() / np.sqrt(3.0), abs=5e-4) == MEAN_FACTOR
    assert pytest.approx(4.0 / np.sqrt(6.0 * np.pi), abs=5e-4) == MEAN_FACTOR


@pytest.mark.parametrize("seed", range(3))
def test_the_bound_of_a_mixture_of_maxwell_distributions(seed):
    bounds = np.random.default_rng(seed).uniform(0.5, 40.0, 30)
    scale = bounds / maxwell.ppf(BOUND_COVERAGE)
    exact = brentq(lambda x: maxwell.cdf(x, scale=scale).mean() - BOUND_COVERAGE, 0.1, 100.0)
    assert common_bound(bounds) == pytest.approx(exact, rel=1e-6)
    assert common_bound(bounds[:1]) == pytest.approx(bounds[0], rel=1e-6)
