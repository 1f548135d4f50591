"""TRC files for OpenSim, by the rules of its reader."""

from __future__ import annotations

import numpy as np
import pytest
from text_files import LABELS, standing

import priorfill as pf
from priorfill import formats
from priorfill.errors import OptionError, OutputError
from priorfill.formats.tables.opensim_trc import opensim_labels

_KEYS = (
    *("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate"),
    *("OrigDataStartFrame", "OrigNumFrames"),
)


def tokens(line: str) -> list[str]:
    """Cells as std::getline gives them: an empty one at the end is lost."""
    cells = line.rstrip("\r").split("\t")
    return cells[:-1] if cells[-1] == "" else cells


def read_as_opensim(text: str) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Labels, times and positions as OpenSim 4.6 reads a TRC file, or an AssertionError."""
    lines = text.split("\n")
    assert lines[0].split()[0] == "PathFileType"
    assert tuple(cell for cell in tokens(lines[1]) if cell) == _KEYS
    values = dict(zip(_KEYS, tokens(lines[2]), strict=True))
    count = int(values["NumMarkers"])
    frame, time, *labels = (cell for cell in tokens(lines[3]) if cell)
    assert (frame, time, len(labels)) == ("Frame#", "Time", count)
    axes = [cell for cell in tokens(lines[4]) if cell]
    assert axes == [f"{axis}{k}" for k in range(1, count + 1) for axis in "XYZ"]
    rows = [tokens(line) for line in lines[5:] if line.strip()]
    assert {len(row) for row in rows} == {2 + 3 * count}
    cells = np.array([[float(cell or "nan") for cell in row] for row in rows])
    assert len(rows) == int(values["NumFrames"])
    return labels, cells[:, 1], cells[:, 2:].reshape(len(rows), count, 3)


def clip_with_gaps(up: str = "+Z") -> pf.Clip:
    positions = standing()
    positions[3:6, 5] = np.nan  # the last marker: rows end with missing samples
    positions[8, 1] = np.nan
    return pf.Clip(positions, LABELS, 100.0, up=up, first_frame=31)


def test_the_file_has_y_up_and_no_blank_cells(tmp_path):
    clip = clip_with_gaps()
    path = tmp_path / "walk.trc"
    report = formats.write(path, clip, program="opensim")
    text = path.read_text()
    labels, times, positions = read_as_opensim(text)
    assert labels == list(LABELS)
    np.testing.assert_allclose(times, np.arange(12) / 100)
    x, y, z = np.moveaxis(clip.positions, 2, 0)
    np.testing.assert_allclose(positions, np.stack([x, z, -y], axis=2), atol=1e-6)
    assert text.count("NaN") == 3 * 4
    again = formats.read(path)
    assert (again.up, again.first_frame, again.missing.sum()) == ("+Y", 31, 4)
    assert report.notes == (
        "Turned for OpenSim, so that +Z of the recording is +Y.",
        "Samples that stay missing are NaN, which inverse kinematics passes over: RTOE, LFHD.",
    )


def test_a_clip_with_y_up_is_not_turned(tmp_path):
    clip = clip_with_gaps("+Y")
    formats.write(tmp_path / "walk.trc", clip, program="opensim")
    _, _, positions = read_as_opensim((tmp_path / "walk.trc").read_text())
    np.testing.assert_allclose(positions, clip.positions, atol=1e-6)


def test_every_new_trc_file_can_be_read_by_opensim(tmp_path):
    clip = clip_with_gaps()
    formats.write(tmp_path / "walk.trc", clip)
    _, _, positions = read_as_opensim((tmp_path / "walk.trc").read_text())
    np.testing.assert_allclose(positions, clip.positions, atol=1e-6)


def test_frames_without_any_marker_are_stated(tmp_path):
    positions = standing()
    positions[5:7] = np.nan
    clip = pf.Clip(positions, LABELS, 100.0)
    report = formats.write(tmp_path / "walk.trc", clip, program="opensim")
    assert report.notes[1].startswith("2 frames from 0.050 to 0.060 s have no marker;")


def test_names_of_markers_follow_opensims_rules(tmp_path):
    labels = ("L TOE", "L/TOE", "L_TOE", "A*1", "C7", "LFHD")
    assert opensim_labels(labels) == ("L_TOE_2", "L_TOE_3", "L_TOE", "A_1", "C7", "LFHD")
    path = tmp_path / "walk.trc"
    report = formats.write(path, pf.Clip(standing(), labels, 100.0, up="+Y"), program="opensim")
    assert read_as_opensim(path.read_text())[0] == list(opensim_labels(labels))
    assert report.notes == (
        "Names of markers for OpenSim: L TOE is L_TOE_2, L/TOE is L_TOE_3, A*1 is A_1.",
    )


def test_labels_and_names_that_would_divide_the_table(tmp_path):
    labels = ('"q"', "a\0b", *LABELS[2:])
    clip = pf.Clip(standing(), labels, 100.0)
    formats.write(tmp_path / "out.trc", clip, program="opensim")
    assert formats.read(tmp_path / "out.trc").labels[:2] == ("_q_", "a_b")
    with pytest.raises(OutputError, match="a TRC file cannot hold the label"):
        formats.write(tmp_path / "plain.trc", clip)


def test_a_copy_is_never_made_for_a_program(tmp_path):
    source = tmp_path / "walk.trc"
    formats.write(source, clip_with_gaps())
    clip = formats.read(source)
    with pytest.raises(OutputError, match="is the file that the clip was read from"):
        formats.write(source, clip, clip.missing & False, program="opensim", overwrite=True)
    formats.write(tmp_path / "new.trc", clip, program="opensim")
    assert "NaN" in (tmp_path / "new.trc").read_text()


def test_other_programs_and_suffixes_are_refused(tmp_path):
    with pytest.raises(OptionError, match="`program` 'matlab' is unknown; use one of opensim"):
        formats.write(tmp_path / "walk.trc", clip_with_gaps(), program="matlab")
    with pytest.raises(OptionError, match=r"a file for OpenSim has the suffix \.trc"):
        formats.write(tmp_path / "walk.c3d", clip_with_gaps(), program="opensim")
