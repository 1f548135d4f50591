"""Interpolation between single samples."""

import numpy as np
import pytest

from priorfill.gp.calibration import MIN_EXPECTED_RMS
from priorfill.signal.gp_interpolation import InterpolationOptions, interpolate_gap
from priorfill.signal.lone_samples import MIN_SPEED, interpolate_marker

OPTIONS = InterpolationOptions()


def path(frames: int, *known: int) -> np.ndarray:
    """A straight path at 600 mm/s at 100 Hz that is visible in some frames."""
    positions = np.full((frames, 3), np.nan)
    positions[list(known)] = 6.0 * np.array(known)[:, None] * [1.0, 0.0, 0.0]
    return positions


def test_two_samples_on_either_side_give_the_process():
    given = path(20, *range(8), *range(12, 20))
    found, expected = interpolate_marker(given, slice(9, 11), 100.0, 600.0, OPTIONS)
    whole, errors = interpolate_gap(given, 8, 12, 100.0)
    np.testing.assert_array_equal(found, whole[1:3])
    np.testing.assert_array_equal(expected, np.maximum(errors[1:3], MIN_EXPECTED_RMS))


@pytest.mark.parametrize("known", [(4, 10), (2, 3, 4, 10), (4, 10, 11, 12)])
def test_one_sample_on_a_side_gives_a_line(known):
    found, expected = interpolate_marker(path(14, *known), slice(6, 8), 100.0, 600.0, OPTIONS)
    np.testing.assert_allclose(found[:, 0], [36.0, 42.0])
    # half the acceleration, times the times from both samples
    np.testing.assert_allclose(expected, [0.5 * 1e4 * 0.02 * 0.04, 0.5 * 1e4 * 0.03 * 0.03])


def test_far_from_both_samples_the_speed_limits_the_error():
    given = path(60, 5, 50)
    _, expected = interpolate_marker(given, slice(6, 50), 100.0, 600.0, OPTIONS)
    assert expected.argmax() in (21, 22)
    np.testing.assert_allclose(expected.max(), 600.0 * 0.22)


@pytest.mark.parametrize(("frames", "speed"), [(slice(0, 3), 600.0), (slice(4, 6), 0.0)])
def test_at_an_end_the_position_is_held(frames, speed):
    found, expected = interpolate_marker(path(6, 3), frames, 100.0, speed, OPTIONS)
    np.testing.assert_array_equal(found[:, 0], 18.0)
    elapsed = np.abs(np.arange(frames.start, frames.stop) - 3) / 100.0
    np.testing.assert_allclose(expected, max(speed, MIN_SPEED) * elapsed)


def test_long_gaps_and_invisible_markers_are_left():
    assert interpolate_marker(path(80, 5, 60), slice(6, 10), 100.0, 600.0, OPTIONS) is None
    assert interpolate_marker(path(80), slice(6, 10), 100.0, 600.0, OPTIONS) is None
