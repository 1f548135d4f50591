"""Tables of numbers in text files: read cells, and replace some without changing any other byte.

A table has a row per frame and three columns per marker. The modules of the single formats parse
the header and determine the columns of each marker.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip, Source
from priorfill.errors import FormatError, OutputError, PriorfillError
from priorfill.formats.file_bytes import read_source
from priorfill.formats.recording import MAX_COORDINATE, Recording
from priorfill.formats.tables.cells import (
    BLANKS,
    cells_of,
    content_of,
    is_blank,
    line_number,
    texts_of,
    with_exchanged_cells,
)
from priorfill.formats.tables.cells import with_cells as _with_cells
from priorfill.formats.tables.columns import check_labels
from priorfill.formats.tables.numbers import (
    cell_number,
    check_points,
    has_decimal_comma,
    place_of,
    shown,
    why_no_number,
)
from priorfill.formats.write_report import WriteReport, check_filled
from priorfill.runtime.atomic_file import check_target, replace_file

__all__ = [
    "TableRecording",
    "TextTable",
    "read_table",
    "texts_of",
    "write_table",
]

_FIXED = re.compile(rb"[+-]?\d*[.,]?(\d*)")
"""A number without exponent; the group captures its decimals."""

_MAX_SAMPLED_ROWS = 500
"""Rows, spread over the table, that determine the number of decimals of the file."""

_DEFAULT_DECIMALS = {True: 3, False: 6}
"""Decimals for a table without a single number: in mm, and in larger units."""

_MAX_DECIMALS = 15
"""Decimals that a float64 can hold."""

_MAX_ABSENT = 10_000_000
"""Cells (80 MB) that a table may have beyond one for each byte of its rows. Only rows that end
early have more cells than bytes."""

_CLOSER = 3.0
"""How many times closer a marker is to the place of a later one, in a row next to its own, than to
its own place there, if its row lacks blank cells before it."""


@dataclass(frozen=True)
class TextTable:
    """Location of the numbers in a file.

    Attributes
    ----------
    lines : list of bytes
        All lines, including line ends.
    rows : ndarray of int [shape=(frames,)]
        Line of each frame, counted from 0.
    columns : ndarray of int [shape=(points, 3)]
        Cell of each coordinate, counted from 0.
    delimiter : bytes
        Separator of cells, or `BLANKS`.
    comma : bool
        Whether the decimal separator is a comma.
    scale : ndarray [shape=(points, 3)] or None
        What the numbers of each column are multiplied by, where columns have different units.
    """

    lines: list[bytes]
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    delimiter: bytes
    comma: bool
    scale: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class TableRecording:
    """Contents of a text file, and their location.

    Attributes
    ----------
    recording : Recording
        The contents.
    table : TextTable
        Location of the numbers.
    """

    recording: Recording
    table: TextTable


def read_table(
    lines: list[bytes],
    rows: Sequence[int],
    columns: Sequence[Sequence[int]],
    labels: Sequence[str],
    delimiter: bytes,
    name: str,
    width: int = 0,
    *,
    scale: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], TextTable]:
    """Parse the numbers of a table.

    Parameters
    ----------
    lines : list of bytes
        All lines of the file.
    rows : sequence of int
        Lines of the frames, counted from 0.
    columns : sequence of sequence of int [shape=(points, 3)]
        Cells of each point's coordinates, counted from 0.
    labels : sequence of str
        Labels of the points, for messages.
    delimiter : bytes
        Separator of cells, or `BLANKS`.
    name : str
        The file's name in messages.
    width : int
        Cells of the header, if it has some after the last coordinate.
    scale : ndarray [shape=(points, 3)] or None
        What the numbers of each column are multiplied by, where columns have different units.

    Returns
    -------
    positions : ndarray [shape=(frames, points, 3), file units]
        NaN if a cell is blank, marked as missing, or beyond the end of its row.
    table : TextTable
        Location of the numbers.

    Raises
    ------
    FormatError
        If a row is wider than the header or too narrow for its cells, a cell is neither a number
        nor a known mark of a missing one, or the decimal separator is ambiguous.
    """
    check_labels(labels, name)
    where = np.array(columns, dtype=np.intp).reshape(-1, 3)
    flat = where.ravel().tolist()
    needed = max(flat, default=0) + 1
    if len(rows) * len(flat) > _MAX_ABSENT + sum(len(lines[row]) for row in rows):
        raise FormatError(
            f"{name}: its {len(rows)} rows hold far less than the {len(labels)} markers of the "
            "header; check the header"
        )
    _check_widths(lines, rows, where, max(width, needed), delimiter, name)
    _check_last_number(lines, rows, delimiter, name)
    comma = has_decimal_comma(lines, rows, flat, labels, delimiter, name)
    if not comma:
        check_points(lines, rows, flat, labels, delimiter, name)
    values = np.full((len(rows), len(flat)), np.nan)
    short = []
    for frame, row in enumerate(rows):
        cells = _contents(lines[row], delimiter, comma)
        if len(cells) < needed:
            short.append(frame)
            cells += [b""] * (needed - len(cells))
        try:
            if b"_" in lines[row]:  # float() accepts 1_000
                raise ValueError
            values[frame] = [float(cells[cell] or b"nan") for cell in flat]
        except ValueError:
            values[frame] = [
                _number(lines, row, cells[cell], cell, number, labels, name)
                for number, cell in enumerate(flat)
            ]
    table = TextTable(lines, np.array(rows, dtype=np.intp), where, delimiter, comma, scale)
    positions = values.reshape(len(rows), len(where), 3)
    _check_partial(positions, table, labels, name)
    if scale is not None:
        positions *= scale
    for frame in _shifted_frames(positions, short):
        have = len(cells_of(lines[rows[frame]], delimiter))
        raise _short_error(lines, rows[frame], have, needed, name)
    return positions, table


def write_table(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_],
    parse: Callable[[bytes, str], TableRecording],
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a copy of the clip's source with the cells of the filled samples replaced.

    Every other byte equals the source's; where a user has exchanged markers, the cells of their
    samples are exchanged as they are. If some coordinates of a sample are given, only its blank
    cells are replaced. Filled numbers have as many decimals as measured ones. The copy is written
    under a temporary name, read back, compared, and then renamed.

    Parameters
    ----------
    path : Path or str
        The file to write; never the source.
    clip : Clip
        The clip, read from a text file, with positions for the filled samples.
    filled : ndarray [shape=(frames, markers), bool]
        Which samples to write.
    parse : callable
        Parses such a file.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    WriteReport
        The number of samples written, and the rounding error.

    Raises
    ------
    OutputError
        If `path` is the source or exists already; its folder does not exist; the source has changed
        since it was read; or a filled sample has no position.
    FormatError
        If the source no longer exists.
    """
    source = clip.source
    if source is None:
        raise OutputError(f"{clip.name}: comes from no file to copy; write it as a new file")
    filled = check_filled(clip, filled)
    check_target(path, overwrite=overwrite, source=source.path)
    original = read_source(source)
    parsed = _exchanged(parse(original, source.path.name), source)
    table = parsed.table
    frames, markers = np.nonzero(filled)
    points = np.asarray(source.points, dtype=np.intp)[markers]
    scale = np.ones((len(frames), 3)) if table.scale is None else table.scale[points]
    in_units = clip.positions[frames, markers] / source.mm_per_unit / scale
    present = parsed.recording.positions[frames, points]
    # all three are present in (0, 0, 0) and in samples that are rejected as artefacts
    written = np.isnan(present) | ~np.isnan(present).any(axis=1, keepdims=True)
    decimals = _decimals(table, source.mm_per_unit)
    texts, rounded = _as_texts(in_units, np.where(written, np.nan, present), decimals)
    lines = list(table.lines)
    changed = _by_row(table, frames, points, texts, written)
    for row, cells in changed.items():
        lines[row] = _with_cells(lines[row], cells, table.delimiter)
    with replace_file(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(b"".join(lines))
        expected = parsed.recording.positions.copy()
        expected[frames, points] = np.where(written, rounded * scale, present)
        _verify(temporary, parsed, parse, changed, expected)
    worst = float(np.abs((rounded - in_units) * scale)[written].max(initial=0.0))
    return WriteReport(samples=len(frames), rounding_mm=worst * source.mm_per_unit)


def _exchanged(parsed: TableRecording, source: Source) -> TableRecording:
    """Return a file in which the samples that are exchanged have their new places."""
    frames, points, taken_from = source.exchanged()
    if not len(frames):
        return parsed
    table = parsed.table
    needed = int(table.columns.max()) + 1
    ends_early = any(
        len(cells_of(table.lines[row], table.delimiter)) < needed for row in table.rows
    )
    moved: dict[int, dict[int, int]] = {}
    for row, point, other in zip(table.rows[frames], points, taken_from, strict=True):
        moved.setdefault(int(row), {}).update(
            zip(table.columns[point].tolist(), table.columns[other].tolist(), strict=True)
        )
    lines = list(table.lines)
    for row, cells in moved.items():
        lines[row] = with_exchanged_cells(lines[row], cells, table.delimiter, ends_early=ends_early)
    positions = parsed.recording.positions.copy()
    positions[frames, points] = parsed.recording.positions[frames, taken_from]
    return TableRecording(
        replace(parsed.recording, positions=positions), replace(table, lines=lines)
    )


def _contents(line: bytes, delimiter: bytes, comma: bool) -> list[bytes]:
    """Return the cells of a row without quotes, with decimal points."""
    cells = cells_of(line, delimiter)
    if b'"' in line:
        cells = [content_of(cell) for cell in cells]
    return [cell.replace(b",", b".") for cell in cells] if comma else cells


def _check_widths(
    lines: list[bytes],
    rows: Sequence[int],
    columns: NDArray[np.intp],
    width: int,
    delimiter: bytes,
    name: str,
) -> None:
    """Raise FormatError at a row from which a cell is missing, or which has one too many.

    Rows may all end with the same number of additional separators. Programs that omit blank cells
    at the end of a row omit them in all rows; so a row that ends early ends after a whole marker,
    and no row ends with a blank cell.
    """
    needed = int(columns.max()) + 1
    widths = np.empty(len(rows), dtype=np.intp)
    ends_blank = np.empty(len(rows), dtype=bool)
    for frame, row in enumerate(rows):
        cells = cells_of(lines[row], delimiter)
        widths[frame] = len(cells)
        ends_blank[frame] = is_blank(cells[-1]) if cells else True
        if len(cells) > width and not all(is_blank(cell) for cell in cells[width:]):
            raise _width_error(lines, row, len(cells), f"the header has {width}", name)
    short = widths < needed
    if short.any():
        _check_short(lines, rows, columns, widths, ends_blank, delimiter, name)
    usual = int(np.bincount(widths[~short]).argmax())
    if usual > width:  # rows end with separators; one without them lacks no cell
        kept = (widths == width) & ~ends_blank
    else:
        kept = np.full(len(rows), not ends_blank[widths == usual].any())
    odd = np.flatnonzero(~short & ((widths > usual) | ((widths < usual) & ~kept)))
    if odd.size:
        other = int(np.flatnonzero(widths == usual)[0])
        has = f"line {line_number(lines, rows[other])} has {usual}"
        raise _width_error(lines, rows[odd[0]], int(widths[odd[0]]), has, name)


def _check_short(
    lines: list[bytes],
    rows: Sequence[int],
    columns: NDArray[np.intp],
    widths: NDArray[np.intp],
    ends_blank: NDArray[np.bool_],
    delimiter: bytes,
    name: str,
) -> None:
    """Raise FormatError if rows that end early lack more than blank cells at their end."""
    needed = int(columns.max()) + 1
    short = np.flatnonzero(widths < needed)
    row, have = rows[short[0]], int(widths[short[0]])
    if delimiter == BLANKS:
        raise FormatError(
            f"{name}: line {line_number(lines, row)} has {have} of {needed} cells, and blanks do "
            "not show which are missing: separate cells by tabs"
        )
    if len(short) == len(rows):
        raise FormatError(
            f"{name}: line {line_number(lines, row)} has {have} of {needed} cells, and no other "
            f"row has {needed}; make the header name the markers of the table"
        )
    if len(rows) - 1 in short and not lines[rows[-1]].endswith((b"\n", b"\r")) and len(short) == 1:
        raise FormatError(
            f"{name}: line {line_number(lines, row)} is cut short: {have} of {needed} cells; "
            "export or copy the file again"
        )
    inside = np.isin(widths[short], columns[:, 1:])
    for bad in (
        inside | ends_blank[short],
        np.full(len(short), ends_blank[widths >= needed].any()),
    ):
        if bad.any():
            frame = short[np.flatnonzero(bad)[0]]
            raise _short_error(lines, rows[frame], int(widths[frame]), needed, name)


def _check_last_number(
    lines: list[bytes], rows: Sequence[int], delimiter: bytes, name: str
) -> None:
    """Raise FormatError if the file ends within the last number: with fewer decimals than above."""
    if len(rows) < 2 or lines[rows[-1]].endswith((b"\n", b"\r")):
        return
    ends = [cells_of(lines[row], delimiter)[-1:] for row in rows]
    decimals = [_decimals_of(content_of(end[0])) if end else -1 for end in ends]
    above = {count for count in decimals[:-1] if count >= 0}
    if len(above) == 1 and 0 <= decimals[-1] < min(above):
        raise FormatError(
            f"{name}: line {line_number(lines, rows[-1])} is cut short within its last number, "
            f"{shown(ends[-1][0])}; export or copy the file again"
        )


def _decimals_of(text: bytes) -> int:
    """Return the number of decimals of a number; -1 if it is none, or has an exponent."""
    found = _FIXED.fullmatch(text)
    return len(found.group(1)) if found and text.strip(b"+-.,") else -1


def _shifted_frames(positions: NDArray[np.float64], short: list[int]) -> list[int]:
    """Return the rows that end early because blank cells are absent before the last marker.

    That marker then is where a later one was in the row before, or will be in the next one.
    """
    absent = set(short)
    shifted = []
    for frame in short:
        present = np.flatnonzero(~np.isnan(positions[frame, :, 0]))
        for other in (frame - 1, frame + 1):
            if not present.size or other in absent or not 0 <= other < len(positions):
                continue
            last = int(present[-1])
            moved = np.linalg.norm(positions[other, last:] - positions[frame, last], axis=1)
            later = moved[1:][~np.isnan(moved[1:])]
            if later.size and later.min() * _CLOSER < moved[0]:
                shifted.append(frame)
    return shifted


def _short_error(lines: list[bytes], row: int, have: int, needed: int, name: str) -> FormatError:
    """Return the error at a row that may lack cells before its end."""
    return FormatError(
        f"{name}: line {line_number(lines, row)} has {have} of {needed} cells, and it is unclear "
        "which are absent; add the separators of blank cells"
    )


def _width_error(lines: list[bytes], row: int, have: int, other: str, name: str) -> FormatError:
    """Return the error at a row with too many or too few cells."""
    return FormatError(
        f"{name}: line {line_number(lines, row)} has {have} cells, but {other}; correct the line"
    )


def _number(
    lines: list[bytes],
    row: int,
    cell: bytes,
    column: int,
    number: int,
    labels: Sequence[str],
    name: str,
) -> float:
    """Return a cell's number; NaN if it is missing."""
    value = cell_number(cell)
    if value is None:
        place = place_of(lines, row, column, number, labels, name)
        raise FormatError(f"{place} is {shown(cell)}, {why_no_number(cell)}")
    return value


def _check_partial(
    positions: NDArray[np.float64], table: TextTable, labels: Sequence[str], name: str
) -> None:
    """Raise FormatError at a coordinate beyond `MAX_COORDINATE` next to a blank one.

    Its cell would stay in a copy whose blank cells are filled, which could not be read.
    """
    beyond = np.abs(positions) > MAX_COORDINATE  # False for NaN
    beyond &= np.isnan(positions).any(axis=2, keepdims=True)
    if beyond.any():
        frame, marker, axis = np.argwhere(beyond)[0]
        row, column = int(table.rows[frame]), int(table.columns[marker, axis])
        place = place_of(table.lines, row, column, 3 * int(marker) + int(axis), labels, name)
        raise FormatError(f"{place} is infinite or farther than any marker; leave the cell blank")


def _decimals(table: TextTable, mm_per_unit: float) -> int:
    """Return the number of decimals of a table's coordinates."""
    chosen = np.unique(np.linspace(0, len(table.rows) - 1, _MAX_SAMPLED_ROWS).astype(int))
    most = -1
    for row in table.rows[chosen]:
        cells = cells_of(table.lines[row], table.delimiter)
        for column in table.columns.ravel():
            found = _FIXED.fullmatch(content_of(cells[column])) if column < len(cells) else None
            if found and found.group(0):
                most = max(most, len(found.group(1)))
    if most < 0:
        return _DEFAULT_DECIMALS[mm_per_unit <= 1]
    return min(most, _MAX_DECIMALS)


def _as_texts(
    values: NDArray[np.float64], kept: NDArray[np.float64], decimals: int
) -> tuple[list[list[str]], NDArray[np.float64]]:
    """Return positions as text, and the numbers that will be read [shape=(samples, 3)].

    `kept` has the coordinates that stay in the file, else NaN.
    """
    texts = [[f"{value:.{decimals}f}" for value in position] for position in values.tolist()]
    rounded = np.array([[float(text) for text in position] for position in texts]).reshape(-1, 3)
    rounded = np.where(np.isnan(kept), rounded, kept)
    for sample in np.flatnonzero((rounded == 0).all(axis=1)):
        # (0, 0, 0) would read as missing
        axis = int(np.flatnonzero(np.isnan(kept[sample]))[-1])
        texts[sample][axis] = f"{10.0**-decimals:.{decimals}f}"
        rounded[sample, axis] = float(texts[sample][axis])
    unsigned = [
        [text.lstrip("-") if float(text) == 0 else text for text in position] for position in texts
    ]
    return unsigned, rounded


def _by_row(
    table: TextTable,
    frames: NDArray[np.intp],
    points: NDArray[np.intp],
    texts: list[list[str]],
    written: NDArray[np.bool_],
) -> dict[int, dict[int, bytes]]:
    """Return the new cells by line and column."""
    sign = "," if table.comma else "."
    changed: dict[int, dict[int, bytes]] = {}
    for sample, (row, point) in enumerate(zip(table.rows[frames], points, strict=True)):
        cells = changed.setdefault(int(row), {})
        for axis in np.flatnonzero(written[sample]):
            cell = int(table.columns[point, axis])
            cells[cell] = texts[sample][axis].replace(".", sign).encode()
    return changed


def _verify(
    temporary: Path,
    source: TableRecording,
    parse: Callable[[bytes, str], TableRecording],
    changed: dict[int, dict[int, bytes]],
    expected: NDArray[np.float64],
) -> None:
    """Read the written file back and compare it with the source.

    Raises
    ------
    OutputError
        If something other than the filled cells differs or a filled sample is wrong, for instance
        because the disk is full.
    """
    failed = OutputError(
        f"{temporary.parent}: the file written there does not read back as intended and was "
        "removed; check the disk and report this as a fault"
    )
    written = temporary.read_bytes()
    try:
        again = parse(written, temporary.name)
    except PriorfillError:
        raise failed from None
    table = source.table
    if not np.array_equal(again.recording.positions, expected, equal_nan=True):
        raise failed
    if len(again.table.lines) != len(table.lines):
        raise failed
    for row, (old, new) in enumerate(zip(table.lines, again.table.lines, strict=True)):
        if row not in changed:
            if old != new:
                raise failed
            continue
        was, has = cells_of(old, table.delimiter), cells_of(new, table.delimiter)
        was += [b""] * (len(has) - len(was))
        if len(was) != len(has) or any(
            a != b for column, (a, b) in enumerate(zip(was, has, strict=True))
            if column not in changed[row]
        ):  # fmt: skip
            raise failed
