"""Complete poses, and evenly spaced ones."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from priorfill.geometry.poses import complete_poses, evenly_spaced, sample_complete_poses


@given(st.integers(0, 300), st.integers(0, 300))
def test_evenly_spaced(count: int, most: int) -> None:
    some = evenly_spaced(count, most)
    assert len(some) == min(count, most)
    if len(some) > 1:
        assert (some[0], some[-1]) == (0, count - 1)
        steps = np.diff(some)
        assert steps.min() >= 1
        assert steps.max() - steps.min() <= 1


def test_complete_poses() -> None:
    poses = np.arange(60.0).reshape(10, 2, 3)
    poses[3, 1] = poses[7] = np.nan
    np.testing.assert_array_equal(np.flatnonzero(~complete_poses(poses)), [3, 7])
    np.testing.assert_array_equal(sample_complete_poses(poses, 3), poses[[0, 4, 9]])
    np.testing.assert_array_equal(sample_complete_poses(poses, 99), poses[complete_poses(poses)])
    assert sample_complete_poses(poses[[3]], 5).shape == (0, 2, 3)
