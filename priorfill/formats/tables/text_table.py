"""Tables of numbers in text files: read cells, and replace some without changing any other byte.

A table has a row per frame and three columns per marker. The modules of the single formats parse
the header and determine the columns of each marker.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError, OutputError, PriorfillError
from priorfill.formats.file_bytes import read_source
from priorfill.formats.recording import Recording
from priorfill.formats.write_report import WriteReport, check_filled
from priorfill.runtime.atomic_file import check_target, replace_file

__all__ = [
    "BLANKS",
    "TableRecording",
    "TextTable",
    "cells_of",
    "count_notes",
    "find_rate",
    "frame_numbers",
    "header_number",
    "read_table",
    "split_lines",
    "texts_of",
    "write_table",
]

BLANKS = b""
"""Delimiter value for cells separated by any number of blanks or tabs."""

_MISSING = frozenset(
    b"|null|na|n/a|none|-|nan|-nan|+nan|nan(ind)|-nan(ind)|-1.#ind|1.#qnan|-1.#qnan".split(b"|")
)
"""Cells that programs write for a missing number; the last five are from Windows' C library."""

_NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")

_FRAME_NUMBER = re.compile(rb"-?\d{1,15}(?:\.0*)?")
"""A frame number; some programs write it as 1.0."""

_FIXED = re.compile(rb"[+-]?\d*[.,]?(\d*)")
"""A number without exponent; the group captures its decimals."""

_MAX_SAMPLED_ROWS = 500
"""Rows, spread over the table, that determine the number of decimals of the file."""

_DEFAULT_DECIMALS = {True: 3, False: 6}
"""Decimals for a table without a single number: in mm, and in larger units."""

_MAX_DECIMALS = 15
"""Decimals that a float64 can hold."""

_RATE_TOLERANCE = 0.01
"""Relative difference between the frame rates of header and time column above which one of them is
wrong. Times are rounded to milliseconds in many files."""


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
    """

    lines: list[bytes]
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    delimiter: bytes
    comma: bool


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


def split_lines(data: bytes, name: str) -> list[bytes]:
    """Return the lines of a text file, including line ends (LF, CR LF or CR).

    Raises
    ------
    FormatError
        If the file is not text in a single-byte or UTF-8 encoding, or is empty.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise FormatError(f"{name}: is text in UTF-16; save it as UTF-8 or ASCII")
    zero = data.find(b"\0")
    if zero >= 0:
        line = data.count(b"\n", 0, zero) + 1
        raise FormatError(f"{name}: line {line} is not text; check the format of the file")
    if not data.strip():
        raise FormatError(f"{name}: is empty; export it again")
    if b"\n" not in data:
        return re.findall(rb"[^\r]*\r|[^\r]+", data)
    return re.findall(rb"[^\n]*\n|[^\n]+", data)


def cells_of(line: bytes, delimiter: bytes) -> list[bytes]:
    """Return the cells of a line as stored, without the line end."""
    if delimiter == BLANKS:
        return line.split()
    return line.rstrip(b"\r\n").split(delimiter)


def texts_of(line: bytes, delimiter: bytes) -> list[str]:
    """Return the cells of a line as text, without quotes and surrounding blanks."""
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = line.decode("latin-1")  # common in older Windows programs
    text = text.rstrip("\r\n")
    if delimiter == BLANKS:
        return text.split()
    cells = text.split(delimiter.decode())
    if '"' in text:
        cells = _unquoted(cells, delimiter.decode())
    return [cell.strip() for cell in cells]


def _unquoted(cells: list[str], delimiter: str) -> list[str]:
    """Join cells that a quoted delimiter has split, and remove quotes. A single quote is kept."""
    unquoted: list[str] = []
    place = 0
    while place < len(cells):
        stop = place + 1
        if cells[place].count('"') % 2:
            ends = (k for k in range(place + 1, len(cells)) if cells[k].count('"') % 2)
            stop = next(ends, place) + 1
        cell = delimiter.join(cells[place:stop]).strip()
        quoted = len(cell) > 1 and cell[0] == cell[-1] == '"'
        unquoted.append(cell[1:-1].replace('""', '"') if quoted else cell)
        place = stop
    return unquoted


def read_table(
    lines: list[bytes],
    rows: Sequence[int],
    columns: Sequence[Sequence[int]],
    labels: Sequence[str],
    delimiter: bytes,
    name: str,
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

    Returns
    -------
    positions : ndarray [shape=(frames, points, 3), file units]
        NaN if a cell is blank, marked as missing, or beyond the end of its row.
    table : TextTable
        Location of the numbers.

    Raises
    ------
    FormatError
        If a cell is neither a number nor a known mark of a missing one, cells are missing from a
        row separated by blanks, or the last line is truncated.
    """
    where = np.array(columns, dtype=np.intp).reshape(-1, 3)
    flat = where.ravel().tolist()
    last = max(flat, default=0)
    comma = delimiter != b"," and _has_commas(lines, rows)
    values = np.full((len(rows), len(flat)), np.nan)
    for frame, row in enumerate(rows):
        line = lines[row].replace(b",", b".") if comma else lines[row]
        cells = cells_of(line, delimiter)
        if len(cells) <= last:
            if delimiter == BLANKS:
                raise FormatError(
                    f"{name}: line {row + 1} has {len(cells)} of {last + 1} cells, and blanks do "
                    "not show which are missing: separate cells by tabs"
                )
            # several programs omit missing cells at the end of a row
            cells += [b""] * (last + 1 - len(cells))
        try:
            if b"_" in line:  # float() accepts 1_000
                raise ValueError
            values[frame] = [float(cells[cell]) for cell in flat]
        except ValueError:
            values[frame] = [
                _number(cells[cell], number, row, cell, labels, name)
                for number, cell in enumerate(flat)
            ]
    _check_end(lines, rows, last, delimiter, name)
    table = TextTable(lines, np.array(rows, dtype=np.intp), where, delimiter, comma)
    return values.reshape(len(rows), len(where), 3), table


def frame_numbers(
    first_cells: Sequence[bytes], rows: Sequence[int], name: str
) -> tuple[int, list[str]]:
    """Parse the column of frame numbers.

    Parameters
    ----------
    first_cells : sequence of bytes
        The cells.
    rows : sequence of int
        Lines of the cells, counted from 0.
    name : str
        The file's name in messages.

    Returns
    -------
    first : int
        Number of the first frame.
    notes : list of str
        What the user should know.

    Raises
    ------
    FormatError
        If a cell is not an integer.
    """
    numbers = []
    for cell, row in zip(first_cells, rows, strict=True):
        text = cell.strip().strip(b'"')
        if not _FRAME_NUMBER.fullmatch(text):
            raise FormatError(
                f"{name}: line {row + 1} begins with {_shown(cell)} instead of a frame number; "
                "delete or correct the line"
            )
        numbers.append(int(text.split(b".")[0]))
    jumps = np.flatnonzero(np.diff(numbers) != 1)
    if not jumps.size:
        return numbers[0], []
    jump = int(jumps[0])
    return numbers[0], [
        f"After frame {numbers[jump]} comes {numbers[jump + 1]} (line {rows[jump + 1] + 1}); "
        "the rows are treated as evenly spaced."
    ]


def header_number(text: str | None) -> float | None:
    """Return the finite number in a header field; None if there is none."""
    try:
        value = float((text or "").replace(",", "."))
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def count_notes(frames: tuple[str | None, int], markers: tuple[str | None, int]) -> list[str]:
    """Return notes on counts in a header that differ from the table's.

    Parameters
    ----------
    frames, markers : (str or None, int)
        The header's field, and the number of frames or markers in the table.
    """
    notes = []
    for (text, actual), what in ((frames, "frames"), (markers, "markers")):
        stated = header_number(text)
        if stated is not None and stated != actual:
            notes.append(f"The header states {stated:g} {what}; there are {actual}.")
    return notes


def find_rate(
    stated: float | None, times: Sequence[bytes], name: str
) -> tuple[float | None, list[str]]:
    """Return the frame rate according to header and time column.

    Parameters
    ----------
    stated : float or None
        Rate in the header (Hz); None if absent.
    times : sequence of bytes
        Cells of the time column (s); empty if absent.
    name : str
        The file's name in messages.

    Returns
    -------
    rate : float or None
        The header's, else that of the times (Hz); None if neither states one.
    notes : list of str
        What the user should know.
    """
    seconds = [_plain(cell.replace(b",", b".")) for cell in times]
    known = np.array([second for second in seconds if second is not None])
    by_time = None
    if len(known) > 1 and known[-1] > known[0]:
        by_time = (len(known) - 1) / float(known[-1] - known[0])
    if stated is None or not (np.isfinite(stated) and stated > 0):
        if by_time is None:
            return None, []
        return by_time, [f"The frame rate is taken from the time column: {by_time:g} Hz."]
    if by_time is not None and abs(by_time / stated - 1) > _RATE_TOLERANCE:
        return stated, [
            f"The header states {stated:g} Hz, the time column {by_time:.4g} Hz; "
            "the header's rate is used (see `rate`)."
        ]
    return stated, []


def write_table(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_],
    parse: Callable[[bytes, str], TableRecording],
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a copy of the clip's source with the cells of the filled samples replaced.

    Every other byte equals the source's. Filled numbers have as many decimals as measured ones. The
    copy is written under a temporary name, read back, compared, and then renamed.

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
    parsed = parse(original, source.path.name)
    table = parsed.table
    frames, markers = np.nonzero(filled)
    points = np.asarray(source.points, dtype=np.intp)[markers]
    in_units = clip.positions[frames, markers] / source.mm_per_unit
    decimals = _decimals(table, source.mm_per_unit)
    texts, rounded = _as_texts(in_units, decimals, table.comma)
    lines = list(table.lines)
    for row, cells in _by_row(table, frames, points, texts).items():
        lines[row] = _with_cells(lines[row], cells, table.delimiter)
    with replace_file(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(b"".join(lines))
        _verify(temporary, parsed, parse, frames, points, rounded)
    worst = float(np.abs(rounded - in_units).max(initial=0.0))
    return WriteReport(samples=len(frames), rounding_mm=worst * source.mm_per_unit)


def _number(
    cell: bytes, number: int, row: int, column: int, labels: Sequence[str], name: str
) -> float:
    """Return a cell's number; NaN if it is missing."""
    value = _plain(cell)
    if value is not None:
        return value
    text = cell.strip().strip(b'"').strip().lower()
    if text in _MISSING:
        return float("nan")
    raise FormatError(
        f"{_place(row, column, number, labels, name)} is {_shown(cell)}, which is not a number; "
        "correct the cell, or leave it blank if the sample is missing"
    )


def _plain(cell: bytes) -> float | None:
    """Return the number in a cell; None if there is none."""
    text = cell.strip().strip(b'"').strip()
    return float(text) if _NUMBER.fullmatch(text) else None


def _place(row: int, column: int, number: int, labels: Sequence[str], name: str) -> str:
    """Return a cell's place for a message."""
    return f"{name}: line {row + 1}, cell {column + 1} ({labels[number // 3]} {'XYZ'[number % 3]})"


def _shown(cell: bytes) -> str:
    """Return the beginning of a cell for a message."""
    return repr(cell[:20].decode("latin-1"))


def _has_commas(lines: list[bytes], rows: Sequence[int]) -> bool:
    """Check whether the decimal separator is a comma: some row has commas, none has a point."""
    seen = False
    for row in rows:
        if b"." in lines[row]:
            return False
        seen = seen or b"," in lines[row]
    return seen


def _check_end(
    lines: list[bytes], rows: Sequence[int], last: int, delimiter: bytes, name: str
) -> None:
    """Raise FormatError if the last row has no line end and lacks cells that all others have."""
    if len(rows) < 2 or lines[rows[-1]].endswith((b"\n", b"\r")):
        return
    have = len(cells_of(lines[rows[-1]], delimiter))
    if have <= last and all(len(cells_of(lines[row], delimiter)) > last for row in rows[:-1]):
        raise FormatError(
            f"{name}: line {rows[-1] + 1} is cut short: {have} of {last + 1} cells; "
            "export or copy the file again"
        )


def _decimals(table: TextTable, mm_per_unit: float) -> int:
    """Return the number of decimals of a table's coordinates."""
    chosen = np.unique(np.linspace(0, len(table.rows) - 1, _MAX_SAMPLED_ROWS).astype(int))
    most = -1
    for row in table.rows[chosen]:
        cells = cells_of(table.lines[row], table.delimiter)
        for column in table.columns.ravel():
            found = (
                _FIXED.fullmatch(cells[column].strip().strip(b'"')) if column < len(cells) else None
            )
            if found and found.group(0):
                most = max(most, len(found.group(1)))
    if most < 0:
        return _DEFAULT_DECIMALS[mm_per_unit <= 1]
    return min(most, _MAX_DECIMALS)


def _as_texts(
    values: NDArray[np.float64], decimals: int, comma: bool
) -> tuple[list[list[bytes]], NDArray[np.float64]]:
    """Return positions as text, and the rounded numbers [shape=(samples, 3)]."""
    texts = [[f"{value:.{decimals}f}" for value in position] for position in values.tolist()]
    rounded = np.array([[float(text) for text in position] for position in texts]).reshape(-1, 3)
    for sample in np.flatnonzero((rounded == 0).all(axis=1)):
        # (0, 0, 0) would read as missing
        texts[sample] = [f"{0:.{decimals}f}"] * 2 + [f"{10.0**-decimals:.{decimals}f}"]
        rounded[sample] = [float(text) for text in texts[sample]]
    unsigned = [
        [text.lstrip("-") if float(text) == 0 else text for text in position] for position in texts
    ]
    sign = "," if comma else "."
    return [
        [text.replace(".", sign).encode() for text in position] for position in unsigned
    ], rounded


def _by_row(
    table: TextTable, frames: NDArray[np.intp], points: NDArray[np.intp], texts: list[list[bytes]]
) -> dict[int, dict[int, bytes]]:
    """Return the new cells by line and column."""
    changed: dict[int, dict[int, bytes]] = {}
    for row, point, position in zip(table.rows[frames], points, texts, strict=True):
        cells = changed.setdefault(int(row), {})
        cells.update(zip(table.columns[point].tolist(), position, strict=True))
    return changed


def _with_cells(line: bytes, new: dict[int, bytes], delimiter: bytes) -> bytes:
    """Return a line with some cells replaced; blanks and quotes around them are kept."""
    if delimiter == BLANKS:
        spans = [match.span() for match in re.finditer(rb"\S+", line)]
        for column in sorted(new, reverse=True):
            start, stop = spans[column]
            line = line[:start] + new[column] + line[stop:]
        return line
    body = line.rstrip(b"\r\n")
    cells = body.split(delimiter)
    cells += [b""] * (max(new) + 1 - len(cells))
    for column, text in new.items():
        inner = cells[column].strip()
        quoted = inner[:1] == b'"'
        content = b'"' + text + b'"' if quoted else text
        cells[column] = cells[column].replace(inner, content, 1) if inner else content
    return delimiter.join(cells) + line[len(body) :]


def _verify(
    temporary: Path,
    source: TableRecording,
    parse: Callable[[bytes, str], TableRecording],
    frames: NDArray[np.intp],
    points: NDArray[np.intp],
    rounded: NDArray[np.float64],
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
    expected = source.recording.positions.copy()
    expected[frames, points] = rounded
    if not np.array_equal(again.recording.positions, expected, equal_nan=True):
        raise failed
    if len(again.table.lines) != len(table.lines):
        raise failed
    touched: dict[int, set[int]] = {}
    for row, point in zip(table.rows[frames], points, strict=True):
        touched.setdefault(int(row), set()).update(table.columns[point].tolist())
    for row, (old, new) in enumerate(zip(table.lines, again.table.lines, strict=True)):
        if row not in touched:
            if old != new:
                raise failed
            continue
        was, has = cells_of(old, table.delimiter), cells_of(new, table.delimiter)
        was += [b""] * (len(has) - len(was))
        if len(was) != len(has) or any(
            a != b for column, (a, b) in enumerate(zip(was, has, strict=True))
            if column not in touched[row]
        ):  # fmt: skip
            raise failed
