"""A summary as JSON values."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from priorfill.runtime.json_numbers import json_number
from priorfill.study.summary.marker_figures import StudyMarker
from priorfill.study.summary.rule import rule_text
from priorfill.study.summary.summarise import StudyPart, StudySummary, SummaryTrial
from priorfill.study.summary.trial_figures import TrialFigures, TrialGap, TrialMarker

__all__ = ["FORMAT", "relative_path", "summary_json"]

FORMAT = "priorfill study summary 1"
"""Name and version of the JSON file."""

MM_DIGITS, SECOND_DIGITS, SHARE_DIGITS = 2, 3, 6
"""Decimals of lengths, times and shares."""


def summary_json(summary: StudySummary, folder: Path) -> dict[str, Any]:
    """Return a summary as JSON values; docs/study_summary.md describes them.

    Parameters
    ----------
    summary : StudySummary
        Of a study.
    folder : Path
        That the paths are relative to.
    """
    limits, contents = summary.limits, summary.contents
    return {
        "format": FORMAT,
        "study": contents.name,
        "sentence": summary.sentence,
        "to_do": summary.to_do,
        "groups": summary.groups,
        "statuses": summary.statuses,
        "waiting": list(contents.waiting),
        "seconds": json_number(contents.seconds, SECOND_DIGITS),
        "facts": summary.facts,
        "limits": {"error_mm": limits.error, "gap_seconds": limits.gap},
        "rule": rule_text(limits),
        "trials": [_trial(one, folder) for one in summary.trials],
        "markers": [_study_marker(one) for one in summary.markers],
        "folders": [
            {"folder": one.name, "subjects": list(one.subjects), **_part(one)}
            for one in summary.folders
        ],
        "subjects": [
            {"subject": one.name, "folders": list(one.folders), **_part(one)}
            for one in summary.subjects
        ],
    }


def relative_path(path: str | None, folder: Path) -> str | None:
    """Return a path relative to a folder, with ``/``; absolute on another drive of Windows.

    Parameters
    ----------
    path : str or None
        An absolute path; None: none.
    folder : Path
        Absolute.
    """
    if not path:
        return None
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return Path(path).as_posix()


def _trial(one: SummaryTrial, folder: Path) -> dict[str, Any]:
    figures, outcome = one.figures, one.figures.outcome
    return {
        "name": outcome.name,
        "folder": figures.folder,
        "subjects": list(figures.subjects),
        "group": one.attention.group,
        "reasons": list(one.attention.reasons),
        "status": outcome.status,
        "try_again": outcome.try_again,
        "frames": figures.frames or None,
        "rate": json_number(figures.rate, MM_DIGITS),
        **_amounts(figures),
        "longest_gap": _gap(figures.longest),
        "least_certain_gap": _gap(figures.least_certain),
        "left": [
            {
                "reason": left.reason,
                "requested": left.requested,
                "samples": left.samples,
                "markers": list(left.markers),
                "first_frame": left.first_frame,
                "last_frame": left.last_frame,
            }
            for left in figures.left
        ],
        "artefacts": dict(figures.artefacts),
        "warnings": _by_gap(outcome.warnings, figures.gaps),
        "notes": list(figures.notes),
        "method": figures.method or None,
        "marker_set": figures.marker_set or None,
        "seconds": json_number(outcome.seconds, SECOND_DIGITS),
        "peak_memory": outcome.peak_memory or None,
        "source": relative_path(outcome.source, folder),
        "output": None if figures.failed else relative_path(outcome.output, folder),
        "report": relative_path(outcome.report, folder),
        "uncertainty": relative_path(outcome.uncertainty, folder),
        "markers": [_marker(marker) for marker in figures.markers],
    }


def _by_gap(warnings: Sequence[str], gaps: Sequence[TrialGap]) -> list[str]:
    """Return warnings in the order of the gaps that they begin with, those of the worst first."""
    places = {
        f"{gap.marker}, frames {gap.first_frame}-{gap.last_frame}": place
        for place, gap in enumerate(gaps)
    }
    return sorted(warnings, key=lambda text: places.get(text.partition(":")[0], len(places)))


def _amounts(figures: TrialFigures) -> dict[str, Any]:
    """Return the numbers of samples and the expected errors of a trial."""
    return {
        "gaps": len(figures.gaps),
        "missing_samples": figures.missing,
        "missing_share": json_number(figures.missing_share, SHARE_DIGITS),
        "filled_samples": figures.filled,
        "left_samples": figures.left_samples,
        "kept_samples": figures.kept,
        "expected_mean_error_mm": json_number(figures.error, MM_DIGITS),
        "error_bound_90_mm": json_number(figures.bound, MM_DIGITS),
    }


def _gap(gap: TrialGap | None) -> dict[str, Any] | None:
    if gap is None:
        return None
    return {
        "marker": gap.marker,
        "first_frame": gap.first_frame,
        "last_frame": gap.last_frame,
        "seconds": json_number(gap.seconds, SECOND_DIGITS),
        "expected_mean_error_mm": json_number(gap.error, MM_DIGITS),
        "error_bound_90_mm": json_number(gap.bound, MM_DIGITS),
    }


def _marker(one: TrialMarker | StudyMarker) -> dict[str, Any]:
    """Return what is known of a marker, in a trial or in the study."""
    return {
        "marker": one.label,
        "gaps": one.gaps,
        "missing_frames": one.frames,
        "missing_share": json_number(one.share, SHARE_DIGITS),
        "filled_frames": one.filled,
        "left_frames": one.left,
        "longest_gap_seconds": json_number(one.longest, SECOND_DIGITS),
        "expected_mean_error_mm": json_number(one.error, MM_DIGITS),
        "greatest_gap_error_mm": json_number(one.worst, MM_DIGITS),
    }


def _study_marker(one: StudyMarker) -> dict[str, Any]:
    return _marker(one) | {
        "trials": one.trials,
        "left_trials": one.left_trials,
        "never_measured_trials": one.throughout_trials,
        "absent_in": list(one.absent),
    }


def _part(one: StudyPart) -> dict[str, Any]:
    return {
        "trials": one.trials,
        "groups": dict(one.groups),
        "missing_samples": one.missing,
        "missing_share": json_number(
            one.missing / one.samples if one.samples else math.nan, SHARE_DIGITS
        ),
        "filled_samples": one.filled,
        "left_samples": one.left,
        "expected_mean_error_mm": json_number(one.error, MM_DIGITS),
        "worst_marker": one.worst_marker or None,
        "absent_markers": list(one.absent),
        "seconds": json_number(one.seconds, SECOND_DIGITS),
    }
