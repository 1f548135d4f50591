import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive import turned
from scipy.spatial.transform import Rotation

from priorfill.geometry.root_frames import heading_frames, rigid_frames, root_group
from priorfill.markers.marker_set import MarkerSet
from priorfill.markers.root_choice import choose_root

angles = st.floats(-3.1, 3.1)
seeds = st.integers(0, 2**31)


def body(seed, frames=20, markers=6):
    """A group of markers that turns and travels while nearly keeping its shape."""
    rng = np.random.default_rng(seed)
    shape = rng.normal(0, 100, (markers, 3))
    heading = np.cumsum(rng.normal(0, 0.1, frames))
    path = np.cumsum(rng.normal(0, 10, (frames, 3)), axis=0)
    poses = np.stack([turned(shape, a, p) for a, p in zip(heading, path, strict=True)])
    return poses + rng.normal(0, 1, poses.shape)


@given(seeds, angles)
def test_local_poses_do_not_depend_on_place_and_heading(seed, angle):
    poses = body(seed)
    moved = turned(poses, angle, [1000.0, -2000.0, 50.0])
    group = root_group(poses, range(6))
    local = group.frames(poses).to_local(poses)
    np.testing.assert_allclose(group.frames(moved).to_local(moved), local, atol=1e-9)


@given(seeds)
def test_there_and_back(seed):
    poses = body(seed)
    for frames in (heading_frames, rigid_frames):
        root = frames(poses, poses[0])
        np.testing.assert_allclose(root.to_world(root.to_local(poses)), poses, atol=1e-9)


@given(seeds)
def test_heading_is_the_best_one(seed):
    poses = body(seed)
    weights = np.random.default_rng(seed).uniform(0.1, 1, 6)
    root = heading_frames(poses, poses[0], weights)
    shape = poses[0] - weights @ poses[0] / weights.sum()

    def misfit(frames):
        return ((frames.to_local(poses) - shape) ** 2 * weights[:, None]).sum(axis=(1, 2))

    best = misfit(root)
    for turn in (-0.01, 0.01):
        c, s = np.cos(turn), np.sin(turn)
        other = type(root)(
            root.origin, root.rotation @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        )
        assert (misfit(other) >= best).all()


@given(seeds)
def test_rigid_frames_undo_any_rotation(seed):
    rng = np.random.default_rng(seed)
    shape = rng.normal(0, 100, (5, 3))
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    poses = (shape @ rotation + [10.0, 20.0, 30.0])[None]
    root = rigid_frames(poses, shape)
    assert np.linalg.det(root.rotation[0]) == pytest.approx(1)
    np.testing.assert_allclose(root.to_local(poses)[0], shape - shape.mean(axis=0), atol=1e-8)


def test_a_missing_pelvis_is_a_case_not_an_error():
    labels = ("P1", "P2", "P3", "H1", "H2", "H3")
    segment = dict(zip(labels, ["pelvis"] * 3 + ["head"] * 3, strict=True))
    marker_set = MarkerSet(
        "test", labels, segment, dict.fromkeys(labels, True), {}, ("pelvis", "head")
    )
    poses = body(1)
    everything = np.ones(6, dtype=bool)
    assert choose_root(marker_set, labels, poses, everything).markers == (0, 1, 2)
    no_pelvis = np.array([False, True, True, True, True, True])
    assert choose_root(marker_set, labels, poses, no_pelvis).markers == (3, 4, 5)
    two = np.array([False, True, False, False, True, False])
    assert choose_root(marker_set, labels, poses, two).markers == (1, 4)
    one = np.array([False, True, False, False, False, False])
    assert choose_root(marker_set, labels, poses, one) is None


def test_a_group_that_is_never_complete_gives_no_root():
    poses = body(2)
    poses[::2, 0] = np.nan
    poses[1::2, 1] = np.nan
    assert root_group(poses, (0, 1, 2)) is None


@settings(deadline=None)
@given(seeds)
def test_a_mirrored_pose_is_turned_and_not_reflected(seed):
    rng = np.random.default_rng(seed)
    shape, weights = rng.normal(0, 100, (5, 3)), rng.uniform(0.1, 1, 5)
    poses = np.stack([shape, shape * [-1.0, 1.0, 1.0], -shape])
    root = rigid_frames(poses, shape, weights)
    np.testing.assert_allclose(np.linalg.det(root.rotation), 1.0)
    centred = shape - weights @ shape / weights.sum()
    for pose, local in zip(poses, root.to_local(poses), strict=True):
        about = pose - weights @ pose / weights.sum()
        best, _ = Rotation.align_vectors(centred, about, weights=weights)
        misfit, least = (weights @ (x - centred) ** 2 for x in (local, best.apply(about)))
        assert misfit.sum() == pytest.approx(least.sum(), abs=1e-6)


def test_which_segment_gives_the_root_frame():
    labels = tuple("abcdefghijkl")
    names = ["line"] * 3 + ["small"] * 3 + ["large"] * 4 + ["two"] * 2
    segment = dict(zip(labels, names, strict=True))

    def chosen(*preferred, gone=()):
        marker_set = MarkerSet("test", labels, segment, dict.fromkeys(labels, True), {}, preferred)
        poses = np.random.default_rng(0).normal(0, 1, (1, 12, 3))
        poses[0, 3:6, :2] += [[0, 0], [80, 0], [0, 80]]
        poses[0, 6:10, :2] += [[0, 0], [90, 0], [0, 90], [90, 90]]
        poses[0, :3, 2] += [0, 100, 200]  # above each other: no heading
        poses[0, 10:, 0] += [0, 400]
        valid = ~np.isin(labels, list(gone))
        return choose_root(marker_set, labels, poses, valid).markers

    assert chosen("small", "large") == (3, 4, 5)
    assert chosen("line", "small") == (3, 4, 5)
    assert chosen("two", "line") == chosen() == (6, 7, 8, 9)  # then the one of most markers
    assert chosen("large", gone="g") == (7, 8, 9)
    assert chosen("large", gone="gh") == (3, 4, 5)
    assert chosen("large", gone="ghf") == (0, 1, 2, 3, 4, 8, 9, 10, 11)
