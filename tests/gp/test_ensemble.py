from dataclasses import replace

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.geometry.root_frames import rigid_frames
from priorfill.gp.calibration import BOUND_FACTOR, UNIT_BOUND
from priorfill.gp.data import (
    BODY_OFFSET,
    Lesson,
    Member,
    Rows,
)
from priorfill.gp.ensemble import PRIOR_BLOCKS, _calibrate, regress
from priorfill.gp.features import ALIGNMENT_FLOOR, Moment, View
from priorfill.gp.pose_kernel import FADED, Kernel

KERNEL = Kernel(1.0, 0.1, 1.0, 0.001, 0.1, smooth=False, noise=1e-4)
VIEW = View("rigid", 220.0, 0.005, 10.0)
MEMBERS = [Member(VIEW, None, KERNEL)]


def rigid_clip(seed, frames=120, noise=0.0):
    """Five markers of a rigid body that tumbles and travels (frames, 5, 3)."""
    rng = np.random.default_rng(seed)
    shape = rng.normal(0, 80, (5, 3))
    time = np.arange(frames) / 100
    poses = []
    for t in time:
        a, b = 0.8 * np.sin(2 * t), 0.5 * np.cos(3 * t)
        turn = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]) @ [
            [np.cos(b), -np.sin(b), 0],
            [np.sin(b), np.cos(b), 0],
            [0, 0, 1],
        ]
        poses.append(shape @ turn.T + [500 * t, 100 * np.sin(t), 900])
    return np.array(poses) + rng.normal(0, noise, (frames, 5, 3)), time


def split(poses, time, gap, marker=0):
    others = [m for m in range(poses.shape[1]) if m != marker]
    seen = np.setdiff1d(np.arange(len(poses)), gap)
    take = np.zeros(len(poses), dtype=np.intp)
    rows = Rows(poses[np.ix_(seen, others)], poses[np.ix_(seen, [marker])], time[seen], take[seen])
    query = Rows(poses[np.ix_(gap, others)], np.empty((len(gap), 0, 3)), time[gap], take[gap])
    return rows, query


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**31))
def test_a_rigid_body_is_predicted_exactly(seed):
    poses, time = rigid_clip(seed)
    gap = np.arange(40, 80)
    rows, query = split(poses, time, gap)
    distance = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1)
    found = regress([Lesson(rows, query, distance, np.zeros(4))], MEMBERS, 0.4)
    np.testing.assert_allclose(found.positions[:, 0], poses[gap, 0], atol=0.05)


def test_the_deviation_is_of_the_size_of_the_error():
    for seed in range(12):
        poses, time = rigid_clip(seed, noise=2.0)
        gap = np.arange(40, 80)
        rows, query = split(poses, time, gap)
        distance = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1)
        found = regress([Lesson(rows, query, distance, np.full(4, 2.0))], MEMBERS, 0.4)
        error = np.sqrt(((found.positions[:, 0] - poses[gap, 0]) ** 2).sum(axis=1).mean())
        assert 0.5 < np.sqrt((found.expected_rms**2).mean()) / error < 2.0


@given(st.integers(0, 2**31), st.floats(-3, 3))
@settings(deadline=None, max_examples=15)
def test_prediction_turns_and_moves_with_the_body(seed, angle):
    poses, time = rigid_clip(seed, noise=2.0)
    gap = np.arange(50, 70)
    distance = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1)
    shift = np.array([3000.0, -500.0, 200.0])
    members = [*MEMBERS, Member(View("heading", 220.0, 0.1), None, KERNEL)]

    def predict(clip):
        rows, query = split(clip, time, gap)
        lesson = Lesson(rows, query, distance, np.full(4, 2.0))
        return regress([lesson], members, 0.2).positions

    moved = predict(naive.turned(poses, angle, shift))
    np.testing.assert_allclose(moved, naive.turned(predict(poses), angle, shift), atol=1e-5)


def test_rows_of_other_takes_are_no_neighbours_in_time():
    rows = Rows(
        np.zeros((3, 1, 3)), np.zeros((3, 1, 3)), np.array([0.0, 1.0, 0.0]), np.array([0, 0, 1])
    )
    np.testing.assert_array_equal(rows.lag(rows)[0], [0, 1, np.inf])
    assert [list(b) for b in rows.blocks(0.5)] == [[0], [1], [2]]


def test_bodies_have_offsets_and_agree_by_kinship():
    rows = Rows(
        np.zeros((4, 1, 3)),
        np.zeros((4, 1, 3)),
        np.zeros(4),
        np.array([0, 1, 2, 3]),
        np.array([1.0, 0.9, 0.9, 0.5]),
        np.array([0, 7, 7, 8]),
    )
    query = Rows(np.zeros((1, 1, 3)), np.empty((1, 0, 3)), np.zeros(1), np.array([0]))
    np.testing.assert_allclose(query.correlation(rows), [[1.0, 0.9, 0.9, 0.5]])
    np.testing.assert_allclose(rows.correlation(rows)[1], [0.9, 1.0, 1.0, 0.45])
    np.testing.assert_array_equal(query.offset(rows), [[BODY_OFFSET, 0, 0, 0]])
    np.testing.assert_array_equal(rows.offset(rows)[1], [0, BODY_OFFSET, BODY_OFFSET, 0])
    assert query.offset(query) == 0.0  # nobody else is there
    assert [list(b) for b in rows.blocks(1.0)] == [[0]]


def test_what_another_body_is_off_by_does_not_matter():
    """A body with longer limbs shows a movement that the clip does not."""
    poses, time = rigid_clip(0, frames=200)
    gap = np.arange(100, 200)
    rows, query = split(poses, time, gap)
    elsewhere = poses[gap][:, :1] + 0.0
    distance = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1)

    def off(offset):
        # in its own frame, which the visible markers give
        other = poses[gap].copy()
        ahead = other[:, 2] - other[:, 1]
        other[:, 0] += offset * ahead / np.linalg.norm(ahead, axis=1)[:, None]
        both = Rows(
            np.concatenate([rows.visible, other[:, 1:]]),
            np.concatenate([rows.missing, other[:, :1]]),
            np.concatenate([rows.time, time[gap]]),
            np.repeat([0, 1], [len(rows.time), len(gap)]),
            np.repeat([1.0, 0.95], [len(rows.time), len(gap)]),
            np.repeat([0, 1], [len(rows.time), len(gap)]),
        )
        lesson = Lesson(both, query, distance, np.zeros(4))
        return regress([lesson], MEMBERS, 0.4).positions

    np.testing.assert_allclose(off(60.0), elsewhere, atol=1.0)
    np.testing.assert_allclose(off(60.0), off(0.0), atol=1.0)


def test_a_handicap_takes_a_lesson_out():
    poses, time = rigid_clip(1, noise=2.0)
    rows, query = split(poses, time, np.arange(40, 80))
    distance = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1)
    lesson = Lesson(rows, query, distance, np.full(4, 2.0))
    wrong = Lesson(
        replace(rows, missing=rows.missing + 500.0 * time[10]), query, distance, lesson.spread
    )
    alone = regress([lesson], MEMBERS, 0.4)
    out = regress([lesson, replace(wrong, handicap=100.0)], MEMBERS, 0.4)
    np.testing.assert_allclose(out.positions, alone.positions, atol=1e-9)
    np.testing.assert_allclose(out.expected_rms, alone.expected_rms, rtol=1e-6)
    assert out.bound_factor == pytest.approx(alone.bound_factor)


def test_blocks_are_as_long_as_asked():
    time = np.arange(100) / 10
    rows = Rows(np.zeros((100, 1, 3)), np.zeros((100, 1, 3)), time, np.zeros(100, dtype=int))
    blocks = rows.blocks(2.0)
    assert len(blocks) == 5
    assert sorted(np.concatenate(blocks)) == list(range(100))
    assert all(np.ptp(time[b]) < 2.0 for b in blocks)


def test_kernel_of_a_pose_with_itself():
    product, zero = np.array([[2.0]]), np.zeros((1, 1))
    found = KERNEL.covariance(product, zero, KERNEL.decay(zero))[0, 0]
    assert found == pytest.approx(1 + 2.0 + 0.1 + 0.001)
    smooth = Kernel(0.0, 0.0, 1.0, 0.5, 0.2, smooth=True, noise=0.0)
    r = np.sqrt(3) * 0.1 / 0.2
    near, far = smooth.decay(np.array([[0.1], [np.inf]]))[:, 0]
    assert near == pytest.approx(0.5 * (1 + r) * np.exp(-r))
    assert far == pytest.approx(0.0)
    assert smooth.covariance(product, zero, zero)[0, 0] == pytest.approx(1.0)


def test_a_kernel_may_forget_what_is_long_ago():
    assert KERNEL.memory(np.array([[0.0, np.inf]])) == 1.0
    fading = replace(KERNEL, fading=2.0).memory(np.array([[0.0, 2.0, np.inf]]))
    np.testing.assert_allclose(fading, [[1.0, FADED + (1 - FADED) / np.e, FADED]])


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**31), st.booleans(), st.sampled_from([None, 0.3]))
def test_a_member_predicts_as_the_textbook_says(seed, velocity, fading):
    """Against solving for every query by itself, with features spelt out."""
    poses, time = rigid_clip(seed, noise=3.0)
    gap = np.arange(40, 60)
    rows, query = split(poses, time, gap)

    def with_moment(part):
        at = np.round(part.time * 100).astype(int)
        around = np.stack([poses[np.clip(at + d, 0, len(poses) - 1), 1:] for d in (-3, 3)])
        return replace(part, around={0.03: around})

    rows, query = with_moment(rows), with_moment(query)
    moving = np.random.default_rng(seed).normal(0, 100, rows.missing.shape)
    rows = replace(rows, moving=moving)
    distance, spread = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1), np.full(4, 2.0)
    moment = Moment(0.03, 0.7, velocity=velocity)
    kernel = replace(KERNEL, fading=fading)
    found = regress([Lesson(rows, query, distance, spread)], [Member(VIEW, moment, kernel)], 0.2)

    nearness, firmness = np.exp(-(distance**2) / (2 * 220.0**2)), 1 / (1 + (2.0 / 10.0) ** 2)
    weight = nearness * np.sqrt(firmness) + 0.005
    template = rows.visible[len(rows.visible) // 2]

    def aligned(part):
        frames = rigid_frames(part.visible, template, nearness * firmness + ALIGNMENT_FLOOR)
        features = []
        for i in range(len(part.time)):
            turn, origin = frames.rotation[i], frames.origin[i]
            here = (part.visible[i] - origin) @ turn
            before, after = ((part.around[0.03][j][i] - origin) @ turn for j in (0, 1))
            beside = [after - before] if velocity else [before, after]
            features.append(np.concatenate([here, *(0.7 * x for x in beside)]).reshape(-1, 4, 3))
        return frames, (np.array(features) * weight[:, None]).reshape(len(features), -1)

    row_frames, known = aligned(rows)
    query_frames, asked = aligned(query)
    mean = known.mean(axis=0)
    scale = np.sqrt(((known - mean) ** 2).sum(axis=1).mean())
    known, asked = (known - mean) / scale, (asked - mean) / scale

    def covariance(a, b, lag):
        value = 1 + a @ b + 0.1 * np.exp(-0.5 * np.sum((a - b) ** 2))
        if fading:
            value *= FADED + (1 - FADED) * np.exp(-lag / fading)
        return value + 0.001 * np.exp(-lag / 0.1)

    turned = np.einsum("ri,rij->rj", moving[:, 0], row_frames.rotation)
    targets = np.concatenate([row_frames.to_local(rows.missing)[:, 0], turned], axis=1)
    matrix = np.array(
        [
            [covariance(a, b, abs(s - t)) for b, t in zip(known, rows.time, strict=True)]
            for a, s in zip(known, rows.time, strict=True)
        ]
    ) + 1e-4 * np.eye(len(known))
    solved = np.linalg.solve(matrix, targets - targets.mean(axis=0))
    for i in range(len(gap)):
        cross = [
            covariance(asked[i], b, abs(query.time[i] - t))
            for b, t in zip(known, rows.time, strict=True)
        ]
        expected = cross @ solved + targets.mean(axis=0)
        local = query_frames.to_local(found.positions)[i, 0]
        np.testing.assert_allclose(local, expected[:3], atol=1e-6)
        velocity = found.motion.velocity[i, 0] @ query_frames.rotation[i]
        np.testing.assert_allclose(velocity, expected[3:], atol=1e-6)


def test_members_count_less_in_frames_that_they_doubt():
    """Two members err alike on rows; one has seen nothing like the second half of the gap."""
    poses, time = rigid_clip(4, noise=2.0)
    rows, query = split(poses, time, np.arange(40, 60))
    lesson = Lesson(rows, query, np.full(4, 80.0), np.full(4, 2.0))
    near = replace(KERNEL, radial=10.0, length=0.05)
    wide = replace(KERNEL, radial=10.0)
    members = [Member(VIEW, None, kernel) for kernel in (near, wide)]
    alone = [regress([lesson], [member], 0.2).positions for member in members]
    both = regress([lesson], members, 0.2).positions
    span = alone[0] - alone[1]
    share = ((both - alone[1]) * span).sum(axis=(1, 2)) / (span**2).sum(axis=(1, 2))
    assert ((share >= 0.0) & (share <= 1.0)).all()
    assert np.ptp(share) > 0.0  # not the same in all frames


def test_velocities_are_told_only_if_rows_say_them():
    poses, time = rigid_clip(5, noise=1.0)
    rows, query = split(poses, time, np.arange(40, 60))
    lesson = Lesson(rows, query, np.full(4, 80.0), np.full(4, 2.0))
    assert regress([lesson], MEMBERS, 0.2).motion is None
    velocity = np.gradient(poses[:, :1], time, axis=0)
    seen = np.setdiff1d(np.arange(len(poses)), np.arange(40, 60))
    told = replace(lesson, rows=replace(rows, moving=velocity[seen]))
    assert regress([told, lesson], MEMBERS, 0.2).motion is None
    found = regress([told], MEMBERS, 0.2)
    alone = regress([lesson], MEMBERS, 0.2)
    np.testing.assert_allclose(found.positions, alone.positions, atol=1e-9)
    speed = np.linalg.norm(velocity[40:60], axis=2)
    wrong = np.linalg.norm(found.motion.velocity - velocity[40:60], axis=2)
    assert wrong.mean() < 0.5 * speed.mean()
    assert (found.motion.expected_rms > 0.0).all()
    off = np.sqrt(((found.positions - poses[40:60, :1]) ** 2).sum(axis=2).mean())
    assert off / 3.0 < found.motion.error[0] < off * 3.0


def test_a_lesson_without_a_moment_is_read_by_the_others():
    poses, time = rigid_clip(3, noise=1.0)
    rows, query = split(poses, time, np.arange(40, 60))
    lesson = Lesson(rows, query, np.full(4, 80.0), np.full(4, 2.0))
    members = [*MEMBERS, Member(VIEW, Moment(0.1, 1.0), KERNEL)]
    alone, both = regress([lesson], MEMBERS, 0.2), regress([lesson], members, 0.2)
    np.testing.assert_array_equal(alone.positions, both.positions)


def test_the_mixture_is_judged_by_what_it_got_wrong():
    """Errors of 3 mm a coordinate where 1 was predicted, in many blocks and in few."""
    rng = np.random.default_rng(0)
    residuals = rng.normal(0, 3.0, (1, 40000, 1, 3))
    factor, bound = _calibrate(np.ones(1), residuals, np.full((1, 40000, 1), 3.0), 10**6)
    assert factor == pytest.approx(3.0, rel=0.01)
    assert bound == pytest.approx(UNIT_BOUND / np.sqrt(3.0), rel=0.01)
    factor, bound = _calibrate(
        np.ones(1), residuals, np.full((1, 40000, 1), 3.0), int(PRIOR_BLOCKS)
    )
    assert factor == pytest.approx(np.sqrt(3.0), rel=0.01)
    assert UNIT_BOUND / np.sqrt(3.0) < bound < BOUND_FACTOR
