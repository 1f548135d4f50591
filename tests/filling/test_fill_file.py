"""`fill_file` and `add_result`: what the command line does, from Python."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gappy import ARM, person, with_gaps

import priorfill as pf
from priorfill.clip import Clip
from priorfill.errors import ClipError, OptionError, OutputError
from priorfill.formats import read, write


def walk(name: str = "") -> Clip:
    """A clip with gaps."""
    gaps = ((60, 90, ARM), (200, 240, ("LKNE",)))
    return replace(with_gaps(person(seed=len(name), body=len(name)), *gaps), subject=name)


@pytest.fixture
def two(here: Path) -> tuple[Clip, Clip]:
    """A file of two subjects, and their clips."""
    clips = walk("Anna"), walk("Ben")
    positions = np.concatenate([clip.positions for clip in clips], axis=1)
    labels = tuple(f"{clip.subject}:{label}" for clip in clips for label in clip.labels)
    write("two.c3d", Clip(positions, labels, 60.0))
    return clips


def test_files_of_several_subjects(two):
    options = pf.FileOptions(uncertainty="how.npz", add_to_database=True)
    calls: list[tuple[int, int]] = []
    done = pf.fill_file(
        "two.c3d",
        "out.c3d",
        database="db",
        method="linear",
        files=options,
        options=pf.FillOptions(progress=lambda done, total: calls.append((done, total))),
    )
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert (done.source, done.output) == (Path("two.c3d"), Path("out.c3d"))
    assert [one.clip.subject for one in done.result.subjects] == ["Anna", "Ben"]
    assert [one.provenance.reading["subject"] for one in done.result.subjects] == ["Anna", "Ben"]
    assert done.result.provenance.reading["subject"] is None
    assert [added.message for added in done.added if added] == ["added to db", "added to db"]
    assert done.not_added is None
    with pf.PriorDatabase.open("db") as database:
        assert {record.subject for record in database.clips()} == {"Anna", "Ben"}
    assert not read("out.c3d", subject="Ben").missing.any()
    assert np.load("how.npz")["filled"].sum() == done.result.filled.sum() == 2 * 220
    one = pf.fill_file("two.c3d", "ben.c3d", method="linear", files=pf.FileOptions(subject="Ben"))
    assert one.result.subjects == ()
    np.testing.assert_array_equal(one.result.clip.positions, done.result.subjects[1].clip.positions)


def test_nothing_is_filled_that_cannot_be_written(two, monkeypatch):
    monkeypatch.setattr("priorfill.filling.fill_file.fill", None)
    Path("old.c3d").write_text("precious")
    for output, options, error, words in (
        ("old.c3d", {}, OutputError, "exists already"),
        ("out.c3d", {"uncertainty": "out.c3d"}, Exception, "uncertainty cannot be written"),
        ("out.c3d", {"add_to_database": True}, OptionError, "cannot be added to a database"),
        ("two.c3d", {"overwrite": True}, OutputError, "read from"),
    ):
        with pytest.raises(error, match=words):
            pf.fill_file("two.c3d", output, files=pf.FileOptions(**options))


def test_artefacts_are_reported_or_rejected(here):
    positions = walk().positions.copy()
    positions[150:154, walk().labels.index("RTOE")] += [0, 70, 0]
    write("walk.c3d", walk().with_positions(positions))
    files = pf.FileOptions(overwrite=True)
    for reject in (False, True):
        done = pf.fill_file(
            "walk.c3d", "out.c3d", method="linear", reject_artefacts=reject, files=files
        )
        assert [(one.kind, one.markers) for one in done.artefacts] == [("spike", ("RTOE",))]
        assert done.result.rejected.sum() == (4 if reject else 0)
        assert done.result.provenance.reject_artefacts is reject


def test_a_failure_to_add_leaves_the_output(here):
    short = walk().with_positions(walk().positions[:70])
    write("short.c3d", short)
    files = pf.FileOptions(add_to_database=True)
    done = pf.fill_file("short.c3d", "out.c3d", database="db", method="linear", files=files)
    assert done.not_added is None
    write("tiny.c3d", short.with_positions(walk().positions[58:66]))
    done = pf.fill_file("tiny.c3d", "tiny_out.c3d", database="db", method="linear", files=files)
    assert done.added == (None,)
    assert "tiny_out.c3d is written but not added" in str(done.not_added)
    assert isinstance(done.not_added.__cause__, ClipError)
    assert Path("tiny_out.c3d").exists()


def test_add_result_without_a_file(here, two):
    result = pf.fill([replace(clip, name=clip.subject) for clip in two], method="linear")
    added = pf.add_result("db", result)
    assert [(one.subject, one.record.name, one.replaced) for one in added] == [
        ("Anna", "Anna", ()),
        ("Ben", "Ben", ()),
    ]
    (again, _) = pf.add_result("db", result)
    assert again.record is None
    assert "is in the database already" in again.message


def test_other_recordings_must_be_of_a_subject_of_the_file(two):
    with pytest.raises(OptionError, match="does not state whether it is of Anna, Ben"):
        pf.fill(two, method="linear", same_subject=[walk("Carl")])
    with pytest.raises(OptionError, match="is the clip to be filled"):
        pf.fill(two, method="linear", same_subject=[two[1]])
    with pytest.raises(OptionError, match="there is no clip to fill"):
        pf.fill([])
