"""Interpolation over time: closed forms, and gaps at the ends of the clip."""

import numpy as np
import pytest
from gappy import error, fill_unchecked, person, straight, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.clip import Clip

CURVES = ("linear", "pchip", "spline")
CURVE = pytest.mark.parametrize("method", CURVES)


def course(frames: int, function) -> Clip:
    """A clip of one marker whose position is a function of time."""
    time = np.arange(frames, dtype=np.float64)
    return Clip(np.stack([function(time)] * 3, axis=1)[:, None], ("M",), 100.0)


def hidden(clip: Clip, *spans: tuple[int, int]) -> Clip:
    return with_gaps(clip, *((start, stop, ("M",)) for start, stop in spans))


@pytest.mark.parametrize(
    ("method", "function"),
    [
        ("linear", lambda t: 3.0 * t - 7.0),
        ("pchip", lambda t: 3.0 * t - 7.0),
        ("spline", lambda t: 0.01 * t**3 - 0.4 * t**2 + t),
    ],
)
def test_what_a_curve_can_be_it_is(method, function):
    whole = course(60, function)
    result = fill_unchecked(hidden(whole, (10, 20), (40, 45)), method=method)
    np.testing.assert_allclose(result.clip.positions, whole.positions, atol=1e-6)


@given(st.lists(st.booleans(), min_size=2, max_size=40), st.integers(0, 2**31))
@settings(max_examples=50, deadline=None)
def test_straight_lines_are_those_of_numpy(seen, seed):
    positions = np.random.default_rng(seed).normal(0.0, 500.0, (len(seen), 1, 3))
    positions[~np.array(seen)] = np.nan
    clip = Clip(positions, ("M",), 100.0)
    found = fill_unchecked(clip, method="linear")
    np.testing.assert_allclose(found.clip.positions, straight(clip), atol=1e-9)
    assert found.complete == any(seen)


@CURVE
def test_the_ends_are_held(method):
    whole = course(60, lambda t: t**3)
    result = fill_unchecked(hidden(whole, (0, 10), (50, 60), (30, 35)), method=method)
    np.testing.assert_array_equal(result.clip.positions[:10], np.full((10, 1, 3), 1000.0))
    np.testing.assert_array_equal(result.clip.positions[50:], np.full((10, 1, 3), 49.0**3))
    sources = [gap.sources for gap in result.gaps]
    assert sources[0] == ("first position held",)
    assert sources[2] == ("last position held",)
    assert "over time" in sources[1][0]


def test_pchip_does_not_overshoot():
    whole = course(60, lambda t: np.where(t < 30, 0.0, 100.0))
    found = fill_unchecked(hidden(whole, (20, 40)), method="pchip").clip.positions
    assert found.min() >= 0.0
    assert found.max() <= 100.0
    assert fill_unchecked(hidden(whole, (20, 40)), method="spline").clip.positions.min() >= -1e-9


@CURVE
@pytest.mark.parametrize("seen", [1, 2, 3])
def test_hardly_a_sample(method, seen):
    clip = hidden(course(9, lambda t: 5.0 * t), (0, 3), (3 + seen, 9))
    result = fill_unchecked(clip, method=method)
    assert result.complete
    assert np.abs(result.clip.positions).max() <= 5.0 * 9


@CURVE
def test_curves_are_near_the_truth_in_short_gaps(method):
    clip = with_gaps(person(), (100, 106, ("LKNE",)), (50, 54, ("RFIN", "C7")))
    result = fill_unchecked(clip, method=method)
    assert error(result.clip.positions, person().positions, result.filled) < 15
