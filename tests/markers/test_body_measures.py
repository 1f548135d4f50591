"""Body measures: the same subject is recognised, another one too."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from gappy import person, with_gaps

import priorfill as pf
from priorfill.clip import Clip
from priorfill.filling.same_subject_takes import same_subject_takes
from priorfill.markers.body_measures import (
    MAX_DIFFERENCE,
    MAX_KEPT_MEASURES,
    MAX_MARKERS,
    body_measures,
    compare_bodies,
    compare_measures,
)
from priorfill.markers.definitions import recognise
from priorfill.synthetic import Body, synthesise

CLIP = person()
SET = recognise(CLIP.labels)


def difference(one: Clip, other: Clip) -> float:
    return compare_bodies(
        (one.positions, one.labels), (other.positions, other.labels), SET
    ).difference


def attached_anew(clip: Clip, size: float) -> Clip:
    """The clip with each marker displaced along the direction to two others of its segment."""
    rng = np.random.default_rng(7)
    apart = np.linalg.norm(clip.positions[:, :, None] - clip.positions[:, None], axis=3)
    order = np.argsort(apart.std(axis=0) + 0.03 * apart.mean(axis=0), axis=1)
    moved = clip.positions.copy()
    for marker in range(len(clip.labels)):
        first, second = order[marker, 1:3]
        a = clip.positions[:, first] - clip.positions[:, marker]
        b = np.cross(a, clip.positions[:, second] - clip.positions[:, marker])
        axes = np.stack([a, b, np.cross(a, b)])
        axes /= np.linalg.norm(axes, axis=2, keepdims=True)
        weights = rng.normal(size=3)
        weights *= size / np.linalg.norm(weights)
        moved[:, marker] += np.einsum("k,kfc->fc", weights, axes)
    return clip.with_positions(moved)


def test_another_take_of_the_subject_is_accepted() -> None:
    for motion in ("running", "walking"):
        assert difference(CLIP, person(motion, seed=9)) < 5.0


def test_markers_attached_anew_are_accepted() -> None:
    assert 4.0 < difference(CLIP, attached_anew(person(seed=9), 15.0)) < MAX_DIFFERENCE


@lru_cache
def stranger(height: float) -> Clip:
    """A take of another subject."""
    return synthesise("walking", seconds=2.0, rate=60.0, seed=9, body=Body(height=height, seed=3))


@pytest.mark.parametrize("height", [1600.0, 1950.0])
def test_another_subject_is_recognised(height: float) -> None:
    assert difference(CLIP, stranger(height)) > MAX_DIFFERENCE


def test_other_places_of_the_markers_are_recognised() -> None:
    labels = tuple(np.roll(CLIP.labels, 3).tolist())
    other = Clip(person(seed=9).positions, labels, CLIP.rate)
    assert difference(CLIP, other) > MAX_DIFFERENCE


def test_two_static_trials_are_compared_within_segments() -> None:
    """Postures differ, so that only distances within a segment are of the body."""
    one = CLIP.with_positions(CLIP.positions[:1])
    other = person(seed=9)
    other = other.with_positions(other.positions[100:101])
    assert difference(one, other) < 5.0
    measures = compare_bodies((one.positions, one.labels), (other.positions, other.labels))
    assert measures.measures == 0
    assert not measures.differs


def test_many_markers_are_compared_in_bounded_time() -> None:
    rng = np.random.default_rng(1)
    many = rng.normal(0.0, 300.0, (5, 1000, 3))
    labels = tuple(f"M{i}" for i in range(1000))
    assert compare_bodies((many, labels), (many, labels)).measures < MAX_MARKERS**2


def test_a_fill_does_not_learn_from_another_subject() -> None:
    truth = person(seconds=1.5)
    clip = with_gaps(truth, (0, truth.frames, ["RELB"]), (50, 60, ["LKNE", "LTHI", "LSHN"]))
    other, own = stranger(1950.0), person(seconds=1.5, seed=9)
    takes, (note,) = same_subject_takes(clip, [other, own], SET)
    assert [take.name for take in takes] == [own.name]
    assert note.startswith(f"{other.name}: shows another subject or other marker positions")
    assert "not learnt from" in note
    assert pf.fill(clip, method="linear", same_subject=[other, own]).notes == (note,)


def test_a_version_of_the_clip_itself_is_not_learnt_from() -> None:
    truth = person()
    clip = with_gaps(truth, (50, 90, ["LKNE"]))
    result = pf.fill(clip, method="linear", same_subject=[truth])
    assert result.notes == (f"{truth.name}: is of the same recording as the clip; not learnt from",)


def test_kept_measures_compare_as_recordings_do() -> None:
    clips = [CLIP, with_gaps(CLIP, (20, 120, ("LKNE",))), person(seed=9), stranger(1950.0)]
    kept = [body_measures(clip.positions, clip.labels) for clip in clips]
    for other, measures in zip(clips[1:], kept[1:], strict=True):
        found = compare_measures(kept[0], measures)
        assert found.difference == pytest.approx(difference(CLIP, other), abs=3.0)
        assert len(measures) <= MAX_KEPT_MEASURES
