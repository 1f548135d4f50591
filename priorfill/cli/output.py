"""What commands print: tables and JSON."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import click

__all__ = ["duration", "json_number", "print_json", "print_table", "some_names"]

MAX_WIDTH = 1000
"""Width of output other than a terminal (columns), so that no cell is cut."""

MAX_NAMES = 6
"""Number of names in a line."""


def print_json(value: Any) -> None:
    """Print a value as JSON."""
    click.echo(json.dumps(value, indent=2, ensure_ascii=False))


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
            Text(name.removesuffix(">")), justify="right" if name.endswith(">") else "left"
        )
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else MAX_WIDTH)
    if title:
        click.echo(title)
    with console.capture() as capture:
        console.print(table)
    for line in capture.get().splitlines():
        click.echo(line.rstrip())


def duration(seconds: float) -> str:
    """Return a duration in readable units: ``3.25 s``, ``4 min 05 s``, ``2 h 13 min``."""
    if seconds < 60:
        return f"{seconds:.2f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min"
