"""Trajectories exported by Vicon Nexus as text (ASCII), separated by commas, tabs or semicolons.

::

    Trajectories
    100
    ,,Ann:LFHD,,,Ann:RFHD,,
    Frame,Sub Frame,X,Y,Z,X,Y,Z
    ,,mm,mm,mm,mm,mm,mm
    1,0,12.3,45.6,78.9,,,

A missing sample has blank cells. Other sections (Devices, Joints, Model Outputs) may precede and
follow; an empty line ends a section.
"""

from __future__ import annotations

import re

from priorfill.errors import ClipError, FormatError
from priorfill.formats.recording import Recording
from priorfill.formats.tables.text_table import (
    TableRecording,
    cells_of,
    frame_numbers,
    header_number,
    read_table,
    split_lines,
    texts_of,
)

__all__ = ["parse_nexus", "recognise_nexus"]

_SECTION = "Trajectories"

_SECTIONS = rb"Trajectories|Devices|Joints|Model Outputs|Segments|Events|Trajectory Count"
"""First lines of the sections of a file."""

_DELIMITERS = (b",", b"\t", b";")

_AXES = ("X", "Y", "Z")


def recognise_nexus(head: bytes) -> bool:
    """Check whether Nexus exported a file by its first bytes."""
    pattern = rb"\A(\xef\xbb\xbf)?\s*\"?(" + _SECTIONS + rb")\"?[,;\t]*\s*[\r\n]"
    return re.match(pattern, head) is not None


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
    start = _section(lines, name)
    if start + 4 >= len(lines):
        raise FormatError(
            f"{name}: the section {_SECTION} in line {start + 1} is cut short; export it again"
        )
    axes_line = lines[start + 3]
    delimiter = max(_DELIMITERS, key=axes_line.count)
    axes = texts_of(axes_line, delimiter)
    names = texts_of(lines[start + 2], delimiter)
    units = texts_of(lines[start + 4], delimiter)
    if not axes or axes[0].lower() != "frame":
        raise FormatError(
            f"{name}: line {start + 4} should begin with Frame, Sub Frame, X, Y, Z, as Nexus "
            "exports it; export the trajectories as ASCII again"
        )
    columns, labels = [], []
    for cell in range(2, len(axes) - 2):
        if tuple(text.upper() for text in axes[cell : cell + 3]) == _AXES:
            columns.append([cell, cell + 1, cell + 2])
            labels.append(names[cell] if cell < len(names) else "")
    if not columns:
        raise FormatError(f"{name}: line {start + 4} has no columns X, Y, Z; export trajectories")
    rows = []
    for row in range(start + 5, len(lines)):
        if not lines[row].strip(b" ,;\t\r\n"):
            break
        rows.append(row)
    if not rows:
        raise ClipError(f"{name}: has no frames after line {start + 5}; export it again")
    positions, table = read_table(lines, rows, columns, labels, delimiter, name)
    first, notes = frame_numbers([cells_of(lines[row], delimiter)[0] for row in rows], rows, name)
    found_units = sorted({units[c[0]] for c in columns if c[0] < len(units) and units[c[0]]})
    if len(found_units) > 1:
        raise FormatError(
            f"{name}: line {start + 5} has several units ({', '.join(found_units)}); "
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
        if line.strip(b'\xef\xbb\xbf ",;\t\r\n') == _SECTION.encode():
            return row
    raise FormatError(
        f"{name}: has no section {_SECTION}; tick Trajectories when exporting from Nexus"
    )
