"""What a deviation says of errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi

from priorfill.uncertainty import BOUND_FACTOR, BOUND_SHARE, MEAN_FACTOR, UNIT_BOUND, common_bound


def test_factors_are_those_of_a_normal_error():
    """Against the textbook's moments of the Maxwell distribution (chi with 3 degrees)."""
    assert chi(3).mean() / np.sqrt(3.0) == pytest.approx(MEAN_FACTOR, abs=1e-3)
    assert chi(3).ppf(BOUND_SHARE) == pytest.approx(UNIT_BOUND, abs=1e-6)
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
