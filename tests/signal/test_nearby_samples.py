"""Gaussian processes of time through the samples nearest to gaps."""

from __future__ import annotations

import numpy as np
import pytest

from priorfill.gp.kernels import Matern52
from priorfill.gp.process import GaussianProcess
from priorfill.signal.gp_interpolation import InterpolationOptions, interpolate_gap
from priorfill.signal.nearby_samples import NearbySamples, SampleWeights

RATE = 120.0
PROCESS = GaussianProcess(Matern52(0.3), 1e-5)


def paths(seed: int) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Two smooth markers with scattered missing samples."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(200, 2, 3)).cumsum(axis=0).cumsum(axis=0)
    positions = 0.1 * steps
    positions[rng.random((200, 2)) < 0.3] = np.nan
    return positions, {m: np.flatnonzero(~np.isnan(positions[:, m, 0])) for m in (0, 1)}


@pytest.mark.parametrize("seed", range(5))
def test_many_gaps_at_once_are_those_interpolated_one_by_one(seed):
    positions, known = paths(seed)
    rng = np.random.default_rng(seed)
    starts = np.sort(rng.integers(30, 160, 12))
    markers = np.sort(rng.integers(0, 2, 12))
    length = 4
    near = NearbySamples.of(known, (markers, starts), length, 100, round(0.3 * RATE))
    (weights,) = SampleWeights.of(near, (PROCESS,), RATE)
    found, scale = weights.predict(positions[near.frames, near.markers[:, None]], near.used)
    latent = weights.variance[weights.pattern] - PROCESS.noise_variance
    rms = np.sqrt(3.0 * scale[:, None] * np.maximum(latent, PROCESS.noise_variance))
    options = InterpolationOptions(context_seconds=0.3, process=PROCESS)
    assert len(near.starts) == 12
    for marker, start, one, error in zip(near.markers, near.starts, found, rms, strict=True):
        path = positions[:, marker].copy()
        path[start : start + length] = np.nan
        expected = interpolate_gap(path, int(start), int(start) + length, RATE, options)
        assert expected is not None
        np.testing.assert_allclose(one, expected[0], atol=1e-6)
        np.testing.assert_allclose(error, expected[1], rtol=1e-4)


def test_gaps_with_fewer_than_two_samples_on_a_side_are_left_out():
    known = {0: np.array([1, 2, 3, 6, 7, 10, 20])}
    near = NearbySamples.of(known, (np.zeros(2, int), np.array([4, 8])), 2, 6, 3)
    assert near.starts.tolist() == [4]  # after the other one, 20 is too far
    assert near.frames[near.used].tolist() == [1, 2, 3, 6, 7]
