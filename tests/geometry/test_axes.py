"""Turning clips upright and back."""

from __future__ import annotations

import numpy as np
import pytest

from priorfill.errors import OptionError
from priorfill.geometry.axes import UP_AXES, from_upright, to_upright


@pytest.mark.parametrize("up", UP_AXES)
def test_is_a_rotation_that_takes_up_to_z(up: str) -> None:
    matrix = to_upright(np.eye(3), up).T  # columns: where x, y, z go
    assert np.linalg.det(matrix) == 1.0
    np.testing.assert_array_equal(matrix @ matrix.T, np.eye(3))
    axis = np.zeros(3)
    axis["XYZ".index(up[1])] = 1.0 if up[0] == "+" else -1.0
    np.testing.assert_array_equal(to_upright(axis, up), [0, 0, 1])


@pytest.mark.parametrize("up", UP_AXES)
def test_there_and_back_is_exact(up: str) -> None:
    positions = np.random.default_rng(0).normal(0, 1000, (7, 4, 3))
    positions[2, 1] = np.nan
    np.testing.assert_array_equal(from_upright(to_upright(positions, up), up), positions)
    assert np.shares_memory(to_upright(positions, up), positions) == (up == "+Z")


def test_unknown_axis() -> None:
    for turn in (to_upright, from_upright):
        with pytest.raises(OptionError, match="up axis 'Z' is unknown"):
            turn(np.zeros((1, 1, 3)), "Z")


@pytest.mark.parametrize(
    ("up", "expected"),
    [  # of the point (1, 2, 3): turned by 90 degrees, of -Z by 180
        ("+X", [-3.0, 2.0, 1.0]),
        ("-X", [3.0, 2.0, -1.0]),
        ("+Y", [1.0, -3.0, 2.0]),
        ("-Y", [1.0, 3.0, -2.0]),
        ("+Z", [1.0, 2.0, 3.0]),
        ("-Z", [1.0, -2.0, -3.0]),
    ],
)
def test_where_a_point_goes(up: str, expected: list[float]) -> None:
    np.testing.assert_array_equal(to_upright(np.array([1.0, 2.0, 3.0]), up), expected)
    np.testing.assert_array_equal(from_upright(np.array(expected), up), [1.0, 2.0, 3.0])
