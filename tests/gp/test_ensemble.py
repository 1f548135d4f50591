from dataclasses import replace
from types import SimpleNamespace

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.geometry.root_frames import rigid_frames
from priorfill.gp.calibration import BOUND_FACTOR, UNIT_BOUND
from priorfill.gp.ensemble import (
    EnsembleOptions,
    _calibrate,
    _CrossValidation,
    _Ensemble,
    regress,
)
from priorfill.gp.features import MIN_ALIGNMENT_WEIGHT, Alignment, LagFeature
from priorfill.gp.fitted_models import Predictions
from priorfill.gp.kernels import Exponential, Forgetting, SameSubject, SubjectCorrelation
from priorfill.gp.pose_process import PoseProcess
from priorfill.gp.problem import GPModel, PoseSamples, RegressionProblem

OFFSET_VARIANCE = 10.0
IN_TIME = 0.001 * Exponential(0.1)
ALIGNMENT = Alignment("rigid", 220.0, 0.005, 10.0)


PROCESS = PoseProcess(linear=1.0, rbf=0.1, of_time=IN_TIME, noise_variance=1e-4)
MODELS = [GPModel(ALIGNMENT, None, PROCESS)]


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
    recording = np.zeros(len(poses), dtype=np.intp)
    rows = PoseSamples(
        poses[np.ix_(seen, others)], poses[np.ix_(seen, [marker])], time[seen], recording[seen]
    )
    query = PoseSamples(
        poses[np.ix_(gap, others)], np.empty((len(gap), 0, 3)), time[gap], recording[gap]
    )
    return rows, query


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**31))
def test_a_rigid_body_is_predicted_exactly(seed):
    poses, time = rigid_clip(seed)
    gap = np.arange(40, 80)
    rows, query = split(poses, time, gap)
    distance = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1)
    found = regress([RegressionProblem(rows, query, distance, np.zeros(4))], MODELS, 0.4)
    np.testing.assert_allclose(found.positions[:, 0], poses[gap, 0], atol=0.05)


def test_expected_errors_have_the_size_of_the_errors():
    for seed in range(12):
        poses, time = rigid_clip(seed, noise=2.0)
        gap = np.arange(40, 80)
        rows, query = split(poses, time, gap)
        distance = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1)
        found = regress([RegressionProblem(rows, query, distance, np.full(4, 2.0))], MODELS, 0.4)
        error = np.sqrt(((found.positions[:, 0] - poses[gap, 0]) ** 2).sum(axis=1).mean())
        assert 0.5 < np.sqrt((found.expected_rms**2).mean()) / error < 2.0


@given(st.integers(0, 2**31), st.floats(-3, 3))
@settings(deadline=None, max_examples=15)
def test_predictions_rotate_and_move_with_the_body(seed, angle):
    poses, time = rigid_clip(seed, noise=2.0)
    gap = np.arange(50, 70)
    distance = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1)
    shift = np.array([3000.0, -500.0, 200.0])
    models = [*MODELS, GPModel(Alignment("heading", 220.0, 0.1), None, PROCESS)]

    def predict(clip):
        rows, query = split(clip, time, gap)
        problem = RegressionProblem(rows, query, distance, np.full(4, 2.0))
        return regress([problem], models, 0.2)

    found, moved = predict(poses), predict(naive.turned(poses, angle, shift))
    turned = naive.turned(found.positions, angle, shift)
    np.testing.assert_allclose(moved.positions, turned, atol=1e-5)
    np.testing.assert_allclose(moved.expected_rms, found.expected_rms, rtol=1e-6)


def test_other_recordings_are_infinitely_far_in_time():
    poses = PoseSamples(
        np.zeros((3, 1, 3)), np.zeros((3, 1, 3)), np.array([0.0, 1.0, 0.0]), np.array([0, 0, 1])
    )
    np.testing.assert_array_equal(poses.pairs(poses).lag[0], [0, 1, np.inf])
    assert [list(b) for b in poses.blocks(0.5)] == [[0], [1], [2]]


def test_subjects_have_offsets_and_correlations():
    train = PoseSamples(
        np.zeros((4, 1, 3)),
        np.zeros((4, 1, 3)),
        np.zeros(4),
        np.array([0, 1, 2, 3]),
        np.array([1.0, 0.9, 0.9, 0.5]),
        np.array([0, 7, 7, 8]),
    )
    query = PoseSamples(np.zeros((1, 1, 3)), np.empty((1, 0, 3)), np.zeros(1), np.array([0]))
    cross, own = query.pairs(train), train.pairs(train)
    correlation, offset = SubjectCorrelation(), 10.0 * SameSubject()
    np.testing.assert_allclose(correlation(cross), [[1.0, 0.9, 0.9, 0.5]])
    np.testing.assert_allclose(correlation(own)[1], [0.9, 1.0, 1.0, 0.45])
    np.testing.assert_array_equal(offset(cross), [[10, 0, 0, 0]])
    np.testing.assert_array_equal(offset(own)[1], [0, 10, 10, 0])
    np.testing.assert_array_equal(correlation(query.pairs(query)), 1.0)
    assert [list(b) for b in train.blocks(1.0)] == [[0]]


def test_recordings_of_a_subject_with_different_correlations_are_positive_definite():
    """Such as of real and of virtual markers: equal poses of all are a singular covariance."""
    rng = np.random.default_rng(2)
    subject = np.repeat([0, 1, 1, 2, 2, 2], 3)
    correlation = np.repeat([1.0, 0.9, 0.8, 0.8, 0.9, 0.0], 3)
    count = len(subject)
    poses = PoseSamples(
        rng.normal(size=(count, 4, 3)),
        rng.normal(size=(count, 1, 3)),
        np.zeros(count),
        np.arange(count),
        correlation=correlation,
        subject=subject,
    )
    covariance = SubjectCorrelation()(poses.pairs(poses))
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    np.testing.assert_allclose(covariance[3, [0, 4, 6, 9, 12]], [0.9, 1.0, 8 / 9, 0.72, 0.81])
    np.testing.assert_array_equal(covariance[15, [0, 9, 16]], [0.0, 0.0, 1.0])


def test_constant_offsets_of_another_subject_do_not_matter():
    """A subject with longer limbs shows a movement that the clip does not."""
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
        both = PoseSamples(
            np.concatenate([rows.visible, other[:, 1:]]),
            np.concatenate([rows.missing, other[:, :1]]),
            np.concatenate([rows.time, time[gap]]),
            np.repeat([0, 1], [len(rows.time), len(gap)]),
            np.repeat([1.0, 0.95], [len(rows.time), len(gap)]),
            np.repeat([0, 1], [len(rows.time), len(gap)]),
        )
        problem = RegressionProblem(
            both, query, distance, np.zeros(4), offset_variance=OFFSET_VARIANCE
        )
        return regress([problem], MODELS, 0.4).positions

    np.testing.assert_allclose(off(60.0), elsewhere, atol=1.0)
    np.testing.assert_allclose(off(60.0), off(0.0), atol=1.0)


def test_a_large_penalty_excludes_a_problem():
    poses, time = rigid_clip(1, noise=2.0)
    rows, query = split(poses, time, np.arange(40, 80))
    distance = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1)
    problem = RegressionProblem(rows, query, distance, np.full(4, 2.0))
    wrong = RegressionProblem(
        replace(rows, missing=rows.missing + 500.0 * time[10]), query, distance, problem.spread
    )
    alone = regress([problem], MODELS, 0.4)
    out = regress([problem, replace(wrong, error_penalty=100.0)], MODELS, 0.4)
    np.testing.assert_allclose(out.positions, alone.positions, atol=1e-9)
    np.testing.assert_allclose(out.expected_rms, alone.expected_rms, rtol=1e-6)
    assert out.bound_factor == pytest.approx(alone.bound_factor)


def test_blocks_have_the_given_length():
    time = np.arange(100) / 10
    rows = PoseSamples(np.zeros((100, 1, 3)), np.zeros((100, 1, 3)), time, np.zeros(100, dtype=int))
    blocks = rows.blocks(2.0)
    assert len(blocks) == 5
    assert sorted(np.concatenate(blocks)) == list(range(100))
    assert all(np.ptp(time[b]) < 2.0 for b in blocks)


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**31), st.booleans(), st.sampled_from([None, 0.3]))
def test_a_model_predicts_as_in_the_textbook(seed, velocity, fading):
    """Against solving for every query by itself, with features spelt out."""
    poses, time = rigid_clip(seed, noise=3.0)
    gap = np.arange(40, 60)
    rows, query = split(poses, time, gap)

    def with_lagged(part):
        at = np.round(part.time * 100).astype(int)
        around = np.stack([poses[np.clip(at + d, 0, len(poses) - 1), 1:] for d in (-3, 3)])
        return replace(part, lagged={0.03: around})

    rows, query = with_lagged(rows), with_lagged(query)
    velocities = np.random.default_rng(seed).normal(0, 100, rows.missing.shape)
    rows = replace(rows, velocity=velocities)
    distance, spread = np.linalg.norm(poses[0, 1:] - poses[0, :1], axis=1), np.full(4, 2.0)
    lag = LagFeature(0.03, 0.7, velocity=velocity)
    process = PROCESS
    if fading is not None:
        process = replace(PROCESS, factor=SubjectCorrelation() * Forgetting(fading, 0.5))
    model = GPModel(ALIGNMENT, lag, process)
    found = regress([RegressionProblem(rows, query, distance, spread)], [model], 0.2)

    nearness, firmness = np.exp(-(distance**2) / (2 * 220.0**2)), 1 / (1 + (2.0 / 10.0) ** 2)
    weight = nearness * np.sqrt(firmness) + 0.005
    template = rows.visible[len(rows.visible) // 2]

    def aligned(part):
        frames = rigid_frames(part.visible, template, nearness * firmness + MIN_ALIGNMENT_WEIGHT)
        features = []
        for i in range(len(part.time)):
            turn, origin = frames.rotation[i], frames.origin[i]
            here = (part.visible[i] - origin) @ turn
            before, after = ((part.lagged[0.03][j][i] - origin) @ turn for j in (0, 1))
            lagged = [after - before] if velocity else [before, after]
            features.append(np.concatenate([here, *(0.7 * x for x in lagged)]).reshape(-1, 4, 3))
        return frames, (np.array(features) * weight[:, None]).reshape(len(features), -1)

    row_frames, known = aligned(rows)
    query_frames, queried = aligned(query)
    mean = known.mean(axis=0)
    scale = np.sqrt(((known - mean) ** 2).sum(axis=1).mean())
    known, queried = (known - mean) / scale, (queried - mean) / scale

    def covariance(a, b, lag):
        value = 1 + a @ b + 0.1 * np.exp(-0.5 * np.sum((a - b) ** 2))
        if fading:
            value *= 0.5 + 0.5 * np.exp(-lag / fading)
        return value + 0.001 * np.exp(-lag / 0.1)

    turned = np.einsum("ri,rij->rj", velocities[:, 0], row_frames.rotation)
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
            covariance(queried[i], b, abs(query.time[i] - t))
            for b, t in zip(known, rows.time, strict=True)
        ]
        expected = cross @ solved + targets.mean(axis=0)
        local = query_frames.to_local(found.positions)[i, 0]
        np.testing.assert_allclose(local, expected[:3], atol=1e-6)
        velocity = found.velocity.velocity[i, 0] @ query_frames.rotation[i]
        np.testing.assert_allclose(velocity, expected[3:], atol=1e-6)


def test_models_have_less_weight_in_frames_where_they_are_uncertain():
    """Two models have equal held-out errors; one has no training poses like half of the gap."""
    poses, time = rigid_clip(4, noise=2.0)
    rows, query = split(poses, time, np.arange(40, 60))
    problem = RegressionProblem(rows, query, np.full(4, 80.0), np.full(4, 2.0))
    processes = [replace(PROCESS, rbf=10.0, length_scale=scale) for scale in (0.05, 1.0)]
    models = [GPModel(ALIGNMENT, None, process) for process in processes]
    alone = [regress([problem], [model], 0.2).positions for model in models]
    both = regress([problem], models, 0.2).positions
    span = alone[0] - alone[1]
    share = ((both - alone[1]) * span).sum(axis=(1, 2)) / (span**2).sum(axis=(1, 2))
    assert ((share >= 0.0) & (share <= 1.0)).all()
    assert np.ptp(share) > 0.0  # not the same in all frames


def test_the_variance_of_an_ensemble_includes_the_disagreement_of_its_models():
    rng = np.random.default_rng(0)
    models, queries, markers = 3, 5, 2
    found = Predictions(
        rng.normal(0.0, 20.0, (models, queries, markers, 3)),
        rng.uniform(1.0, 400.0, (models, queries, markers)),
        np.ones((models, queries)),
    )
    # models of one problem, with equal errors
    fitted = SimpleNamespace(
        problems=[SimpleNamespace(error_penalty=1.0)], problem_of=np.zeros(models, dtype=int)
    )
    ensemble = _Ensemble(
        fitted,
        slice(0, markers),
        EnsembleOptions(),
        np.empty((queries, markers, 3)),
        np.empty((queries, markers)),
        np.zeros(models),
        np.ones(models),
        EnsembleOptions().weight_power,
    )
    ensemble.add(slice(0, queries), ensemble.combined([found], np.ones(queries, dtype=bool)))
    mean = found.mean.mean(axis=0)
    square = found.variance + np.linalg.norm(found.mean - mean, axis=3) ** 2
    np.testing.assert_allclose(ensemble.mean, mean)
    np.testing.assert_allclose(ensemble.predicted_rms, np.sqrt(square.mean(axis=0)))


def test_jitter_where_the_covariance_of_a_model_is_singular(monkeypatch):
    """A clip without movement, and a model without noise, between two others."""
    poses, time = rigid_clip(0)
    poses[:] = poses[0]
    rows, query = split(poses, time, np.arange(40, 60))
    problem = RegressionProblem(rows, query, np.full(4, 80.0), np.full(4, 2.0))
    singular = replace(PROCESS, of_time=0.0 * Exponential(0.1), noise_variance=0.0)
    models = [GPModel(ALIGNMENT, None, process) for process in (PROCESS, singular, PROCESS)]
    found = regress([problem], models, 0.2).positions
    np.testing.assert_allclose(found, poses[40:60, :1], atol=1e-6)
    monkeypatch.setattr("priorfill.gp.linalg.JITTER", ())
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        regress([problem], models, 0.2)


def test_velocities_are_predicted_only_if_all_problems_have_them():
    poses, time = rigid_clip(5, noise=1.0)
    rows, query = split(poses, time, np.arange(40, 60))
    problem = RegressionProblem(rows, query, np.full(4, 80.0), np.full(4, 2.0))
    assert regress([problem], MODELS, 0.2).velocity is None
    velocity = np.gradient(poses[:, :1], time, axis=0)
    seen = np.setdiff1d(np.arange(len(poses)), np.arange(40, 60))
    with_velocity = replace(problem, train=replace(rows, velocity=velocity[seen]))
    assert regress([with_velocity, problem], MODELS, 0.2).velocity is None
    found = regress([with_velocity], MODELS, 0.2)
    alone = regress([problem], MODELS, 0.2)
    np.testing.assert_allclose(found.positions, alone.positions, atol=1e-9)
    speed = np.linalg.norm(velocity[40:60], axis=2)
    wrong = np.linalg.norm(found.velocity.velocity - velocity[40:60], axis=2)
    assert wrong.mean() < 0.5 * speed.mean()
    assert (found.velocity.expected_rms > 0.0).all()
    off = np.sqrt(((found.positions - poses[40:60, :1]) ** 2).sum(axis=2).mean())
    assert off / 3.0 < found.velocity.position_rms[0] < off * 3.0


def test_a_problem_without_lagged_poses_is_fitted_by_the_other_models():
    poses, time = rigid_clip(3, noise=1.0)
    rows, query = split(poses, time, np.arange(40, 60))
    problem = RegressionProblem(rows, query, np.full(4, 80.0), np.full(4, 2.0))
    models = [*MODELS, GPModel(ALIGNMENT, LagFeature(0.1, 1.0), PROCESS)]
    alone, both = regress([problem], MODELS, 0.2), regress([problem], models, 0.2)
    np.testing.assert_array_equal(alone.positions, both.positions)


@pytest.mark.parametrize("prior_share", [0.0, 0.5])
def test_expected_errors_are_calibrated_by_cross_validation(prior_share):
    """Errors of 3 mm per coordinate where 1 was predicted, in many blocks and in few."""
    residuals = np.random.default_rng(0).normal(0, 3.0, (1, 40000, 1, 3))
    blocks = int(EnsembleOptions().prior_blocks) if prior_share else 10**6
    validation = _CrossValidation(
        np.ones(1), residuals, np.full((1, 40000, 1), 3.0), np.empty((40000, 0, 3)), blocks
    )
    factor, bound = _calibrate(validation, EnsembleOptions())
    normal = UNIT_BOUND / np.sqrt(3.0)
    assert factor == pytest.approx(3.0 ** (1.0 - prior_share), rel=0.01)
    assert bound == pytest.approx(
        normal ** (1.0 - prior_share) * BOUND_FACTOR**prior_share, rel=0.01
    )
