"""What the scripts of papers' tables and figures share: recordings, artificial gaps, tables.

Each script runs by itself, as ``scripts/papers/NAME.py``; what lies in ``scripts/`` can be imported
once this module is.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TypeVar

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))

from recordings import add_data_option

import priorfill as pf

__all__ = ["beside", "cut", "error", "find", "in_processes", "options"]

UNKNOWN = "-"
"""What a table has where a figure is not known."""

Cell = str | float | None
Case = TypeVar("Case")
Outcome = TypeVar("Outcome")


def options(doc: str | None, **more: str) -> argparse.ArgumentParser:
    """Return a script's parser, with ``--data`` and what more it takes (``full="help"``).

    ``recording`` takes a file, everything else is a flag.
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
    """Find a recording: the one named by the user, else the first of some names that is there.

    Parameters
    ----------
    names : sequence of str
        Paths below the folder, or names of files anywhere below it; the best first.
    data : Path
        Folder of recordings.
    recording : Path, optional
        The user's own.

    Raises
    ------
    SystemExit
        Where there is none, with a line that says what was looked for.
    """
    if recording is not None:
        if not recording.is_file():
            raise SystemExit(f"{recording}: no such recording")
        return recording
    for name in names:
        for file in (data / name, *sorted(data.rglob(Path(name).name))):
            if file.is_file():
                return file
    raise SystemExit(f"{data}: has none of {', '.join(names)}; use --data or --recording")


def cut(clip: pf.Clip, start: int, stop: int, labels: Iterable[str]) -> pf.Clip:
    """Return a clip without frames ``start <= frame < stop`` of some markers."""
    positions = clip.positions.copy()
    positions[start:stop, [clip.labels.index(label) for label in labels]] = np.nan
    return clip.with_positions(positions)


def error(found: pf.Clip, truth: pf.Clip, gappy: pf.Clip) -> float:
    """Return the mean distance (mm) to what was cut out; NaN if any of it is left missing."""
    gone = gappy.missing & ~truth.missing
    return float(np.linalg.norm((found.positions - truth.positions)[gone], axis=1).mean())


def in_processes(function: Callable[[Case], Outcome], cases: Sequence[Case]) -> list[Outcome]:
    """Return what a function makes of each case, in their order, worked on by all cores."""
    with ProcessPoolExecutor(min(len(cases), os.cpu_count() or 1)) as pool:
        return list(pool.map(function, cases))


def beside(title: str, columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    """Print a table; numbers have three digits at least, and what is not known is a dash.

    Parameters
    ----------
    title : str
        What it shows, and in which unit.
    columns : sequence of str
        Their heads; the paper's figures stand beside ours.
    rows : iterable of sequences
        A text, a number, or None or NaN where nothing is known, for each column.
    """
    lines = [list(columns), *([_written(cell) for cell in row] for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(columns))]
    print(f"\n{title}")
    for line in lines:
        texts = [line[0].ljust(widths[0])]
        texts += [text.rjust(width) for text, width in zip(line[1:], widths[1:], strict=True)]
        print("  ".join(texts).rstrip())
    sys.stdout.flush()


def _written(cell: Cell) -> str:
    if cell is None or (isinstance(cell, float) and np.isnan(cell)):
        return UNKNOWN
    if isinstance(cell, str | int):
        return str(cell)
    decimals = 2 if abs(cell) < 1.0 else 1
    return f"{cell:.{decimals}f}" if abs(cell) < 1000.0 else f"{cell:.0f}"
