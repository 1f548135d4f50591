"""Distances of markers, pooled over recordings, against loops."""

from __future__ import annotations

import numpy as np

from priorfill.geometry.distances import (
    MAX_POSES,
    median_distances,
    norms,
    pair_distances,
    pooled_distances,
)


def recordings(seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    made = []
    for poses in (9, 1, 14):
        positions = rng.normal(0, 100, (poses, 5, 3))
        positions[rng.random((poses, 5)) < 0.3] = np.nan
        positions[:, 4] = np.nan
        made.append(positions)
    return made


def test_pooled_distances() -> None:
    parts, markers = recordings(), np.array([3, 0])
    distance, spread = pooled_distances(parts, markers)
    for row, marker in enumerate(markers):
        for other in range(5):
            lengths, away = [], []
            for part in parts:
                here = np.linalg.norm(part[:, marker] - part[:, other], axis=1)
                here = here[~np.isnan(here)]
                lengths += list(here)
                away += list(here - here.mean()) if len(here) else []
            if not lengths:
                assert np.isinf(distance[row, other])
                assert np.isinf(spread[row, other])
                continue
            assert np.isclose(distance[row, other], np.sqrt(np.mean(np.square(lengths))))
            assert np.isclose(spread[row, other], np.sqrt(np.mean(np.square(away))))
    assert pooled_distances([], markers)[0].shape == (2, 0)


def test_one_recording_pooled_is_the_recording() -> None:
    part = recordings(1)[2]
    pooled, pairs = pooled_distances([part], np.arange(5)), pair_distances(part, min_common=1)
    for one, other in zip(pooled, pairs, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-4)


def test_median_distances() -> None:
    part = recordings()[2]
    one, other = np.triu_indices(5, 1)
    for a, b, found in zip(one, other, median_distances(part, one, other), strict=True):
        lengths = np.linalg.norm(part[:, a] - part[:, b], axis=1)
        lengths = np.sort(lengths[~np.isnan(lengths)])
        if len(lengths):
            assert found == lengths[(len(lengths) - 1) // 2]
        else:
            assert np.isnan(found)


def test_pair_distances() -> None:
    positions = recordings(2)[2]
    for min_common in (1, 5, 6, 7):
        distance, spread = pair_distances(positions, min_common)
        for one in range(5):
            for other in range(5):
                lengths = np.linalg.norm(positions[:, one] - positions[:, other], axis=1)
                lengths = lengths[~np.isnan(lengths)]
                known = len(lengths) >= min_common
                rms = np.sqrt(np.mean(lengths**2)) if known else np.inf
                assert np.isclose(distance[one, other], rms)
                assert np.isclose(spread[one, other], lengths.std() if known else np.inf)


def test_five_poses_are_enough_for_a_pair() -> None:
    positions = np.random.default_rng(0).normal(0, 100, (5, 2, 3))
    assert np.isfinite(pair_distances(positions)).all()
    assert np.isinf(pair_distances(positions[:4])).all()


def test_distances_of_a_long_recording_are_those_of_some_poses() -> None:
    positions = np.random.default_rng(0).normal(0, 100, (2 * MAX_POSES - 1, 2, 3))
    for one, other in zip(pair_distances(positions), pair_distances(positions[::2]), strict=True):
        np.testing.assert_array_equal(one, other)
    short = positions[:MAX_POSES]
    lengths = np.linalg.norm(short[:, 0] - short[:, 1], axis=1)
    assert np.isclose(pair_distances(short)[1][0, 1], lengths.std())


def test_lengths() -> None:
    vectors = np.array([[[3.0, 4.0, 12.0], [0.0, 0.0, -2.0]], [[0.0, -5.0, 0.0], [1.0, 2.0, 2.0]]])
    np.testing.assert_allclose(norms(vectors), [[13.0, 2.0], [5.0, 3.0]])
