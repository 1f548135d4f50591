"""Recordings, artificial gaps and tables for the scripts of published tables and figures.

Importing this module makes ``scripts/support`` importable.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))

from method_alone import method_alone
from process_pool import process_pool
from recordings import add_data_option

import priorfill as pf

__all__ = [
    "Comparison",
    "cut",
    "error",
    "find",
    "in_processes",
    "method_alone",
    "options",
    "print_table",
    "table_lines",
]

UNKNOWN = "-"
"""Cell of a table without a value."""

CLOSE = 0.1
"""Relative deviation up to which a cell counts as equal to the paper's."""

Cell = str | float | None
Case = TypeVar("Case")
Outcome = TypeVar("Outcome")


def options(doc: str | None, **more: str) -> argparse.ArgumentParser:
    """Return a parser with ``--data`` and further options (``name="help text"``).

    ``recording`` takes a file, all others are flags.
    """
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    add_data_option(parser)
    for name, text in more.items():
        if name == "recording":
            parser.add_argument("--recording", type=Path, metavar="FILE", help=text)
        else:
            parser.add_argument(f"--{name}", action="store_true", help=text)
    return parser


def find(names: Sequence[str], data: Path, recording: Path | None = None) -> Path:
    """Find a recording: the given one, otherwise the first of some names that exists.

    Parameters
    ----------
    names : sequence of str
        Paths below the folder, or names of files anywhere below it, in order of preference.
    data : Path
        Folder of recordings.
    recording : Path, optional
        File given by the user.

    Raises
    ------
    SystemExit
        If there is none; the message lists the names.
    """
    if recording is not None:
        if not recording.is_file():
            raise SystemExit(f"{recording}: file not found")
        return recording
    for name in names:
        for file in (data / name, *sorted(data.rglob(Path(name).name))):
            if file.is_file():
                return file
    raise SystemExit(f"{data}: contains none of {', '.join(names)}; use --data or --recording")


def cut(clip: pf.Clip, start: int, stop: int, labels: Iterable[str]) -> pf.Clip:
    """Return a clip without frames ``start <= frame < stop`` of some markers."""
    positions = clip.positions.copy()
    positions[start:stop, [clip.labels.index(label) for label in labels]] = np.nan
    return clip.with_positions(positions)


def error(found: pf.Clip, truth: pf.Clip, gappy: pf.Clip) -> float:
    """Return the mean error (mm) over the removed samples; NaN if any stays missing."""
    gone = gappy.missing & ~truth.missing
    return float(np.linalg.norm((found.positions - truth.positions)[gone], axis=1).mean())


def in_processes(function: Callable[[Case], Outcome], cases: Sequence[Case]) -> list[Outcome]:
    """Apply a function to all cases on all cores, and return the results in order."""
    with process_pool(min(len(cases), os.cpu_count() or 1)) as pool:
        return list(pool.map(function, cases))


def table_lines(columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> list[str]:
    """Return the lines of a table; unknown values are dashes.

    Parameters
    ----------
    columns : sequence of str
        Column heads.
    rows : iterable of sequences
        Text, number, or None or NaN if unknown, for each column.
    """
    lines = [list(columns), *([_written(cell) for cell in row] for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(columns))]
    written = []
    for line in lines:
        texts = [line[0].ljust(widths[0])]
        texts += [text.rjust(width) for text, width in zip(line[1:], widths[1:], strict=True)]
        written.append("  ".join(texts).rstrip())
    return written


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    """Print `table_lines` below a title, which has quantity and unit."""
    print(f"\n{title}", *table_lines(columns, rows), sep="\n", flush=True)


def _written(cell: Cell) -> str:
    if cell is None or (isinstance(cell, float) and np.isnan(cell)):
        return UNKNOWN
    if isinstance(cell, str | int):
        return str(cell)
    decimals = 2 if abs(cell) < 1.0 else 1
    return f"{cell:.{decimals}f}" if abs(cell) < 1000.0 else f"{cell:.0f}"


class Comparison:
    """Cells of a table that the paper has too, and how far they are from its values.

    Parameters
    ----------
    unit : str
        Of all cells.
    """

    def __init__(self, unit: str = "mm") -> None:
        self._unit = unit
        self._close = 0
        self._far: list[tuple[str, float, str, str]] = []

    def add(self, cell: str, ours: float | None, paper: str, why: str = "") -> None:
        """Compare one cell.

        Parameters
        ----------
        cell : str
            Row and column.
        ours : float or None
            NaN or None if nothing was filled.
        paper : str
            The paper's value as printed: "1.7", "25". Equal after rounding to its decimals counts
            as close.
        why : str, optional
            What explains a deviation.
        """
        value = float("nan") if ours is None else ours
        decimals = len(paper.partition(".")[2])
        published = float(paper)
        if round(value, decimals) == published or abs(value - published) <= CLOSE * published:
            self._close += 1
        else:
            self._far.append((cell, value, paper, why))

    def print(self) -> None:
        """Print how many cells are close, and the others with what explains them."""
        count = self._close + len(self._far)
        print(f"\n{self._close} of {count} cells are within {CLOSE:.0%} of the paper's")
        for cell, value, paper, why in self._far:
            change = f"{value / float(paper) - 1.0:+.0%}" if not np.isnan(value) else "not filled"
            reason = f": {why}" if why else ""
            ours = f"{_written(value)} {self._unit}".rstrip()
            print(f"  {cell}: {ours} (paper {paper}, {change}){reason}")
        sys.stdout.flush()
