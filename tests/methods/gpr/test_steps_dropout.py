"""Markers that the clip hardly shows: donors, and the regression over several bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gappy import error, person, with_gaps
from scipy.spatial.transform import Rotation

import priorfill as pf
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.geometry.root_frames import heading_frames, rigid_frames
from priorfill.gp.features import ALIGNMENT_FLOOR
from priorfill.methods.gpr.dropout.donors import Witness
from priorfill.methods.gpr.dropout.marker_coupling import Ties
from priorfill.methods.gpr.dropout.predict_from_donors import VIEWS, predict_by_all
from priorfill.methods.gpr.dropout.predict_from_donors import testify as mixture
from priorfill.methods.gpr.dropout.subject_kernel import KINDS
from priorfill.methods.gpr.dropout.subjects import OWN

SHAPE = np.array(
    [[0, 0, 0], [180, 20, 0], [30, 170, 10], [20, 40, 190], [150, 140, 60], [90, 80, 70.0]]
)
"""mm; the last marker is the missing one."""

VISIBLE = len(SHAPE) - 1


def donor(
    body: int,
    scale: float = 1.0,
    shift: Sequence[float] = (0.0, 0.0, 0.0),
    rows: int = 6,
    mirrored: bool = False,
    seed: int = 0,
) -> Witness:
    """Poses of a body of some size that bends, its last marker shifted in its own frame."""
    rng = np.random.default_rng([seed, body + 1, mirrored])
    poses = np.tile(scale * SHAPE, (rows, 1, 1))
    bend = rng.normal(0.0, 15.0, rows)
    poses[:, 4, 2] += bend
    poses[:, 5, 2] += 0.8 * bend
    poses[:, 5] += np.array(shift)
    turns = Rotation.from_rotvec(rng.uniform(-3.0, 3.0, (rows, 1)) * [0.0, 0.0, 1.0]).as_matrix()
    poses = np.einsum("rij,rmj->rmi", turns, poses) + rng.normal(0.0, 500.0, (rows, 1, 3))
    return Witness(body, mirrored, poses[:, :-1], poses[:, -1:])


def ties_of() -> Ties:
    far = np.linalg.norm(SHAPE[:-1] - SHAPE[-1], axis=1)
    inner = 2.0 + np.arange(VISIBLE)[:, None] + np.arange(VISIBLE)
    return Ties(far, np.linspace(3.0, 12.0, VISIBLE), inner.astype(np.float64))


# --- shapes of bodies ---


def test_a_shape_difference_has_the_size_of_the_distances_differences() -> None:
    """Where every distance differs by 10 mm, so do the shapes, whatever the weights."""
    side = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0]])
    ties = Ties(
        np.array([50.0, 200.0, 400.0]),
        np.full(3, 5.0),
        np.array([[0, 1, 9.0], [1, 0, 4], [9, 4, 0]]),
    )
    one, other = (ties.shape((length * side)[None]) for length in (150.0, 160.0))
    assert np.linalg.norm(one - other) == pytest.approx(10.0)


def test_shape_differences_match_the_weighted_rms() -> None:
    """The rms difference of distances, each counting exp(-(D² + D'²) / 4 R²) / (1 + (s / 5)²)."""
    rng = np.random.default_rng(0)
    distance, inner = rng.uniform(50.0, 500.0, 5), rng.uniform(0.0, 20.0, (5, 5))
    inner = inner + inner.T
    bodies = rng.normal(0.0, 200.0, (2, 8, 5, 3))
    ties = Ties(distance, np.full(5, 5.0), inner)
    square, total = 0.0, 0.0
    for i in range(5):
        for j in range(i):
            weight = np.exp(-(distance[i] ** 2 + distance[j] ** 2) / (4.0 * 300.0**2))
            weight /= 1.0 + (inner[i, j] / 5.0) ** 2
            lengths = np.linalg.norm(bodies[:, :, i] - bodies[:, :, j], axis=2).mean(axis=1)
            square += weight * (lengths[0] - lengths[1]) ** 2
            total += weight
    away = ties.shape(bodies[0]) - ties.shape(bodies[1])
    assert np.linalg.norm(away) == pytest.approx(np.sqrt(square / total))


def test_bodies_of_the_same_shape_count_most() -> None:
    """Two people differ by 40 mm in where the marker sits; one has the shape of the clip's body.

    The shapes differ in a far marker, which hardly counts among the features.
    """
    ties = Ties(
        np.array([100.0, 900.0, 100.0, 100.0, 100.0]), np.full(5, 3.0), np.full((5, 5), 2.0)
    )
    clip, alike = donor(5, rows=10), donor(1, shift=(20.0, 0.0, 0.0), rows=10)
    other = donor(2, shift=(-20.0, 0.0, 0.0), rows=10)
    ahead = other.visible[:, 1] - other.visible[:, 0]
    other.visible[:, 1] += 300.0 * ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    errors = np.full(len(VIEWS) * len(KINDS), 10.0)
    found = mixture([alike, other], clip.visible, ties, errors)[0]
    frames = rigid_frames(clip.visible, SHAPE[:-1], np.ones(VISIBLE))
    # mm from the middle between the two, along the body's x axis
    away = (frames.to_local(found) - frames.to_local(clip.missing))[..., 0].mean()
    # 5 mm without it: the far marker is a weak feature too
    assert away > 8.0


# --- the regression, against solving for every query by itself ---


def some_donors() -> list[Witness]:
    return [
        donor(OWN, shift=(3.0, 0.0, 0.0), rows=3),
        donor(OWN, shift=(9.0, 0.0, 0.0), rows=4, mirrored=True),
        donor(1, 1.05, (0.0, 12.0, 0.0)),
        donor(1, 1.05, (0.0, 10.0, 4.0), mirrored=True),
        donor(2, 0.9, (0.0, -15.0, 0.0)),
        donor(3, 1.1, (-6.0, 0.0, 9.0), rows=5),
    ]


@pytest.mark.parametrize("own", [True, False])
def test_each_member_matches_the_textbook_formulas(own: bool) -> None:
    """Covariance 1 + k + b (offset + movement k), a tenth of the noise for the clip's own frames.

    b is shape exp(-|d|² / 2 reach²) + image [same body] + rest [same body and side].
    """
    donors = [one for one in some_donors() if own or one.body != OWN]
    query, ties = donor(OWN, rows=4, seed=8).visible, ties_of()
    found = predict_by_all(donors, query, ties, None)
    visible = np.concatenate([one.visible for one in donors])
    missing = np.concatenate([one.missing for one in donors])
    who = [i for i, one in enumerate(donors) for _ in one.visible]
    shapes = [
        ties.shape(query if one.body == OWN and not one.mirrored else one.visible) for one in donors
    ]
    shapes.append(ties.shape(query))
    sides = [*((one.body, one.mirrored) for one in donors), (OWN, False)]
    mine = np.array([sides[i] == (OWN, False) for i in who])
    # left out together: one side of a body if the clip has a mirror image, else the body
    groups = {sides[i] if own else sides[i][0] for i in who if sides[i][0] != OWN}
    blocks = [
        np.array([r for r, i in enumerate(who) if (sides[i] if own else sides[i][0]) == group])
        for group in sorted(groups)
    ]
    number = 0
    for view in VIEWS:
        nearness = np.exp(-(ties.distance**2) / (2.0 * view.reach**2))
        firmness = np.ones(VISIBLE)
        if view.slack is not None:
            firmness = 1.0 / (1.0 + (ties.spread / view.slack) ** 2)
        align = rigid_frames if view.frame == "rigid" else heading_frames
        template, alignment = query[len(query) // 2], nearness * firmness + ALIGNMENT_FLOOR
        weight = (nearness * np.sqrt(firmness) + view.floor)[:, None]
        row_frames, query_frames = (align(p, template, alignment) for p in (visible, query))
        known = (row_frames.to_local(visible) * weight).reshape(len(visible), -1)
        asked = (query_frames.to_local(query) * weight).reshape(len(query), -1)
        middle = known.mean(axis=0)
        scale = np.sqrt(((known - middle) ** 2).sum(axis=1).mean())
        known, asked = (known - middle) / scale, (asked - middle) / scale
        targets = row_frames.to_local(missing)[:, 0]
        centre = (targets[mine] if own else targets).mean(axis=0)
        for kind in KINDS:

            def shared(i: int, j: int, kind: object = kind) -> float:
                away = np.sum((shapes[i] - shapes[j]) ** 2)
                value = kind.shape * np.exp(-away / (2.0 * kind.reach**2))
                value += kind.image * (sides[i][0] == sides[j][0])
                return value + (1.0 - kind.shape - kind.image) * (sides[i] == sides[j])

            def covariance(
                a: np.ndarray, b: np.ndarray, i: int, j: int, kind: object = kind
            ) -> float:
                square = np.sum((a - b) ** 2)
                k = kind.linear * a @ b + kind.radial * np.exp(-square / (2 * kind.length**2))
                return 1.0 + k + shared(i, j) * (kind.offset + kind.movement * k)

            rows = list(zip(known, who, strict=True))
            noise = np.where(mine, 0.1, 1.0) * kind.noise
            matrix = np.array([[covariance(a, b, i, j) for b, j in rows] for a, i in rows])
            matrix += np.diag(noise)
            cross = np.array([[covariance(q, b, len(donors), j) for b, j in rows] for q in asked])
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
            itself = np.array([covariance(q, q, len(donors), len(donors)) for q in asked])
            left = itself - np.einsum("qr,rq->q", cross, np.linalg.solve(matrix, cross.T))
            np.testing.assert_allclose(
                found.variance[number, :, 0], unit * (left + noise.min()), rtol=1e-6
            )
            number += 1
    assert number == len(found.positions)


def test_members_that_err_less_count_more() -> None:
    query, ties = donor(OWN, rows=4, seed=8).visible, ties_of()
    members = len(VIEWS) * len(KINDS)
    each = predict_by_all(some_donors(), query, ties, 10.0).positions
    errors = np.full(members, 10.0)
    errors[2] = 5.0
    weight = np.where(np.arange(members) == 2, 16.0, 1.0)  # (10 / 5)⁴
    mean, expected_rms = mixture(some_donors(), query, ties, errors)
    np.testing.assert_allclose(mean, np.average(each, axis=0, weights=weight), atol=1e-6)
    spread = ((each - mean) ** 2).sum(axis=3) + (errors**2)[:, None, None]
    expected = np.sqrt(np.average(spread, axis=0, weights=weight))
    np.testing.assert_allclose(expected_rms, expected, rtol=1e-6)


def test_the_clips_own_few_frames_are_trusted_most() -> None:
    """One frame of the clip and one of its twin, with the marker 60 mm away from each other."""
    ties = ties_of()
    own = donor(OWN, rows=1, seed=4)
    twin = Witness(1, False, own.visible, own.missing + np.array([60.0, 0.0, 0.0]))
    errors = np.full(len(VIEWS) * len(KINDS), 10.0)
    found = mixture([own, twin], own.visible, ties, errors)[0]
    away = np.linalg.norm(found - own.missing)
    # with the noise of the twin's frames 10 and more
    assert away < 5.0


# --- donors ---


def without(clip: Clip, *labels: str) -> Clip:
    return with_gaps(clip, (0, clip.frames, labels))


def test_donors_of_the_most_similar_shape_are_chosen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sizes of 0.85 to 1.15 of the same person; one donor is to be taken."""
    truth = person()
    with PriorDatabase.create(tmp_path / "db") as made:
        for size in (0.85, 0.96, 1.15):
            other = person(seconds=3.0, seed=9)
            other = replace(other, positions=size * other.positions, name=f"size{size}")
            made.add(other, subject=f"size{size}")
    monkeypatch.setattr("priorfill.methods.gpr.dropout.donors.BODIES", 1)
    (gap,) = pf.fill(without(truth, "C7"), database=tmp_path / "db").gaps
    assert gap.source_clips == ("size0.96",)


def test_a_donor_that_shows_the_other_side_only_is_mirrored(tmp_path: Path) -> None:
    """The clip has neither of the elbow markers, the database only the right one."""
    truth = person()
    clip = without(truth, "LELB", "RELB")
    with PriorDatabase.create(tmp_path / "db") as made:
        for body in (11, 12):
            made.add(without(person(seconds=3.0, seed=body, body=body), "LELB"))
    result = pf.fill(clip, database=tmp_path / "db")
    assert result.complete
    assert {gap.sources for gap in result.gaps} == {("the database's bodies",)}
    assert error(result.clip.positions, truth.positions, clip.missing) < 50.0
