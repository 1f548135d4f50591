"""The result of an evaluation, and its files."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from priorfill.evaluation import summary_tables
from priorfill.evaluation.evaluation_plan import EvaluationPlan, FillJob
from priorfill.evaluation.gap_case import FillOutcome
from priorfill.evaluation.metrics import ErrorSummary
from priorfill.evaluation.summary_tables import (
    GapRow,
    MethodComparison,
    MethodPair,
    MethodRow,
)
from priorfill.runtime.atomic_file import replace_file
from priorfill.runtime.display import csv_cell

__all__ = ["FILES", "Evaluation", "write_results"]

FILES = ("gaps.csv", "methods.csv", "markers.csv", "lengths.csv", "results.json")
"""Names of the files that `write_results` writes."""

DIGITS = 6
"""Significant digits of numbers in files."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The errors of methods in artificial gaps.

    Attributes
    ----------
    plan : EvaluationPlan
        Clips, cases, methods and settings.
    outcomes : dict of FillJob to FillOutcome
        The outcome of each method in each case.

    See Also
    --------
    priorfill.evaluate : Makes an evaluation.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic import synthesise
    >>> clip = synthesise("walking", seconds=2.0)
    >>> found = pf.evaluate(clip, methods="linear", protocol="frames")
    >>> found.gaps[0].sources
    ('straight lines over time',)
    """

    plan: EvaluationPlan
    outcomes: dict[FillJob, FillOutcome]

    @property
    def settings(self) -> dict[str, Any]:
        """Everything that the errors depend on: options, versions, seed, checksums of the clips."""
        return self.plan.settings

    @cached_property
    def methods(self) -> dict[str, MethodRow]:
        """Errors of each method in all cases, by method."""
        return {
            method: summary_tables.method_row(self.outcomes, self.plan, method)
            for method in self.plan.methods
        }

    @cached_property
    def clips(self) -> dict[str, dict[str, MethodRow]]:
        """Errors of each method in each clip with cases, by clip and method."""
        with_cases = dict.fromkeys(case.clip for case in self.plan.cases)
        return {
            self.plan.sources[clip].clip.name: {
                method: summary_tables.method_row(self.outcomes, self.plan, method, clip)
                for method in self.plan.methods
            }
            for clip in with_cases
        }

    @cached_property
    def gaps(self) -> list[GapRow]:
        """A row per gap and method."""
        return summary_tables.gap_rows(self.outcomes, self.plan)

    @cached_property
    def markers(self) -> dict[tuple[str, str, str], tuple[int, ErrorSummary]]:
        """Number of gaps and errors by marker set, marker and method."""
        return summary_tables.marker_rows(self.outcomes, self.plan)

    @cached_property
    def lengths(self) -> dict[tuple[str, str], tuple[int, ErrorSummary]]:
        """Number of gaps and errors by class of length and method."""
        return summary_tables.length_rows(self.outcomes, self.plan)

    @cached_property
    def comparison(self) -> MethodComparison:
        """The methods compared over the samples that all of them filled."""
        return summary_tables.compare(self.outcomes, self.plan)

    @cached_property
    def pairs(self) -> list[MethodPair]:
        """All pairs of methods compared over the samples that both filled."""
        return summary_tables.pairs(self.outcomes, self.plan)

    @property
    def best(self) -> str | None:
        """The method with the smallest mean error over the samples that all filled."""
        return self.comparison.best

    @property
    def worked(self) -> bool:
        """Whether every method could work on every case."""
        return not any(row.refused for row in self.methods.values())

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Cases that were skipped, and notes of the fills."""
        notes = (note for outcome in self.outcomes.values() for note in outcome.notes)
        return (*self.plan.notes, *dict.fromkeys(notes))

    def to_dict(self) -> dict[str, Any]:
        """Return settings and summaries as written to ``results.json``; unknown values are None."""
        comparison = self.comparison
        facts = {
            "settings": self.settings,
            "files": {
                source.clip.name: str(source.clip.source.path)
                for source in self.plan.sources
                if source.clip.source is not None
            },
            "cases": len(self.plan.cases),
            "gaps": sum(len(case.gaps) for case in self.plan.cases),
            "samples": sum(case.samples for case in self.plan.cases),
            "methods": {name: _method(row) for name, row in self.methods.items()},
            "clips": {
                clip: {name: _method(row) for name, row in rows.items()}
                for clip, rows in self.clips.items()
            },
            "lengths": [
                {"length": length, "method": method, "gaps": gaps} | errors_of(errors)
                for (length, method), (gaps, errors) in self.lengths.items()
            ],
            "comparison": {
                "samples": comparison.samples,
                "of": comparison.of,
                "best": comparison.best,
                "left_out": list(comparison.left_out),
                "mean_mm": {name: one.mean for name, one in comparison.methods.items()},
                "rmse_mm": {name: one.rmse for name, one in comparison.methods.items()},
            },
            "pairs": [asdict(pair) for pair in self.pairs],
            "notes": list(self.notes),
        }
        return _known(facts)  # type: ignore[no-any-return]


def errors_of(errors: ErrorSummary) -> dict[str, Any]:
    """Return errors by the names of their columns in files."""
    return {
        "samples": errors.samples,
        "filled": errors.filled,
        "filled_share": errors.share,
        "mean_mm": errors.mean,
        "rmse_mm": errors.rmse,
        "median_mm": errors.median,
        "p95_mm": errors.p95,
        "max_mm": errors.maximum,
        "mae_mm": errors.mae,
        "velocity_mm_s": errors.velocity,
        "acceleration_m_s2": errors.acceleration,
        "expected_mean_error_mm": errors.expected_mean_error_mm,
        "error_bound_90_coverage": errors.error_bound_90_coverage,
    }


def _method(row: MethodRow) -> dict[str, Any]:
    """Return the errors of a method by the names of their columns in files."""
    return {
        "cases": row.cases,
        "gaps": row.gaps,
        **errors_of(row.errors),
        "joint_angle_deg": row.joint_angle,
        "joints_deg": row.joints,
        "seconds": row.seconds,
        "refused_cases": sum(row.refused.values()),
        "refused": row.refused,
    }


def _known(value: Any) -> Any:
    """Return a value with rounded numbers, and with None for NaN, which JSON lacks."""
    if isinstance(value, dict):
        return {key: _known(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_known(inner) for inner in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value


def write_results(folder: Path, evaluation: Evaluation) -> None:
    """Write `FILES` to a folder, each atomically; existing ones are replaced.

    Parameters
    ----------
    folder : Path
        An existing folder.
    evaluation : Evaluation
        The result to write.
    """
    gaps = [
        {
            "method": row.method,
            "clip": row.clip,
            "case": row.case,
            "copy": row.copy,
            "marker": row.marker,
            "segment": row.segment,
            "first_frame": row.first_frame,
            "frames": row.frames,
            "seconds": row.seconds,
            **errors_of(row.errors),
            "sources": "; ".join(row.sources),
            "source_clips": "; ".join(row.source_clips),
            "training_poses": row.training_poses,
            "unfilled": "; ".join(row.unfilled),
        }
        for row in evaluation.gaps
    ]
    by_clip = [row for rows in evaluation.clips.values() for row in rows.values()]
    methods = [
        {"method": row.method, "clip": row.clip}
        | {k: v for k, v in _method(row).items() if k not in ("joints_deg", "refused")}
        | {"refused": "; ".join(row.refused)}
        for row in [*evaluation.methods.values(), *by_clip]
    ]
    markers = [
        {"marker_set": name, "marker": marker, "method": method, "gaps": count} | errors_of(errors)
        for (name, marker, method), (count, errors) in evaluation.markers.items()
    ]
    lengths = [
        {"length": length, "method": method, "gaps": count} | errors_of(errors)
        for (length, method), (count, errors) in evaluation.lengths.items()
    ]
    for name, rows in zip(FILES, (gaps, methods, markers, lengths), strict=False):
        _write_csv(folder / name, rows)
    with replace_file(folder / FILES[-1], overwrite=True) as temporary:
        text = json.dumps(evaluation.to_dict(), indent=2)
        temporary.write_text(text + "\n", encoding="utf-8", newline="\n")


def _write_csv(file: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows with the same columns; unknown values are empty cells."""

    def cells(row: dict[str, Any]) -> Iterable[Any]:
        for value in row.values():
            known = _known(value)
            if isinstance(known, str):
                known = csv_cell(known)
            yield "" if known is None else known

    with (
        replace_file(file, overwrite=True) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as lines,
    ):
        writer = csv.writer(lines)
        writer.writerow(rows[0])
        writer.writerows(cells(row) for row in rows)
