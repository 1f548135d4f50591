"""Text tables as programs write and users damage them: read rightly, or refused in one line."""

from __future__ import annotations

import re

import numpy as np
import pytest
import text_files as files
from text_files import LABELS, standing

from priorfill import formats
from priorfill.errors import ClipError, FormatError
from priorfill.formats.tables import cells, text_table
from priorfill.formats.tables.frames import find_rate

NAMES = b"Frame#\tTime\t" + b"".join(label.encode() + b"\t\t\t" for label in LABELS)


def read(tmp_path, data: bytes, suffix: str = ".trc", **options):
    path = tmp_path / f"odd{suffix}"
    path.write_bytes(data)
    return formats.read(path, **options)


def rows_mapped(data: bytes, change, end: bytes = b"\r\n") -> bytes:
    """The file with each row of frames changed; a row is a list of cells."""
    lines = data.split(end)
    return end.join(
        b"\t".join(change(line.split(b"\t"))) if line[:1].isdigit() and b"mm" not in line else line
        for line in lines
    )


def as_standing(clip, up: int) -> bool:
    """Whether every marker has the positions that were written for its label."""
    expected = standing(clip.frames, up)[:, [LABELS.index(label) for label in clip.labels]]
    return bool(np.allclose(clip.positions, expected, atol=0.01))


def trc(**options) -> bytes:
    return files.trc(standing(up=1), **options)


# the same table, written differently
ALIKE = {
    "names above every column": trc().replace(
        NAMES, b"Frame#\tTime\t" + b"".join((label.encode() + b"\t") * 3 for label in LABELS)
    ),
    "names shifted by a tab": trc().replace(NAMES, NAMES.replace(b"Time\t", b"Time\t\t")),
    "names by blanks": trc().replace(NAMES, NAMES.replace(b"\t\t\t", b"   ")),
    "axes shifted by a tab": trc().replace(b"\t\tX1", b"\t\t\tX1"),
    "the whole row of names shifted": trc().replace(b"Frame#", b"\tFrame#"),
    "axes from X0": trc().replace(b"X1\tY1\tZ1", b"X0\tY0\tZ1"),
    "commas": trc().replace(b"\t", b","),
    "semicolons": trc().replace(b"\t", b";"),
    "all in quotes": b"\r\n".join(
        b",".join(b'"' + cell + b'"' for cell in line.split(b"\t")) for line in trc().split(b"\r\n")
    ),
    "decimal comma": files.trc(standing(up=1), decimals=3).replace(b".", b","),
    "mixed line ends": trc().replace(b"\r\n", b"\n", 3).replace(b"\r\n", b"\r", 6),
    "CR CR LF": trc().replace(b"\r\n", b"\r\r\n"),
    "tabs and blanks": rows_mapped(trc(), lambda row: [*row[:2], b"  ".join(row[2:])]),
    "header values with doubled tabs": trc().replace(
        b"100.00\t100.00\t12\t6\tmm\t", b"  100.0\t\t 100.0\t\t 12\t\t 6\t\t mm\t\t "
    ),
    "time in ms": rows_mapped(trc(), lambda row: [row[0], b"%d" % (10 * int(row[0])), *row[2:]]),
}


@pytest.mark.parametrize("what", ALIKE)
def test_the_same_table_in_another_notation(tmp_path, what):
    clip = read(tmp_path, ALIKE[what])
    assert clip.labels == LABELS
    assert as_standing(clip, up=1)
    assert (clip.rate, clip.source.unit) == (100.0, "mm")
    assert len(clip.source.notes) == (what == "names shifted by a tab")


def nexus(**options) -> bytes:
    return files.nexus(standing(), **options)


def motive(**options) -> bytes:
    return files.motive(standing(up=1) / 1000, **options)


def qualisys(**options) -> bytes:
    return files.qualisys(standing(), **options)


QTM_NAMES = b"MARKER_NAMES\t" + "\t".join(LABELS).encode()

# name: file, suffix, message
REFUSED = {
    "a cell too many": (trc().replace(b"\t30.00000\t", b"\t30.00000\t1\t", 1), ".trc",
                        "line 7 has 21 cells, but the header has 20"),
    "a separator too many": (trc().replace(b"\n3\t0.02000\t", b"\n3\t0.02000\t\t"), ".trc",
                             "line 9 has 21 cells, but the header has 20"),
    "a cell too few": (trc().replace(b"\t30.00000\t", b"\t", 1), ".trc",
                       "line 7 has 19 of 20 cells, and it is unclear which are absent"),
    "additional separators in one row": (
        rows_mapped(trc(), lambda row: row + [b""] * (row[0] == b"4")), ".trc",
        "line 10 has 21 cells, but line 7 has 20"),
    "a name too many": (trc().replace(NAMES, NAMES + b"XX\t"), ".trc", "line 4 names 7 markers"),
    "a row of names with a gap, shifted": (
        trc().replace(NAMES, NAMES.replace(b"Time", b"Time\t").replace(b"LKNE", b"")), ".trc",
        "line 4 has 5 names for 6 markers, and they do not stand above"),
    "a short row without its blank cells": (
        rows_mapped(trc(), lambda row: row[:5] + row[8:] if row[0] == b"5" else row), ".trc",
        "line 11 has 17 of 20 cells, and it is unclear which are absent"),
    "a title of QTM absent": (
        files.qualisys(np.where(np.arange(6)[:, None] == 5, np.nan, standing()), missing="")
        .replace(b"Frame\tTime\t", b"Frame\t"), ".tsv", "line 14 has 20 cells; 6 markers take 18"),
    "axes of Nexus shifted": (nexus().replace(b"Frame,Sub Frame,X", b"Frame,Sub Frame,,X"), ".csv",
                              "line 4 should have Frame, Sub Frame, and X, Y, Z for each marker"),
    "units of Nexus shifted": (nexus().replace(b",,mm", b",,,mm"), ".csv",
                               "line 5 lacks units of some columns"),
    "a title of Motive absent": (motive().replace(b"X,Y,Z\r", b"X,,Z\r"), ".csv",
                                 "does not have X, Y, Z for each marker of the rows above"),
    "an empty line without frame numbers": (
        qualisys(numbers=False, titles=False).replace(b"\r\n-", b"\r\n\r\n-", 3), ".tsv",
        "has an empty line between frames without numbers"),
    "axes out of order": (trc().replace(b"X2", b"X9"), ".trc", "line 5 should have X1, Y1, Z1"),
    "axes in another order": (trc().replace(b"X1\tY1\tZ1", b"Z1\tY1\tX1"), ".trc",
                              "line 5 should have X1, Y1, Z1"),
    "a time that is none": (trc().replace(b"\t0.02000\t", b"\tlate\t"), ".trc",
                            r"line 9, cell 2 \(time\) is 'late', which is not a number"),
    "thousands": (trc().replace(b"\t1450", b"\t1,450"), ".trc",
                  r"line 7, cell 16 \(C7 Y\) is '1,450.0\d*', with a thousands separator"),
    "thousands with blanks": (trc().replace(b"\t1450", b"\t1'450"), ".trc",
                              r"is \"1'450.0\d*\", with a thousands separator"),
    "thousands without decimals": (
        files.trc(np.round(standing(up=1)), decimals=0).replace(b"\t1450", b"\t1,450"), ".trc",
        "is '1,450', and every comma might separate thousands"),
    "commas and points": (trc(decimals=2).replace(b"\t30.00\t", b"\t30,00\t"), ".trc",
                          r"line 7, cell 4 \(LTOE Y\) is '30,00', and other cells have decimal"),
    "quoted thousands": (re.sub(rb"(?<=,)1(\d{3}\.\d+)", rb'"1,\1"', nexus()), ".csv",
                         r"line 6, cell 17 \(Ann:C7 Z\) is '1,450.0\d*', with a thousands"),
    "an empty line inside": (nexus().replace(b"\n9,", b"\n,,\n9,"), ".csv",
                             "line 15 continues the trajectories after an empty line"),
    "a rate that is none": (nexus().replace(b"\n100\n", b"\n1e-320\n"), ".csv",
                            "the frame rate is .*e-3.. Hz; give the right one"),
    "types of Motive shifted": (motive().replace(b",Type,", b",,Type,"), ".csv",
                                r"X, Y, Z in cells \d+-\d+, but the rows above change"),
    "names of Motive shifted": (motive().replace(b",Name,", b",Name,,"), ".csv",
                                r"X, Y, Z in cells \d+-\d+, but the rows above change"),
    "frames and times alone": (
        b"Format Version,1.23,Export Frame Rate,100,Length Units,Meters\r\n\r\n,Type\r\n,Name\r\n"
        b",ID\r\n,\r\nFrame,Time (Seconds)\r\n0,0.00\r\n1,0.01\r\n", ".csv",
        "has no columns of markers, only frames and times; tick Markers"),
    "fewer names of QTM": (
        qualisys(titles=False).replace(QTM_NAMES, QTM_NAMES.replace(b"\tC7", b"")), ".tsv",
        "line 13 has 20 cells; 5 markers take 15"),
    "other names in the titles of QTM": (
        qualisys().replace(QTM_NAMES, QTM_NAMES.replace(b"LKNE", b"LANK")), ".tsv",
        "line 14 follows titles that do not name the markers"),
    "an open quote": (nexus().replace(b"Ann:C7", b'"Ann:C7'), ".csv",
                      "a quote that opens in line 3 is not closed"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_ambiguous_is_refused_in_one_line(tmp_path, what):
    data, suffix, message = REFUSED[what]
    with pytest.raises((FormatError, ClipError), match=message) as caught:
        read(tmp_path, data, suffix)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "suffix"),
    [
        (trc().replace(b"LKNE", b""), ".trc"),
        (nexus().replace(b"Ann:LKNE", b""), ".csv"),
        (qualisys().replace(b"LKNE", b""), ".tsv"),
        (qualisys(titles=False).replace(b"LKNE", b""), ".tsv"),
        (motive().replace(b"Ann:LKNE", b""), ".csv"),
    ],
)
def test_a_blank_name_is_an_unlabelled_point(tmp_path, data, suffix):
    clip = read(tmp_path, data, suffix)
    assert clip.labels == tuple(label for label in LABELS if label != "LKNE")
    assert as_standing(clip, up=2 if suffix == ".tsv" or data.startswith(b"Traj") else 1)
    assert clip.source.left_out == {"(point 3)": "has no label"}


@pytest.mark.parametrize("shift", [b"\t", b""])
def test_shifted_axes_of_trc_with_a_marker_that_is_never_seen(tmp_path, shift):
    for marker in (0, 5):
        positions = standing(up=1)
        positions[:, marker] = np.nan
        data = files.trc(positions, trailing_tab=True).replace(b"\t\tX1", b"\t\t" + shift + b"X1")
        clip = read(tmp_path, data)
        assert np.allclose(clip.positions, positions, atol=0.01, equal_nan=True)


@pytest.mark.parametrize("titles", [True, False])
def test_blank_names_of_qtm_at_the_end(tmp_path, titles):
    data = qualisys(titles=titles).replace(b"LFHD", b"").replace(b"C7", b"")
    clip = read(tmp_path, data, ".tsv")
    assert clip.labels == LABELS[:4]
    assert as_standing(clip, up=2)


@pytest.mark.parametrize("trailing", [True, False])
@pytest.mark.parametrize("columns", ["frame and time", "frame", "none"])
def test_qtm_without_titles_whose_last_marker_is_never_seen(tmp_path, columns, trailing):
    positions = standing()
    positions[:, 5] = np.nan
    data = files.qualisys(
        positions, titles=False, missing="", trailing_tab=trailing, numbers=columns != "none"
    )
    if columns == "frame":
        data = rows_mapped(data, lambda row: row[:1] + row[2:])
    clip = read(tmp_path, data, ".tsv")
    assert np.allclose(clip.positions, positions, atol=0.01, equal_nan=True)


def test_qtm_files_of_other_programs(tmp_path):
    data = qualisys(numbers=False, titles=False, trailing_tab=True)
    for key in (b"DESCRIPTION", b"TIME_STAMP"):
        at = data.index(key)
        data = data[:at] + key + b"--" + data[data.index(b"\r\n", at) :]
    data = data.replace(QTM_NAMES, QTM_NAMES + b"\t").replace(b"EVENT\tstart", b"EVENT start")
    clip = read(tmp_path, data, ".tsv")
    assert clip.labels == LABELS
    assert as_standing(clip, up=2)


def test_trajectories_of_vicon_workstation(tmp_path):
    data = nexus(subject="Ann").replace(b"Sub Frame,", b"").replace(b"Frame,", b"Field #,")
    data = data.replace(b",0,", b",").replace(b"Trajectories\n100\n", b"TRAJECTORIES\n100,Hz\n")
    data = data.replace(b",,Ann:", b",Ann:", 1).replace(b"," + b",mm" * 18 + b"\n", b"")
    head = b'Title\nDate:\nDescription:,""\n\nEVENTS\n\n'
    clip = read(tmp_path, head + data, ".csv")
    assert clip.labels == LABELS
    assert as_standing(clip, up=2)
    assert (clip.rate, clip.subject) == (100.0, "Ann")


def test_motive_with_semicolons_and_commas_in_the_notes(tmp_path):
    data = motive().replace(b"Take Notes,,", b'Take Notes,6" pole,').replace(b",", b";")
    clip = read(tmp_path, data.replace(b".", b","), ".csv")
    assert (clip.labels, clip.rate) == (LABELS, 120.0)
    assert as_standing(clip, up=1)


MISSING = (
    "", "NaN", "nan", "-nan", "-nan(ind)", "nan(snan)", "-1.#IND", "-1.#IND00", "1.#QNAN",
    "1.#QNAN0", "1.#R", "-1.#J", "1.#QO", "NULL", "null", "N/A", "n/a", "#N/A", "<NA>", "None",
    "n. def.", "-",
)  # fmt: skip


@pytest.mark.parametrize("word", MISSING)
def test_marks_of_missing_numbers(tmp_path, word):
    positions = standing(up=1)
    positions[3:5, 2] = np.nan
    clip = read(tmp_path, files.trc(positions, missing=word))
    assert np.argwhere(clip.missing).tolist() == [[3, 2], [4, 2]]


@pytest.mark.parametrize("word", ["1.#INF", "-1.#INF00", "inf", "-Infinity", "1e999"])
def test_infinite_numbers_are_refused(tmp_path, word):
    data = trc().replace(b"\t30.00000\t", b"\t" + word.encode() + b"\t", 1)
    with pytest.raises(ClipError, match="LTOE has an infinite coordinate in frame 1"):
        read(tmp_path, data)


def test_only_blank_cells_of_a_sample_are_written(tmp_path):
    data = rows_mapped(trc(), lambda row: [*row[:3], b"", *row[4:]] if row[0] == b"5" else row)
    clip = read(tmp_path, data)
    assert np.argwhere(clip.missing).tolist() == [[4, 0]]
    values = np.where(clip.missing[..., None], [7.0, 8.0, 9.0], clip.positions)
    report = formats.write(tmp_path / "out.trc", clip.with_positions(values), clip.missing)
    expected = rows_mapped(
        trc(), lambda row: [*row[:3], b"8.00000", *row[4:]] if row[0] == b"5" else row
    )
    assert (tmp_path / "out.trc").read_bytes() == expected
    assert report.rounding_mm < 1e-5


def test_a_rejected_sample_is_written_as_a_whole(tmp_path):
    clip = read(tmp_path, trc())
    filled = np.zeros((12, 6), dtype=bool)
    filled[4, 0] = True
    values = np.where(filled[..., None], [7.0, 8.0, 9.0], clip.positions)
    formats.write(tmp_path / "out.trc", clip.with_positions(values), filled)
    assert b"\n5\t0.04000\t7.00000\t8.00000\t9.00000\t" in (tmp_path / "out.trc").read_bytes()


def times(*seconds: float, decimals: int = 3) -> list[bytes]:
    return [f"{second:.{decimals}f}".encode() for second in seconds]


@pytest.mark.parametrize(
    ("stated", "column", "rate", "note"),
    [
        (1000.0, times(*np.arange(40) / 100), 100.0, "the rate of the time column is used"),
        (100.0, times(*np.arange(40) / 120), 120.0, "the rate of the time column is used"),
        (120.0, times(*np.arange(40) / 120), 120.0, None),
        (120.0, times(0.0, 0.008), 120.0, None),  # too coarse to contradict
        (60.0, times(0.0, 0.01, 0.02, 0.04, 0.05), 60.0, "uneven"),
        (100.0, times(*np.arange(40) * 10.0), 100.0, None),  # milliseconds
        (100.0, times(*np.arange(40.0), decimals=0), 100.0, "counts rows"),
        (None, times(*np.arange(40) / 50), 50.0, "taken from the time column: 50 Hz."),
        (None, times(0.0, 0.01, 0.02, 0.04), 75.0, "although its times are uneven"),
        (None, times(*np.arange(40.0), decimals=0), None, None),
        (0.0, [], None, None),
        (100.0, [b""] * 5, 100.0, None),
    ],
)
def test_even_times_win_over_a_stale_header(stated, column, rate, note):
    found, notes = find_rate(stated, column)
    assert found == (rate if rate is None else pytest.approx(rate, rel=1e-3))
    assert len(notes) == (note is not None)
    assert note is None or note in notes[0]


# --- bounds ----------------------------------------------------------------------------------


def test_bounds(tmp_path, monkeypatch):
    monkeypatch.setattr(cells, "_MAX_CELLS", 100)
    wide = trc().replace(NAMES, NAMES + b"\t" * 100)
    with pytest.raises(FormatError, match="line 4 has more than 100 cells"):
        read(tmp_path, wide)
    monkeypatch.setattr(cells, "_MAX_LINES", 20)
    with pytest.raises(FormatError, match="has more than 20 lines"):
        read(tmp_path, trc() + b"\n" * 10)
    monkeypatch.undo()
    with pytest.raises(FormatError, match="name of 5000 characters"):
        read(tmp_path, trc().replace(b"LKNE", b"a" * 5000))
    monkeypatch.setattr(text_table, "_MAX_ABSENT", 0)
    rows = b"".join(b"%d\t0\r\n" % frame for frame in range(13, 200))
    positions = standing(up=1)
    with pytest.raises(FormatError, match="199 rows hold far less than the 6 markers"):
        read(tmp_path, files.trc(np.round(positions), decimals=0) + rows)
