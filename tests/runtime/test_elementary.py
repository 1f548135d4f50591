"""Elementary functions compared with those of NumPy, and their bits on every system."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable

import numpy as np
import pytest

from priorfill.runtime import elementary

pytestmark = pytest.mark.windows

# rounded, so that they do not depend on the system's own functions
RNG = np.random.default_rng(0)
LARGE = np.round(RNG.uniform(-700.0, 700.0, 5000), 6)
SMALL = np.round(RNG.normal(size=5000), 6)
VALUES = np.concatenate([LARGE, SMALL])
POSITIVE = np.concatenate([RNG.uniform(1e-8, 2.0, 5000), RNG.uniform(1.0, 1e8, 5000)])


def ulps(found: np.ndarray, wanted: np.ndarray) -> float:
    """The largest difference, in units of the last place."""
    return float((np.abs(found - wanted) / np.spacing(np.abs(wanted))).max())


def test_exp_and_log_agree_with_numpy() -> None:
    assert ulps(elementary.exp(VALUES), np.exp(VALUES)) <= 1.0
    assert np.abs(elementary.log(POSITIVE) - np.log(POSITIVE)).max() < 2e-13
    near_one = 1.0 + 1e-3 * SMALL
    assert ulps(elementary.log(near_one), np.log(near_one)) <= 2.0


def test_exp_of_extreme_values() -> None:
    found = elementary.exp([np.nan, np.inf, -np.inf, -708.0, 709.5, 0.0])
    np.testing.assert_array_equal(found, [np.nan, np.inf, 0.0, 0.0, np.inf, 1.0])


def test_log_of_extreme_values() -> None:
    found = elementary.log([0.0, -1.0, np.nan, np.inf, 5e-324])
    np.testing.assert_allclose(found, [-np.inf, np.nan, np.nan, np.inf, -744.4400719213812])


def test_shapes_are_kept() -> None:
    assert elementary.exp(1.0).shape == ()
    assert elementary.exp(np.zeros((2, 0))).shape == (2, 0)
    turned = VALUES[:6].reshape(2, 3).T
    np.testing.assert_array_equal(elementary.exp(turned).T, elementary.exp(turned.T))


@pytest.mark.parametrize("exponent", [0.0, 0.3, 0.5, 1.0, 1.5, 2.3, 8.0, -0.7, -2.0, -6.0])
def test_powers_agree_with_numpy(exponent: float) -> None:
    values = POSITIVE[::5]
    np.testing.assert_allclose(elementary.power(values, exponent), values**exponent, rtol=3e-15)


def test_powers_of_zero_and_to_infinity() -> None:
    assert elementary.power([0.0], 0.3).tolist() == [0.0]
    assert elementary.power([0.0], -0.3).tolist() == [math.inf]
    assert elementary.power([0.5, 1.0], math.inf).tolist() == [0.0, 1.0]


def test_huge_exponents_take_no_longer_than_others() -> None:
    near_one = 1.0 - 1e-9
    found = elementary.power([0.0, 0.5, near_one, 1.0], 1e9)
    np.testing.assert_allclose(found, [0.0, 0.0, near_one**1e9, 1.0], rtol=1e-8)
    assert elementary.power([0.5, 1.0, 2.0], 1e308).tolist() == [0.0, 1.0, math.inf]


def test_sines_agree_with_numpy() -> None:
    angles = 10.0 * SMALL
    assert np.abs(elementary.sin(angles) - np.sin(angles)).max() < 1e-14
    small = 1e-2 * SMALL[SMALL != 0.0]
    np.testing.assert_allclose(elementary.sin(small), np.sin(small), rtol=1e-15)


def test_bessel_function_and_hypotenuse_agree_with_numpy() -> None:
    values = np.linspace(0.0, 14.0, 50)
    np.testing.assert_allclose(elementary.bessel_i0(values), np.i0(values), rtol=1e-14)
    other = values[::-1]
    np.testing.assert_allclose(elementary.hypot(values, other), np.hypot(values, other), rtol=1e-15)


@pytest.mark.parametrize(
    ("function", "values", "digest"),
    [
        (elementary.exp, VALUES, "b6e6901a8748dba7"),
        (elementary.log, POSITIVE, "5a336318cd3711f4"),
        (elementary.sin, SMALL, "8eaf39f3b3b52c4f"),
        (elementary.bessel_i0, SMALL, "7e4d5b0d10b2ca69"),
        (lambda values: elementary.power(values, 2.3), np.abs(SMALL), "012758d124872f6f"),
    ],
)
def test_bits_are_the_same_on_every_system(
    function: Callable[[np.ndarray], np.ndarray], values: np.ndarray, digest: str
) -> None:
    found = function(values)
    assert hashlib.sha256(found.tobytes()).hexdigest()[:16] == digest
