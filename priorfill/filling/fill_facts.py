"""A fill as JSON values: what was done, gap by gap, and what it was computed from."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from priorfill.artefacts.artefact_facts import artefact_facts
from priorfill.report.result_summary import MarkerSummary, summarise_markers
from priorfill.runtime.json_numbers import json_number

if TYPE_CHECKING:
    from priorfill.filling.add_result import AddedClip
    from priorfill.filling.fill_file import FileResult
    from priorfill.filling.result import FilledGap, Result

__all__ = ["fill_facts"]


def fill_facts(done: FileResult, text: Callable[[str], str] = str) -> dict[str, Any]:
    """Return a fill as JSON values, as ``priorfill fill --json`` prints them.

    Parameters
    ----------
    done : FileResult
        The fill.
    text : callable
        Turns notes and reasons into what is shown, which name arguments in backquotes.
    """
    result, report = done.result, done.report
    gaps = [(one, gap) for one in result.by_subject for gap in one.gaps]
    added = [_added_facts(one) for one in done.added]
    return {
        "file": str(done.source),
        "output": str(done.output) if done.output else None,
        "companions": [str(path) for path in done.companions],
        "uncertainty": str(done.uncertainty) if done.uncertainty else None,
        "plot": [str(path) for path in done.further.get("plot", ())],
        "report": next((str(path) for path in done.further.get("report", ())), None),
        "overrides": next((str(path) for path in done.further.get("write_overrides", ())), None),
        "method": result.method,
        "database": str(result.database) if result.database else None,
        "marker_set": result.marker_set.name,
        "rate": result.clip.rate,
        "frames": result.clip.frames,
        "samples": result.clip.missing.size,
        "filled_samples": int(result.filled.sum()),
        "rejected_samples": int(result.rejected.sum()),
        "swapped_samples": 0 if result.swapped is None else int(result.swapped.sum()),
        "missing_samples": int(result.clip.missing.sum()),
        "complete": result.complete,
        "notes": [text(note) for note in (*result.notes, *report.notes)],
        "rounding_mm": report.rounding_mm,
        "rewriting_changed": list(report.changes),
        **(added[0] if len(added) == 1 else {}),
        "subjects": [
            _subject_facts(one) | (added[number] if added else {})
            for number, one in enumerate(result.by_subject)
        ],
        "gaps": [
            _gap_facts(one, gap, text) for one, gap in sorted(gaps, key=lambda pair: pair[1].start)
        ],
        "markers": [
            _marker_facts(one, summary)
            for one in result.by_subject
            for summary in summarise_markers(one.gaps)
        ],
        "artefacts": artefact_facts(done.artefacts, result.clip),
        "provenance": result.provenance.to_dict(),
    }


def _added_facts(added: AddedClip | None) -> dict[str, Any]:
    """Return what became of adding a clip to a database; None: it failed."""
    record = None if added is None else added.record
    return {
        "added": None if record is None else record.content,
        "replaced": [] if added is None else [old.content for old in added.replaced],
    }


def _subject_facts(result: Result) -> dict[str, Any]:
    """Return the totals of a subject."""
    return {
        "subject": result.clip.subject,
        "marker_set": result.marker_set.name,
        "filled_samples": int(result.filled.sum()),
        "missing_samples": int(result.clip.missing.sum()),
        "complete": result.complete,
    }


def _marker_facts(result: Result, one: MarkerSummary) -> dict[str, Any]:
    """Return what became of the gaps of a marker."""
    return {
        "marker": one.label,
        "subject": result.clip.subject,
        "gaps": one.gaps,
        "frames": one.frames,
        "filled": one.filled,
        "expected_mean_error_mm": json_number(one.expected_mean_error_mm, 3),
        "error_bound_90_mm": json_number(one.error_bound_90_mm, 3),
    }


def _gap_facts(result: Result, gap: FilledGap, text: Callable[[str], str]) -> dict[str, Any]:
    """Return what became of a gap."""
    first = result.clip.first_frame
    return {
        "marker": gap.label,
        "subject": result.clip.subject,
        "first_frame": first + gap.start,
        "last_frame": first + gap.stop - 1,
        "frames": gap.frames,
        "seconds": round(gap.frames / result.clip.rate, 4),
        "filled": gap.filled,
        "expected_rms_mm": json_number(gap.expected_rms_mm, 3),
        "expected_mean_error_mm": json_number(gap.expected_mean_error_mm, 3),
        "error_bound_90_mm": json_number(gap.error_bound_90_mm, 3),
        "expected_mean_error_without_database_mm": json_number(
            gap.expected_mean_error_without_database_mm, 3
        ),
        "method": gap.method,
        "sources": list(gap.sources),
        "source_clips": list(gap.source_clips),
        "training_poses": gap.training_poses,
        "unfilled": [
            {
                "first_frame": first + span.start,
                "last_frame": first + span.stop - 1,
                "reason": text(span.reason),
                "requested": span.requested,
                "expected_mean_error_mm": (
                    None
                    if span.expected_mean_error_mm is None
                    else json_number(span.expected_mean_error_mm, 3)
                ),
            }
            for span in gap.unfilled
        ],
    }
