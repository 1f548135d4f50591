"""Results of the accuracy study, and the CSV file that stores them."""

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
        Settings of the study, and name of the case.
    gaps : int
        Number of rows of the case, database and method; with fewer in the file, it is repeated.
    window, start : int
        First frame of the clip in its recording, and of the gap in the clip.
    filled : int
        Filled frames, over which errors are averaged.
    error, rms, worst, linear : float
        Mean, rms and maximum error, and the mean error of linear interpolation.
    expected_mean, expected_rms, bound : float
        Expected mean error, expected rms error and 90 % bound of the gap.
    below, below_gap : int
        Frames with an error below their own bound, and below that of the gap.
    edge, edge_truth, edge_reference : float
        Largest second difference across an edge of the gap, filled and true, and the 99th
        percentile of the marker's measured second differences.
    jitter : float
        Power of the accelerations above 10 Hz, relative to the truth.
    jitter_mm, jitter_truth_mm : float
        Rms displacement above 10 Hz, filled and true.
    penetration, penetration_truth : float
        How far a foot marker goes below its lowest measured height, filled and true.
    """

    plan: str
    case: str
    kind: str
    folder: str
    clip: str
    subject: str
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
    edge_reference: float
    jitter: float
    jitter_mm: float
    jitter_truth_mm: float
    penetration: float
    penetration_truth: float
    fill_seconds: float


def load(file: Path) -> list[Row]:
    """Read the rows of a study, without those of interrupted fills."""
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
                    continue  # incomplete last line
                raise SystemExit(
                    f"{file}: is not a file of this study ({error}); choose another folder with -o"
                ) from None
    count: dict[tuple[str, ...], int] = {}
    for row in rows:
        count[key_of(row)] = count.get(key_of(row), 0) + 1
    return [row for row in rows if count[key_of(row)] == row.gaps]


def save(file: Path, rows: Iterable[Row]) -> None:
    """Write the rows of a study, completely or not at all."""
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
    """Return the key of a fill."""
    return row.plan, row.case, row.database, row.method
