"""What commands print: lines, tables and JSON.

Nothing else prints (tests/test_style.py). What files, file names, databases and errors contain
reaches a terminal without control characters (`priorfill.runtime.display`).
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import click

from priorfill.cli.option_names import with_options
from priorfill.runtime.display import escaped

__all__ = ["duration", "json_number", "print_json", "print_line", "print_table", "some_names"]

MAX_WIDTH = 1000
"""Width of output other than a terminal (columns), so that no cell is cut."""

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
    _write(escaped(with_options(text)), err=err)


def _write(line: str, *, err: bool = False) -> None:
    """Write a line; characters that the encoding of the output lacks as escape sequences."""
    stream = sys.stderr if err else sys.stdout
    encoding = getattr(stream, "encoding", None) or "utf-8"
    click.echo(line.encode(encoding, "backslashreplace").decode(encoding), err=err)


def print_json(value: Any) -> None:
    """Print a value as JSON of ASCII characters, which no terminal interprets."""
    click.echo(json.dumps(value, indent=2))


def json_number(value: float, digits: int) -> float | None:
    """Return a rounded number for JSON; None for NaN and infinity, which JSON lacks."""
    return round(value, digits) if math.isfinite(value) else None


def some_names(names: Sequence[str], separator: str = ", ") -> str:
    """Return the first names in a line, with an ellipsis if there are more."""
    return separator.join([*names[:MAX_NAMES], *(["..."] if len(names) > MAX_NAMES else [])])


def print_table(columns: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> None:
    """Print a table.

    Parameters
    ----------
    columns : sequence of str
        Names of the columns; those that end in ``>`` are right-aligned.
    rows : iterable of sequence of str
        The cells.
    title : str
        Printed above the table.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in columns:
        table.add_column(
            Text(escaped(name.removesuffix(">"))), justify="right" if name.endswith(">") else "left"
        )
    for row in rows:
        table.add_row(*(Text(escaped(cell)) for cell in row))
    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else MAX_WIDTH)
    if title:
        print_line(title)
    with console.capture() as capture:
        console.print(table)
    for line in capture.get().splitlines():
        _write(line.rstrip())  # with the styles of the table's header on a terminal


def duration(seconds: float) -> str:
    """Return a duration in readable units: ``3.25 s``, ``4 min 05 s``, ``2 h 13 min``."""
    if seconds < 60:
        return f"{seconds:.2f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min"
