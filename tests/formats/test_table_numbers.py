"""Numbers in cells of text tables that are easily misread: separators, cut files, rates."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import text_files

from priorfill import formats
from priorfill.errors import FormatError
from priorfill.formats.tables.frames import find_rate
from priorfill.formats.tables.motive_csv import parse_motive
from priorfill.formats.tables.nexus_csv import parse_nexus
from priorfill.formats.tables.qualisys_tsv import parse_qualisys
from priorfill.formats.units import find_unit


def _nexus(rows, sep: str = ",") -> bytes:
    """Two markers; a row is six cells."""
    lines = [
        ["Trajectories"],
        ["100"],
        ["", "", "C7", "", "", "LSHO", "", ""],
        ["Frame", "Sub Frame", *"XYZXYZ"],
        ["", "", *["mm"] * 6],
        *([frame, 0, *row] for frame, row in enumerate(rows, 1)),
    ]
    return "".join(f"{sep.join(map(str, line))}\n" for line in lines).encode()


@pytest.mark.parametrize("shown", ["1.450", "1.383"])
def test_points_that_may_separate_thousands_are_refused(shown):
    rows = [[-40, 0, shown, 80, 7, 950], [-28, 1, shown, 92, 7, 951]]
    with pytest.raises(FormatError, match=f"'{shown}', and every point might separate thousands"):
        parse_nexus(_nexus(rows), "a.csv")


@pytest.mark.parametrize(
    "rows",
    [
        [["1.450", "0.5", "2", "3", "4", "5"]] * 2,
        [["1.450", "2.125", "3.250", "0", "0", "0"]] * 2,
        [["1.450", "2.125", "1500", "1", "2", "3"]] * 2,
    ],
)
def test_points_that_separate_decimals_are_read(rows):
    positions = parse_nexus(_nexus(rows), "a.csv").recording.positions
    assert positions[0, 0, 0] == 1.45


@pytest.mark.parametrize(
    "cell", ["1\u00a0450.5", "1\u202f450,5", "1\u2019450.500"], ids=["nbsp", "nnbsp", "apostrophe"]
)
def test_thousands_separators_beyond_ascii_are_shown_as_written(cell):
    with pytest.raises(FormatError) as error:
        parse_nexus(_nexus([[cell, 1.5, 2.5, 3.5, 4.5, 5.5]] * 2, ";"), "a.csv")
    assert f"is {cell!r}, with a thousands separator" in str(error.value)


@pytest.mark.parametrize("cut", [1, 2, 3, 4, 5])
def test_file_that_ends_within_its_last_number_is_refused(cut):
    rows = [[f"{value + frame:.3f}" for value in (1, 2, 3, 4, 5, 126)] for frame in range(4)]
    data = _nexus(rows).rstrip()
    assert len(parse_nexus(data, "a.csv").recording.positions) == 4
    with pytest.raises(FormatError, match=r"line 9 is cut short within its last number"):
        parse_nexus(data[:-cut], "a.csv")


def test_last_number_with_fewer_decimals_is_read_where_decimals_vary():
    rows = [
        ["1.25", "2", "3", "4", "5", "6.5"],
        ["1", "2", "3", "4", "5", "7.25"],
        [1, 2, 3, 4, 5, 8],
    ]
    assert len(parse_nexus(_nexus(rows).rstrip(), "a.csv").recording.positions) == 3


@pytest.mark.parametrize("rate", ["1,000", "1_000", "\uff12\uff10\uff10"])
def test_rate_with_a_thousands_separator_is_unknown(rate):
    data = _nexus([[1.5, 2.5, 3.5, 4.5, 5.5, 6.5]] * 2, ";").replace(b"100", rate.encode(), 1)
    assert parse_nexus(data, "a.csv").recording.rate is None


def test_frame_number_that_other_formats_cannot_hold_is_refused():
    data = _nexus([[1.5, 2.5, 3.5, 4.5, 5.5, 6.5]]).replace(b"\n1,0,", b"\n1000000000000,0,")
    with pytest.raises(
        FormatError, match="line 6 has the frame number 1000000000000, which is too"
    ):
        parse_nexus(data, "a.csv")


@pytest.mark.parametrize("step", [10, 10_000])
def test_times_in_milliseconds_and_microseconds_leave_the_rate(step):
    assert find_rate(100.0, [b"%d" % (k * step) for k in range(40)]) == (100.0, [])


def test_times_too_far_apart_for_a_rate_leave_that_of_the_header():
    rate, notes = find_rate(100.0, [b"%d" % (k * 7000) for k in range(40)])
    assert rate == 100.0
    assert "7000 s apart" in notes[0]


@pytest.mark.parametrize(
    ("frame", "time", "titles", "tab"), list(itertools.product([True, False], repeat=4))
)
def test_qualisys_columns_where_a_coordinate_rises_evenly(frame, time, titles, tab):
    """The first X, 12 mm a frame, is no time column, nor is a tab at the end a marker's."""
    positions = text_files.standing(12)
    positions[:, 0, 0] = -40.0 + 12.0 * np.arange(12)
    lines = text_files.qualisys(positions, titles=titles, trailing_tab=tab).split(b"\r\n")
    begin = 13 if titles else 12
    kept = [keep for keep, asked in ((0, frame), (1, time)) if asked]
    for row in range(begin - titles, len(lines) - 1):
        cells = lines[row].split(b"\t")
        lines[row] = b"\t".join([cells[k] for k in kept] + cells[2:])
    recording = parse_qualisys(b"\r\n".join(lines), "a.tsv").recording
    np.testing.assert_allclose(recording.positions, positions, atol=0.0006)
    assert recording.rate == 100.0


def test_motive_names_shifted_by_a_marker_are_refused():
    data = text_files.motive(text_files.standing(12, 1)).replace(b",Name,", b",Name,,,,", 1)
    with pytest.raises(FormatError, match="correct the shifted row of the header"):
        parse_motive(data, "a.csv")


@pytest.mark.parametrize("mark", ["-9999", "9999999"])
def test_marks_of_missing_samples_that_are_numbers_are_noted(tmp_path, mark):
    path = tmp_path / "a.csv"
    rows = [[1.5, 2.5, 3.5, 400.5, 5.5, 6.5], [1.5, 2.5, 3.5, *[mark] * 3]]
    path.write_bytes(_nexus(rows * 3))
    notes = formats.read(path).source.notes
    assert [note for note in notes if note.startswith(f"3 samples are at ({float(mark):g}")]


def test_unit_in_which_a_body_is_too_large_is_noted():
    body = np.array([[[0.0, 0, 0], [0, 0, 1360.0]]])
    _, factor, notes = find_unit(body, "cm", None, "a")
    assert factor == 10.0
    assert notes == [
        "The markers spread over 13.6 m if the unit is cm, as the file states, and over 1.36 m "
        "if it is mm (see `unit`)."
    ]
    assert find_unit(body * 2, "mm", None, "a")[2] == []


def test_text_in_utf16_is_named(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(_nexus([[1.5, 2.5, 3.5, 4.5, 5.5, 6.5]]).decode(), encoding="utf-16")
    with pytest.raises(FormatError, match="is text in UTF-16; save it as UTF-8"):
        formats.read(path)
