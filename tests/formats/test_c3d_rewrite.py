from __future__ import annotations

import struct

import ezc3d
import numpy as np
import pytest
from c3d_bytes import DEC, INTEL, LABELS, MIPS, C3DFile, standing
from click.testing import CliRunner

from priorfill import formats
from priorfill.cli import main
from priorfill.errors import OutputError
from priorfill.formats import read_c3d, write_c3d
from priorfill.formats.c3d.rewrite import rewrite_c3d

STEP = 0.1
FAR = (0.0, 0.0, 4000.0)
"""mm, beyond the range of integers in steps of 0.1 mm (3276.7 mm)."""


@pytest.fixture
def source(tmp_path):
    """A clip read from an integer file, with a filled sample out of range, and the mask."""

    def make(**options):
        options = {"is_float": False, "scale": STEP, **options}
        records = standing(step=None if options["is_float"] else STEP)
        records[4:7, 2, 3] = -1
        records[:, 1, 3] = 0x0503 if not options["is_float"] else float(0x0503)
        change, labels = options.pop("change", None), options.pop("labels", LABELS)
        content = C3DFile(records, labels, **options).bytes()
        (tmp_path / "in.c3d").write_bytes(change(content) if change else content)
        clip = read_c3d(tmp_path / "in.c3d")
        filled = np.zeros_like(clip.missing)
        filled[4, 2] = True
        positions = clip.positions.copy()
        positions[4, 2] = FAR
        return clip.with_positions(positions), filled

    return make


@pytest.mark.parametrize("processor", [INTEL, DEC])
def test_samples_out_of_range_are_rewritten(tmp_path, source, processor):
    clip, filled = source(processor=processor, analog=np.arange(72).reshape(12, 2, 3))
    with pytest.raises(OutputError, match=r"end at 3277: .* \(`rewrite`\)"):
        write_c3d(tmp_path / "out.c3d", clip, filled)
    report = formats.write(tmp_path / "out.c3d", clip, filled, rewrite=True)
    assert (report.samples, report.rounding_mm) == (1, 0.0)
    assert report.changes[0] == "coordinates are floats instead of integers"
    assert ("number format INTEL instead of DEC" in report.changes) == (processor == DEC)
    assert not any("analog values" in change for change in report.changes)
    back = read_c3d(tmp_path / "out.c3d")
    np.testing.assert_allclose(back.positions, clip.positions, rtol=1e-6)
    np.testing.assert_array_equal(back.missing, clip.missing)
    theirs = ezc3d.c3d(str(tmp_path / "out.c3d"))["data"]
    np.testing.assert_allclose(theirs["points"][:3, 2, 4], FAR)
    assert theirs["meta_points"]["residuals"][0, 2, 4] == 0
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["in.c3d", "out.c3d"]


def test_every_change_is_reported(tmp_path, source, monkeypatch):
    """A library that loses and changes contents between reading and writing."""
    write = ezc3d.c3d.write

    def spoil(self, path):
        self["parameters"]["PROCESSING"]["MASS"]["value"] = [61.0]
        del self["parameters"]["PROCESSING"]["HEIGHT"]
        self.add_parameter("NEW", "ONE", [1])
        self["data"]["analogs"][0, 1, 5] += 7
        self["data"]["meta_points"]["residuals"][0, 5, 5] = 2
        self["data"]["meta_points"]["camera_masks"][3, 6, 7] = True
        write(self, path)

    monkeypatch.setattr(ezc3d.c3d, "write", spoil)
    processing = {"PROCESSING": {"MASS": 60.0, "HEIGHT": 1700.0}}
    clip, filled = source(parameters=processing, analog=np.arange(72).reshape(12, 2, 3))
    changes = rewrite_c3d(tmp_path / "out.c3d", clip, filled).changes
    assert "parameters of PROCESSING: changed MASS; lost HEIGHT" in changes
    assert "parameters of NEW: added ONE" in changes
    assert "analog values differ" in changes
    assert any("cameras of" in change for change in changes)
    assert any("residuals of" in change for change in changes)


@pytest.mark.parametrize("bit", [0, 6])
def test_every_camera_is_compared(tmp_path, source, monkeypatch, bit):
    write = ezc3d.c3d.write

    def spoil(self, path):
        # ezc3d takes the upper byte of the fourth word for the residual, and truncates it
        self["data"]["meta_points"]["residuals"][0, 5, 5] = STEP * ((1 << bit) + 0.5)
        write(self, path)

    monkeypatch.setattr(ezc3d.c3d, "write", spoil)
    clip, filled = source()
    changes = rewrite_c3d(tmp_path / "out.c3d", clip, filled).changes
    assert [change for change in changes if "samples differ" in change] == [
        "cameras of 1 measured samples differ"
    ]


def test_unsigned_analog_values(tmp_path, source, monkeypatch):
    """ezc3d reads them as signed."""
    analog = np.linspace(0, 65535, 72).astype(int).reshape(12, 2, 3)
    clip, filled = source(analog=analog, parameters={"ANALOG": {"FORMAT": ["UNSIGNED"]}})
    assert "analog values differ" in rewrite_c3d(tmp_path / "out.c3d", clip, filled).changes
    write = ezc3d.c3d.write

    def correct(self, path):
        self["data"]["analogs"] %= 1 << 16
        write(self, path)

    monkeypatch.setattr(ezc3d.c3d, "write", correct)
    assert "analog values differ" not in rewrite_c3d(tmp_path / "2.c3d", clip, filled).changes


def test_lost_events_are_reported(tmp_path, source):
    def with_events(content: bytes) -> bytes:
        head = bytearray(content)
        head[298:302] = struct.pack("<HH", 0x3039, 2)
        head[304:312] = struct.pack("<ff", 0.5, 0.75)
        return bytes(head)

    clip, filled = source(change=with_events)
    changes = rewrite_c3d(tmp_path / "out.c3d", clip, filled).changes
    assert (tmp_path / "out.c3d").read_bytes()[304:312] == bytes(8)
    assert "the header's events differ (2 in the source)" in changes


@pytest.mark.parametrize("labels", [[*LABELS, "EXTRA1", "EXTRA2"], LABELS[:-1]])
def test_labels_more_or_fewer_than_points(tmp_path, source, labels):
    clip, filled = source(labels=labels)
    report = rewrite_c3d(tmp_path / "out.c3d", clip, filled)
    assert read_c3d(tmp_path / "out.c3d").labels == clip.labels
    assert any(
        change.startswith("parameters of POINT: changed ") and "LABELS" in change
        for change in report.changes
    )


def test_moved_samples_are_refused(tmp_path, source, monkeypatch):
    write = ezc3d.c3d.write

    def spoil(self, path):
        self["data"]["points"][0, 7, 3] += 1.0
        write(self, path)

    monkeypatch.setattr(ezc3d.c3d, "write", spoil)
    clip, filled = source()
    with pytest.raises(OutputError, match="changes samples of this file when writing it"):
        rewrite_c3d(tmp_path / "out.c3d", clip, filled)
    assert [path.name for path in tmp_path.iterdir()] == ["in.c3d"]


def test_a_source_that_changes_while_it_is_rewritten(tmp_path, source, monkeypatch):
    write = ezc3d.c3d.write

    def disturbed(self, path):
        write(self, path)
        (tmp_path / "in.c3d").write_bytes(b"")

    monkeypatch.setattr(ezc3d.c3d, "write", disturbed)
    clip, filled = source()
    with pytest.raises(OutputError, match="has changed since it was read"):
        rewrite_c3d(tmp_path / "out.c3d", clip, filled)
    assert [path.name for path in tmp_path.iterdir()] == ["in.c3d"]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"processor": MIPS}, "has the number format of MIPS"),
        ({"header": {"last": 40}}, "contradicts itself"),
        ({"parameters": {"PROCESSING": {"UNIT": b"kg/m\xb2"}}}, r"ezc3d cannot rewrite this file"),
    ],
)
def test_files_that_ezc3d_cannot_rewrite(tmp_path, source, options, reason):
    clip, filled = source(**options)
    with pytest.raises(OutputError, match=reason) as error:
        rewrite_c3d(tmp_path / "out.c3d", clip, filled)
    assert "\n" not in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["in.c3d"]


def test_option_of_fill(here, source):
    source()
    arguments = ["fill", "in.c3d", "-o", "out.c3d", "-m", "linear", "--rewrite"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert "note: rewritten: coordinates are floats instead of integers" in result.stderr
    assert not read_c3d(here / "out.c3d").missing.any()


def test_fill_reports_notes_on_the_file(here):
    records = standing()
    records[4:7, 2, 3] = -1
    labels = ["RKNE" if label == "LKNE" else label for label in LABELS]
    (here / "in.c3d").write_bytes(C3DFile(records, labels).bytes())
    result = CliRunner().invoke(main, ["fill", "in.c3d", "-o", "out.c3d", "-m", "linear"])
    assert result.exit_code == 0, result.output
    assert "note: Points 6 and 7 are both labelled RKNE" in result.stderr


@pytest.mark.realdata
@pytest.mark.parametrize(
    "name", ["gait/HC055A09.c3d", "cmu/127_07.c3d", "hdm05/HDM_dg_06-03_03_120.c3d"]
)
def test_recordings(data, tmp_path, name):
    clip = read_c3d(data / name)
    filled = np.zeros_like(clip.missing)
    filled[20:25, 3] = True
    moved = clip.positions.copy()
    moved[filled] = (1.0, 2.0, 3e5)
    report = rewrite_c3d(tmp_path / "out.c3d", clip.with_positions(moved), filled)
    back = read_c3d(tmp_path / "out.c3d", unit="mm", up=clip.up)
    scale = clip.source.mm_per_unit
    np.testing.assert_allclose(back.positions * scale, moved, rtol=1e-6)
    assert report.samples == 5
    assert bool(report.changes) == (not name.startswith("cmu"))  # those files were written by ezc3d


@pytest.mark.parametrize("word", [3e38, float("inf"), -1e9])
def test_invalid_fourth_words_and_analog_values(tmp_path, source, word):
    """Damage that reading ignores must not cause a warning, which is an error in tests."""
    analog = np.ones((12, 2, 3))

    def change(content):
        layout = C3DFile(standing(), LABELS, is_float=True, analog=analog)
        at = layout.offset(2, 4) + 12
        content = bytearray(content)
        content[at : at + 4] = struct.pack("<f", word)
        values = layout.offset(5, len(LABELS) - 1) + 16
        content[values : values + 4] = struct.pack("<f", float("inf"))
        return bytes(content)

    clip, filled = source(is_float=True, analog=analog, change=change)
    report = rewrite_c3d(tmp_path / "out.c3d", clip, filled)
    assert report.samples == 1


def test_rounding_is_in_millimetres(tmp_path):
    records = standing(20)
    records[:, :, :3] /= 1000
    records[5, 2] = [0, 0, 0, -1]
    (tmp_path / "m.c3d").write_bytes(C3DFile(records, LABELS, units="m").bytes())
    clip = formats.read(tmp_path / "m.c3d")
    filled = clip.missing
    clip = clip.with_positions(np.where(filled[..., None], 1234.56789, clip.positions))
    report = formats.write(tmp_path / "out.c3d", clip, filled, rewrite=True)
    off = np.abs(formats.read(tmp_path / "out.c3d").positions - clip.positions)[filled].max()
    assert report.rounding_mm == pytest.approx(off, rel=1e-3)
    assert off > 0.0
