"""Distances of markers, pooled over recordings, against loops."""

from __future__ import annotations

import numpy as np

from priorfill.distances import median_distances, pair_distances, pooled_distances


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
    distance, deviation = pooled_distances(parts, markers)
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
                assert np.isinf(deviation[row, other])
                continue
            assert np.isclose(distance[row, other], np.sqrt(np.mean(np.square(lengths))))
            assert np.isclose(deviation[row, other], np.sqrt(np.mean(np.square(away))))
    assert pooled_distances([], markers)[0].shape == (2, 0)


def test_one_recording_pooled_is_the_recording() -> None:
    part = recordings(1)[2]
    pooled, pairs = pooled_distances([part], np.arange(5)), pair_distances(part, fewest=1)
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
