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
or ``null``. The unit is always mm. A trajectory without a name is unlabelled. Other programs write
this format with header lines that have no tab (``DESCRIPTION--``).
"""

from __future__ import annotations

import re

from priorfill.errors import ClipError, FormatError
from priorfill.formats.recording import Recording
from priorfill.formats.tables.cells import (
    cells_of,
    is_blank,
    join_quoted,
    line_number,
    split_lines,
    texts_of,
    trimmed,
)
from priorfill.formats.tables.frames import (
    are_times,
    count_frames,
    count_notes,
    find_rate,
    frame_numbers,
)
from priorfill.formats.tables.numbers import header_number
from priorfill.formats.tables.text_table import TableRecording, read_table

__all__ = ["parse_qualisys", "recognise_qualisys"]

_KEY = re.compile(
    rb"(?:\xef\xbb\xbf)?(?:NO_OF_|ANALOG_|FREQUENCY|DESCRIPTION|TIME_STAMP|DATA_INCLUDED|MARKER_NAMES|"
    rb"TRAJECTORY_TYPES|EVENT|FILE_VERSION|[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*[ \t]*(?:[\t\r\n]|\Z))"
)
"""The beginning of a header line: a known word, or any word in capitals before a tab."""

_WORD = re.compile(r"[A-Z0-9_]+")

_TITLES = re.compile(rb"\s*(?:Frame|Time)\b|[^\t]*[ _]X\t", re.IGNORECASE)

_MAX_HEADER_LINES = 10_000
"""Lines in which the header is searched; each event has one."""

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
    lines = join_quoted(split_lines(data, name), _DELIMITER, name)
    header, row = _header(lines)
    kind = next(iter(header.get("DATA_INCLUDED", [])), "3D")
    if kind.upper() != "3D":
        raise FormatError(f"{name}: holds {kind} data; export 3D data from QTM")
    if not any(header.get("MARKER_NAMES", [])):
        raise FormatError(
            f"{name}: its header has no MARKER_NAMES; export with the TSV header from QTM"
        )
    titles: list[str] = []
    if row < len(lines) and _TITLES.match(lines[row]):
        titles = texts_of(lines[row], _DELIMITER)
        row += 1
    rows = [k for k in range(row, len(lines)) if lines[k].strip(b" \r\n")]
    if not rows:
        line = line_number(lines, row) - 1
        raise ClipError(f"{name}: has no frames after line {line}; export it again")
    leads = [cells_of(lines[k], _DELIMITER)[:2] for k in rows]
    what = f"{name}: line {line_number(lines, rows[0])}"
    before, labels, notes = _layout(header, titles, leads, _width(lines, rows), what)
    columns = [[before + 3 * k, before + 3 * k + 1, before + 3 * k + 2] for k in range(len(labels))]
    positions, table = read_table(lines, rows, columns, labels, _DELIMITER, name)
    only = titles[:1] if titles else ["Time" if _begins_with_time(leads) else "Frame"]
    has_frames = before == 2 or (before == 1 and only != ["Time"])
    first = 1
    if has_frames:
        first = frame_numbers([cells[0] for cells in leads], rows, lines, name)
    elif rows[-1] - rows[0] >= len(rows):
        raise FormatError(
            f"{name}: has an empty line between frames without numbers; delete it, or fill it with "
            "blank cells"
        )
    times = [cells[before - 1] for cells in leads if before > has_frames and len(cells) >= before]
    rate, rate_notes = find_rate(header_number(_field(header, "FREQUENCY")), times)  # may be EXT
    counts = count_notes(
        (_field(header, "NO_OF_FRAMES"), len(rows)), (_field(header, "NO_OF_MARKERS"), len(labels))
    )
    computed, type_notes = _computed(header.get("TRAJECTORY_TYPES", []), len(labels))
    return TableRecording(
        Recording(
            positions,
            tuple(labels),
            rate,
            "mm",
            first_frame=first,
            not_markers=computed,
            notes=(*notes, *rate_notes, *counts, *type_notes),
        ),
        table,
    )


def _header(lines: list[bytes]) -> tuple[dict[str, list[str]], int]:
    """Return the values of the header lines by key, and the first line after them."""
    header: dict[str, list[str]] = {}
    row = 0
    last = min(len(lines), _MAX_HEADER_LINES)
    while row < last and (not lines[row].strip() or _KEY.match(lines[row])):
        if lines[row].strip() and _TITLES.match(lines[row]):
            break
        key, *values = texts_of(lines[row], _DELIMITER)
        word = _WORD.match(key)
        header.setdefault(word.group() if word else key, values)
        row += 1
    return header, row


def _layout(
    header: dict[str, list[str]],
    titles: list[str],
    leads: list[list[bytes]],
    widths: tuple[int, int],
    what: str,
) -> tuple[int, list[str], list[str]]:
    """Return the number of cells before the first coordinate, labels, and notes.

    Blanks among the names, or after them, are trajectories without a name, unless the line merely
    ends with tabs. The titles of the columns decide, else the width of the rows.
    """
    names = header["MARKER_NAMES"]
    named = trimmed(names)
    width, blank = widths
    if titles:
        titles = trimmed(titles)
        before = sum(title.lower() in ("frame", "time") for title in titles[:2])
        labels, notes = _titled(titles[before:], named, what)
        untitled = before < 2 and (
            count_frames([cells[0] for cells in leads])
            if before == 0
            else are_times([cells[1] for cells in leads if len(cells) > 1])
        )
        cells = before + 3 * len(labels)
        ends_with_tab = width == cells + 1 and 0 < blank < 3
        if width < cells or (width > cells and untitled and not ends_with_tab):
            raise _layout_error(len(labels), width, what)
        return before, labels, notes
    stated = int(header_number(_field(header, "NO_OF_MARKERS")) or 0)
    for points in dict.fromkeys((stated, len(named), len(names))):
        if len(named) <= points <= len(names):
            spare = _columns_before(leads, width - 3 * points, blank)
            if spare is not None:
                return spare, [*named, *[""] * (points - len(named))], []
    raise _layout_error(len(named), width, what)


def _width(lines: list[bytes], rows: list[int]) -> tuple[int, int]:
    """Return the cells of the widest rows, and how many at the end are blank in all of these."""
    width, blank = 0, 0
    for row in rows:
        cells = cells_of(lines[row], _DELIMITER)
        if len(cells) > width:
            width, blank = len(cells), len(cells)
        if len(cells) == width and blank:
            blank = next((k for k in range(blank) if not is_blank(cells[-1 - k])), blank)
    return width, blank


def _columns_before(leads: list[list[bytes]], spare: int, blank: int) -> int | None:
    """Return how many of the spare cells of a row come before the coordinates; None if unclear.

    These are the frame and the time. Another one is after the last coordinate if rows end with a
    tab; then `blank` is the number of cells at the end that are blank in all rows. A marker that is
    never seen leaves three of them.
    """
    if spare == 0 and len(leads) > 2 and count_frames([cells[0] for cells in leads]):
        return None  # no coordinate counts the frames
    if not blank:
        return spare if spare in (0, 1, 2) else None
    if spare in (1, 3):  # a tab at the end, or a frame before and the last marker is never seen
        return spare - (spare == 3 or blank < 3 or not count_frames([cells[0] for cells in leads]))
    if spare == 2 and (blank < 3 or not are_times([cells[1] for cells in leads if len(cells) > 1])):
        return 1
    return spare if spare in (0, 2) else None


def _titled(titles: list[str], named: list[str], what: str) -> tuple[list[str], list[str]]:
    """Return labels and notes according to the titles of the columns, three for each marker."""
    if len(titles) % 3:
        raise FormatError(
            f"{what} follows a row with the titles of {len(titles)} coordinates, and a marker has "
            "three; export it again"
        )
    labels = [re.sub(r"[ _]?X$", "", title, flags=re.IGNORECASE) for title in titles[::3]]
    known = [*named, *[""] * (len(labels) - len(named))]
    if len(known) == len(labels) and all(
        label == name or not (label and name) for label, name in zip(labels, known, strict=True)
    ):
        return [name or label for label, name in zip(labels, known, strict=True)], []
    if [label for label in labels if label] == [name for name in named if name]:
        return labels, ["MARKER_NAMES lacks trajectories without a name; the titles have them."]
    raise FormatError(
        f"{what} follows titles that do not name the markers of MARKER_NAMES; export it again"
    )


def _layout_error(markers: int, width: int, what: str) -> FormatError:
    """Return the error at rows that do not fit the number of markers."""
    return FormatError(
        f"{what} has {width} cells; {markers} markers take {3 * markers}, "
        "frame and time 2 more: export it again"
    )


def _computed(types: list[str], markers: int) -> tuple[dict[int, str], list[str]]:
    """Return the trajectories that are no markers, with the reason, and notes."""
    if types and markers not in (len(types), len(trimmed(types))):
        return {}, [
            f"TRAJECTORY_TYPES has {len(types)} types for {markers} markers; it is ignored."
        ]
    return {
        point: _COMPUTED_TYPES[kind.lower()]
        for point, kind in enumerate(types[:markers])
        if kind.lower() in _COMPUTED_TYPES
    }, []


def _begins_with_time(leads: list[list[bytes]]) -> bool:
    """Check whether the first column, which has no title, is the time."""
    first = [cells[0] for cells in leads]
    return not count_frames(first) and are_times(first)


def _field(header: dict[str, list[str]], key: str) -> str | None:
    """Return the first value of a header line; None if absent."""
    return next(iter(header.get(key, [])), None)
