"""Facts of the recordings of a study."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from gappy import person, with_gaps

from priorfill import formats
from priorfill.database.content_hash import content_hash
from priorfill.study.survey import Survey, survey_file


def test_the_facts_of_a_file(tmp_path: Path) -> None:
    clip = with_gaps(person(), (60, 120, ("LKNE", "LANK")))
    file = tmp_path / "walk.npz"
    formats.write(file, clip)
    survey = survey_file("P01/walk.npz", file, {})
    (one,) = survey.subjects
    assert survey.session == "P01"
    assert survey.reason == ""
    assert (one.labels, one.absent) == (clip.labels, ())
    assert (one.frames, one.rate, one.missing) == (clip.frames, clip.rate, 120)
    assert one.longest_gap == pytest.approx(60 / clip.rate)
    assert one.speed > 100.0
    assert len(one.body) > 10
    assert one.clip == content_hash(formats.read(file))
    assert Survey.from_json(json.loads(json.dumps(survey.to_json()))) == survey


def test_a_marker_that_is_hardly_seen_is_absent(tmp_path: Path) -> None:
    clip = with_gaps(person(), (2, 10**6, ("LKNE",)))
    formats.write(tmp_path / "walk.npz", clip)
    (one,) = survey_file("walk.npz", tmp_path / "walk.npz", {}).subjects
    assert one.absent == ("LKNE",)
    assert "LKNE" not in one.labels
    assert one.samples == clip.missing.size


def test_a_file_that_cannot_be_read_has_the_reason(tmp_path: Path) -> None:
    (tmp_path / "bad.c3d").write_bytes(b"no recording\n" * 99)
    survey = survey_file("bad.c3d", tmp_path / "bad.c3d", {})
    assert survey.subjects == ()
    assert "bad.c3d" in survey.reason
    assert survey.content
    absent = survey_file("none.c3d", tmp_path / "none.c3d", {})
    assert absent.content == ""
    assert "none.c3d" in absent.reason
