"""Sums and maxima over a moving window, compared with SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import correlate1d, maximum_filter1d

from priorfill.signal.running import running_maximum, symmetric_filter


@pytest.mark.parametrize("frames", [1, 2, 9, 200])
@pytest.mark.parametrize("reach", [0, 1, 2, 5, 13, 300])
def test_running_maximum(frames: int, reach: int) -> None:
    values = np.random.default_rng(frames).normal(size=(frames, 3))
    expected = maximum_filter1d(values, 2 * reach + 1, axis=0, mode="nearest")
    np.testing.assert_array_equal(running_maximum(values, reach), expected)
    some = values[:, 0] > 1.0
    near = maximum_filter1d(some.astype(int), 2 * reach + 1, mode="constant") > 0
    np.testing.assert_array_equal(running_maximum(some, reach), near)


@pytest.mark.parametrize("step", [1, 2, 7])
@pytest.mark.parametrize("half", [0, 1, 20])
def test_symmetric_filter(step: int, half: int) -> None:
    rng = np.random.default_rng(half)
    values = rng.normal(size=(90, 2, 3))
    side = rng.normal(size=half)
    taps = np.concatenate([side, [1.0], side[::-1]])
    wanted = np.arange(half, 90 - half, step)
    expected = correlate1d(values, taps, axis=0)[wanted]
    np.testing.assert_allclose(symmetric_filter(values, taps, wanted), expected, atol=1e-12)
    assert len(symmetric_filter(values, taps, wanted[:1])) == 1
    assert symmetric_filter(values, taps, wanted[:0]).shape == (0, 2, 3)
