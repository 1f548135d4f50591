"""A summary as tables: a row for each trial, and one for each marker of a trial."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from priorfill.runtime.display import csv_cell

__all__ = ["MARKER_COLUMNS", "TRIAL_COLUMNS", "write_marker_table", "write_trial_table"]

TRIAL_COLUMNS = (
    "trial", "folder", "subjects", "group", "reasons", "status", "try_again", "frames", "rate",
    "gaps", "missing_samples", "missing_share", "filled_samples", "left_samples", "left_reasons",
    "kept_samples",
    "expected_mean_error_mm", "error_bound_90_mm",
    "longest_gap_seconds", "longest_gap_marker",
    "least_certain_gap_error_mm", "least_certain_gap_marker",
    "artefacts", "warnings", "seconds", "peak_memory_mb", "output", "report",
)  # fmt: skip
"""Columns of the table of trials, worst first."""

MARKER_COLUMNS = (
    "trial", "folder", "marker", "gaps", "missing_frames", "missing_share", "filled_frames",
    "left_frames", "longest_gap_seconds", "expected_mean_error_mm", "greatest_gap_error_mm",
)  # fmt: skip
"""Columns of the table of markers."""

MEGABYTE = 1e6
"""bytes"""


def write_trial_table(path: Path, summary: Mapping[str, Any]) -> None:
    """Write a row for each trial, worst first.

    Parameters
    ----------
    path : Path
        The file.
    summary : mapping
        As from `summary_json`.
    """
    _write(path, TRIAL_COLUMNS, (_trial(one) for one in summary["trials"]))


def write_marker_table(path: Path, summary: Mapping[str, Any]) -> None:
    """Write a row for each marker with gaps of each trial.

    Parameters
    ----------
    path : Path
        The file.
    summary : mapping
        As from `summary_json`.
    """
    rows = (
        {"trial": trial["name"], "folder": trial["folder"]} | marker
        for trial in summary["trials"]
        for marker in trial["markers"]
    )
    _write(path, MARKER_COLUMNS, rows)


def _trial(one: Mapping[str, Any]) -> dict[str, Any]:
    longest, uncertain = one["longest_gap"] or {}, one["least_certain_gap"] or {}
    memory = one["peak_memory"]
    return {
        **one,
        "trial": one["name"],
        "subjects": "; ".join(one["subjects"]),
        "reasons": "; ".join(one["reasons"]),
        "left_reasons": "; ".join(left["reason"] for left in one["left"]),
        "longest_gap_seconds": longest.get("seconds"),
        "longest_gap_marker": longest.get("marker"),
        "least_certain_gap_error_mm": uncertain.get("expected_mean_error_mm"),
        "least_certain_gap_marker": uncertain.get("marker"),
        "artefacts": sum(one["artefacts"].values()),
        "warnings": len(one["warnings"]),
        "peak_memory_mb": None if memory is None else round(memory / MEGABYTE),
    }


def _write(path: Path, columns: Sequence[str], rows: Iterator[dict[str, Any]]) -> None:
    """Write a table; unknown values are empty cells."""
    with path.open("w", encoding="utf-8-sig", newline="") as file:  # Excel needs the mark
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in rows:
            writer.writerow([_cell(row[name]) for name in columns])


def _cell(value: object) -> object:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return csv_cell(value) if isinstance(value, str) else value
