"""Compiled loops over aligned poses, compared with sums of arrays."""

from __future__ import annotations

import numpy as np
import pytest

from priorfill.geometry.alignment_kernels import centroids_and_covariances, to_local

SIZES = [(0, 4), (1, 1), (7, 2), (30, 41)]


def poses(count: int, markers: int) -> np.ndarray:
    return np.random.default_rng(count).normal(size=(count, markers, 3)) * 400.0 + 3000.0


@pytest.mark.parametrize("size", SIZES)
def test_centroids_and_covariances(size: tuple[int, int]) -> None:
    points = poses(*size)
    random = np.random.default_rng(1)
    shape, weights = random.normal(size=(size[1], 3)), random.uniform(0.1, 2.0, size[1])
    share = weights / weights.sum()
    both = np.empty((size[0], 4, 3))
    centroids_and_covariances(points, shape, weights, share, both)
    origin = np.einsum("g,fgi->fi", share, points)
    covariance = np.einsum("g,fgi,gj->fij", weights, points - origin[:, None], shape)
    np.testing.assert_allclose(both[:, 0], origin, rtol=1e-13)
    np.testing.assert_allclose(both[:, 1:], covariance, rtol=1e-11, atol=1e-8)


@pytest.mark.parametrize("size", SIZES)
def test_to_local(size: tuple[int, int]) -> None:
    points = poses(*size)
    random = np.random.default_rng(2)
    origin = random.normal(size=(size[0], 3)) * 1000.0
    rotation = np.linalg.qr(random.normal(size=(size[0], 3, 3)))[0]
    local = np.empty(points.shape)
    to_local(points, origin, rotation, local)
    expected = (points - origin[:, None]) @ rotation
    np.testing.assert_allclose(local, expected, rtol=1e-12, atol=1e-9)


def test_missing_markers_stay_missing_and_spoil_their_pose_alone() -> None:
    points = poses(3, 4)
    points[1, 2] = np.nan
    both, local = np.empty((3, 4, 3)), np.empty(points.shape)
    share = np.full(4, 0.25)
    centroids_and_covariances(points, points[0] - points[0].mean(axis=0), share, share, both)
    assert np.isnan(both).all(axis=(1, 2)).tolist() == [False, True, False]
    to_local(points, np.zeros((3, 3)), np.tile(np.eye(3), (3, 1, 1)), local)
    np.testing.assert_array_equal(local, points)
