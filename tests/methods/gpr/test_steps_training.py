"""Training data of the regressions, their weights, and the calibration of their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gappy import ARM, person, with_gaps

from priorfill.clip import Clip
from priorfill.gaps import gap_groups
from priorfill.gp.ensemble import (
    EnsembleOptions,
    Regression,
    _calibrate,
    _CrossValidation,
    regress,
)
from priorfill.gp.features import Alignment
from priorfill.gp.kernels import Exponential
from priorfill.gp.pose_process import PoseProcess
from priorfill.gp.problem import GPModel, PoseSamples, RegressionProblem
from priorfill.markers.describe import describe
from priorfill.methods.gpr.gap_segments import GapSegment, SegmentBatch
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.predict import SegmentPredictor
from priorfill.methods.gpr.segment_batches import split_into_batches
from priorfill.methods.gpr.training.options import TrainingOptions
from priorfill.methods.gpr.training.own_clip import OwnClipProblem, OwnClipProblems
from priorfill.methods.gpr.training.plan import TrainingPlan, TrainingPlanner
from priorfill.methods.gpr.training.subject_correlation import SubjectCorrelationOptions
from priorfill.methods.task import MIRROR_IMAGE, THIS_CLIP, Task
from priorfill.search.takes import same_subject_take

PROCESS = PoseProcess(linear=1.0, rbf=0.1, of_time=0.001 * Exponential(0.1), noise_variance=1e-4)
MODELS = [GPModel(Alignment("rigid", 220.0, 0.005, 10.0), None, PROCESS)]
CORRELATION = SubjectCorrelationOptions()
OPTIONS = EnsembleOptions()
GAP = np.arange(40, 80)
JOINTS = (
    *("LFHD", "C7", "STRN", "LSHO", "LELB", "LWRA", "RSHO", "RELB", "RWRA"),
    *("LFWT", "LKNE", "LANK", "RFWT", "RKNE", "RANK"),
)


def bending(seed: int, noise: float, bend: float = 0.0) -> RegressionProblem:
    """Four visible markers that move, and a missing one that is a function of them."""
    rng = np.random.default_rng(seed)
    time = np.arange(160) / 100.0
    shape = np.random.default_rng(7).normal(0.0, 100.0, (5, 3))
    poses = np.tile(shape, (160, 1, 1))
    poses[:, 1:3, 2] += 60.0 * np.sin(5.0 * time)[:, None]
    poses[:, 3, 0] += 60.0 * np.cos(3.0 * time)
    poses[:, 0, 2] += 50.0 * np.sin(5.0 * time) + bend
    poses += rng.normal(0.0, noise, poses.shape)
    seen = np.setdiff1d(np.arange(160), GAP)
    take = np.zeros(160, dtype=np.intp)
    return RegressionProblem(
        PoseSamples(poses[seen, 1:], poses[seen, :1], time[seen], take[seen]),
        PoseSamples(poses[GAP, 1:], np.empty((len(GAP), 0, 3)), time[GAP], take[GAP]),
        np.linalg.norm(shape[1:] - shape[0], axis=1),
        np.full(4, 2.0),
    )


# --- calibration ---


@pytest.mark.parametrize(("blocks", "known"), [(8, 0.5), (24, 0.75), (2, 0.2)])
def test_calibration_is_shrunk_when_there_are_few_blocks(blocks: int, known: float) -> None:
    """Errors of 3 mm each where 1 was predicted; the uncalibrated values count as 8 blocks."""
    residuals = np.zeros((1, 50, 2, 3))
    residuals[..., 1] = 3.0
    validation = _CrossValidation(
        np.ones(1), residuals, np.ones((1, 50, 2)), np.empty((50, 0, 3)), blocks
    )
    factor, bound = _calibrate(validation, OPTIONS)
    assert factor == pytest.approx(3.0**known)
    # all errors are equal, so the 90 % bound equals the rms error; the uncalibrated factor is 1.6
    assert bound == pytest.approx(1.6 ** (1.0 - known))


def test_the_calibration_scales_the_deviation(monkeypatch: pytest.MonkeyPatch) -> None:
    factors = iter([1.0, 2.5])
    monkeypatch.setattr("priorfill.gp.ensemble._calibrate", lambda *_: (next(factors), 1.75))
    plain, scaled = (regress([bending(0, 1.0)], MODELS, 0.4) for _ in range(2))
    np.testing.assert_allclose(scaled.expected_rms, 2.5 * plain.expected_rms)
    assert scaled.bound_factor == 1.75


def test_a_mixture_of_training_sets_has_a_wider_deviation() -> None:
    """Weights chosen on the blocks left out do better there than in the gap."""
    problem = bending(0, 1.0)
    one, two = regress([problem], MODELS, 0.4), regress([problem, problem], MODELS, 0.4)
    np.testing.assert_allclose(two.positions, one.positions, atol=1e-6)
    assert OPTIONS.selection_inflation > 1.1
    # half of the weight is on the second one
    np.testing.assert_allclose(
        two.expected_rms / one.expected_rms, OPTIONS.selection_inflation**0.5, rtol=1e-6
    )
    assert two.bound_factor == pytest.approx(one.bound_factor)


# --- the penalty on other recordings ---


def test_a_penalty_shifts_the_mixture_towards_the_other_problem() -> None:
    own, others = bending(1, 2.0), bending(2, 2.0, bend=30.0)
    others = replace(others, query=own.query)
    alone = [regress([one], MODELS, 0.4).positions for one in (own, others)]
    span = (alone[1] - alone[0]).ravel()

    def share(penalty: float) -> float:
        both = regress([own, replace(others, error_penalty=penalty)], MODELS, 0.4).positions
        return float((both - alone[0]).ravel() @ span / (span @ span))

    rewarded, even, penalised = share(0.9), share(1.0), share(1.2)
    # by the errors to the power of 8
    assert rewarded / (1 - rewarded) == pytest.approx(even / (1 - even) * 0.9**-8, rel=0.01)
    assert penalised / (1 - penalised) == pytest.approx(even / (1 - even) * 1.2**-8, rel=0.01)


def test_a_problem_with_more_models_has_no_more_weight() -> None:
    """Its own models are those of the call, each three times."""
    own, others = bending(1, 2.0), replace(bending(2, 2.0, bend=30.0), query=bending(1, 2.0).query)
    few, many = (
        regress([own, replace(others, models=models)], MODELS, 0.4).positions
        for models in (None, [*MODELS, *MODELS, *MODELS])
    )
    np.testing.assert_allclose(many, few, atol=1e-6)


def test_a_problem_is_predicted_by_its_own_models() -> None:
    problem = bending(1, 2.0)
    others = [GPModel(Alignment("heading", 220.0, 0.005), None, PROCESS)]
    own = regress([replace(problem, models=others)], MODELS, 0.4).positions
    np.testing.assert_array_equal(own, regress([problem], others, 0.4).positions)
    assert not np.allclose(own, regress([problem], MODELS, 0.4).positions)


def test_the_held_out_blocks_are_not_as_short_as_parts_of_a_gap(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """However short the segments are into which markers that come and go divide it."""
    task = task_of(with_gaps(person(seconds=4.0, rate=20.0), (20, 60, ["LWRA"])))
    whole = arm_of(task, ["LWRA"]).segments[0]
    parts = (replace(whole, start=30, stop=32), replace(whole, start=40, stop=43))
    seconds: list[float] = []

    def regressed(*arguments: Any) -> Regression:
        seconds.append(arguments[2])
        return regress(*arguments)

    monkeypatch.setattr("priorfill.methods.gpr.predict.regress", regressed)
    predictor = SegmentPredictor(task, 8, GPROptions())
    for length in (0, 4, 40):
        batch = SegmentBatch(tuple(replace(part, gap_frames=length) for part in parts))
        predictor.predict_batch(batch, None)
    assert seconds == [3.0 / 20.0, 4.0 / 20.0, GPROptions().segments.min_block_seconds]


def task_of(clip: Clip, *others: Clip) -> Task:
    takes = tuple(same_subject_take(other, clip.labels) for other in others)
    groups = tuple(gap_groups(clip.missing))
    return Task(
        clip.positions, clip.labels, clip.rate, describe(clip), groups, takes, "clip", clip.subject
    )


def arm_of(task: Task, labels: Sequence[str] = ARM) -> SegmentBatch:
    markers = np.array([task.labels.index(label) for label in labels])
    frames = np.flatnonzero(~task.valid[:, markers[0]])
    visible = np.setdiff1d(np.arange(len(task.labels)), markers)
    return SegmentBatch((GapSegment(markers, int(frames[0]), int(frames[-1]) + 1, visible),))


def plan_for(clip: Clip, *others: Clip, labels: Sequence[str] = ARM) -> TrainingPlan:
    task, options = task_of(clip, *others), GPROptions()
    planner = TrainingPlanner(task, PoseSearch(task, options.search), 8, options)
    plan = planner.plan(arm_of(task, labels), None)
    assert plan is not None
    return plan


@pytest.mark.parametrize(("marker", "has_image"), [("RELB", True), ("RBAC", False)])
def test_a_single_marker_is_predicted_from_the_mirror_image_too(
    marker: str, has_image: bool
) -> None:
    clip = with_gaps(person(seconds=4.0, rate=20.0), (30, 50, [marker]))
    (problem,) = plan_for(clip, labels=[marker]).problems
    assert (MIRROR_IMAGE in problem.train.recording) == has_image


@pytest.mark.parametrize(("start", "is_long"), [(40, False), (39, True)])
def test_a_marker_that_is_missing_for_longer_than_it_is_seen(start: int, is_long: bool) -> None:
    clip = with_gaps(person(seconds=4.0, rate=20.0), (start, 80, ["RELB"]))
    models = GPROptions().models
    assert len(models.long_gap) == 38
    assert set(models.single_marker) < set(models.long_gap)
    expected = models.long_gap if is_long else models.single_marker
    assert plan_for(clip, labels=["RELB"]).models == expected


@pytest.mark.parametrize("labels", [JOINTS, None])
def test_a_marker_without_a_rigid_segment_is_predicted_like_a_limb(
    labels: tuple[str, ...] | None,
) -> None:
    clip = person(seconds=4.0, rate=20.0)
    if labels is not None:
        clip = Clip(clip.positions[:, [clip.labels.index(x) for x in labels]], labels, clip.rate)
    other = person(seconds=4.0, rate=30.0, seed=9)
    plan = plan_for(with_gaps(clip, (30, 50, ["LWRA"])), other, labels=["LWRA"])
    models = GPROptions().models
    assert plan.models == (models.single_marker if labels is None else models.loose_marker)
    assert len(plan.problems) == (1 if labels is None else 2)  # the second is of the database


@pytest.mark.parametrize(
    ("seconds", "rate", "start", "penalty"),
    [
        (17.0, 20.0, 100, 1.2),  # 16 s with the arm: two doublings of 4 s
        (9.0, 20.0, 100, 1.1),
        (3.0, 20.0, 20, 0.9),  # 2 s
        (2.0, 20.0, 10, 0.9),  # 1 s: no more reward than for half of 4 s
    ],
)
def test_long_clips_penalise_other_recordings_and_short_ones_reward_them(
    seconds: float, rate: float, start: int, penalty: float
) -> None:
    clip = with_gaps(person(seconds=seconds, rate=rate), (start, start + 20, ARM))
    plan = plan_for(clip, person(seconds=4.0, rate=30.0, seed=9))
    own, others = plan.problems
    assert own.error_penalty == 1.0
    assert others.error_penalty == pytest.approx(penalty, abs=0.01)


# --- the clip's own frames ---


def own_problem(
    clip: Clip, training: TrainingOptions | None = None
) -> tuple[OwnClipProblems, OwnClipProblem]:
    task, options = task_of(clip), GPROptions()
    problems = OwnClipProblems(
        task, 8, training or options.training, options.spline_nodes, options.correlation
    )
    own = problems.problem_for(arm_of(task), None)
    assert own is not None
    return problems, own


def test_all_poses_near_the_gap_are_used() -> None:
    training = TrainingOptions(max_poses=20, mirror_poses=0, adjacent_seconds=0.05)
    clip = with_gaps(person(seconds=6.0, rate=100.0), (250, 350, ARM))
    _, own = own_problem(clip, training)
    used = np.round(own.problem.train.time * clip.rate).astype(int)
    assert {*range(245, 250), *range(350, 355)} <= set(used)
    assert len(used) < 40


# --- the clip's mirror image, and other subjects ---


def test_the_mirror_image_is_correlated_with_the_subject_but_not_the_same() -> None:
    problems, own = own_problem(with_gaps(person(), (100, 160, ARM)))
    train = problems.with_mirror_image(own).problem.train
    assert train.correlation is not None
    image = train.recording == MIRROR_IMAGE
    assert image.sum() >= 50 and (~image).sum() >= 50
    assert set(train.correlation[~image]) == {1.0}
    assert ((train.correlation[image] > 0.5) & (train.correlation[image] < 0.99)).all()
    # other people are less correlated, and virtual markers least
    assert 0.5 < CORRELATION.virtual_markers < CORRELATION.other_subject
    assert CORRELATION.other_subject < CORRELATION.mirror_image < 0.99


@pytest.mark.parametrize("correlation", [CORRELATION.mirror_image, CORRELATION.other_subject])
def test_the_clips_own_frames_outweigh_contradicting_ones(correlation: float) -> None:
    """The same poses, but the missing marker 60 mm away."""
    own = bending(3, 1.0)
    rows = own.train
    count = len(rows.time)

    def both(correlation: float) -> np.ndarray:
        mixed = PoseSamples(
            np.concatenate([rows.visible, rows.visible]),
            np.concatenate([rows.missing, rows.missing + np.array([60.0, 0.0, 0.0])]),
            np.concatenate([rows.time, rows.time]),
            np.repeat([0, 1], count),
            np.repeat([1.0, correlation], count),
        )
        return regress([replace(own, train=mixed)], MODELS, 0.4).positions

    alone = regress([own], MODELS, 0.4).positions
    away = [np.linalg.norm(both(c) - alone, axis=2).mean() for c in (correlation, 1.0)]
    assert away[0] < 4.0
    # as one subject they are averaged
    assert away[1] > 10.0


# --- velocities ---


def test_velocities_of_a_uniform_motion_are_those_of_the_motion() -> None:
    """Each marker moves along a line; its mirror image as the contralateral marker's line."""
    still = person()
    rng = np.random.default_rng(0)
    speed = rng.normal(0.0, 30.0, (len(still.labels), 3))  # mm/s
    time = np.arange(still.frames) / still.rate
    clip = still.with_positions(still.positions[50] + time[:, None, None] * speed)
    problems, own = own_problem(with_gaps(clip, (100, 160, ARM)))
    train = problems.with_velocities(problems.with_mirror_image(own)).problem.train
    assert train.velocity is not None
    markers = [clip.labels.index(label) for label in ARM]
    mirror = describe(clip).mirror
    contralateral = [clip.labels.index(mirror[label]) for label in ARM]
    for number, expected in (
        (THIS_CLIP, speed[markers]),
        (MIRROR_IMAGE, speed[contralateral] * [-1.0, 1.0, 1.0]),
    ):
        some = train.velocity[train.recording == number]
        assert len(some) >= 50
        np.testing.assert_allclose(some, np.broadcast_to(expected, some.shape), atol=1e-6)


# --- segments ---


def cut(distances: list[float], lost: list[int]) -> int:
    """Number of segments of a gap of marker 0 in the middle of which some others are missing."""
    count = 1 + len(distances)
    valid = np.ones((90, count), dtype=bool)
    valid[10:80, 0] = False
    valid[np.ix_(np.arange(30, 60), lost)] = False
    # far from each other, so that each is a segment of its own
    distance = np.full((count, count), 5000.0)
    distance[0, 1:] = distance[1:, 0] = distances
    np.fill_diagonal(distance, 0.0)
    (group,) = gap_groups(~valid)
    return sum(
        len(batch.segments)
        for batch in split_into_batches(group, valid, distance)
        if 0 in batch.markers
    )


def test_neighbours_are_weighted_by_a_gaussian_of_their_distance() -> None:
    """A gap is cut where more than 0.3 of exp(-D² / 2 (220 mm)²) + 0.005 would be lost."""

    def share(distances: list[float], lost: list[int]) -> float:
        weight = np.exp(-(np.array(distances) ** 2) / (2.0 * 220.0**2)) + 0.005
        return float(weight[np.array(lost) - 1].sum() / weight.sum())

    far = [100.0, 100.0, 100.0, *[600.0] * 6]  # an exponential would lose a fifth and more
    assert share(far, [4, 5, 6, 7, 8, 9]) < 0.07
    assert cut(far, [4, 5, 6, 7, 8, 9]) == 1
    near = [150.0] * 6 + [500.0] * 30  # of an exponential the far ones would be most
    assert share(near, [1, 2, 3]) > 0.32
    assert cut(near, [1, 2, 3]) == 3
    assert cut(near, [7]) == 1
