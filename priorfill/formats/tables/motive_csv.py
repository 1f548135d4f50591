"""Marker positions in the CSV files that OptiTrack Motive exports.

::

    Format Version,1.23,Take Name,walk,...,Export Frame Rate,120.000000,...,Length Units,Meters,...

    ,Type,Marker,Marker,Marker,...        (,Type,,Marker,... with a column of time codes)
    ,Name,Ann:LTOE,Ann:LTOE,Ann:LTOE,...
    ,ID,"5A...","5A...","5A...",...
    ,Parent,,,,...                        (since Motive 3)
    ,,Position,Position,Position,...
    Frame,Time (Seconds),X,Y,Z,...
    0,0.000000,0.1,0.2,0.3,...

A missing sample has blank cells. Rigid bodies and bones are not markers. Markers solved from these
(types Rigid Body Marker and Bone Marker) are read only if the file has no measured ones.
Spreadsheet programs save such files with semicolons or tabs.
"""

from __future__ import annotations

import re

from priorfill.errors import ClipError, FormatError
from priorfill.formats.recording import Recording
from priorfill.formats.tables.cells import (
    cells_of,
    delimiter_after,
    join_quoted,
    line_number,
    split_lines,
    texts_of,
)
from priorfill.formats.tables.columns import axis_columns
from priorfill.formats.tables.frames import find_rate, frame_numbers
from priorfill.formats.tables.numbers import header_number
from priorfill.formats.tables.text_table import TableRecording, read_table

__all__ = ["parse_motive", "recognise_motive"]

_FIRST_TITLE = "Format Version"

_MAX_HEADER_LINES = 20
"""Lines in which the header is searched."""

_MARKER = "marker"
_SOLVED = re.compile(r".+ marker")
"""Types of columns with a measured and with a solved marker's position."""

_MAX_TITLE_CELL = 3
"""Cells of a header row in which its name is searched."""


def recognise_motive(head: bytes) -> bool:
    """Check whether Motive exported a file by its first bytes."""
    return bool(delimiter_after(head[: head.find(b"\n")], _FIRST_TITLE))


def parse_motive(data: bytes, name: str) -> TableRecording:
    """Parse a CSV file exported by Motive.

    Raises
    ------
    FormatError
        If it is not one, has no markers, or is damaged.
    ClipError
        If it has no frames.
    """
    lines = split_lines(data, name)
    delimiter = delimiter_after(lines[0], _FIRST_TITLE) or b","
    lines = join_quoted(lines, delimiter, name)
    facts = texts_of(lines[0], delimiter)
    titles, frame_row = _titles(lines, delimiter, name)
    line = line_number(lines, frame_row)
    if _fact(facts, "Coordinate Space").lower() == "local":
        raise FormatError(f"{name}: has local coordinates; export in the global coordinate space")
    found = _markers(titles, f"{name}: line {line}")
    chosen, notes = _choose(found)
    if not chosen:
        kinds = sorted({kind for kind in titles["type"][2:] if kind and kind != "Type"})
        held = f"only {', '.join(kinds)}" if kinds else "only frames and times"
        raise FormatError(
            f"{name}: has no columns of markers, {held}; tick Markers when exporting from Motive"
        )
    labels = [label for label, _ in chosen]
    columns = [where for _, where in chosen]
    rows = [row for row in range(frame_row + 1, len(lines)) if lines[row].strip(b' ,;\t\r\n"')]
    if not rows:
        raise ClipError(f"{name}: has no frames after line {line}; export it again")
    width = len(titles["axis"])
    positions, table = read_table(lines, rows, columns, labels, delimiter, name, width)
    split = [cells_of(lines[row], delimiter)[:2] for row in rows]
    first = frame_numbers([cells[0] for cells in split], rows, lines, name)
    times = [cells[1] for cells in split if len(cells) > 1]
    stated = _fact(facts, "Export Frame Rate") or _fact(facts, "Capture Frame Rate")
    rate, rate_notes = find_rate(header_number(stated), times)
    return TableRecording(
        Recording(
            positions,
            tuple(labels),
            rate,
            _fact(facts, "Length Units"),
            first_frame=first,
            default_up="+Y",
            notes=(*notes, *rate_notes),
        ),
        table,
    )


def _fact(facts: list[str], title: str) -> str:
    """Return the cell after a title in the first line; empty if absent.

    Notes of the take may contain separators, and any text, but come first.
    """
    places = [place for place, text in enumerate(facts[:-1]) if text == title]
    return facts[places[-1] + 1] if places else ""


def _titles(lines: list[bytes], delimiter: bytes, name: str) -> tuple[dict[str, list[str]], int]:
    """Return the header rows by name, those of measures and axes among them, and the last row."""
    titles: dict[str, list[str]] = {}
    for row, line in enumerate(lines[:_MAX_HEADER_LINES]):
        cells = texts_of(line, delimiter)
        if row and cells and cells[0].lower() == "frame":
            if "type" in titles and "name" in titles:
                measures = texts_of(lines[row - 1], delimiter)
                return titles | {"measure": measures, "axis": cells}, row
            break
        for cell in cells[:_MAX_TITLE_CELL]:
            if cell.lower() in ("type", "name"):
                titles.setdefault(cell.lower(), cells)
    raise FormatError(
        f"{name}: lacks the rows Type, Name and Frame of a Motive export; export with all headers"
    )


def _markers(titles: dict[str, list[str]], what: str) -> dict[str, list[tuple[str, list[int]]]]:
    """Return name and cells of the markers by the type of their columns, in lower case.

    Raises
    ------
    FormatError
        If the rows of the header are shifted against each other.
    """
    found: dict[str, list[tuple[str, list[int]]]] = {}
    for where in axis_columns(titles["axis"], first=2):
        kinds, names, measures = (
            [_at(titles[title], cell) for cell in where] for title in ("type", "name", "measure")
        )
        is_marker = [kind.lower() == _MARKER or _SOLVED.fullmatch(kind.lower()) for kind in kinds]
        is_position = [measure.lower() == "position" for measure in measures]
        if not any(is_marker) or not any(is_position):
            continue
        if len(set(kinds)) > 1 or not all(is_position) or len({n for n in names if n}) > 1:
            raise FormatError(
                f"{what} has X, Y, Z in cells {where[0] + 1}-{where[2] + 1}, but the rows above "
                "change within these cells; correct the shifted row of the header"
            )
        found.setdefault(kinds[0].lower(), []).append((names[0], where))
    _check_complete(titles, 3 * sum(map(len, found.values())), what)
    width = len(titles["axis"])
    if any(titles["name"][width:]) or any(titles["type"][width:]):
        raise FormatError(
            f"{what} ends before the rows of types and names do; correct the shifted row of the "
            "header"
        )
    return found


def _check_complete(titles: dict[str, list[str]], used: int, what: str) -> None:
    """Raise FormatError if there are positions of markers outside the columns X, Y, Z in use."""
    pairs = zip(titles["type"], titles["measure"], strict=False)
    stated = sum(
        (kind.lower() == _MARKER or _SOLVED.fullmatch(kind.lower()) is not None)
        and measure.lower() == "position"
        for kind, measure in pairs
    )
    if stated != used:
        raise FormatError(
            f"{what} does not have X, Y, Z for each marker of the rows above; correct the line"
        )


def _choose(
    found: dict[str, list[tuple[str, list[int]]]],
) -> tuple[list[tuple[str, list[int]]], list[str]]:
    """Return the columns to read: measured markers, or solved ones if there are none."""
    if _MARKER in found:
        solved = sum(len(columns) for kind, columns in found.items() if kind != _MARKER)
        left = f"{solved} solved markers of rigid bodies and bones are left out."
        return found[_MARKER], [left] if solved else []
    for kind in sorted(found, reverse=True):
        title = kind.title()
        return found[kind], [f"The file has no measured markers; columns of type {title} are read."]
    return [], []


def _at(cells: list[str], cell: int) -> str:
    return cells[cell] if cell < len(cells) else ""
