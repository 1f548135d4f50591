"""Lines and cells of a text table, with the bytes that each of them occupies.

Reading and patching use the same rules, those of RFC 4180 and of Python's csv module: a cell that
begins with a quote ends with one; quotes inside it are doubled, and separators and line ends inside
it belong to it. Blanks around a quoted cell are allowed. A quote inside an unquoted cell is a
character like any other.
"""

from __future__ import annotations

import re
from functools import cache

from priorfill.errors import FormatError

__all__ = [
    "BLANKS",
    "cells_of",
    "content_of",
    "delimiter_after",
    "is_blank",
    "join_quoted",
    "line_number",
    "split_lines",
    "texts_of",
    "trimmed",
    "with_cells",
]

BLANKS = b""
"""Delimiter value for cells separated by any number of blanks or tabs."""

_MAX_LINES = 10_000_000
"""Eleven hours at 240 Hz; more lines take more memory than a recording is worth."""

_MAX_CELLS = 200_000
"""Cells of a line: the 65,535 points that a C3D file can hold, three coordinates each."""

_LINE = re.compile(rb"[^\r\n]*+(?:\r{0,2}\n|\r)|[^\r\n]++")
"""A line and its end: LF, CR LF or CR; CR CR LF comes from CR LF written in Windows' text mode."""

_INSIDE = rb'[^"]*+(?:""[^"]*+)*+'
"""The contents of a quoted cell."""

_REST = re.compile(_INSIDE)

_BLANK_CELL = re.compile(b'"' + _INSIDE + rb'"(?!\S)|\S++')
"""A cell of a line that is separated by blanks."""

_OPENING = re.compile(rb' *+"')


def split_lines(data: bytes, name: str) -> list[bytes]:
    """Return the lines of a text file, including line ends (LF, CR LF or CR).

    Raises
    ------
    FormatError
        If the file is not text in a single-byte or UTF-8 encoding, is empty, or has more lines, or
        more cells in a line, than a recording can have.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise FormatError(f"{name}: is text in UTF-16; save it as UTF-8 or ASCII")
    zero = data.find(b"\0")
    if zero >= 0:
        raise FormatError(
            f"{name}: line {_count_ends(data[:zero]) + 1} is not text; check the format of the file"
        )
    if not data or data.isspace():
        raise FormatError(f"{name}: is empty; export it again")
    if max(data.count(b"\n"), data.count(b"\r")) > _MAX_LINES:
        raise FormatError(
            f"{name}: has more than {_MAX_LINES:,} lines; cut the recording into parts"
        )
    lines = _LINE.findall(data)
    for row, line in enumerate(lines):
        if len(line) > _MAX_CELLS and _most_cells(line) > _MAX_CELLS:
            raise FormatError(
                f"{name}: line {row + 1} has more than {_MAX_CELLS:,} cells; "
                "check the format of the file"
            )
    return lines


def join_quoted(lines: list[bytes], delimiter: bytes, name: str) -> list[bytes]:
    """Join lines that a line end inside a quoted cell has split.

    Parameters
    ----------
    lines : list of bytes
        Lines as `split_lines` returns them.
    delimiter : bytes
        Separator of cells, or `BLANKS`.
    name : str
        The file's name in messages.

    Returns
    -------
    list of bytes
        The lines; together they are the same bytes.

    Raises
    ------
    FormatError
        If a quote is not closed.
    """
    if delimiter == BLANKS or not any(b'"' in line for line in lines):
        return lines
    joined: list[bytes] = []
    pending: list[bytes] = []
    for line in lines:
        still_open = _ends_open(line, delimiter, bool(pending)) if b'"' in line else bool(pending)
        pending.append(line)
        if not still_open:
            joined.append(b"".join(pending))
            pending = []
    if pending:
        row = line_number(joined, len(joined))
        raise FormatError(
            f"{name}: a quote that opens in line {row} is not closed; correct the line"
        )
    return joined


def line_number(lines: list[bytes], row: int) -> int:
    """Return the number in an editor, counted from 1, of the line with an index."""
    return 1 + sum(_count_ends(line) if b'"' in line else 1 for line in lines[:row])


def delimiter_after(line: bytes, title: str) -> bytes | None:
    """Return the separator (tab, comma, semicolon) that follows the first cell of a title row.

    Parameters
    ----------
    line : bytes
        A line.
    title : str
        What the first cell contains, in any case; a regular expression.

    Returns
    -------
    bytes or None
        The separator; `BLANKS` if blanks follow; None if the line has another first cell.
    """
    pattern = rb"(?:\xef\xbb\xbf)?\s*\"?(?i:" + title.encode() + rb")\"? *([\t,; ]|[\r\n]|\Z)"
    found = re.match(pattern, line)
    if not found:
        return None
    before = found.group(1).strip(b" \r\n")
    return before or BLANKS


def cells_of(line: bytes, delimiter: bytes) -> list[bytes]:
    """Return the cells of a line as stored, quotes included, without the line end."""
    if delimiter == BLANKS:
        return _BLANK_CELL.findall(line) if b'"' in line else line.split()
    body = line.rstrip(b"\r\n")
    if b'"' in body:
        return _cell_pattern(delimiter).findall(body + delimiter)
    return body.split(delimiter)


def content_of(cell: bytes) -> bytes:
    """Return a cell without quotes and surrounding blanks."""
    text = cell.strip()
    if len(text) > 1 and text[:1] == text[-1:] == b'"':
        text = text[1:-1].replace(b'""', b'"').strip()
    return text


def is_blank(cell: bytes) -> bool:
    """Check whether a cell has no content."""
    return not cell or not content_of(cell)


def texts_of(line: bytes, delimiter: bytes) -> list[str]:
    """Return the cells of a line as text, without quotes and surrounding blanks."""
    line = line.removeprefix(b"\xef\xbb\xbf")
    try:
        line.decode()
        encoding = "utf-8"
    except UnicodeDecodeError:
        encoding = "latin-1"  # common in older Windows programs
    return [content_of(cell).decode(encoding).strip() for cell in cells_of(line, delimiter)]


def trimmed(texts: list[str]) -> list[str]:
    """Return cells without blank ones at the end."""
    return texts[: max((k + 1 for k, text in enumerate(texts) if text), default=0)]


def with_cells(line: bytes, new: dict[int, bytes], delimiter: bytes) -> bytes:
    """Return a line with the contents of some cells replaced.

    Parameters
    ----------
    line : bytes
        The line.
    new : dict of int to bytes
        New contents by cell, counted from 0. A cell beyond the end of the line gets the delimiters
        it needs.
    delimiter : bytes
        Separator of cells, or `BLANKS`; cells of the latter must exist.

    Returns
    -------
    bytes
        The line; blanks and quotes around the contents, and all other cells, are as before.
    """
    if delimiter == BLANKS:
        spans = [found.span() for found in _BLANK_CELL.finditer(line)]
        for column in sorted(new, reverse=True):
            start, stop = spans[column]
            line = line[:start] + _filled(line[start:stop], new[column], delimiter) + line[stop:]
        return line
    body = line.rstrip(b"\r\n")
    cells = cells_of(line, delimiter)
    cells += [b""] * (max(new, default=0) + 1 - len(cells))
    for column, text in new.items():
        cells[column] = _filled(cells[column], text, delimiter)
    return delimiter.join(cells) + line[len(body) :]


def with_exchanged_cells(
    line: bytes, taken_from: dict[int, int], delimiter: bytes, *, ends_early: bool = False
) -> bytes:
    """Return a line in which some cells have moved, as stored: with their quotes and blanks.

    Parameters
    ----------
    line : bytes
        The line.
    taken_from : dict of int to int
        For each cell that changes, counted from 0, the one whose contents it gets. One beyond the
        end of the line is blank.
    delimiter : bytes
        Separator of cells, or `BLANKS`; cells of the latter must exist.
    ends_early : bool
        Whether blank cells at the end of a line are left out.
    """
    old = cells_of(line, delimiter)
    if delimiter == BLANKS:
        spans = [found.span() for found in _BLANK_CELL.finditer(line)]
        for column in sorted(taken_from, reverse=True):
            start, stop = spans[column]
            line = line[:start] + old[taken_from[column]] + line[stop:]
        return line
    old += [b""] * (max((*taken_from, *taken_from.values())) + 1 - len(old))
    cells = [old[taken_from.get(column, column)] for column in range(len(old))]
    while ends_early and cells and is_blank(cells[-1]):
        cells.pop()
    return delimiter.join(cells) + line[len(line.rstrip(b"\r\n")) :]


def _filled(cell: bytes, text: bytes, delimiter: bytes) -> bytes:
    """Return a cell with new contents, in the quotes and between the blanks of the old ones."""
    inner = cell.strip()
    if inner[:1] == b'"' or (delimiter and delimiter in text):
        text = b'"' + text + b'"'
    return cell.replace(inner, text, 1) if inner else text


@cache
def _cell_pattern(delimiter: bytes) -> re.Pattern[bytes]:
    """Return the pattern of a cell with its delimiter, for lines that have quotes."""
    end = re.escape(delimiter)
    return re.compile(b'( *+"' + _INSIDE + b'" *+(?=' + end + b")|[^" + end + b"]*+)" + end)


def _ends_open(line: bytes, delimiter: bytes, inside: bool) -> bool:
    """Check whether a line ends inside a quoted cell, given whether it begins in one."""
    place = 0
    if not inside:
        cells = cells_of(line, delimiter)
        if all(not cell.lstrip().startswith(b'"') or _is_quoted(cell) for cell in cells):
            return False
        opening = _OPENING.match(line.removeprefix(b"\xef\xbb\xbf"))
        if opening:
            place, inside = (
                len(line) - len(line.removeprefix(b"\xef\xbb\xbf")) + opening.end(),
                True,
            )
    while True:
        if inside:
            place = _match_end(_REST, line, place)
            if place >= len(line):
                return True
        place = line.find(delimiter, place) + 1
        if not place:
            return False
        opening = _OPENING.match(line, place)
        inside = opening is not None
        if opening:
            place = opening.end()


def _match_end(pattern: re.Pattern[bytes], line: bytes, place: int) -> int:
    """Return where a pattern that matches anything ends."""
    found = pattern.match(line, place)
    return found.end() if found else place


def _is_quoted(cell: bytes) -> bool:
    """Check whether a cell is a quoted one as a whole."""
    text = cell.strip()
    return len(text) > 1 and _match_end(_REST, text, 1) == len(text) - 1


def _most_cells(line: bytes) -> int:
    """Return the number of cells of a line for the separator that gives most."""
    by_blanks = len(line.split(maxsplit=_MAX_CELLS + 1))
    return max(by_blanks, *(line.count(delimiter) + 1 for delimiter in (b"\t", b",", b";")))


def _count_ends(data: bytes) -> int:
    """Return the number of line ends."""
    return len(re.findall(rb"\r{0,2}\n|\r", data))
