"""Random text tables of every dialect: what was measured stays as it is, byte for byte."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from text_files import standing

from priorfill import formats
from priorfill.errors import FormatError
from priorfill.formats.tables import cells

QUIET = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))

MISSING = ("", "", "NaN", "null", "-1.#IND00", "1.#QNAN0", "-nan(ind)", "NULL", "N/A")

HOLE = rb'"?-?\d+(?:[.,]\d+)?"?'
"""What fills a blank cell."""


@dataclass
class Style:
    """How cells become text."""

    rng: np.random.Generator
    delimiter: str
    quotes: float  # share of cells in quotes
    padding: float  # share of cells with blanks around them
    newlines: tuple[str, ...]
    comma: bool

    def cell(self, text: str) -> str:
        """The text as a cell; quoted where it must be."""
        must = self.delimiter in text or "\n" in text or text.startswith('"')
        quoted = must or self.rng.random() < self.quotes
        raw = '"' + text.replace('"', '""') + '"' if quoted else text
        if text and self.rng.random() < self.padding:
            raw = " " * int(self.rng.integers(3)) + raw + " " * int(self.rng.integers(3))
        return raw

    def line(self, raw: list[str], trailing: int = 0) -> str:
        """A line of cells that are quoted already."""
        return self.delimiter.join(raw + [""] * trailing) + str(self.rng.choice(self.newlines))


def names_row(lead: list[str], labels: list[str], repeat: bool) -> list[str]:
    return lead + [
        text for label in labels for text in (label, *([label] * 2 if repeat else ["", ""]))
    ]


def header(dialect: str, labels: list[str], frames: int) -> tuple[list[list[str]], int]:
    """The rows above the table, and the number of cells before the first coordinate."""
    count = len(labels)
    axes = ["X", "Y", "Z"] * count
    if dialect == "trc":
        keys = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame"
        return [
            ["PathFileType", "4", "(X/Y/Z)", "a b.trc"],
            [*keys.split(), "OrigNumFrames"],
            ["100", "100", str(frames), str(count), "mm", "100", "1", str(frames)],
            names_row(["Frame#", "Time"], labels, False),
            ["", "", *[f"{a}{k // 3 + 1}" for k, a in enumerate(axes)]],
            [],
        ], 2
    if dialect == "nexus":
        return [
            ["Trajectories"], ["100"], names_row(["", ""], labels, False),
            ["Frame", "Sub Frame", *axes], ["", "", *["mm"] * (3 * count)],
        ], 2  # fmt: skip
    if dialect == "workstation":
        rows = [["TRAJECTORIES"], ["100", "Hz"], names_row([""], labels, False)]
        return [*rows, ["Field #", *axes]], 1
    if dialect == "qualisys":
        titles = [f"{label} {a}" for label in labels for a in "XYZ"]
        return [
            ["NO_OF_FRAMES", str(frames)], ["NO_OF_MARKERS", str(count)], ["FREQUENCY", "100"],
            ["MARKER_NAMES", *labels], ["Frame", "Time", *titles],
        ], 2  # fmt: skip
    return [
        ["Format Version", "1.23", "Take Notes", 'he said "no",\nthen went', "Length Units",
         "Millimeters", "Export Frame Rate", "100"],
        [],
        ["", "Type", *["Bone"] * 3, *["Marker"] * (3 * count)],
        names_row(["", "Name"], ["Hip, left", *labels], True),
        ["", "ID", *["a"] * (3 * count + 3)],
        ["", "", *["Position"] * (3 * count + 3)],
        ["Frame", "Time (Seconds)", "X", "Y", "Z", *axes],
    ], 5  # fmt: skip


def random_table(
    dialect: str, style: Style, partial: bool
) -> tuple[bytes, list[bytes], np.ndarray]:
    """A file, its bytes between the blank cells, and its positions [shape=(frames, 6, 3), mm]."""
    rng = style.rng
    decimals = int(rng.choice([1, 2, 4]))
    positions = np.round(standing(9) + rng.normal(0, 30, (9, 6, 3)), decimals)
    positions[rng.random((9, 6)) < 0.25] = np.nan
    if partial:
        positions[rng.random((9, 6, 3)) < 0.1] = np.nan
    labels = ["LTOE", "RTOE", "L" + style.delimiter.strip() + "K", 'C"7', "LFHD", "T 10"]
    if dialect == "qualisys":
        labels[2] = "LKNE"
    rows, before = header(dialect, labels, len(positions))
    text = "" if rng.random() < 0.7 else "\ufeff"
    for row in rows:
        plain = len(row) == 1 or dialect == "qualisys"  # a section's name, a key
        text += style.line([row[0] if plain else style.cell(row[0]), *map(style.cell, row[1:])]
                           if row else [])  # fmt: skip
    trailing = int(rng.integers(3)) if rng.random() < 0.5 else 0
    fixed: list[bytes] = []
    for frame, values in enumerate(positions.reshape(len(positions), -1)):
        lead = [str(frame + 1), f"{frame / 100:.2f}", "1.25", "2.5", "3.75"][:before]
        if dialect == "nexus":
            lead[1] = "0"
        raw = [style.cell(cell.replace(".", "," if style.comma else ".")) for cell in lead]
        for value in values:
            if np.isnan(value):
                cell = style.cell(str(rng.choice(MISSING)))
                raw.append(f"\0{cell}\0")
            else:
                number = f"{value:.{decimals}f}"
                raw.append(style.cell(number.replace(".", "," if style.comma else ".")))
        text += style.line(raw, trailing)
    fixed = [part.encode() for part in text.split("\0")]
    return text.replace("\0", "").encode(), fixed, positions


def delimiters(dialect: str) -> list[str]:
    return {"qualisys": ["\t"], "trc": ["\t", ",", ";"]}.get(dialect, [",", ";", "\t"])


@QUIET
@given(
    st.sampled_from(["trc", "nexus", "workstation", "qualisys", "motive"]),
    st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.3, 1.0]), st.sampled_from([0.0, 0.3]),
    st.sampled_from([("\n",), ("\r\n",), ("\r",), ("\n", "\r\n", "\r")]),
    st.booleans(), st.booleans(),
)  # fmt: skip
def test_only_blank_cells_change(
    tmp_path_factory, dialect, seed, quotes, padding, newlines, comma, partial
):
    rng = np.random.default_rng(seed)
    delimiter = str(rng.choice(delimiters(dialect)))
    style = Style(rng, delimiter, quotes, padding, newlines, comma)
    data, fixed, positions = random_table(dialect, style, partial)
    suffix = {"trc": ".trc", "qualisys": ".tsv"}.get(dialect, ".csv")
    source = tmp_path_factory.mktemp("table") / f"a{suffix}"
    source.write_bytes(data)
    clip = formats.read(source, unit="mm", up="+Z")
    missing = np.isnan(positions)
    assert np.array_equal(clip.missing, missing.any(axis=2))
    assert np.array_equal(clip.positions[~clip.missing], positions[~clip.missing])
    filled = clip.missing & (rng.random(clip.missing.shape) < 0.7)
    values = rng.normal(0, 900, positions.shape)
    out = source.with_name(f"b{suffix}")
    whole = np.where(filled[..., None], values, clip.positions)
    formats.write(out, clip.with_positions(whole), filled)
    pattern = re.escape(fixed[0])
    holes = filled[..., None].repeat(3, axis=2)[missing]
    for was, fill, after in zip(fixed[1::2], holes, fixed[2::2], strict=True):
        hole = rb" *" + HOLE + rb" *" if fill else re.escape(was)
        pattern += rb"(" + hole + rb")" + re.escape(after)
    written = out.read_bytes()
    found = re.fullmatch(pattern, written, re.DOTALL)
    assert found
    again = formats.read(out, unit="mm", up="+Z")
    assert np.array_equal(again.missing, clip.missing & ~filled)
    shown = np.where(missing, values, positions)[filled]
    assert again.positions[filled] == pytest.approx(shown, abs=0.0501)
    if dialect != "workstation":  # the csv module needs one delimiter for all rows, and knows no CR
        compare_with_csv(data, delimiter)
        compare_with_csv(written, delimiter)


def compare_with_csv(data: bytes, delimiter: str) -> None:
    """Compare the cells with those that Python's csv module finds."""
    text = data.decode("utf-8-sig")
    expected = [
        [cell.strip() for cell in row]
        for row in csv.reader(io.StringIO(text, newline=""), delimiter=delimiter,
                              skipinitialspace=True)
    ]  # fmt: skip
    lines = cells.join_quoted(cells.split_lines(data, "a"), delimiter.encode(), "a")
    found = [cells.texts_of(line, delimiter.encode()) for line in lines]
    # an empty line between CR and LF is none
    assert [row for row in found if row != [""]] == [row for row in expected if row]


@QUIET
@given(
    st.lists(st.lists(st.text('a1.,;" \n\r\t'), min_size=1, max_size=5), min_size=1, max_size=6),
    st.sampled_from([",", ";", "\t"]), st.sampled_from([csv.QUOTE_ALL, csv.QUOTE_MINIMAL]),
)  # fmt: skip
def test_cells_are_those_of_the_csv_module(rows, delimiter, quoting):
    text = io.StringIO(newline="")
    csv.writer(text, delimiter=delimiter, quoting=quoting).writerows(rows)
    data = text.getvalue().encode()
    if not data.strip() or data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return
    sep = delimiter.encode()
    lines = cells.join_quoted(cells.split_lines(data, "a"), sep, "a")
    assert b"".join(lines) == data
    expected = [row or [""] for row in csv.reader(io.StringIO(text.getvalue(), newline=""),
                                                  delimiter=delimiter)]  # fmt: skip
    found = [cells.texts_of(line, sep) for line in lines]
    assert found == [[cell.strip() for cell in row] for row in expected]


@QUIET
@given(
    st.lists(st.text('a1.,;" \n', max_size=6), min_size=1, max_size=6),
    st.dictionaries(st.integers(0, 8), st.integers(-99, 99)), st.sampled_from([",", ";", "\t"]),
)  # fmt: skip
def test_other_cells_of_a_line_stay(texts, new, delimiter):
    text = io.StringIO(newline="")
    csv.writer(text, delimiter=delimiter).writerow(texts)
    line, sep = text.getvalue().encode(), delimiter.encode()
    changed = cells.with_cells(line, {k: str(v).encode() for k, v in new.items()}, sep)
    was, now = cells.cells_of(line, sep), cells.cells_of(changed, sep)
    assert len(now) == max(len(was), max(new, default=0) + 1)
    for k, cell in enumerate(now):
        if k in new:
            assert cells.content_of(cell) == str(new[k]).encode()
        else:
            assert cell == (was[k] if k < len(was) else b"")


def test_a_quote_that_is_not_closed():
    with pytest.raises(FormatError, match="a quote that opens in line 2 is not closed"):
        cells.join_quoted(cells.split_lines(b'a,b\nc,"d\ne\n', "a"), b",", "a")
