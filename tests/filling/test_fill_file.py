"""`fill_file` and `add_result`: what the command line does, from Python."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c3d_bytes import C3DFile
from gappy import ARM, person, with_gaps

import priorfill as pf
from priorfill.clip import Clip
from priorfill.errors import ClipError, OptionError, OutputError
from priorfill.filling.overrides import GapOverride, Overrides
from priorfill.filling.plausibility_options import UNCHECKED
from priorfill.formats import read, write

UNBELIEVABLE = pf.FillOptions(plausibility=UNCHECKED)
"""Options under which straight lines and wide curves are kept."""


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
        options=replace(UNBELIEVABLE, progress=lambda done, total: calls.append((done, total))),
    )
    assert calls[0] == (0, 440)
    assert calls[-1] == (440, 440)
    assert (220, 440) in calls  # the first subject
    assert [done for done, _ in calls] == sorted({done for done, _ in calls})
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
    one = pf.fill_file(
        "two.c3d",
        "ben.c3d",
        method="linear",
        files=pf.FileOptions(subject="Ben"),
        options=UNBELIEVABLE,
    )
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


FURTHER = {
    "uncertainty": "how.npz",
    "plot": "plot.png",
    "report": "page.html",
    "write_overrides": "gaps.toml",
}
"""Fields of `FileOptions` that name further outputs."""

WHAT = {
    "uncertainty": "the file for the uncertainty",
    "plot": "the file for the plot",
    "report": "the report",
}


@pytest.fixture
def spot(here: Path) -> Path:
    """A file with two gaps of one marker."""
    write("spot.c3d", with_gaps(person(), (60, 90, ("LKNE",)), (200, 240, ("LKNE",))))
    return Path("spot.c3d")


def test_further_outputs_are_checked_before_the_fill(spot, monkeypatch):
    monkeypatch.setattr("priorfill.filling.fill_file.fill", None)

    def refused(words: str, overwrite: bool, **options: str) -> None:
        files = pf.FileOptions(overwrite=overwrite, **options)
        with pytest.raises(OutputError, match=words):
            pf.fill_file(spot, files=files)

    for name, path in FURTHER.items():
        Path(path).write_text("mine")
        refused(f"{path}: exists already", False, **{name: path})
        Path(path).unlink()
        Path(path).hardlink_to(spot)
        refused(f"{path}: is the file that the clip was read from", True, **{name: path})
        Path(path).unlink()
    for (one, what), other in zip(WHAT.items(), list(FURTHER)[1:], strict=True):
        Path(FURTHER[one]).write_text("mine")
        Path(FURTHER[other]).hardlink_to(FURTHER[one])
        both = {name: FURTHER[name] for name in (one, other)}
        refused(f"{FURTHER[other]}: is {what}; choose another name", True, **both)
        for path in both.values():
            Path(path).unlink()


@pytest.mark.parametrize("name", FURTHER)
def test_a_file_that_appears_during_the_fill_is_kept(spot, name):
    path = Path(FURTHER[name])
    options = replace(UNBELIEVABLE, progress=lambda done, total: path.write_text("mine"))
    files = pf.FileOptions(**{name: path})
    with pytest.raises(OutputError, match=f"{path}: exists already"):
        pf.fill_file(spot, "out.c3d", method="linear", files=files, options=options)
    assert path.read_text() == "mine"
    assert sorted(Path().iterdir()) == sorted([path, spot])


def test_further_outputs_are_replaced_together(spot):
    for path in ("out.c3d", *FURTHER.values()):
        Path(path).write_text("mine")
    files = pf.FileOptions(plot_gaps=2, overwrite=True, **FURTHER)
    # the page shows measured samples that the fill exchanges
    swap = GapOverride(("LANK",), "swap", first=5, last=9, other="RANK")
    done = pf.fill_file(
        spot,
        "out.c3d",
        method="linear",
        files=files,
        options=UNBELIEVABLE,
        overrides=Overrides((swap,)),
    )
    assert done.further == {name: (Path(path),) for name, path in FURTHER.items()}
    assert list(done.further) == list(FURTHER)
    assert np.load("how.npz")["filled"].sum() == done.result.filled.sum() == 70
    assert pf.read_overrides("gaps.toml").to_entries()
    assert '"as measured"' in Path("page.html").read_text("utf-8")
    width, height = struct.unpack(">II", Path("plot.png").read_bytes()[16:24])
    expected = done.result.plot(gaps=2).get_size_inches()
    assert height / width == pytest.approx(expected[1] / expected[0], rel=0.01)


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


@pytest.fixture
def integers(here: Path) -> Path:
    """A file of integers up to 2949 mm and of two subjects; a marker passes that in its gap."""
    frames = np.arange(60)
    records = np.zeros((60, 6, 4))
    records[:, :, :3] = 1000 + 100 * np.arange(18).reshape(6, 3)
    records[:, 1, 0] = 3200 - 0.5 * (frames - 30) ** 2  # at most 2949 in frames 0-7 and 53-59
    records[5:55, [1, 4], :] = 0, 0, 0, -1
    labels = [f"{subject}:{name}" for subject in ("Anna", "Ben") for name in "ABC"]
    stored = np.rint(records / [0.09, 0.09, 0.09, 1])
    path = Path("integers.c3d")
    path.write_bytes(C3DFile(stored, labels, is_float=False, scale=0.09).bytes())
    return path


def test_samples_beyond_the_integers_of_a_file_stay_missing(integers):
    options = pf.FileOptions(uncertainty="how.npz")
    done = pf.fill_file(integers, "out.c3d", method="spline", files=options, options=UNBELIEVABLE)
    beyond, other = (gap for gap in done.result.gaps if gap.frames == 50)
    assert (beyond.label, other.label) == ("Anna:B", "Ben:B")
    assert other.complete and not beyond.complete
    (span,) = beyond.unfilled
    assert (span.start, span.stop, span.requested) == (8, 53, True)
    assert "beyond the range of the integers" in span.reason
    assert beyond.filled == 5
    clip = read("out.c3d", subject="Anna")
    assert np.flatnonzero(clip.missing[:, 1]).tolist() == list(range(8, 53))
    np.testing.assert_array_equal(done.result.clip.missing[:, 1], clip.missing[:, 1])
    np.testing.assert_array_equal(done.result.subjects[0].filled, done.result.filled[:, :3])
    assert not np.load("how.npz")["filled"][8:53, 1].any()
    assert np.isnan(done.result.expected_rms_mm[8:53, 1]).all()
    whole = pf.fill_file(
        integers,
        "floats.c3d",
        method="spline",
        files=pf.FileOptions(rewrite=True),
        options=UNBELIEVABLE,
    )
    assert whole.result.complete
    new = pf.fill_file(integers, "new.npz", method="spline", options=UNBELIEVABLE)
    assert new.result.complete
