"""What commands print: lines, tables and JSON.

Nothing else prints (tests/test_style.py). What files, file names, databases and errors contain
reaches a terminal without control characters (`priorfill.runtime.display`).
"""

from __future__ import annotations

import errno
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.encoding import encodable
from priorfill.cli.option_names import with_options
from priorfill.cli.system import is_closed_pipe
from priorfill.errors import OutputError
from priorfill.runtime.display import escaped

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "MAX_ROWS",
    "duration",
    "ended_by_reader",
    "print_json",
    "print_line",
    "print_table",
    "print_wrapped",
    "some_names",
]

WIDTH = 80
"""Width of text, and of tables where the output is no terminal (columns)."""

MAX_CELL = 400
MAX_LINE = 4000
"""Maximum number of characters of a cell and of a line; a label of a file can have any length."""

MAX_WORD = 40
"""Length of a word above which it is divided."""

MIN_WORD = 16
"""Length of a word above which it is divided if the whole table then fits the width."""

GAP = 2
"""Blanks between the columns of a table."""

MAX_ROWS = 20
"""Number of rows of a long table; ``--all`` prints all."""

MAX_NAMES = 6
"""Number of names in a line."""


def print_line(text: str = "", *, err: bool = False) -> None:
    r"""Print a line in which control characters are visible.

    Parameters
    ----------
    text : str
        The line; a line break in it is shown as ``\n``. Arguments in backquotes are shown as
        options.
    err : bool
        Print on stderr instead of stdout.
    """
    _write(_shown(with_options(text), MAX_LINE), err=err)


def _write(line: str, *, err: bool = False) -> None:
    """Write a line; what the encoding of the output lacks is replaced."""
    with _errors_explained(err=err):
        click.echo(encodable(line, sys.stderr if err else sys.stdout), err=err)


@contextmanager
def _errors_explained(*, err: bool = False) -> Iterator[None]:
    """Turn an OSError from writing to stdout into an OutputError, and ignore one from stderr."""
    try:
        yield
    except OSError as error:
        if err:  # there is nowhere to report it
            return
        if is_closed_pipe(error):
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE)) from error
        raise OutputError(
            f"the standard output cannot be written ({error.strerror}); "
            "what the command has written to files is complete"
        ) from error


def ended_by_reader(error: BaseException) -> bool:
    """Return whether a command ended because the reader of our output has closed it.

    On Windows, other failures look the same, such as writing to a share that is gone. So an empty
    line is printed, to see whether that fails, too.

    Parameters
    ----------
    error : BaseException
        What ended the command.
    """
    if not isinstance(error, OSError) or not is_closed_pipe(error):
        return False
    if isinstance(error, BrokenPipeError):
        return True
    try:
        print_line()
    except OSError as failure:
        return isinstance(failure, BrokenPipeError)
    return False


def print_json(value: Any) -> None:
    """Print a value as JSON of ASCII characters, the same on every code page."""
    _write(json.dumps(value, indent=2))


def some_names(names: Sequence[str], separator: str = ", ") -> str:
    """Return the first names in a line, with an ellipsis if there are more."""
    return separator.join([*names[:MAX_NAMES], *(["..."] if len(names) > MAX_NAMES else [])])


def print_wrapped(text: str, indent: str = "") -> None:
    """Print a text in lines of at most `WIDTH` columns.

    Parameters
    ----------
    text : str
        The text.
    indent : str
        Precedes each line but the first.
    """
    shown = _shown(with_options(text), MAX_LINE)
    lines = wrap(
        shown, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    for line in lines or [shown]:
        _write(line)


def print_table(columns: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> None:
    r"""Print a table in `WIDTH` columns, or in the width of the terminal.

    Long texts are wrapped. A table with too many columns is printed in parts, each with the first
    column.

    Parameters
    ----------
    columns : sequence of str
        Names of the columns, with ``\n`` between the lines of a long name; those that end in ``>``
        are right-aligned.
    rows : iterable of sequence of str
        The cells.
    title : str
        Printed above the table.
    """
    from rich.console import Console

    # what the output lacks is replaced before the widths of columns are known
    names = ["\n".join(map(_in_table, name.split("\n"))) for name in columns]
    cells = [[_in_table(cell) for cell in row] for row in rows]
    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH)
    if title:
        print_line(title)
    parts, least = _layout(names, cells, console.width)
    for number, part in enumerate(parts):
        if number:
            print_line()
        shown = _table(
            [names[i] for i in part],
            [[row[i] for i in part] for row in cells],
            [least[i] for i in part],
        )
        with _errors_explained(), console.capture() as capture:
            console.print(shown)
        for line in capture.get().splitlines():
            _write(line.rstrip())  # with the styles of the table's header on a terminal


def _shown(text: str, longest: int) -> str:
    """Return a text without control characters, shortened in the middle."""
    shown = escaped(text)
    half = longest // 2
    return shown if len(shown) <= longest else f"{shown[:half]} ... {shown[-half:]}"


def _in_table(text: str) -> str:
    """Return the text of a cell, or a line of a column's name."""
    return encodable(_shown(text, MAX_CELL), sys.stdout)


def _layout(
    names: Sequence[str], cells: Sequence[Sequence[str]], width: int
) -> tuple[list[list[int]], list[int]]:
    """Divide the columns of a table so that each part fits the width; the first is in each.

    Returns
    -------
    tuple of list of list of int, list of int
        The columns of each part, and the least width of each column.
    """
    for longest in (MAX_WORD, MIN_WORD):
        needed = [_needed(name, [row[i] for row in cells], longest) for i, name in enumerate(names)]
        if sum(needed) + GAP * (len(needed) - 1) <= width:
            return [list(range(len(names)))], needed
    needed = [_needed(name, [row[i] for row in cells], MAX_WORD) for i, name in enumerate(names)]
    parts, used = [[0]], needed[0]
    for i in range(1, len(names)):
        if used + GAP + needed[i] > width and len(parts[-1]) > 1:
            parts.append([0])
            used = needed[0]
        parts[-1].append(i)
        used += GAP + needed[i]
    return parts, needed


def _needed(name: str, cells: Sequence[str], longest: int) -> int:
    """Return the least width of a column: numbers stay in one piece, texts are wrapped."""
    from rich.cells import cell_len

    header = max(cell_len(piece) for piece in name.removesuffix(">").split("\n"))
    if name.endswith(">"):
        return min(max([header, *map(cell_len, cells)]), MAX_WORD)
    words = [cell_len(word) for cell in cells for word in cell.split(" ")]
    return max(header, min(max(words, default=0), longest))


def _table(names: Sequence[str], cells: Sequence[Sequence[str]], least: Sequence[int]) -> Table:
    """Return a table for the terminal, in which only texts are wrapped."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, GAP, 0, 0))
    for name, width in zip(names, least, strict=True):
        table.add_column(
            Text(name.removesuffix(">")),
            justify="right" if name.endswith(">") else "left",
            min_width=width,
            overflow="fold",
        )
    for row in cells:
        table.add_row(*(Text(cell) for cell in row))
    return table


def duration(seconds: float) -> str:
    """Return a duration in readable units: ``3.25 s``, ``4 min 05 s``, ``2 h 13 min``."""
    if seconds < 60:
        return f"{seconds:.2f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min"
