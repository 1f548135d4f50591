"""Poses of other bodies mapped onto the clip's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from priorfill.geometry.distances import pair_distances
from priorfill.geometry.root_frames import root_group
from priorfill.markers.discover import discover
from priorfill.methods.gpr.other_bodies import BodyMapOptions, body_maps, bring_onto_clip
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.task import THIS_CLIP, Task
from priorfill.search.takes import own_take
from priorfill.signal.resample import Level

TRUNK, ARM = np.array([0, 1, 2, 3]), np.array([4, 5, 6])
LABELS = tuple("ABCDEFG")


def body(frames: int, trunk: float, arm: float, seed: int = 0) -> np.ndarray:
    """Return poses of a rigid trunk of four markers and a swinging arm of three (frames, 7, 3)."""
    time = np.arange(frames) / 30.0 + seed
    angle = 1.2 * np.sin(2.0 * time)
    along = np.stack([np.cos(angle), 0.3 * np.sin(3.0 * time), np.sin(angle)], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    shape = trunk * np.array([[0, 150, 0], [0, -150, 0], [40, 0, 250], [-80, 20, 120.0]])
    poses = np.empty((frames, 7, 3))
    poses[:, TRUNK] = shape
    reach = arm * np.array([150.0, 300.0, 450.0])
    poses[:, ARM] = shape[0] + reach[None, :, None] * along[:, None]
    poses += np.stack([300.0 * trunk * time, 0.0 * time, 900.0 + 0.0 * time], axis=1)[:, None]
    return poses


def centred(poses: np.ndarray) -> np.ndarray:
    return poses - poses[:, TRUNK].mean(axis=1, keepdims=True)


def error(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(((centred(one) - centred(other)) ** 2).sum(axis=2).mean()))


def test_a_larger_body_is_scaled_and_its_path_as_well() -> None:
    clip, large = body(200, 1.0, 1.0), body(200, 1.25, 1.25)
    (matrix,) = body_maps(*pair_distances(clip), [large])
    np.testing.assert_allclose(matrix @ large, clip - [0, 0, 900 - 900 / 1.25], atol=1e-3)


def test_limbs_get_the_lengths_of_the_clip() -> None:
    clip, other = body(200, 1.0, 1.0), body(150, 0.95, 1.2, seed=5)
    (matrix,) = body_maps(*pair_distances(clip), [other])
    expected = body(150, 1.0, 1.0, seed=5)
    assert error(matrix @ other, expected) < 0.15 * error(other, expected)


def test_differences_of_posture_are_not_taken_for_differences_of_bodies() -> None:
    clip, other = body(200, 1.0, 1.0), body(150, 1.0, 1.0, seed=5)
    options = BodyMapOptions(same_body_distance=0.0)
    noise = np.random.default_rng(0).normal(0.0, 1.0, other.shape)
    (matrix,) = body_maps(*pair_distances(clip), [other + noise], options)
    assert error(matrix @ other, other) < 5.0  # the joint bends by other angles


def test_nothing_is_mapped_where_the_clips_own_body_is_among_the_subjects() -> None:
    clip, own, large = body(200, 1.0, 1.0), body(150, 1.0, 1.0, seed=5), body(100, 1.2, 1.2)
    assert body_maps(*pair_distances(clip), [large, own]) == []
    positions = np.concatenate([large, own]).astype(np.float32)
    mapped = positions.copy()
    bring_onto_clip(mapped, np.repeat([0, 1], [100, 150]), np.arange(250), pair_distances(clip))
    np.testing.assert_array_equal(mapped, positions)


def test_each_matrix_is_the_minimum_of_the_squared_differences() -> None:
    """Against least squares over all pairs of markers, written out."""
    rng = np.random.default_rng(1)
    clip, other = body(60, 1.0, 1.0), body(60, 0.9, 1.1, seed=2) + rng.normal(0, 5, (60, 7, 3))
    distance, spread = pair_distances(clip)
    (matrix,) = body_maps(distance, spread, [other])
    length, varies = pair_distances(other, 1)
    varies = np.maximum(spread, varies)
    share = 1.0 / (1.0 + (varies / 20.0) ** 2)
    np.fill_diagonal(distance, 1.0)
    np.fill_diagonal(length, 1.0)
    ratio = np.log(distance / length)
    off = 1.0 - np.eye(7)
    scale = (off * distance * share**2 * ratio).sum() / (off * distance * share**2).sum()
    weight = off * np.exp(-(distance**2) / (2.0 * 400.0**2)) / (10.0**2 + varies**2)
    place = 1e-3 * weight.sum(axis=1).mean()
    rows, target = [], []
    for i in range(7):
        rows.append(np.sqrt(place) * np.eye(7)[i])
        target.append(np.sqrt(place) * np.exp(scale) * other[3, i])
        for j in range(i):
            root = np.sqrt(weight[i, j])
            rows.append(root * (np.eye(7)[i] - np.eye(7)[j]))
            apart = (distance[i, j] * (ratio[i, j] - scale)) ** 2
            certain = share[i, j] * apart / (apart + varies[i, j] ** 2)
            factor = np.exp(scale + certain * (ratio[i, j] - scale))
            target.append(root * factor * (other[3, i] - other[3, j]))
    expected = np.linalg.lstsq(np.array(rows), np.array(target), rcond=None)[0]
    np.testing.assert_allclose(matrix @ other[3], expected, rtol=1e-6, atol=1e-3)


def test_pairs_that_the_clip_does_not_show_are_only_scaled() -> None:
    clip, other = body(100, 1.0, 1.0), body(100, 1.3, 1.3, seed=4)
    distance, spread = pair_distances(clip)
    distance[6], spread[6], distance[:, 6], spread[:, 6] = (np.inf,) * 4
    (matrix,) = body_maps(distance, spread, [other])
    np.testing.assert_allclose(matrix @ other, other / 1.3, atol=0.2)


def test_only_poses_of_others_are_mapped() -> None:
    clip = body(80, 1.0, 1.0)
    parts = [body(30, 1.1, 0.9, seed=1), body(20, 1.0, 1.0), body(25, 0.8, 0.8, seed=3)]
    positions = np.concatenate(parts).astype(np.float32)
    positions[40, 2] = np.nan
    subject = np.repeat([7, THIS_CLIP, 7], [30, 20, 25])
    rows = np.flatnonzero(~np.isnan(positions).any(axis=(1, 2)))
    mapped = positions.copy()
    bring_onto_clip(mapped, subject, rows, pair_distances(clip))
    np.testing.assert_array_equal(mapped[30:50], positions[30:50])
    for poses, expected in ((mapped[:30], parts[0]), (mapped[50:], parts[2])):
        assert not np.allclose(poses, expected, atol=10.0)
    (matrix,) = body_maps(*pair_distances(clip), [np.concatenate([parts[0], parts[2]])])
    np.testing.assert_allclose(mapped[:30], matrix @ parts[0], atol=2.0)


@pytest.mark.parametrize(
    ("subject", "same_subject", "mapped"),
    [("B", False, True), ("B", True, False), ("A", False, False)],
)
def test_a_search_compares_poses_on_the_clips_body(
    subject: str, same_subject: bool, mapped: bool
) -> None:
    clip, large = body(120, 1.0, 1.0), body(120, 1.3, 1.3)
    task = Task(clip, LABELS, 30.0, discover(clip, LABELS), (), subject="A")
    take = replace(own_take([Level(large, 30.0, 1)], "large", subject), own=False)
    task = replace(task, takes=(replace(take, same_subject=same_subject),))
    search = PoseSearch(task)
    root = root_group(clip, TRUNK.tolist())
    assert root is not None
    bank = search.bank(root, np.arange(7), np.arange(7), 30.0, on_clips_body=True)
    distance, _ = bank.search(clip[10:100], root.frames(clip[10:100]), 1)
    assert (distance.max() < 0.1) == mapped
    recorded = search.bank(root, np.arange(7), np.arange(7), 30.0)
    assert recorded.search(clip[10:100], root.frames(clip[10:100]), 1)[0].min() > 10.0
