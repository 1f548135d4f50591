"""Markers that the clip never shows: other recordings, the mirror image, and other subjects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gappy import error, person, with_gaps
from scipy.spatial.transform import Rotation

from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import ClipError, OptionError
from priorfill.filling.fill_clip import fill
from priorfill.geometry.axes import from_upright
from priorfill.markers.discover import discover
from priorfill.methods.gpr.dropout.fill_dropouts import DropoutPredictor
from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.methods.task import Task
from priorfill.search.takes import same_subject_take

LABELS = ("A", "B", "C", "D", "E", "F")


def tumbling(frames: int, seed: int) -> np.ndarray:
    """A rigid body that turns over and moves about [shape=(frames, 6, 3), mm]."""
    shape = 100.0 * np.random.default_rng(0).normal(size=(6, 3))
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(np.cumsum(0.05 * rng.normal(size=(frames, 3)), axis=0))
    path = np.cumsum(rng.normal(size=(frames, 1, 3)), axis=0)
    return np.einsum("fij,mj->fmi", turns.as_matrix(), shape) + path


def without(clip: Clip, *labels: str) -> Clip:
    return with_gaps(clip, (0, clip.frames, labels))


def standing(body: int = 0) -> Clip:
    """Two frames of a person who stands still."""
    clip = person(seed=9, body=body)
    return replace(clip, positions=clip.positions[50:52], name="static")


@pytest.mark.parametrize(
    ("frames", "rate", "up"),
    [(1, 50.0, "+Z"), (30, 120.0, "+Z"), (60, 100.0, "+Y"), (5, 25.0, "-X")],
)
def test_a_rigid_body_in_another_recording(frames, rate, up):
    truth = tumbling(120, seed=1)
    clip = without(Clip(truth, LABELS, 100.0), "C")
    other = Clip(from_upright(tumbling(frames, seed=2), up), LABELS, rate, up=up, name="static")
    task = Task(
        clip.positions,
        LABELS,
        clip.rate,
        discover(clip.positions, LABELS),
        (),
        (same_subject_take(other, LABELS),),
    )
    missing = np.array([2])
    predictor = DropoutPredictor(task, DropoutOptions())
    visible = predictor.nearest_visible(missing, np.array([0, 1, 3, 4, 5]))
    found = predictor.predict(missing, visible, np.arange(120))
    assert found is not None
    np.testing.assert_allclose(found.positions, truth[:, missing], atol=1e-6)
    assert found.source_clips == ("static",)

    result = fill(clip, same_subject=[other])
    np.testing.assert_allclose(result.clip.positions, truth, atol=1e-2)
    assert result.gaps[0].sources == ("other recordings of the same subject",)
    assert result.gaps[0].source_clips == ("static",)


@pytest.mark.parametrize(("label", "static", "moving"), [("C7", 8, 6), ("RELB", 25, 12)])
def test_other_recordings_of_the_same_person(label, static, moving):
    clip = without(person(), label)
    for same_subject, most in ((standing(), static), (person(seed=9), moving)):
        result = fill(clip, same_subject=[same_subject])
        assert result.complete
        off = error(result.clip.positions, person().positions, clip.missing)
        assert off < most
        assert off < 3 * result.gaps[0].expected_rms_mm
        assert same_subject.name in result.gaps[0].source_clips


def test_another_recording_with_other_spelling_and_axes():
    clip = without(person(), "RELB")
    other = person(seed=9)
    turned = Clip(
        from_upright(other.positions, "+Y"), [x.lower() for x in other.labels], 60.0, up="+Y"
    )
    expected = fill(clip, same_subject=[other]).clip.positions
    found = fill(clip, same_subject=[turned]).clip.positions
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_several_other_recordings():
    clip = without(person(), "C7", "RELB")
    other = person(seed=9)
    halves = [without(other, "C7"), replace(without(other, "RELB"), name="second")]
    result = fill(clip, same_subject=halves)
    assert result.complete
    assert error(result.clip.positions, person().positions, clip.missing) < 12
    assert {gap.label: "second" in gap.source_clips for gap in result.gaps} == {
        "C7": True,
        "RELB": False,
    }


def test_other_recordings_that_are_refused():
    clip = without(person(), "C7")
    with pytest.raises(OptionError, match="is the clip to be filled"):
        fill(clip, same_subject=[clip])
    with pytest.raises(OptionError, match="is the clip to be filled"):
        fill(clip, same_subject=[replace(clip, name="copy")])
    thing = Clip(tumbling(10, 3), LABELS, 60.0, name="thing")
    with pytest.raises(ClipError, match="thing: no marker in common with the clip"):
        fill(clip, same_subject=[thing])


def symmetric(clip: Clip) -> Clip:
    """The clip with the left side of the body replaced by the mirror image of the right side."""
    positions = clip.positions.copy()
    for i, label in enumerate(clip.labels):
        if label[0] == "L":
            right = positions[:, clip.labels.index("R" + label[1:])]
            positions[:, i] = right * [-1.0, 1.0, 1.0]
        elif label[0] != "R":
            positions[:, i, 0] = 0.0
    return clip.with_positions(positions)


def test_mirror_image_of_a_symmetric_person():
    complete = symmetric(person())
    for label in ("LELB", "RANK", "RFHD"):
        clip = without(complete, label)
        result = fill(clip)
        assert result.complete
        assert result.gaps[0].sources == ("the clip's mirror image",)
        assert error(result.clip.positions, complete.positions, clip.missing) < 3.0


def test_markers_without_any_donor_stay_missing():
    clip = without(person(), "C7", "LANK", "RANK")  # on the midline, and both of a pair
    result = fill(clip)
    assert {gap.label: gap.filled for gap in result.gaps} == {"C7": 0, "LANK": 0, "RANK": 0}
    for gap in result.gaps:
        assert "no database" in gap.unfilled[0].reason
        assert "`same_subject`" in gap.unfilled[0].reason


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> PriorDatabase:
    """Other people, and one take of the clip's own subject under another name."""
    place = tmp_path_factory.mktemp("priors") / "db"
    with PriorDatabase.create(place) as made:
        for body in (11, 12, 13):
            made.add(person(seconds=6.0, seed=body, body=body))
        made.add(replace(person(seconds=6.0, seed=21), name="same", subject="nobody"))
    with PriorDatabase.open(place) as opened:
        yield opened


def test_the_same_subject_in_the_database_is_recognised_by_its_shape(database):
    clip = without(person(), "C7")
    (gap,) = fill(clip, database=database).gaps
    assert gap.sources[0].startswith("other recordings of the same subject")
    assert gap.source_clips[0] == "same"
    other = without(person(body=5, seed=6), "C7")
    (gap,) = fill(other, database=database).gaps
    assert gap.sources == ("other subjects of the database",)


def test_a_few_frames_fix_the_placement_of_a_marker(database):
    truth = person(body=5, seed=6)
    never = without(truth, "RELB")
    rarely = with_gaps(truth, (0, 110, ("RELB",)), (116, truth.frames, ("RELB",)))
    errors = [
        error(fill(clip, database=database).clip.positions, truth.positions, rarely.missing)
        for clip in (never, rarely)
    ]
    assert errors[1] < 0.8 * errors[0]


def test_a_few_own_frames_are_reported_as_such(database):
    """Five frames, too few to learn from alone, with each kind of other donor."""
    complete = person(body=5, seed=6)
    clip = with_gaps(complete, (0, 110, ("RELB",)), (115, complete.frames, ("RELB",)))
    other = person(body=5, seed=9)
    own, others = "the clip's own few frames", "other recordings of the same subject"
    for given, expected in (
        ({"database": database}, f"{own}, the clip's mirror image, other subjects of the database"),
        ({"same_subject": [other]}, f"{own}, {others}"),
        ({}, f"{own}, the clip's mirror image"),
    ):
        assert {gap.sources for gap in fill(clip, **given).gaps} == {(expected,)}


def test_the_same_subject_counts_more_than_others(database):
    clip = without(person(body=5, seed=6), "RELB")
    truth = person(body=5, seed=6).positions
    others = fill(clip, database=database)
    both = fill(clip, database=database, same_subject=[person(body=5, seed=9)])
    off = [error(r.clip.positions, truth, clip.missing) for r in (others, both)]
    assert off[1] < 0.6 * off[0]
    assert both.gaps[0].expected_rms_mm < others.gaps[0].expected_rms_mm


@pytest.mark.parametrize("body", [11, 13, 17])
def test_expected_error_of_a_single_donor_subject(tmp_path, body):
    """With one person in the database, it is estimated on visible markers near the missing one."""
    clip = without(person(), "C7")
    with PriorDatabase.create(tmp_path / "db") as made:
        made.add(person(seconds=6.0, seed=11, body=body))
    result = fill(clip, database=tmp_path / "db")
    assert result.gaps[0].sources == ("other subjects of the database",)
    actual = error(result.clip.positions, person().positions, clip.missing)
    assert 0.2 < actual / result.gaps[0].expected_mean_error_mm < 1.5


@pytest.mark.parametrize(
    ("name", "value"),
    [("max_visible", 2), ("min_visible_share", 1.5), ("database_rate", 0.0), ("weight_power", -1)],
)
def test_options_out_of_range_are_refused(name, value):
    with pytest.raises(OptionError, match=f"DropoutOptions.{name} is"):
        DropoutOptions(**{name: value})
