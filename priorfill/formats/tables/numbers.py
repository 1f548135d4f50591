"""Numbers in cells of text tables: marks of missing ones, decimal comma, thousands separators."""

from __future__ import annotations

import re
from collections.abc import Sequence

from priorfill.errors import FormatError
from priorfill.formats.tables.cells import cells_of, content_of, line_number

__all__ = [
    "cell_number",
    "check_points",
    "has_decimal_comma",
    "header_number",
    "place_of",
    "plain_number",
    "shown",
    "why_no_number",
]

_WORDS = frozenset(
    b"|null|na|n/a|<na>|#na|#n/a|#n/a n/a|none|nil|-|--|n. def.|nodata|missing".split(b"|")
)
"""Words for a missing number: those that pandas reads as such, and those of other programs."""

_NAN = re.compile(rb"[+-]?(?:s|q)?nan(?:\([0-9a-z_]*\))?")
"""printf of glibc and of Visual C++ since 2015: nan, -nan(ind)."""

_OLD_NAN = re.compile(rb"[+-]?1\.(?:#(?:ind|qnan|snan|qnb|qo|io|r|j)0*|\$)")
"""printf of Visual C++ before 2015: 1.#QNAN, -1.#IND00, and what it makes of them if it rounds to
fewer decimals: 1.#QO, -1.#J."""

_OLD_INFINITY = re.compile(rb"[+-]?1\.#inf0*")

_NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")

_COMMA_NUMBER = re.compile(rb"[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?")

_GROUPED = re.compile(rb"[+-]?[1-9]\d{0,2},\d{3}")
"""A number that is as likely to be in the thousands as to have three decimals."""

_THOUSANDS = re.compile(
    rb"[+-]?\d{1,3}(?:(?:[,.' _\xa0]|\xc2\xa0|\xe2\x80[\x89\x99\xaf])\d{3})+(?:[.,]\d*)?"
)
"""Also with the separators that are not ASCII: no-break spaces, thin spaces, typographic
apostrophes."""

_GROUPED_POINT = re.compile(rb"[+-]?[1-9]\d{0,2}\.\d{3}")
_BELOW_THOUSAND = re.compile(rb"[+-]?0*\d{1,3}")

_MIN_GROUPED_RATE = 10.0
"""A header's ``1,000`` is as likely to be 1000 as 1; ``120,000`` is 120."""


_SHOWN = 20
"""Characters of a cell in a message."""


def cell_number(cell: bytes) -> float | None:
    """Return a cell's number; NaN if it is marked as missing, None if it is something else."""
    text = content_of(cell)
    if _NUMBER.fullmatch(text):
        return float(text)
    word = text.lower()
    if word in _WORDS or _NAN.fullmatch(word) or _OLD_NAN.fullmatch(word):
        return float("nan")
    if _OLD_INFINITY.fullmatch(word) or word.lstrip(b"+-") in (b"inf", b"infinity"):
        return float("inf")
    return None


def plain_number(cell: bytes) -> float | None:
    """Return the finite number in a cell, with decimal point or comma; None if there is none."""
    text = content_of(cell)
    if _COMMA_NUMBER.fullmatch(text):
        text = text.replace(b",", b".")
    return float(text) if _NUMBER.fullmatch(text) else None


def header_number(text: str | None) -> float | None:
    """Return the finite number in a header field; None if there is none."""
    cell = (text or "").strip().encode()
    value = plain_number(cell)
    if value is None or abs(value) == float("inf"):
        return None
    return None if _GROUPED.fullmatch(cell) and abs(value) < _MIN_GROUPED_RATE else value


def has_decimal_comma(
    lines: list[bytes],
    rows: Sequence[int],
    columns: Sequence[int],
    labels: Sequence[str],
    delimiter: bytes,
    name: str,
) -> bool:
    """Check whether the decimal separator of a table is a comma.

    One answer holds for the whole table, and only numbers that cannot be read otherwise decide.

    Parameters
    ----------
    lines, rows, labels, delimiter, name
        As in `read_table`.
    columns : sequence of int
        Cells of the coordinates, in the order of the labels, three each.

    Returns
    -------
    bool
        False if no coordinate has a comma.

    Raises
    ------
    FormatError
        If a coordinate has a thousands separator, some have commas and others points, or all
        commas might separate thousands.
    """
    if not any(_has_inner_comma(lines[row], delimiter) for row in rows):
        return False
    with_comma: tuple[int, int] | None = None
    has_point = sure = False
    for row in rows:
        cells = cells_of(lines[row], delimiter)
        for number, column in enumerate(columns):
            if column >= len(cells):
                continue
            text = content_of(cells[column])
            if b"," not in text:
                has_point |= b"." in text and _NUMBER.fullmatch(text) is not None
            elif _COMMA_NUMBER.fullmatch(text):
                with_comma = with_comma or (row, number)
                sure |= _GROUPED.fullmatch(text) is None
            elif _THOUSANDS.fullmatch(text):
                place = place_of(lines, row, column, number, labels, name)
                raise FormatError(
                    f"{place} is {shown(text)}, with a thousands separator; "
                    "export numbers without thousands separators"
                )
    if with_comma is None:
        return False
    if sure and not has_point:
        return True
    row, number = with_comma
    cell = cells_of(lines[row], delimiter)[columns[number]]
    place = place_of(lines, row, columns[number], number, labels, name)
    raise FormatError(
        f"{place} is {shown(cell)}, and "
        + (
            "other cells have decimal points"
            if has_point
            else "every comma might separate thousands"
        )
        + "; export with decimal points and without thousands separators"
    )


def check_points(
    lines: list[bytes],
    rows: Sequence[int],
    columns: Sequence[int],
    labels: Sequence[str],
    delimiter: bytes,
    name: str,
) -> None:
    """Raise FormatError if every point may separate thousands: 950 next to 1.450.

    A program that writes three decimals writes them in all numbers, and one that omits zeros at the
    end leaves one or two decimals in some. Parameters are those of `has_decimal_comma`.
    """
    with_point: tuple[int, int] | None = None
    whole = False
    for row in rows:
        cells = cells_of(lines[row], delimiter)
        for number, column in enumerate(columns):
            text = content_of(cells[column]) if column < len(cells) else b""
            if _GROUPED_POINT.fullmatch(text):
                with_point = with_point or (row, number)
            elif _BELOW_THOUSAND.fullmatch(text):
                whole |= text.strip(b"+-0") != b""  # 0 is a mark of missing samples
            elif _NUMBER.fullmatch(text):
                return
    if with_point and whole:
        row, number = with_point
        cell = cells_of(lines[row], delimiter)[columns[number]]
        place = place_of(lines, row, columns[number], number, labels, name)
        raise FormatError(
            f"{place} is {shown(cell)}, and every point might separate thousands; "
            "export without thousands separators"
        )


def _has_inner_comma(line: bytes, delimiter: bytes) -> bool:
    """Check whether a line has commas other than separators."""
    if delimiter != b",":
        return b"," in line
    return b'"' in line and line.count(b",") >= len(cells_of(line, delimiter))


def place_of(
    lines: list[bytes], row: int, column: int, number: int, labels: Sequence[str], name: str
) -> str:
    """Return a cell's place for a message.

    Parameters
    ----------
    lines : list of bytes
        All lines.
    row, column : int
        Line and cell, counted from 0.
    number : int
        Number of the coordinate, three for each label.
    labels : sequence of str
        Labels of the points.
    name : str
        The file's name.

    Returns
    -------
    str
        File, line, cell, marker, axis.
    """
    label = labels[number // 3] or f"point {number // 3 + 1}"
    line = line_number(lines, row)
    return f"{name}: line {line}, cell {column + 1} ({label} {'XYZ'[number % 3]})"


def shown(cell: bytes) -> str:
    """Return the beginning of a cell for a message."""
    try:
        text = cell.decode()
    except UnicodeDecodeError:
        text = cell.decode("latin-1")
    return repr(text[:_SHOWN])


def why_no_number(cell: bytes) -> str:
    """Return the end of the message on a cell that is no number."""
    if _THOUSANDS.fullmatch(content_of(cell)):
        return "with a thousands separator; export numbers without thousands separators"
    return "which is not a number; correct the cell, or leave it blank if the sample is missing"
