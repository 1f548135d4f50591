"""Trajectories exported by Vicon Nexus as text (ASCII), separated by commas, tabs or semicolons.

::

    Trajectories
    100
    ,,Ann:LFHD,,,Ann:RFHD,,
    Frame,Sub Frame,X,Y,Z,X,Y,Z
    ,,mm,mm,mm,mm,mm,mm
    1,0,12.3,45.6,78.9,,,

A missing sample has blank cells. Other sections (Devices, Joints, Model Outputs) may precede and
follow; an empty line ends a section. Vicon Workstation, the predecessor, writes ``TRAJECTORIES``,
``100,Hz`` and ``Field #`` instead, without sub frames and units.
"""

from __future__ import annotations

import re

from priorfill.errors import ClipError, FormatError
from priorfill.formats.recording import Recording
from priorfill.formats.tables.cells import (
    cells_of,
    content_of,
    is_blank,
    join_quoted,
    line_number,
    split_lines,
    texts_of,
)
from priorfill.formats.tables.columns import axis_columns, names_of_columns
from priorfill.formats.tables.frames import frame_numbers
from priorfill.formats.tables.numbers import header_number
from priorfill.formats.tables.text_table import TableRecording, read_table

__all__ = ["parse_nexus", "recognise_nexus"]

_SECTION = "Trajectories"

_SECTIONS = rb"Trajectories|Devices|Joints|Model Outputs|Segments|Events|Trajectory Count"
"""First lines of the sections of a file."""

_OLD_SECTION = re.compile(rb'(?:\A|[\r\n])(?:\xef\xbb\xbf)?"?TRAJECTORIES"?[,;\t ]*[\r\n]')
"""The section in a file of Vicon Workstation, which begins with facts about the trial."""

_DELIMITERS = (b",", b"\t", b";")

_FRAME_TITLES = ("frame", "field #")

_AXES_LINE = 3
"""Line with Frame, Sub Frame, X, Y, Z after that of the section's name; 2 after it are the names in
a file of Nexus and the axes in one of Workstation."""

_MAX_BEFORE = 2
"""Cells before the first coordinate: frame and sub frame."""

_BLANK = b' ,;\t\r\n"'


def recognise_nexus(head: bytes) -> bool:
    """Check whether Nexus or Workstation exported a file by its first bytes."""
    pattern = rb"\A(\xef\xbb\xbf)?[\s,;]*\"?(" + _SECTIONS + rb")\"?[,;\t]*\s*[\r\n]"
    return re.match(pattern, head) is not None or _OLD_SECTION.search(head) is not None


def parse_nexus(data: bytes, name: str) -> TableRecording:
    """Parse the section of trajectories.

    Raises
    ------
    FormatError
        If there is none, or it is damaged.
    ClipError
        If it has no frames.
    """
    lines = split_lines(data, name)
    axes_row = _axes_row(lines, _section(lines, name), name)
    delimiter = max(_DELIMITERS, key=lines[axes_row].count)
    lines = join_quoted(lines, delimiter, name)
    start = _section(lines, name)
    axes_row = _axes_row(lines, start, name)
    axes = texts_of(lines[axes_row], delimiter)
    line = line_number(lines, axes_row)
    columns = axis_columns(axes, first=1)
    if not columns:
        raise FormatError(f"{name}: line {line} has no columns X, Y, Z; export trajectories")
    _check_axes(axes, columns, f"{name}: line {line}")
    names = texts_of(lines[axes_row - 1], delimiter)
    labels, notes = names_of_columns(names, columns, 0, f"{name}: line {line - 1}")
    units: list[str] = []
    if axes_row + 1 < len(lines) and is_blank(cells_of(lines[axes_row + 1], delimiter)[0]):
        units = texts_of(lines[axes_row + 1], delimiter)
    rows = _rows(lines, axes_row + 1 + bool(units), delimiter, name)
    if not rows:
        raise ClipError(f"{name}: has no frames after line {line + 1}; export it again")
    positions, table = read_table(lines, rows, columns, labels, delimiter, name, len(axes))
    first = frame_numbers([cells_of(lines[row], delimiter)[0] for row in rows], rows, lines, name)
    of_columns = [[*units, *[""] * len(axes)][cell] for where in columns for cell in where]
    if units and not all(of_columns) and any(of_columns):
        raise FormatError(
            f"{name}: line {line + 1} lacks units of some columns; correct the shifted line"
        )
    found_units = sorted(set(of_columns) - {""}) if units else []
    if len(found_units) > 1:
        raise FormatError(
            f"{name}: line {line + 1} has several units ({', '.join(found_units)}); "
            "export positions only"
        )
    return TableRecording(
        Recording(
            positions,
            tuple(labels),
            header_number(next(iter(texts_of(lines[start + 1], delimiter)), None)),
            found_units[0] if found_units else "",
            first_frame=first,
            notes=tuple(notes),
        ),
        table,
    )


def _section(lines: list[bytes], name: str) -> int:
    """Return the first line of the section of trajectories."""
    for row, line in enumerate(lines):
        if line.strip(b"\xef\xbb\xbf" + _BLANK).lower() == _SECTION.lower().encode():
            return row
    raise FormatError(
        f"{name}: has no section {_SECTION}; tick Trajectories when exporting from Nexus"
    )


def _axes_row(lines: list[bytes], start: int, name: str) -> int:
    """Return the line with the titles Frame, Sub Frame, X, Y, Z."""
    for row in range(start + 2, min(start + _AXES_LINE + 1, len(lines))):
        title = re.split(rb"[,;\t]", lines[row], maxsplit=1)[0]
        if content_of(title).lower().decode("latin-1") in _FRAME_TITLES:
            return row
    if start + _AXES_LINE + 1 >= len(lines):
        raise FormatError(
            f"{name}: the section {_SECTION} in line {line_number(lines, start)} is cut short; "
            "export it again"
        )
    raise FormatError(
        f"{name}: line {line_number(lines, start + _AXES_LINE)} should begin with Frame, Sub "
        "Frame, X, Y, Z, as Nexus exports it; export the trajectories as ASCII again"
    )


def _check_axes(axes: list[str], columns: list[list[int]], what: str) -> None:
    """Raise FormatError if titles of columns are absent."""
    before = columns[0][0]
    second = axes[1].lower()
    plain = second == "sub frame" if axes[0].lower() == _FRAME_TITLES[0] else second == "x"
    alone = sum(title.upper() in ("X", "Y", "Z") for title in axes) - 3 * len(columns)
    if not plain or before > _MAX_BEFORE or alone or not all(axes[: columns[-1][-1] + 1]):
        raise FormatError(
            f"{what} should have Frame, Sub Frame, and X, Y, Z for each marker; correct the line"
        )


def _rows(lines: list[bytes], begin: int, delimiter: bytes, name: str) -> list[int]:
    """Return the lines of the frames: those up to an empty one."""
    rows = []
    for row in range(begin, len(lines)):
        if not lines[row].strip(_BLANK):
            break
        rows.append(row)
    follows = begin + len(rows)
    while follows < len(lines) and not lines[follows].strip(_BLANK):
        follows += 1
    if rows and follows < len(lines):
        cells = cells_of(lines[follows], delimiter)
        if len(cells) > 1 and content_of(cells[0]).isdigit():
            raise FormatError(
                f"{name}: line {line_number(lines, follows)} continues the trajectories after an "
                "empty line; delete the empty line"
            )
    return rows
