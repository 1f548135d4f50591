"""What ``priorfill fill`` prints: a table of the gaps, JSON, and notes on stderr."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from priorfill.cli.artefacts import (
    artefact_facts,
    print_artefacts,
    print_left_as_measured,
    warn_of_artefacts,
)
from priorfill.cli.output import json_number, print_line, print_table, some_names

if TYPE_CHECKING:
    from priorfill.filling.add_result import AddedClip
    from priorfill.filling.fill_file import FileResult
    from priorfill.filling.result import FilledGap, Result

__all__ = ["fill_facts", "print_fill", "print_fill_notes", "print_unfilled"]

MAX_GAPS = 40
"""Number of gaps in the table; ``--json`` has all."""

MIN_ROUNDING = 0.001
"""Smallest rounding error of a coordinate (mm) worth a line."""


def fill_facts(done: FileResult) -> dict[str, Any]:
    """Return a fill in the form of the JSON output.

    Parameters
    ----------
    done : FileResult
        The fill.
    """
    result, report = done.result, done.report
    gaps = [(one, gap) for one in result.by_subject for gap in one.gaps]
    added = [_added_facts(one) for one in done.added]
    return {
        "file": str(done.source),
        "output": str(done.output),
        "uncertainty": str(done.uncertainty) if done.uncertainty else None,
        "method": result.method,
        "database": str(result.database) if result.database else None,
        "marker_set": result.marker_set.name,
        "rate": result.clip.rate,
        "filled_samples": int(result.filled.sum()),
        "rejected_samples": int(result.rejected.sum()),
        "missing_samples": int(result.clip.missing.sum()),
        "complete": result.complete,
        "notes": list(result.notes),
        "rounding_mm": report.rounding_mm,
        "rewriting_changed": list(report.changes),
        **(added[0] if len(added) == 1 else {}),
        "subjects": [
            _subject_facts(one) | (added[number] if added else {})
            for number, one in enumerate(result.by_subject)
        ],
        "gaps": [_gap_facts(one, gap) for one, gap in sorted(gaps, key=lambda pair: pair[1].start)],
        "artefacts": artefact_facts(done.artefacts, result.clip),
        "provenance": result.provenance.to_dict(),
    }


def print_fill(done: FileResult) -> None:
    """Print what was done.

    Parameters
    ----------
    done : FileResult
        The fill.
    """
    result = done.result
    if result.gaps:
        _print_gaps(result)
        print_line()
        print_line(f"{_summary(result)}; written to {done.output}")
        if done.report.rounding_mm > MIN_ROUNDING:
            print_line(
                "filled samples are rounded to the file's number format, by up to "
                f"{done.report.rounding_mm:.3f} mm"
            )
    else:
        print_line(f"{result.clip.name} has no gaps; {done.output} is a copy")
    if result.rejected.any():
        print_line()
        facts = artefact_facts(done.artefacts, result.clip)
        print_artefacts(facts, "Artefacts, treated as missing")
    if done.uncertainty is not None:
        print_line(f"expected error of each filled sample: {done.uncertainty}")
    for added in done.added:
        if added is not None:
            print_line(added.message)


def print_fill_notes(done: FileResult) -> None:
    """Print notes, warnings and what was not filled on stderr.

    Parameters
    ----------
    done : FileResult
        The fill.
    """
    result = done.result
    source = result.clip.source
    for note in (
        *(source.notes if source is not None else ()),
        *result.notes,
        *(f"rewritten: {change}" for change in done.report.changes),
    ):
        print_line(f"note: {note}", err=True)
    if not result.provenance.reject_artefacts:
        warn_of_artefacts(artefact_facts(done.artefacts, result.clip), str(done.source))
    print_left_as_measured(result, done.source, done.output)
    print_unfilled(result)


def print_unfilled(result: Result) -> None:
    """Print on stderr, for each reason, the markers and frames that were not filled.

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    spans = [(span, gap.label) for gap in result.gaps for span in gap.unfilled]
    first = result.clip.first_frame
    for requested, reason in dict.fromkeys((span.requested, span.reason) for span, _ in spans):
        same = [(s, label) for s, label in spans if (s.requested, s.reason) == (requested, reason)]
        labels = list(dict.fromkeys(label for _, label in same))
        samples = sum(span.stop - span.start for span, _ in same)
        start = min(span.start for span, _ in same)
        stop = max(span.stop for span, _ in same)
        print_line(
            f"{'unfilled' if requested else 'left alone'}: {samples} samples of {len(labels)} "
            f"marker{'s' if len(labels) > 1 else ''} ({some_names(labels)}) within frames "
            f"{first + start}-{first + stop - 1}: {reason}",
            err=True,
        )


def _print_gaps(result: Result) -> None:
    """Print the table of a result's gaps."""
    clip = result.clip
    rows = [
        (
            gap.label,
            f"{clip.first_frame + gap.start}-{clip.first_frame + gap.stop - 1}",
            f"{gap.frames / clip.rate:.2f}",
            f"{100 * gap.filled / gap.frames:.0f} %",
            *(
                f"{value:.1f}" if math.isfinite(value) else "-"
                for value in (gap.expected_mean_error_mm, gap.error_bound_90_mm)
            ),
            "; ".join(
                [*gap.sources, *dict.fromkeys(f"unfilled: {s.reason}" for s in gap.unfilled)]
            ),
        )
        for gap in result.gaps[:MAX_GAPS]
    ]
    columns = ("marker", "frames", "s>", "filled>", "mean error mm>", "90 % below mm>", "sources")
    print_table(columns, rows)
    if len(result.gaps) > MAX_GAPS:
        print_line(f"... and {len(result.gaps) - MAX_GAPS} more gaps (--json lists all)")


def _summary(result: Result) -> str:
    """Return the numbers of filled samples and complete gaps in a line."""
    requested = [gap for gap in result.gaps if gap.requested]
    complete = sum(gap.complete for gap in requested)
    alone = len(result.gaps) - len(requested)
    return (
        f"filled {int(result.filled.sum())} samples with {result.method}; "
        f"{complete} of {len(requested)} gaps complete" + (f", {alone} left alone" if alone else "")
    )


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


def _gap_facts(result: Result, gap: FilledGap) -> dict[str, Any]:
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
        "method": gap.method,
        "sources": list(gap.sources),
        "source_clips": list(gap.source_clips),
        "training_poses": gap.training_poses,
        "unfilled": [
            {
                "first_frame": first + span.start,
                "last_frame": first + span.stop - 1,
                "reason": span.reason,
                "requested": span.requested,
            }
            for span in gap.unfilled
        ],
    }
