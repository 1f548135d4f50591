"""Markers that the clip hardly shows: donors, and the regression over several subjects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gappy import error, person, with_gaps
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import priorfill as pf
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.geometry.distances import pooled_distances
from priorfill.geometry.root_frames import heading_frames, rigid_frames
from priorfill.gp.features import MIN_ALIGNMENT_WEIGHT
from priorfill.markers.describe import describe
from priorfill.methods.gpr.dropout.donors import Donor, Donors
from priorfill.methods.gpr.dropout.fill_dropouts import DropoutPredictor
from priorfill.methods.gpr.dropout.marker_coupling import MarkerCoupling
from priorfill.methods.gpr.dropout.multi_subject_kernel import MultiSubjectKernel
from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.methods.gpr.dropout.predict_from_donors import (
    predict_from_donors,
    predict_with_each_model,
)
from priorfill.methods.gpr.dropout.subjects import Subjects
from priorfill.methods.task import THIS_CLIP, Task
from priorfill.search.takes import Take, same_subject_take

OPTIONS = DropoutOptions()
MODELS = len(OPTIONS.alignments) * len(OPTIONS.processes)

SHAPE = np.array(
    [[0, 0, 0], [180, 20, 0], [30, 170, 10], [20, 40, 190], [150, 140, 60], [90, 80, 70.0]]
)
"""mm; the last marker is the missing one."""

VISIBLE = len(SHAPE) - 1


def donor(
    subject: int,
    scale: float = 1.0,
    shift: Sequence[float] = (0.0, 0.0, 0.0),
    rows: int = 6,
    mirrored: bool = False,
    seed: int = 0,
) -> Donor:
    """Poses of a subject of some size that bends, its last marker shifted in the body's frame."""
    rng = np.random.default_rng([seed, subject + 1, mirrored])
    poses = np.tile(scale * SHAPE, (rows, 1, 1))
    bend = rng.normal(0.0, 15.0, rows)
    poses[:, 4, 2] += bend
    poses[:, 5, 2] += 0.8 * bend
    poses[:, 5] += np.array(shift)
    turns = Rotation.from_rotvec(rng.uniform(-3.0, 3.0, (rows, 1)) * [0.0, 0.0, 1.0]).as_matrix()
    poses = np.einsum("rij,rmj->rmi", turns, poses) + rng.normal(0.0, 500.0, (rows, 1, 3))
    return Donor(subject, mirrored, poses[:, :-1], poses[:, -1:])


def coupling_of() -> MarkerCoupling:
    far = np.linalg.norm(SHAPE[:-1] - SHAPE[-1], axis=1)
    inner = 2.0 + np.arange(VISIBLE)[:, None] + np.arange(VISIBLE)
    return MarkerCoupling(far, np.linspace(3.0, 12.0, VISIBLE), inner.astype(np.float64))


# --- body shapes ---


def test_a_shape_difference_has_the_size_of_the_distances_differences() -> None:
    """Where every distance differs by 10 mm, so do the shapes, whatever the weights."""
    side = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0]])
    coupling = MarkerCoupling(
        np.array([50.0, 200.0, 400.0]),
        np.full(3, 5.0),
        np.array([[0, 1, 9.0], [1, 0, 4], [9, 4, 0]]),
    )
    one, other = (coupling.body_shape((length * side)[None], OPTIONS) for length in (150.0, 160.0))
    assert np.linalg.norm(one - other) == pytest.approx(10.0)


def test_shape_differences_match_the_weighted_rms() -> None:
    """The rms difference of distances, each counting exp(-(D² + D'²) / 4 R²) / (1 + (s / 5)²)."""
    rng = np.random.default_rng(0)
    distance, inner = rng.uniform(50.0, 500.0, 5), rng.uniform(0.0, 20.0, (5, 5))
    inner = inner + inner.T
    bodies = rng.normal(0.0, 200.0, (2, 8, 5, 3))
    coupling = MarkerCoupling(distance, np.full(5, 5.0), inner)
    square, total = 0.0, 0.0
    for i in range(5):
        for j in range(i):
            weight = np.exp(-(distance[i] ** 2 + distance[j] ** 2) / (4.0 * 300.0**2))
            weight /= 1.0 + (inner[i, j] / 5.0) ** 2
            lengths = np.linalg.norm(bodies[:, :, i] - bodies[:, :, j], axis=2).mean(axis=1)
            square += weight * (lengths[0] - lengths[1]) ** 2
            total += weight
    away = coupling.body_shape(bodies[0], OPTIONS) - coupling.body_shape(bodies[1], OPTIONS)
    assert np.linalg.norm(away) == pytest.approx(np.sqrt(square / total))


def test_subjects_of_the_same_shape_count_most() -> None:
    """Two people differ by 40 mm in where the marker sits; one has the clip's body shape.

    The shapes differ in a far marker, which hardly counts among the features.
    """
    coupling = MarkerCoupling(
        np.array([100.0, 900.0, 100.0, 100.0, 100.0]), np.full(5, 3.0), np.full((5, 5), 2.0)
    )
    clip, alike = donor(5, rows=10), donor(1, shift=(20.0, 0.0, 0.0), rows=10)
    other = donor(2, shift=(-20.0, 0.0, 0.0), rows=10)
    ahead = other.visible[:, 1] - other.visible[:, 0]
    other.visible[:, 1] += 300.0 * ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    errors = np.full(MODELS, 10.0)
    found = predict_from_donors([alike, other], clip.visible, coupling, OPTIONS, errors)[0]
    frames = rigid_frames(clip.visible, SHAPE[:-1], np.ones(VISIBLE))
    # mm from the middle between the two, along the body's x axis
    away = (frames.to_local(found) - frames.to_local(clip.missing))[..., 0].mean()
    # 5 mm without it: the far marker is a weak feature too
    assert away > 8.0


# --- the regression, against solving for every query by itself ---


def some_donors() -> list[Donor]:
    return [
        donor(THIS_CLIP, shift=(3.0, 0.0, 0.0), rows=3),
        donor(THIS_CLIP, shift=(9.0, 0.0, 0.0), rows=4, mirrored=True),
        donor(1, 1.05, (0.0, 12.0, 0.0)),
        donor(1, 1.05, (0.0, 10.0, 4.0), mirrored=True),
        donor(2, 0.9, (0.0, -15.0, 0.0)),
        donor(3, 1.1, (-6.0, 0.0, 9.0), rows=5),
    ]


@pytest.mark.parametrize("own", [True, False])
def test_each_model_matches_the_textbook_formulas(own: bool) -> None:
    """Covariance 1 + k + b (offset + movement k), a tenth of the noise for the clip's own frames.

    b is shape exp(-|d|² / 2 scale²) + image [same subject] + rest [same subject and side].
    """
    donors = [one for one in some_donors() if own or one.subject != THIS_CLIP]
    query, coupling = donor(THIS_CLIP, rows=4, seed=8).visible, coupling_of()
    found = predict_with_each_model(donors, query, coupling, OPTIONS, None)
    visible = np.concatenate([one.visible for one in donors])
    missing = np.concatenate([one.missing for one in donors])
    who = [i for i, one in enumerate(donors) for _ in one.visible]
    shapes = [coupling.body_shape(query if one.is_own else one.visible, OPTIONS) for one in donors]
    shapes.append(coupling.body_shape(query, OPTIONS))
    sides = [*((one.subject, one.mirrored) for one in donors), (THIS_CLIP, False)]
    mine = np.array([sides[i] == (THIS_CLIP, False) for i in who])
    # held out together: one side of a subject if the clip has a mirror image, else both
    groups = {sides[i] if own else sides[i][0] for i in who if sides[i][0] != THIS_CLIP}
    blocks = [
        np.array([r for r, i in enumerate(who) if (sides[i] if own else sides[i][0]) == group])
        for group in sorted(groups)
    ]
    number = 0
    for alignment in OPTIONS.alignments:
        near = np.exp(-(coupling.distance**2) / (2.0 * alignment.length_scale**2))
        rigidity = np.ones(VISIBLE)
        if alignment.rigidity_scale is not None:
            rigidity = 1.0 / (1.0 + (coupling.spread / alignment.rigidity_scale) ** 2)
        align = rigid_frames if alignment.frame == "rigid" else heading_frames
        template, in_alignment = query[len(query) // 2], near * rigidity + MIN_ALIGNMENT_WEIGHT
        weight = (near * np.sqrt(rigidity) + alignment.min_weight)[:, None]
        row_frames, query_frames = (align(p, template, in_alignment) for p in (visible, query))
        known = (row_frames.to_local(visible) * weight).reshape(len(visible), -1)
        queries = (query_frames.to_local(query) * weight).reshape(len(query), -1)
        middle = known.mean(axis=0)
        scale = np.sqrt(((known - middle) ** 2).sum(axis=1).mean())
        known, queries = (known - middle) / scale, (queries - middle) / scale
        targets = row_frames.to_local(missing)[:, 0]
        centre = (targets[mine] if own else targets).mean(axis=0)
        for process in OPTIONS.processes:
            kernel = process.kernel
            assert isinstance(kernel, MultiSubjectKernel)

            def shared(i: int, j: int, of: MultiSubjectKernel = kernel) -> float:
                away = np.sum((shapes[i] - shapes[j]) ** 2)
                value = of.shape_share * np.exp(-away / (2.0 * of.shape_scale**2))
                value += of.image_share * (sides[i][0] == sides[j][0])
                return value + (1.0 - of.shape_share - of.image_share) * (sides[i] == sides[j])

            def covariance(
                a: np.ndarray, b: np.ndarray, i: int, j: int, of: MultiSubjectKernel = kernel
            ) -> float:
                square = np.sum((a - b) ** 2)
                k = of.linear_variance * a @ b
                k += of.rbf_variance * np.exp(-square / (2 * of.length_scale**2))
                return 1.0 + k + shared(i, j) * (of.offset_variance + of.movement_ratio * k)

            rows = list(zip(known, who, strict=True))
            noise = np.where(mine, 0.1, 1.0) * process.noise_variance
            matrix = np.array([[covariance(a, b, i, j) for b, j in rows] for a, i in rows])
            matrix += np.diag(noise)
            cross = np.array([[covariance(q, b, len(donors), j) for b, j in rows] for q in queries])
            expected = cross @ np.linalg.solve(matrix, targets - centre) + centre
            local = query_frames.to_local(found.positions[number])[:, 0]
            np.testing.assert_allclose(local, expected, atol=1e-6)

            residuals, variances = [], []
            for block in blocks:
                rest = np.setdiff1d(np.arange(len(who)), block)
                gain = np.linalg.solve(matrix[np.ix_(rest, rest)], matrix[np.ix_(rest, block)]).T
                residuals.append(targets[block] - centre - gain @ (targets[rest] - centre))
                left = matrix[np.ix_(block, block)] - gain @ matrix[np.ix_(rest, block)]
                variances.append(np.diag(left))
            square = (np.concatenate(residuals) ** 2).sum(axis=1)
            assert found.errors[number] == pytest.approx(np.sqrt(square.mean()))
            unit = (square / np.concatenate(variances)).mean()
            itself = np.array([covariance(q, q, len(donors), len(donors)) for q in queries])
            left = itself - np.einsum("qr,rq->q", cross, np.linalg.solve(matrix, cross.T))
            np.testing.assert_allclose(
                found.variance[number, :, 0], unit * (left + noise.min()), rtol=1e-6
            )
            number += 1
    assert number == len(found.positions)


def test_models_that_err_less_count_more() -> None:
    query, coupling = donor(THIS_CLIP, rows=4, seed=8).visible, coupling_of()
    each = predict_with_each_model(some_donors(), query, coupling, OPTIONS, 10.0).positions
    errors = np.full(MODELS, 10.0)
    errors[2] = 5.0
    weight = np.where(np.arange(MODELS) == 2, 16.0, 1.0)  # (10 / 5)⁴
    mean, expected_rms = predict_from_donors(some_donors(), query, coupling, OPTIONS, errors)
    np.testing.assert_allclose(mean, np.average(each, axis=0, weights=weight), atol=1e-6)
    spread = ((each - mean) ** 2).sum(axis=3) + (errors**2)[:, None, None]
    expected = np.sqrt(np.average(spread, axis=0, weights=weight))
    np.testing.assert_allclose(expected_rms, expected, rtol=1e-6)


def test_the_clips_own_few_frames_are_trusted_most() -> None:
    """The same pose of the clip and of another subject, whose marker is 60 mm away."""
    coupling = coupling_of()
    own = donor(THIS_CLIP, rows=1, seed=4)
    other = Donor(1, False, own.visible, own.missing + np.array([60.0, 0.0, 0.0]))
    errors = np.full(MODELS, 10.0)
    found = predict_from_donors([own, other], own.visible, coupling, OPTIONS, errors)[0]
    away = np.linalg.norm(found - own.missing)
    # with as much noise as in the other subject's frames, 10 and more
    assert away < 5.0


# --- donors ---


def without(clip: Clip, *labels: str) -> Clip:
    return with_gaps(clip, (0, clip.frames, labels))


def test_donors_of_the_most_similar_shape_are_chosen() -> None:
    """The same subject, scaled by 0.85 to 1.15; one of these is to be a donor."""
    clip = without(person(), "C7")
    takes = []
    for size in (0.85, 0.96, 1.15):
        other = person(seconds=3.0, seed=9)
        other = replace(other, positions=size * other.positions, name=f"size {size}")
        take = same_subject_take(other, clip.labels)
        takes.append(replace(take, same_subject=False, subject=other.name))
    task = Task(clip.positions, clip.labels, clip.rate, describe(clip), (), tuple(takes))
    predictor = DropoutPredictor(task, replace(OPTIONS, max_donor_subjects=1))
    missing = np.array([clip.labels.index("C7")])
    visible = np.flatnonzero(task.valid.all(axis=0))
    visible = predictor.nearest_visible(missing, visible)
    found = predictor.predict(missing, visible, np.arange(3))
    assert found is not None
    assert found.source_clips == ("size 0.96",)


def task_without(clip: Clip, label: str, *takes: Take) -> Task:
    """The task of filling a clip from which a marker was removed."""
    gappy = without(clip, label)
    return Task(gappy.positions, gappy.labels, gappy.rate, describe(gappy), (), takes)


def test_rigidity_is_that_of_adjacent_markers_where_donors_stand_still() -> None:
    clip, other = person(), person(seed=9)
    static = replace(other, positions=other.positions[50:52], name="static")
    task = task_without(clip, "RELB", same_subject_take(static, clip.labels))
    # without the mirror image, which moves
    task = replace(task, marker_set=replace(task.marker_set, mirror={}))
    visible = np.flatnonzero(task.valid.all(axis=0))
    spread = Donors(task, OPTIONS).coupling(np.array([clip.labels.index("RELB")]), visible).spread
    # from the static pose alone it would be the noise
    assert spread.min() > 3.0
    upper_arm, toe = (list(visible).index(clip.labels.index(m)) for m in ("RUPA", "LTOE"))
    assert spread[upper_arm] < 0.7 * spread[toe]


def test_all_frames_that_show_a_rarely_visible_marker_are_among_the_poses() -> None:
    clip, shown = person(), [101, 102, 131]
    elbow = clip.labels.index("RELB")
    positions = clip.positions.copy()
    positions[np.setdiff1d(np.arange(clip.frames), shown), elbow] = np.nan
    task = Task(positions, clip.labels, clip.rate, describe(clip), ())
    poses = Subjects(task, replace(OPTIONS, max_own_poses=50)).samples[0].poses
    seen = ~np.isnan(poses[:, elbow, 0])
    np.testing.assert_array_equal(poses[seen, elbow], clip.positions[shown, elbow])
    assert 50 <= len(poses) <= 50 + len(shown)


def test_distances_that_are_kept_are_those_of_the_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    clip = person()
    elbow = np.array([clip.labels.index("RELB")])
    positions = clip.positions.copy()
    positions[3:, elbow] = np.nan
    task = Task(positions, clip.labels, clip.rate, describe(clip), ())
    subjects = Subjects(task, OPTIONS)
    computed: list[int] = []

    def counted(poses: list[NDArray[np.float64]], markers: NDArray[np.intp]) -> object:
        computed.extend(markers.tolist())
        return pooled_distances(poses, markers)

    monkeypatch.setattr("priorfill.methods.gpr.dropout.subjects.pooled_distances", counted)
    some = np.array([4, 2, 9])
    for markers in (some[:2], some, some[::-1], elbow[:0]):
        everywhere = pooled_distances([one.poses for one in subjects.samples], markers)
        np.testing.assert_array_equal(subjects.distances(markers), everywhere)
        shown = [one.poses for one in subjects.samples_with(elbow)]
        found = subjects.distances_where_shown(elbow, markers)
        np.testing.assert_array_equal(found, pooled_distances(shown, markers))
    assert sorted(computed) == sorted([*some, *some])


@pytest.mark.parametrize("moving", [False, True])
def test_the_mirror_image_limits_the_visible_markers_unless_the_subject_moves(moving: bool) -> None:
    """The clip never shows the marker LUPA, so its mirror image lacks RUPA."""
    clip, other = person(), person(seed=9)
    if not moving:
        still = np.tile(other.positions[50], (other.frames, 1, 1))
        still += np.random.default_rng(0).normal(0.0, 0.5, still.shape)
        other = replace(other, positions=still)
    task = task_without(without(clip, "LUPA"), "RELB", same_subject_take(other, clip.labels))
    visible = np.flatnonzero(task.valid.all(axis=0))
    markers = np.array([clip.labels.index("RELB")])
    found = Donors(task, OPTIONS).nearest_visible(markers, visible)
    assert (clip.labels.index("RUPA") in found) == moving
    assert clip.labels.index("RSHO") in found


def test_a_marker_on_the_midline_is_no_proxy_for_the_mirror_image() -> None:
    clip = person()
    task = task_without(clip, "RFHD")
    markers = np.array([clip.labels.index("RFHD")])
    midline, side, *others = (
        clip.labels.index(label) for label in ("C7", "RSHO", "LSHO", "LBHD", "RBHD")
    )
    errors = []
    for order, proxies in (([midline, side], 2), ([side, midline], 1)):
        predictor = DropoutPredictor(task, replace(OPTIONS, max_proxy_markers=proxies))
        visible = np.array([*order, *others])
        errors.append(predictor._proxy_errors(markers, visible, from_clip=True))
    assert errors[0].max() < OPTIONS.default_error
    np.testing.assert_allclose(errors[0], errors[1], rtol=1e-6)


def test_errors_on_a_proxy_are_computed_once_for_all_missing_markers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And again where the clip shows one of them together with the visible markers."""
    clip = person()
    task = task_without(clip, "RFHD")
    names = ("RSHO", "C7", "LSHO", "LBHD", "RBHD")
    visible = np.array([clip.labels.index(label) for label in names])
    never, seen = np.array([clip.labels.index("RFHD")]), np.array([clip.labels.index("LFHD")])
    asked: list[int] = []

    def count(donors: Sequence[Donor], *arguments: Any) -> Any:
        asked.append(len(donors))
        return predict_with_each_model(donors, *arguments)

    place = "priorfill.methods.gpr.dropout.fill_dropouts.predict_with_each_model"
    monkeypatch.setattr(place, count)
    predictor = DropoutPredictor(task, OPTIONS)
    first = predictor._proxy_errors(never, visible, from_clip=True)
    computed = len(asked)
    assert computed >= len(names) - 1
    again = predictor._proxy_errors(never, visible[::-1].copy(), from_clip=True)
    assert len(asked) == computed
    np.testing.assert_allclose(again, first, rtol=1e-12)
    other = predictor._proxy_errors(seen, visible, from_clip=True)
    assert len(asked) > computed
    assert not np.allclose(other, first)


def test_a_donor_that_shows_the_other_side_only_is_mirrored(tmp_path: Path) -> None:
    """The clip has neither of the elbow markers, the database only the right one."""
    truth = person()
    clip = without(truth, "LELB", "RELB")
    with PriorDatabase.create(tmp_path / "db") as made:
        for body in (11, 12):
            made.add(without(person(seconds=3.0, seed=body, body=body), "LELB"))
    result = pf.fill(clip, database=tmp_path / "db")
    assert result.complete
    assert {gap.sources for gap in result.gaps} == {("other subjects of the database",)}
    assert error(result.clip.positions, truth.positions, clip.missing) < 50.0
