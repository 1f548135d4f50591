"""The rows of the accuracy study, and the file that they are kept in."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Row:
    """One gap filled by one method from one database; lengths in mm.

    Attributes
    ----------
    plan, case : str
        What all cases depend on, and which of them.
    gaps : int
        Rows of the case, database and method: with fewer of them in the file, it was interrupted.
    window, start : int
        First frame of the clip in its recording, of the gap in the clip.
    filled : int
        Frames filled; the errors are over these.
    error, rms, worst, linear : float
        Mean, rms and greatest error, and the mean error of linear interpolation.
    expected_mean, expected_rms, bound : float
        What priorfill says of the gap.
    below, below_gap : int
        Frames off by less than their own bound, by less than the gap's.
    edge, edge_truth, edge_usual : float
        Greatest second difference over an edge of the gap: filled, true; the 99th percentile of
        the marker's measured ones.
    shake : float
        Power of the accelerations above 10 Hz, of that of the truth.
    shake_mm, shake_truth_mm : float
        Rms distance by which the fill, and the truth, shake at such frequencies.
    sunk, sunk_truth : float
        How far a marker of the foot goes below its lowest measured height: filled, true.
    """

    plan: str
    case: str
    kind: str
    folder: str
    clip: str
    person: str
    window: int
    clip_frames: int
    rate: float
    database: str
    method: str
    gaps: int
    marker: str
    segment: str
    start: int
    frames: int
    seconds: float
    filled: int
    error: float
    rms: float
    worst: float
    linear: float
    expected_mean: float
    expected_rms: float
    bound: float
    below: int
    below_gap: int
    poses: int
    how: str
    edge: float
    edge_truth: float
    edge_usual: float
    shake: float
    shake_mm: float
    shake_truth_mm: float
    sunk: float
    sunk_truth: float
    fill_seconds: float


def load(file: Path) -> list[Row]:
    """Read the rows of a study, without those of fills that were interrupted while written."""
    if not file.exists():
        return []
    kinds: dict[str, Callable[[str], Any]] = {"int": int, "float": float, "str": str}
    rows: list[Row] = []
    with file.open(newline="", encoding="utf-8") as lines:
        for line in csv.DictReader(lines):
            try:
                rows.append(Row(**{f.name: kinds[str(f.type)](line[f.name]) for f in fields(Row)}))
            except (TypeError, ValueError, KeyError) as error:
                if any(value is None for value in line.values()):
                    continue  # torn at the end
                raise SystemExit(
                    f"{file}: is no file of this study ({error}); take another folder with -o"
                ) from None
    count: dict[tuple[str, ...], int] = {}
    for row in rows:
        count[key_of(row)] = count.get(key_of(row), 0) + 1
    return [row for row in rows if count[key_of(row)] == row.gaps]


def save(file: Path, rows: Iterable[Row]) -> None:
    """Write the rows of a study, whole or not at all."""
    temporary = file.with_suffix(".part")
    with temporary.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, [f.name for f in fields(Row)])
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)
    temporary.replace(file)


def append(file: Path, rows: Iterable[Row]) -> None:
    """Add rows to the file of a study."""
    with file.open("a", newline="", encoding="utf-8") as lines:
        csv.DictWriter(lines, [f.name for f in fields(Row)]).writerows(asdict(r) for r in rows)


def key_of(row: Row) -> tuple[str, ...]:
    """Return what tells a fill from others."""
    return row.plan, row.case, row.database, row.method
