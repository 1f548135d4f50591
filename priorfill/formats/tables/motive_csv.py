"""Marker positions in the CSV files that OptiTrack Motive exports.

::

    Format Version,1.23,Take Name,walk,...,Export Frame Rate,120.000000,...,Length Units,Meters,...

    ,,Type,Marker,Marker,Marker,...        (,Type,,Marker,... with a column of time codes)
    ,,Name,Ann:LTOE,Ann:LTOE,Ann:LTOE,...
    ,,ID,"5A...","5A...","5A...",...
    ,,,Position,Position,Position,...
    Frame,Time (Seconds),X,Y,Z,...
    0,0.000000,0.1,0.2,0.3,...

A missing sample has blank cells. Rigid bodies and bones are not markers. Markers solved from these
(types Rigid Body Marker and Bone Marker) are read only if the file has no measured ones.
"""

from __future__ import annotations

import re

from priorfill.errors import ClipError, FormatError
from priorfill.formats.recording import Recording
from priorfill.formats.tables.text_table import (
    TableRecording,
    cells_of,
    find_rate,
    frame_numbers,
    header_number,
    read_table,
    split_lines,
    texts_of,
)

__all__ = ["parse_motive", "recognise_motive"]

_DELIMITER = b","

_MAX_HEADER_LINES = 20
"""Lines in which the header is searched."""

_MARKER = "marker"
_SOLVED = ("rigid body marker", "bone marker")
"""Types of columns with a marker's position."""

_MAX_TITLE_CELL = 3
"""Cells of a header row in which its name is searched."""


def recognise_motive(head: bytes) -> bool:
    """Check whether Motive exported a file by its first bytes."""
    return re.match(rb"(\xef\xbb\xbf)?\"?Format Version\"?,", head) is not None


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
    pairs = texts_of(lines[0], _DELIMITER)
    header = dict(zip(pairs[0::2], pairs[1::2], strict=False))
    titles, frame_row = _titles(lines, name)
    axes = texts_of(lines[frame_row], _DELIMITER)
    measures = texts_of(lines[frame_row - 1], _DELIMITER)
    if header.get("Coordinate Space", "Global").lower() == "local":
        raise FormatError(f"{name}: has local coordinates; export in the global coordinate space")
    found: dict[str, list[tuple[str, list[int]]]] = {kind: [] for kind in (_MARKER, *_SOLVED)}
    for cell in range(2, len(axes) - 2):
        kind = _at(titles["type"], cell).lower()
        where = [cell, cell + 1, cell + 2]
        if (
            kind in found
            and [axes[k].upper() for k in where] == ["X", "Y", "Z"]
            and all(_at(measures, k).lower() == "position" for k in where)
        ):
            found[kind].append((_at(titles["name"], cell), where))
    chosen, notes = _choose(found)
    if not chosen:
        kinds = sorted({kind for kind in titles["type"][2:] if kind and kind != "Type"})
        raise FormatError(
            f"{name}: has no columns of markers, only {', '.join(kinds) or 'none'}; "
            "tick Markers when exporting from Motive"
        )
    labels = [label for label, _ in chosen]
    columns = [where for _, where in chosen]
    rows = [row for row in range(frame_row + 1, len(lines)) if lines[row].strip(b" ,\r\n")]
    if not rows:
        raise ClipError(f"{name}: has no frames after line {frame_row + 1}; export it again")
    positions, table = read_table(lines, rows, columns, labels, _DELIMITER, name)
    split = [cells_of(lines[row], _DELIMITER)[:2] for row in rows]
    first, frame_notes = frame_numbers([cells[0] for cells in split], rows, name)
    times = [cells[1] for cells in split if len(cells) > 1]
    stated = header.get("Export Frame Rate") or header.get("Capture Frame Rate") or ""
    rate, rate_notes = find_rate(header_number(stated), times, name)
    return TableRecording(
        Recording(
            positions,
            tuple(labels),
            rate,
            header.get("Length Units", ""),
            first_frame=first,
            default_up="+Y",
            notes=(*notes, *frame_notes, *rate_notes),
        ),
        table,
    )


def _titles(lines: list[bytes], name: str) -> tuple[dict[str, list[str]], int]:
    """Return the header rows by name, and the line with the axes of the columns."""
    titles: dict[str, list[str]] = {}
    for row, line in enumerate(lines[:_MAX_HEADER_LINES]):
        cells = texts_of(line, _DELIMITER)
        if row and cells and cells[0].lower() == "frame":
            if "type" in titles and "name" in titles:
                return titles, row
            break
        for cell in cells[:_MAX_TITLE_CELL]:
            if cell.lower() in ("type", "name"):
                titles.setdefault(cell.lower(), cells)
    raise FormatError(
        f"{name}: lacks the rows Type, Name and Frame of a Motive export; export with all headers"
    )


def _choose(
    found: dict[str, list[tuple[str, list[int]]]],
) -> tuple[list[tuple[str, list[int]]], list[str]]:
    """Return the columns to read: measured markers, or solved ones if there are none."""
    notes = []
    if found[_MARKER]:
        solved = sum(len(found[kind]) for kind in _SOLVED)
        if solved:
            notes.append(f"{solved} solved markers of rigid bodies and bones are left out.")
        return found[_MARKER], notes
    for kind in _SOLVED:
        if found[kind]:
            return found[kind], [
                f"The file has no measured markers; columns of type {kind} are read."
            ]
    return [], []


def _at(cells: list[str], cell: int) -> str:
    return cells[cell] if cell < len(cells) else ""
