"""Frame numbers and times of the rows of a text table, and what its header states about them."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import MAX_RATE, MIN_RATE
from priorfill.errors import FormatError
from priorfill.formats.tables.cells import content_of, line_number
from priorfill.formats.tables.numbers import header_number, plain_number, shown

__all__ = ["are_times", "count_frames", "count_notes", "find_rate", "frame_numbers"]

_FRAME_NUMBER = re.compile(rb"[+-]?\d{1,15}(?:[.,]0*)?")
"""A frame number; some programs write it as 1.0."""

_MAX_FRAME = 2**31 - 1
"""Largest frame number, that of a 32-bit integer, in which other formats store it."""

_RATE_TOLERANCE = 0.01
"""Relative difference between the frame rates of header and time column above which one of them is
wrong. Times are rounded to milliseconds in many files."""

_PER_SECOND = (1e3, 1e6)
"""Milliseconds and microseconds: some programs write times in these."""

_SLACK = 1.01
"""Allowed distance of a rounded time from an even one, in units of its last decimal: half a unit
for its own rounding, and half for that of the ends of the column."""


def frame_numbers(first_cells: Sequence[bytes], rows: Sequence[int], lines: list[bytes], name: str
) -> int:  # fmt: skip
    """Parse the column of frame numbers.

    Parameters
    ----------
    first_cells : sequence of bytes
        The cells.
    rows : sequence of int
        Lines of the cells, counted from 0.
    lines : list of bytes
        All lines of the file.
    name : str
        The file's name in messages.

    Returns
    -------
    int
        Number of the first frame.

    Raises
    ------
    FormatError
        If a cell is not an integer, or the numbers do not rise by 1 from row to row: a clip has
        evenly spaced frames, and every option, message and output names frames by these numbers.
    """
    numbers = []
    for cell, row in zip(first_cells, rows, strict=True):
        text = content_of(cell)
        if not _FRAME_NUMBER.fullmatch(text):
            raise FormatError(
                f"{name}: line {line_number(lines, row)} begins with {shown(cell)} instead of a "
                "frame number; delete or correct the line"
            )
        numbers.append(int(re.split(rb"[.,]", text)[0]))
        if abs(numbers[-1]) > _MAX_FRAME:
            raise FormatError(
                f"{name}: line {line_number(lines, row)} has the frame number {numbers[-1]}, which "
                "is too large; number the frames from 1"
            )
    jumps = np.flatnonzero(np.diff(numbers) != 1)
    if jumps.size:
        jump = int(jumps[0])
        before, after = numbers[jump], numbers[jump + 1]
        at = [line_number(lines, rows[k]) for k in (jump, jump + 1)]
        if after > before:
            one = after == before + 2
            absent = f"frame {before + 1}" if one else f"frames {before + 1}-{after - 1}"
            fault = f"after frame {before} (line {at[0]}) comes frame {after} (line {at[1]})"
            remedy = f"insert rows with blank cells for {absent}, or cut the file there"
        elif after == before:
            fault = f"frame {before} is there twice (lines {at[0]} and {at[1]})"
            remedy = "delete one of the rows, or number the rows anew"
        else:
            fault = f"after frame {before} (line {at[0]}) comes frame {after} (line {at[1]})"
            remedy = "sort the rows, or number them anew"
        raise FormatError(f"{name}: {fault}; {remedy}")
    return numbers[0]


def count_frames(cells: Sequence[bytes]) -> bool:
    """Check whether a column counts frames: most cells are integers that rise by 1."""
    texts = [content_of(cell) for cell in cells]
    numbers = [
        int(re.split(rb"[.,]", text)[0]) if _FRAME_NUMBER.fullmatch(text) else np.nan
        for text in texts
    ]
    return len(numbers) < 2 or float((np.diff(numbers) == 1).mean()) > 1 / 2


def are_times(cells: Sequence[bytes]) -> bool:
    """Check whether a column holds even, rising times."""
    return _even_rate(cells)[0] is not None


def count_notes(frames: tuple[str | None, int], markers: tuple[str | None, int]) -> list[str]:
    """Return notes on counts in a header that differ from the table's.

    Parameters
    ----------
    frames, markers : (str or None, int)
        The header's field, and the number of frames or markers in the table.

    Returns
    -------
    list of str
        At most one note for each.
    """
    notes = []
    for (text, actual), what in ((frames, "frames"), (markers, "markers")):
        stated = header_number(text)
        if stated is not None and stated != actual:
            notes.append(f"The header states {stated:g} {what}; there are {actual}.")
    return notes


def find_rate(stated: float | None, times: Sequence[bytes]) -> tuple[float | None, list[str]]:
    """Return the frame rate according to header and time column.

    Parameters
    ----------
    stated : float or None
        Rate in the header (Hz); None if absent.
    times : sequence of bytes
        Cells of the time column (s); empty if absent.

    Returns
    -------
    rate : float or None
        That of the times if they are even and contradict the header, which programs often leave
        unchanged when they resample or cut a recording; else the header's; else the mean rate of
        the times (Hz); None if there is none.
    notes : list of str
        What the user should know.
    """
    even, mean, step = _even_rate(times)
    if stated is None or not MIN_RATE <= stated <= MAX_RATE:
        if mean is None or step == 1:
            return None, []
        uneven = "" if even is not None else ", although its times are uneven"
        return mean, [f"The frame rate is taken from the time column: {mean:.6g} Hz{uneven}."]
    if mean is None or abs(mean / stated - 1) <= max(_RATE_TOLERANCE, _precision(times, mean)):
        return stated, []
    if even is None:
        return stated, [
            f"The header states {stated:g} Hz; the times in the time column are uneven "
            f"({mean:.4g} Hz on average). The header's rate is used (see `rate`)."
        ]
    if any(abs(even * unit / stated - 1) <= _RATE_TOLERANCE for unit in _PER_SECOND):
        return stated, []
    if even < MIN_RATE:
        return stated, [
            f"The times in the time column are {1 / even:.6g} s apart; the header's rate of "
            f"{stated:g} Hz is used (see `rate`)."
        ]
    if step == 1:
        return stated, [
            f"The time column counts rows; the header's rate of {stated:g} Hz is used (see `rate`)."
        ]
    return even, [
        f"The header states {stated:g} Hz, the time column {even:.6g} Hz, evenly; "
        "the rate of the time column is used (see `rate`)."
    ]


def _even_rate(times: Sequence[bytes]) -> tuple[float | None, float | None, float]:
    """Return the rate of even times, the mean rate of any times, and the step; None if unknown."""
    texts = [content_of(cell) for cell in times]
    found = [plain_number(text) for text in texts]
    known = np.array([second for second in found if second is not None])
    if len(known) < 2 or not known[-1] > known[0]:
        return None, None, 0.0
    step = float(known[-1] - known[0]) / (len(known) - 1)
    mean = 1 / step if step > 1 / MAX_RATE else None
    if mean is None or len(known) < len(found):
        return None, mean, step
    line: NDArray[np.float64] = known[0] + step * np.arange(len(known))
    if np.abs(known - line).max() > _SLACK * _last_decimal(texts) + 1e-9 * abs(known).max():
        return None, mean, step
    nearest = float(round(mean))
    near = nearest > 0 and abs(mean / nearest - 1) <= _precision(times, mean)
    return (nearest if near else mean), mean, step


def _last_decimal(texts: Sequence[bytes]) -> float:
    """Return the unit (s) of the last decimal of the times."""
    decimals = max((len(re.split(rb"[.,]", text)[-1]) if re.search(rb"[.,]", text) else 0
                    for text in texts if not re.search(rb"[eE]", text)), default=15)  # fmt: skip
    return float(10.0 ** -min(decimals, 15))


def _precision(times: Sequence[bytes], mean: float) -> float:
    """Return the relative error of the mean rate from rounded times."""
    return _last_decimal([content_of(cell) for cell in times]) * mean / max(len(times) - 1, 1)
