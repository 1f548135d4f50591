"""Tables of numbers in text files: read their cells, replace some, leave every other byte.

A table has a row for each frame and three columns for each marker. What stands above it, and
which columns are whose, is for the modules of the formats to find out.
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
    "Table",
    "TableRecording",
    "cells_of",
    "find_rate",
    "frame_numbers",
    "read_table",
    "split_lines",
    "texts_of",
    "write_table",
]

BLANKS = b""
"""Delimiter of lines whose cells are separated by any number of blanks or tabs."""

_MISSING = frozenset(
    b"|null|na|n/a|none|-|nan|-nan|+nan|nan(ind)|-nan(ind)|-1.#ind|1.#qnan|-1.#qnan".split(b"|")
)
"""What programs write where there is no number; the last five are those of Windows' C library."""

_NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")

_WHOLE = re.compile(rb"-?\d{1,15}(?:\.0*)?")
"""A frame's number; some programs write it as 1.0."""

_FIXED = re.compile(rb"[+-]?\d*[.,]?(\d*)")
"""A number without exponent; the group holds its decimals."""

_ROWS_LOOKED_AT = 500
"""Rows, spread over the table, whose cells say with how many decimals the file writes."""

_DECIMALS = {True: 3, False: 6}
"""Decimals in a table without a single number, by whether its unit is mm (or smaller than m)."""

_MOST_DECIMALS = 15
"""What a float64 can hold after the point."""

_RATE_DIFFERS = 0.01
"""Share by which the frame rate of a header and that of its time column differ if one of them is
wrong; times are rounded to milliseconds in many files."""


@dataclass(frozen=True)
class Table:
    """Where the numbers of a file are.

    Attributes
    ----------
    lines : list of bytes
        All lines with their ends.
    rows : ndarray of int [shape=(frames,)]
        The line of each frame, from 0.
    columns : ndarray of int [shape=(points, 3)]
        The cell of each coordinate, from 0.
    delimiter : bytes
        What is between cells, or `BLANKS`.
    comma : bool
        Whether the decimal sign is a comma.
    """

    lines: list[bytes]
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    delimiter: bytes
    comma: bool


@dataclass(frozen=True)
class TableRecording:
    """What a text file holds, and where."""

    recording: Recording
    table: Table


def split_lines(data: bytes, name: str) -> list[bytes]:
    """Return the lines of a text file with their ends, be these LF, CR LF or CR.

    Raises
    ------
    FormatError
        If it is no text of one byte a character, or empty.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise FormatError(f"{name}: is text in UTF-16; save it as UTF-8 or ASCII")
    zero = data.find(b"\0")
    if zero >= 0:
        line = data.count(b"\n", 0, zero) + 1
        raise FormatError(f"{name}: line {line} is no text; is the file of another format?")
    if not data.strip():
        raise FormatError(f"{name}: is empty; export it again")
    if b"\n" not in data:
        return re.findall(rb"[^\r]*\r|[^\r]+", data)
    return re.findall(rb"[^\n]*\n|[^\n]+", data)


def cells_of(line: bytes, delimiter: bytes) -> list[bytes]:
    """Return the cells of a line as they are, without the line's end."""
    if delimiter == BLANKS:
        return line.split()
    return line.rstrip(b"\r\n").split(delimiter)


def texts_of(line: bytes, delimiter: bytes) -> list[str]:
    """Return the cells of a line as text, without quotes and outer blanks."""
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = line.decode("latin-1")  # what programs on Windows wrote before
    text = text.rstrip("\r\n")
    if delimiter == BLANKS:
        return text.split()
    cells = text.split(delimiter.decode())
    if '"' in text:
        cells = _unquoted(cells, delimiter.decode())
    return [cell.strip() for cell in cells]


def _unquoted(cells: list[str], delimiter: str) -> list[str]:
    """Take off quotes, within which a delimiter is none; a quote that never ends is a letter."""
    ready: list[str] = []
    place = 0
    while place < len(cells):
        stop = place + 1
        if cells[place].count('"') % 2:
            ends = (k for k in range(place + 1, len(cells)) if cells[k].count('"') % 2)
            stop = next(ends, place) + 1
        cell = delimiter.join(cells[place:stop]).strip()
        quoted = len(cell) > 1 and cell[0] == cell[-1] == '"'
        ready.append(cell[1:-1].replace('""', '"') if quoted else cell)
        place = stop
    return ready


def read_table(
    lines: list[bytes],
    rows: Sequence[int],
    columns: Sequence[Sequence[int]],
    labels: Sequence[str],
    delimiter: bytes,
    name: str,
) -> tuple[NDArray[np.float64], Table]:
    """Read the numbers of a table.

    C3DParameters
    ----------
    lines : list of bytes
        All lines of the file.
    rows : sequence of int
        The lines of the frames, from 0.
    columns : sequence of sequence of int [shape=(points, 3)]
        The cells of each point's coordinates.
    labels : sequence of str
        The points' names, for messages.
    delimiter : bytes
        What is between cells, or `BLANKS`.
    name : str
        What to call the file in messages.

    Returns
    -------
    positions : ndarray [shape=(frames, points, 3), file units]
        NaN where a cell is blank, or says that it is missing, or the row has ended before.
    table : Table
        Where they are.

    Raises
    ------
    FormatError
        If a cell is neither a number nor known to mean "missing", or there are too many cells,
        or the last line is cut short.
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
                    f"{name}: line {row + 1} has {len(cells)} of {last + 1} cells; which are "
                    "missing cannot be told where blanks separate them: separate cells by tabs"
                )
            # several programs leave out what is missing at the end of a row
            cells += [b""] * (last + 1 - len(cells))
        try:
            if b"_" in line:  # float() takes 1_000 as a number
                raise ValueError
            values[frame] = [float(cells[cell]) for cell in flat]
        except ValueError:
            values[frame] = [
                _number(cells[cell], number, row, cell, labels, name)
                for number, cell in enumerate(flat)
            ]
    _check_end(lines, rows, last, delimiter, name)
    table = Table(lines, np.array(rows, dtype=np.intp), where, delimiter, comma)
    return values.reshape(len(rows), len(where), 3), table


def frame_numbers(
    first_cells: Sequence[bytes], rows: Sequence[int], name: str
) -> tuple[int, list[str]]:
    """Read the column of frame numbers.

    C3DParameters
    ----------
    first_cells : sequence of bytes
        The cells.
    rows : sequence of int
        Their lines, from 0.
    name : str
        What to call the file in messages.

    Returns
    -------
    first : int
        The first frame's number.
    notes : list of str
        What the user should know.

    Raises
    ------
    FormatError
        If a cell is no whole number.
    """
    numbers = []
    for cell, row in zip(first_cells, rows, strict=True):
        text = cell.strip().strip(b'"')
        if not _WHOLE.fullmatch(text):
            raise FormatError(
                f"{name}: line {row + 1} begins with {_shown(cell)} where a frame's number "
                "should be; delete or correct the line"
            )
        numbers.append(int(text.split(b".")[0]))
    jumps = np.flatnonzero(np.diff(numbers) != 1)
    if not jumps.size:
        return numbers[0], []
    jump = int(jumps[0])
    return numbers[0], [
        f"After frame {numbers[jump]} comes {numbers[jump + 1]} (line {rows[jump + 1] + 1}); "
        "the rows are taken as evenly spaced."
    ]


def find_rate(
    said: float | None, times: Sequence[bytes], name: str
) -> tuple[float | None, list[str]]:
    """Return the frame rate by a header and a time column.

    C3DParameters
    ----------
    said : float or None
        Of the header (Hz); None if it has none.
    times : sequence of bytes
        The cells of the time column (s); empty if there is none.
    name : str
        What to call the file in messages.

    Returns
    -------
    rate : float or None
        The header's, else that of the times (Hz); None if neither tells.
    notes : list of str
        What the user should know.
    """
    seconds = [_plain(cell.replace(b",", b".")) for cell in times]
    known = np.array([second for second in seconds if second is not None])
    by_time = None
    if len(known) > 1 and known[-1] > known[0]:
        by_time = (len(known) - 1) / float(known[-1] - known[0])
    if said is None or not (np.isfinite(said) and said > 0):
        if by_time is None:
            return None, []
        return by_time, [f"The frame rate is taken from the time column: {by_time:g} Hz."]
    if by_time is not None and abs(by_time / said - 1) > _RATE_DIFFERS:
        return said, [
            f"The header says {said:g} Hz, the time column {by_time:.4g} Hz; "
            "the header is believed (see --rate)."
        ]
    return said, []


def write_table(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_],
    parse: Callable[[bytes, str], TableRecording],
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a copy of the clip's source in which the cells of filled samples have numbers.

    Every other byte is as in the source. Numbers have as many decimals as the measured ones.
    The copy is read back and compared before it gets its name.

    C3DParameters
    ----------
    path : Path or str
        The file to write; never the source.
    clip : Clip
        The clip, read from a text file, with positions for the filled samples.
    filled : ndarray [shape=(frames, markers), bool]
        Which samples to write.
    parse : callable
        Reads such a file.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OutputError
        If `path` is the source, exists already, or its folder does not; the source has changed
        since it was read; or a filled sample has no position.
    FormatError
        If the source is gone.
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
    return WriteReport(samples=len(frames), worst_error_mm=worst * source.mm_per_unit)


def _number(
    cell: bytes, number: int, row: int, column: int, labels: Sequence[str], name: str
) -> float:
    """Return a cell's number, NaN if it is missing."""
    value = _plain(cell)
    if value is not None:
        return value
    text = cell.strip().strip(b'"').strip().lower()
    if text in _MISSING:
        return float("nan")
    raise FormatError(
        f"{_place(row, column, number, labels, name)} is {_shown(cell)}, which is no number; "
        "correct the cell, or leave it blank if the sample is missing"
    )


def _plain(cell: bytes) -> float | None:
    """Return the number that a cell holds; None if it holds none."""
    text = cell.strip().strip(b'"').strip()
    return float(text) if _NUMBER.fullmatch(text) else None


def _place(row: int, column: int, number: int, labels: Sequence[str], name: str) -> str:
    """Return words for a cell."""
    return f"{name}: line {row + 1}, cell {column + 1} ({labels[number // 3]} {'XYZ'[number % 3]})"


def _shown(cell: bytes) -> str:
    """Return a cell's beginning for a message."""
    return repr(cell[:20].decode("latin-1"))


def _has_commas(lines: list[bytes], rows: Sequence[int]) -> bool:
    """Tell if the decimal sign is a comma: some row has commas, and none has a point."""
    seen = False
    for row in rows:
        if b"." in lines[row]:
            return False
        seen = seen or b"," in lines[row]
    return seen


def _check_end(
    lines: list[bytes], rows: Sequence[int], last: int, delimiter: bytes, name: str
) -> None:
    """Raise FormatError if the last row lacks its end and cells that all others have."""
    if len(rows) < 2 or lines[rows[-1]].endswith((b"\n", b"\r")):
        return
    have = len(cells_of(lines[rows[-1]], delimiter))
    if have <= last and all(len(cells_of(lines[row], delimiter)) > last for row in rows[:-1]):
        raise FormatError(
            f"{name}: line {rows[-1] + 1} is cut short: {have} of {last + 1} cells; "
            "export or copy the file again"
        )


def _decimals(table: Table, mm_per_unit: float) -> int:
    """Return with how many decimals a table writes coordinates."""
    chosen = np.unique(np.linspace(0, len(table.rows) - 1, _ROWS_LOOKED_AT).astype(int))
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
        return _DECIMALS[mm_per_unit <= 1]
    return min(most, _MOST_DECIMALS)


def _as_texts(
    values: NDArray[np.float64], decimals: int, comma: bool
) -> tuple[list[list[bytes]], NDArray[np.float64]]:
    """Return positions as text, and what numbers the texts are [shape=(samples, 3)]."""
    texts = [[f"{value:.{decimals}f}" for value in position] for position in values.tolist()]
    rounded = np.array([[float(text) for text in position] for position in texts]).reshape(-1, 3)
    for sample in np.flatnonzero((rounded == 0).all(axis=1)):
        # at the very origin it would read as missing
        texts[sample] = [f"{0:.{decimals}f}"] * 2 + [f"{10.0**-decimals:.{decimals}f}"]
        rounded[sample] = [float(text) for text in texts[sample]]
    ready = [
        [text.lstrip("-") if float(text) == 0 else text for text in position] for position in texts
    ]
    sign = "," if comma else "."
    return [[text.replace(".", sign).encode() for text in position] for position in ready], rounded


def _by_row(
    table: Table, frames: NDArray[np.intp], points: NDArray[np.intp], texts: list[list[bytes]]
) -> dict[int, dict[int, bytes]]:
    """Return the new cells of each line that gets some, by column."""
    changed: dict[int, dict[int, bytes]] = {}
    for row, point, position in zip(table.rows[frames], points, texts, strict=True):
        cells = changed.setdefault(int(row), {})
        cells.update(zip(table.columns[point].tolist(), position, strict=True))
    return changed


def _with_cells(line: bytes, new: dict[int, bytes], delimiter: bytes) -> bytes:
    """Return a line with some cells replaced; blanks around their contents stay."""
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
        If something beside the filled cells has changed, or a filled sample is not as it should
        be. Neither has a cause that we know; a full disk and a faulty program have.
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
