"""TRC (track row column) files of OpenSim and Motion Analysis (EVaRT, Cortex).

::

    PathFileType  4  (X/Y/Z)  walk.trc
    DataRate  CameraRate  NumFrames  NumMarkers  Units  OrigDataRate  OrigDataStartFrame  ...
    120.00    120.00      900        41          mm     120.00        1                   ...
    Frame#  Time  LTOE            RTOE ...
                  X1   Y1   Z1    X2 ...
                                                            (blank line, optional)
    1       0.000 12.3 45.6 78.9  ...

Cells are separated by tabs; in some files by blanks, commas or semicolons. Names and header values
may be separated by blanks although the rows are not.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import ClipError, FormatError, OutputError, escaped
from priorfill.formats.recording import Recording
from priorfill.formats.tables.cells import (
    BLANKS,
    cells_of,
    delimiter_after,
    is_blank,
    join_quoted,
    line_number,
    split_lines,
    texts_of,
    trimmed,
)
from priorfill.formats.tables.columns import axis_columns, names_of_columns
from priorfill.formats.tables.frames import count_notes, find_rate, frame_numbers
from priorfill.formats.tables.new_table import DECIMALS, position_rows, report_of_new_table
from priorfill.formats.tables.numbers import cell_number, header_number, plain_number, shown
from priorfill.formats.tables.text_table import TableRecording, read_table
from priorfill.formats.write_report import WriteReport, check_filled
from priorfill.runtime.atomic_file import replace_file

__all__ = ["create_trc", "parse_trc", "recognise_trc", "write_new_trc"]

_MAX_HEADER_LINES = 30
"""Lines in which the header is searched."""

_FIRST_COORDINATE = 2
"""Cell of the first coordinate, after frame and time."""

_FRAME = "Frame#?"
"""First title of the row with the markers' names; a regular expression."""

_UNSEPARATED = re.compile(rb"[^\s,;] +[^\s,;]")
"""Two numbers with nothing but blanks between them."""


def recognise_trc(head: bytes) -> bool:
    """Check whether a file is TRC by its first bytes."""
    return re.search(rb"^\"?(PathFileType|DataRate)\"?[ \t,;]", head, re.MULTILINE) is not None


def parse_trc(data: bytes, name: str) -> TableRecording:
    """Parse the contents of a TRC file.

    Raises
    ------
    FormatError
        If it is not TRC, or damaged.
    ClipError
        If it has no frames.
    """
    lines = split_lines(data, name)
    delimiter = _row_delimiter(lines, _names_row(lines, name))
    lines = join_quoted(lines, delimiter, name)
    names_row = _names_row(lines, name)
    axes_row, rows = _rows(lines, names_row)
    if not rows:
        line = line_number(lines, names_row)
        raise ClipError(f"{name}: has no frames after line {line}; export it again")
    leads = [cells_of(lines[row], delimiter)[:_FIRST_COORDINATE] for row in rows]
    titles = (names_row, axes_row)
    labels, columns, label_notes = _markers(lines, titles, rows, delimiter, name)
    positions, table = read_table(lines, rows, columns, labels, delimiter, name)
    header = _header(lines, names_row)
    first = frame_numbers([cells[0] for cells in leads], rows, lines, name)
    times = [cells[1] for cells in leads if len(cells) > 1]
    _check_times(times, rows, lines, name)
    notes = count_notes(
        (header.get("numframes"), len(rows)), (header.get("nummarkers"), len(labels))
    )
    rate, rate_notes = find_rate(header_number(header.get("datarate")), times)
    return TableRecording(
        Recording(
            positions,
            tuple(labels),
            rate,
            header.get("units", ""),
            first_frame=first,
            default_up="+Y",
            notes=(*label_notes, *notes, *rate_notes),
        ),
        table,
    )


def create_trc(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip as a new TRC file in mm and in the clip's axes; missing cells are blank.

    Parameters
    ----------
    path : Path or str
        The file to write.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; the file does not mark them.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    WriteReport
        The number of filled samples, and the rounding error.

    Raises
    ------
    OutputError
        If the file exists already or cannot be written, or a filled sample has no position.
    """
    return write_new_trc(path, clip, filled, overwrite=overwrite)


def write_new_trc(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None,
    *,
    missing: str = "",
    overwrite: bool,
) -> WriteReport:
    """Write a clip as a new TRC file, with a given mark of missing samples.

    Parameters
    ----------
    path, clip, filled, overwrite
        As for `create_trc`.
    missing : str
        Contents of the cells of missing samples.

    Raises
    ------
    OutputError
        As in `create_trc`.
    """
    written = check_filled(clip, filled)
    for label in clip.labels:
        if not label or label[0] == '"' or set(label) & set("\t\r\n\0"):
            raise OutputError(
                f"{clip.name}: a TRC file cannot hold the label {label!r}; rename the marker"
            )
    rate = f"{clip.rate:.12g}"
    count, frames = len(clip.labels), clip.frames
    head = [
        f"PathFileType\t4\t(X/Y/Z)\t{escaped(Path(path).name)}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits"
        "\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{frames}\t{count}\tmm\t{rate}\t{clip.first_frame}\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(clip.labels) + "\t\t",
        "\t\t" + "\t".join(f"X{n}\tY{n}\tZ{n}" for n in range(1, count + 1)),
        "",
    ]
    body = [
        # the last tab: OpenSim takes no row that ends with a blank cell
        f"{clip.first_frame + frame}\t{frame / clip.rate:.{DECIMALS}f}\t{row}\t"
        for frame, row in enumerate(position_rows(clip, written, missing))
    ]
    with replace_file(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(
            "".join(f"{line}\r\n" for line in head + body).encode("utf-8", "replace")
        )
        again = parse_trc(temporary.read_bytes(), temporary.name).recording
        return report_of_new_table(path, again, clip, written)


def _names_row(lines: list[bytes], name: str) -> int:
    """Return the line with the markers' names."""
    for row, line in enumerate(lines[:_MAX_HEADER_LINES]):
        if delimiter_after(line, _FRAME) is not None:
            return row
    raise FormatError(
        f"{name}: is not a TRC file (no line 'Frame# Time ...' among its first "
        f"{_MAX_HEADER_LINES}); check the file"
    )


def _rows(lines: list[bytes], names_row: int) -> tuple[int | None, list[int]]:
    """Return the line with the axes (X1 Y1 Z1 ...), None if absent, and those of the frames."""
    axes_row: int | None = None
    rows: list[int] = []
    for row in range(names_row + 1, len(lines)):
        text = lines[row].strip(b' \t,;\r\n"')
        if not text:
            continue
        if not rows and axes_row is None and text[:1] in b"XxYyZz":
            axes_row = row
        else:
            rows.append(row)
    return axes_row, rows


def _row_delimiter(lines: list[bytes], names_row: int) -> bytes:
    """Return the separator of the cells in the rows of frames."""
    _, rows = _rows(lines, names_row)
    row = lines[rows[0]] if rows else b""
    if _UNSEPARATED.search(row.replace(b'"', b"")):
        return BLANKS
    if b"\t" in row:
        return b"\t"
    stated = delimiter_after(lines[names_row], _FRAME)
    if b";" in row:
        return b";"
    return b"," if stated == b"," and b"," in row else BLANKS


def _header(lines: list[bytes], names_row: int) -> dict[str, str]:
    """Return the header's values by name in lower case.

    As in OpenSim, cells without content count for nothing if the values have too many of them.
    """
    for row in range(names_row - 1):
        keys = [key.lower() for key in texts_of(lines[row], _line_delimiter(lines[row]))]
        keys = trimmed(keys)
        if "datarate" not in keys:
            continue
        values = trimmed(texts_of(lines[row + 1], _line_delimiter(lines[row + 1])))
        if len(values) == len(keys):
            return dict(zip(keys, values, strict=True))
        keys = [key for key in keys if key]
        given = [value for value in values if value]
        if len(given) != len(keys):  # some programs separate some of the values by blanks
            by_blanks = texts_of(lines[row + 1], BLANKS)
            given = by_blanks if len(by_blanks) == len(keys) else given
        return dict(zip(keys, given, strict=False))
    return {}


def _line_delimiter(line: bytes) -> bytes:
    """Return the separator of the cells of a line of the header."""
    for delimiter in (b"\t", b";", b","):
        if delimiter in line:
            return delimiter
    return BLANKS


def _check_times(times: list[bytes], rows: list[int], lines: list[bytes], name: str) -> None:
    """Raise FormatError if a time is not a number."""
    for time, row in zip(times, rows, strict=False):
        if cell_number(time) is None and plain_number(time) is None:
            raise FormatError(
                f"{name}: line {line_number(lines, row)}, cell 2 (time) is {shown(time)}, which is "
                "not a number; correct the cell"
            )


def _markers(
    lines: list[bytes],
    titles: tuple[int, int | None],
    rows: list[int],
    delimiter: bytes,
    name: str,
) -> tuple[list[str], list[list[int]], list[str]]:
    """Return labels, the cells of their coordinates, and notes.

    The row of the axes states the columns of the markers. Without it, the names are in order, three
    columns each.
    """
    names_row, axes_row = titles
    what = f"{name}: line {line_number(lines, names_row)}"
    count = 0
    columns: list[list[int]] = []
    if axes_row is not None:
        axes = texts_of(lines[axes_row], _line_delimiter(lines[axes_row]))
        columns = axis_columns(axes)
        count = len(columns)
        _check_axes(axes, count, f"{name}: line {line_number(lines, axes_row)}")
    names = _names(lines[names_row], delimiter)
    given = sum(bool(text) for text in names[_FIRST_COORDINATE:])
    if not given:
        raise FormatError(f"{what} names no markers; export it again")
    in_order = [_triple(_FIRST_COORDINATE + 3 * k) for k in range(count or given)]
    if not count:
        return _without_axes(names, in_order, _used_columns(lines, rows, delimiter), what)
    if columns != in_order:
        separated = delimiter != BLANKS and _line_delimiter(lines[axes_row or 0]) == delimiter
        used = _used_columns(lines, rows, delimiter)
        fits = [separated and _are_whole(columns, used), _are_whole(in_order, used)]
        if not any(fits) or all(fits):
            raise FormatError(
                f"{what} and the next one do not show where the columns of the markers begin; let "
                f"the first X stand in cell {_FIRST_COORDINATE + 1}, as its numbers do"
            )
        columns = columns if fits[0] else in_order  # else the row of the axes is shifted
    if given < count and len(names) <= columns[-1][-1]:
        line = line_number(lines, rows[0])
        raise FormatError(
            f"{name}: line {line} has {len(cells_of(lines[rows[0]], delimiter))} cells, but line "
            f"{line_number(lines, names_row)} names {given} markers, which take "
            f"{_FIRST_COORDINATE + 3 * given}; name all markers"
        )
    if given > count and any(names[columns[-1][-1] + 1 :]):
        raise FormatError(
            f"{what} names {given} markers, but the next line has X, Y, Z for {count}; "
            "correct one of them"
        )
    by_blanks = names == texts_of(lines[names_row], BLANKS)
    if by_blanks and all(names) and given == count:
        return names[_FIRST_COORDINATE:], columns, []
    labels, notes = names_of_columns(names, columns, _FIRST_COORDINATE, what)
    return labels, columns, notes


def _names(line: bytes, delimiter: bytes) -> list[str]:
    """Return the cells of the row of names.

    Some programs separate the names by blanks, and the rest of the table by tabs.
    """
    names = texts_of(line, _line_delimiter(line))
    while names and not names[0]:
        names.pop(0)  # the whole row is shifted
    if sum(bool(text) for text in names[_FIRST_COORDINATE:]) <= 1 and delimiter != BLANKS:
        by_blanks = texts_of(line, BLANKS)
        return by_blanks if len(by_blanks) > len(trimmed(names)) else names
    return names


def _without_axes(
    names: list[str], in_order: list[list[int]], used: set[int], what: str
) -> tuple[list[str], list[list[int]], list[str]]:
    """Return labels, columns and notes for a file without a row of axes."""
    places = [cell for cell in range(_FIRST_COORDINATE, len(names)) if names[cell]]
    last = max(used, default=0)
    labels = [names[place] for place in places]
    spread = len(places) > 1 and min(np.diff(places)) >= 3
    if spread and places[0] == _FIRST_COORDINATE and last <= places[-1] + 2:
        if all(place % 3 == _FIRST_COORDINATE for place in places):
            return labels, [_triple(place) for place in places], []
    elif last <= in_order[-1][-1]:
        return labels, in_order, []
    raise FormatError(
        f"{what} names {len(labels)} markers, which take {in_order[-1][-1] + 1} cells, but the "
        f"rows have {last + 1}; name all markers, each above its X"
    )


def _check_axes(axes: list[str], count: int, what: str) -> None:
    """Raise FormatError if the axes are not whole markers in order."""
    given = [title for title in axes if title]
    numbers = [int(title[1:]) for title in given if title[1:].isdigit() and title[0] in "Xx"]
    if len(given) != 3 * count or numbers != sorted(numbers):
        raise FormatError(f"{what} should have X1, Y1, Z1, X2, ... in order; correct the line")


def _triple(start: int) -> list[int]:
    """Return the cells of a marker."""
    return [start, start + 1, start + 2]


def _are_whole(columns: list[list[int]], used: set[int]) -> bool:
    """Check whether the cells in use are those of some markers, with all of their coordinates."""
    whole = [set(where) for where in columns if not used.isdisjoint(where)]
    return all(where <= used for where in whole) and used <= set().union(*whole)


def _used_columns(lines: list[bytes], rows: list[int], delimiter: bytes) -> set[int]:
    """Return the cells after the time that have content in some row."""
    used: set[int] = set()
    for row in rows:
        cells = cells_of(lines[row], delimiter)
        used.update(
            cell
            for cell in range(_FIRST_COORDINATE, len(cells))
            if cell not in used and not is_blank(cells[cell])
        )
    return used
