"""3D motion data exported by Qualisys Track Manager (QTM) as TSV.

::

    NO_OF_FRAMES  500
    NO_OF_CAMERAS  8
    NO_OF_MARKERS  2
    FREQUENCY  100
    ...
    DATA_INCLUDED  3D
    MARKER_NAMES  LTOE  RTOE
    TRAJECTORY_TYPES  Measured  Mixed
    Frame  Time  LTOE X  LTOE Y  LTOE Z  RTOE X ...     (optional)
    1  0.00000  12.3  45.6  78.9  ...

Frame and time columns are export options, and so is the notation of a missing sample: 0.000, blank
or ``null``. The unit is always mm.
"""

from __future__ import annotations

import re

from priorfill.errors import ClipError, FormatError
from priorfill.formats.recording import Recording
from priorfill.formats.tables.text_table import (
    TableRecording,
    cells_of,
    count_notes,
    find_rate,
    frame_numbers,
    header_number,
    read_table,
    split_lines,
    texts_of,
)

__all__ = ["parse_qualisys", "recognise_qualisys"]

_KEY = re.compile(rb"(?:\xef\xbb\xbf)?[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*[ \t]*(?:[\t\r\n]|$)")
"""A header line: a word in capitals, then a tab."""

_DELIMITER = b"\t"

_COMPUTED_TYPES = {"virtual": "virtual trajectory"}
"""Types of computed trajectories, with the reason for leaving them out."""


def recognise_qualisys(head: bytes) -> bool:
    """Check whether QTM exported a file by its first bytes."""
    return (
        re.match(rb"(\xef\xbb\xbf)?(FILE_VERSION|NO_OF_FRAMES|NO_OF_CAMERAS)\t", head) is not None
    )


def parse_qualisys(data: bytes, name: str) -> TableRecording:
    """Parse a TSV file exported by QTM.

    Raises
    ------
    FormatError
        If it is not one, holds no 3D data, or is damaged.
    ClipError
        If it has no frames.
    """
    lines = split_lines(data, name)
    header: dict[str, list[str]] = {}
    row = 0
    while row < len(lines) and (_KEY.match(lines[row]) or not lines[row].strip()):
        key, *values = texts_of(lines[row], _DELIMITER)
        header.setdefault(key, values)
        row += 1
    kind = next(iter(header.get("DATA_INCLUDED", [])), "3D")
    if kind.upper() != "3D":
        raise FormatError(f"{name}: holds {kind} data; export 3D data from QTM")
    labels = [label for label in header.get("MARKER_NAMES", []) if label]
    if not labels:
        raise FormatError(
            f"{name}: its header has no MARKER_NAMES; export with the TSV header from QTM"
        )
    titles: list[str] = []
    if row < len(lines) and re.match(rb"\s*(Frame|Time)\b|[^\t]*[ _]X\t", lines[row]):
        titles = texts_of(lines[row], _DELIMITER)
        row += 1
    rows = [k for k in range(row, len(lines)) if lines[k].strip(b" \r\n")]
    if not rows:
        raise ClipError(f"{name}: has no frames after line {row}; export it again")
    split = [cells_of(lines[k], _DELIMITER) for k in rows]
    before = _columns_before(split, titles, len(labels), rows, name)
    columns = [[before + 3 * k, before + 3 * k + 1, before + 3 * k + 2] for k in range(len(labels))]
    positions, table = read_table(lines, rows, columns, labels, _DELIMITER, name)
    has_frames = before == 2 or (before == 1 and titles[:1] != ["Time"])
    first = 1
    notes: list[str] = []
    if has_frames:
        first, notes = frame_numbers([cells[0] for cells in split], rows, name)
    timed = before > has_frames
    times = [cells[before - 1] for cells in split if timed and len(cells) >= before]
    rate, rate_notes = find_rate(
        header_number(_field(header, "FREQUENCY")), times, name
    )  # may be EXT
    notes += rate_notes
    notes += count_notes(
        (_field(header, "NO_OF_FRAMES"), len(rows)), (_field(header, "NO_OF_MARKERS"), len(labels))
    )
    types = header.get("TRAJECTORY_TYPES", [])
    return TableRecording(
        Recording(
            positions,
            tuple(labels),
            rate,
            "mm",
            first_frame=first,
            not_markers={
                point: _COMPUTED_TYPES[kind.lower()]
                for point, kind in enumerate(types[: len(labels)])
                if kind.lower() in _COMPUTED_TYPES
            },
            notes=tuple(notes),
        ),
        table,
    )


def _columns_before(
    split: list[list[bytes]], titles: list[str], markers: int, rows: list[int], name: str
) -> int:
    """Return the number of columns before the first coordinate (frame and time)."""
    if titles:
        while titles and not titles[-1]:
            titles.pop()
        before = sum(title.lower() in ("frame", "time") for title in titles[:2])
        width = max(len(cells) for cells in split)
    else:
        width = max(len(cells) for cells in split)
        before = width - 3 * markers
        if before in (1, 3) and not any(
            cells[-1].strip() for cells in split if len(cells) == width
        ):
            before -= 1  # rows end with a tab
    if before not in (0, 1, 2) or width < before + 3 * markers:
        raise FormatError(
            f"{name}: line {rows[0] + 1} has {width} cells; {markers} markers take {3 * markers}, "
            "frame and time 2 more: export it again"
        )
    return before


def _field(header: dict[str, list[str]], key: str) -> str | None:
    """Return the first value of a header line; None if absent."""
    return next(iter(header.get(key, [])), None)
