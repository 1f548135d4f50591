"""What ``priorfill fill`` prints: a table of the gaps, JSON, and notes on stderr."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import count
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

from priorfill.cli.artefacts import (
    artefact_facts,
    print_artefacts,
    print_left_as_measured,
    warn_of_artefacts,
)
from priorfill.cli.option_names import with_options
from priorfill.cli.output import MAX_ROWS, json_number, print_line, print_table, some_names
from priorfill.report.result_summary import (
    MarkerSummary,
    gap_cells,
    mm_text,
    share_text,
    summarise_markers,
    summary_text,
    worst_first,
)

if TYPE_CHECKING:
    from priorfill.filling.add_result import AddedClip
    from priorfill.filling.fill_file import FileResult
    from priorfill.filling.result import FilledGap, Result

__all__ = [
    "fill_facts",
    "print_fill",
    "print_fill_notes",
    "print_gaps",
    "print_unfilled",
    "worth_of_database",
]

MIN_ROUNDING = 0.001
"""Smallest rounding error of a coordinate (mm) worth a line."""

_ERRORS = ("expected mean\nerror mm>", "error bound\n90 mm>")
"""Columns of `expected_mean_error_mm` and `error_bound_90_mm`."""


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
        "output": str(done.output) if done.output else None,
        "uncertainty": str(done.uncertainty) if done.uncertainty else None,
        "plot": [str(path) for path in done.further.get("plot", ())],
        "report": next((str(path) for path in done.further.get("report", ())), None),
        "overrides": next((str(path) for path in done.further.get("write_overrides", ())), None),
        "method": result.method,
        "database": str(result.database) if result.database else None,
        "marker_set": result.marker_set.name,
        "rate": result.clip.rate,
        "filled_samples": int(result.filled.sum()),
        "rejected_samples": int(result.rejected.sum()),
        "swapped_samples": 0 if result.swapped is None else int(result.swapped.sum()),
        "missing_samples": int(result.clip.missing.sum()),
        "complete": result.complete,
        "notes": [with_options(note) for note in result.notes],
        "rounding_mm": report.rounding_mm,
        "rewriting_changed": list(report.changes),
        **(added[0] if len(added) == 1 else {}),
        "subjects": [
            _subject_facts(one) | (added[number] if added else {})
            for number, one in enumerate(result.by_subject)
        ],
        "gaps": [_gap_facts(one, gap) for one, gap in sorted(gaps, key=lambda pair: pair[1].start)],
        "markers": [
            _marker_facts(one, summary)
            for one in result.by_subject
            for summary in summarise_markers(one.gaps)
        ],
        "artefacts": artefact_facts(done.artefacts, result.clip),
        "provenance": result.provenance.to_dict(),
    }


def print_fill(done: FileResult, *, every_row: bool = False) -> None:
    """Print what was done.

    Parameters
    ----------
    done : FileResult
        The fill.
    every_row : bool
        Print all rows of long tables.
    """
    result = done.result
    rows = None if every_row else MAX_ROWS
    if result.gaps:
        print_gaps(result, rows)
        print_line()
        print_line(f"{summary_text(result)}; {_written(done)}")
        worth = worth_of_database(result)
        if worth:
            print_line(worth)
        if done.report.rounding_mm > MIN_ROUNDING:
            print_line(
                "filled samples are rounded to the file's number format, by up to "
                f"{done.report.rounding_mm:.3f} mm"
            )
    elif done.output is None:
        print_line(f"{result.clip.name} has no gaps; nothing to write")
    else:
        print_line(f"{result.clip.name} has no gaps; {done.output} is a copy")
    if result.rejected.any():
        print_line()
        facts = artefact_facts(done.artefacts, result.clip)
        print_artefacts(facts, "Artefacts, treated as missing", rows)
    if done.uncertainty is not None:
        print_line(f"expected error of each filled sample: {done.uncertainty}")
    _print_plots(done)
    for path in done.further.get("report", ()):
        print_line(f"page that shows the fill: {path}")
    for path in done.further.get("write_overrides", ()):
        print_line(f"overrides, an entry for each gap: {path}")
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


def worth_of_database(result: Result) -> str:
    """Return a line that says how much smaller the database makes errors; empty where unknown.

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    gaps = [g for g in result.gaps if math.isfinite(g.expected_mean_error_without_database_mm)]
    frames = sum(gap.filled for gap in gaps)
    if not frames:
        return ""
    with_it = sum(gap.filled * gap.expected_mean_error_mm for gap in gaps) / frames
    without = sum(gap.filled * gap.expected_mean_error_without_database_mm for gap in gaps) / frames
    return (
        f"the database was used for {len(gaps)} gap{'s' if len(gaps) > 1 else ''}: expected mean "
        f"error {mm_text(with_it)} mm, {mm_text(without)} mm without it"
    )


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


def print_gaps(result: Result, rows: int | None) -> None:
    """Print the gaps, what they were filled from, and the markers if one has several gaps.

    Parameters
    ----------
    result : Result
        Of a fill.
    rows : int or None
        Rows of each table, the worst first; None: all.
    """
    _print_gap_rows(result, rows)
    if len(result.gaps) > len({gap.label for gap in result.gaps}):
        print_line()
        _print_markers(result, rows)


def _print_gap_rows(result: Result, rows: int | None) -> None:
    """Print a row for each gap, the worst first, and what they were filled from."""
    clip = result.clip
    shown = worst_first(result.gaps)[:rows]
    letters = _letters(dict.fromkeys(source for gap in shown for source in gap.sources))
    print_table(
        ("marker", "frames", "s>", "filled>", *_ERRORS, "from"),
        [
            (
                *gap_cells(clip, gap),
                " ".join(letters[source] for source in gap.sources) or "-",
            )
            for gap in shown
        ],
    )
    if len(shown) < len(result.gaps):
        print_line(f"... and {len(result.gaps) - len(shown)} more gaps (--all prints them)")
    for source, letter in letters.items():
        print_line(f"from {letter}: {source}")


def _print_markers(result: Result, rows: int | None) -> None:
    """Print a row for each marker, the worst first."""
    markers = summarise_markers(result.gaps)
    print_table(
        ("marker", "gaps>", "frames>", "filled>", *_ERRORS),
        [
            (
                one.label,
                str(one.gaps),
                str(one.frames),
                share_text(one.filled, one.frames),
                *map(mm_text, (one.expected_mean_error_mm, one.error_bound_90_mm)),
            )
            for one in markers[:rows]
        ],
        title="By marker",
    )
    if rows is not None and len(markers) > rows:
        print_line(f"... and {len(markers) - rows} more markers (--all prints them)")


def _letters(sources: Iterable[str]) -> dict[str, str]:
    """Return a letter for each source; numbers where there are many."""
    names = list(sources)
    signs = ascii_lowercase if len(names) <= len(ascii_lowercase) else map(str, count(1))
    return dict(zip(names, signs, strict=False))


def _print_plots(done: FileResult) -> None:
    """Print where plots are."""
    files = done.further.get("plot")
    if files is None:
        return
    if len(files) == 1:
        print_line(f"plot: {files[0]}")
    elif files:
        print_line(f"plots of {len(files)} markers: {files[0].parent}")
    else:
        print_line("no gaps to plot")


def _written(done: FileResult) -> str:
    """Return where the filled clip is, or how to write it."""
    if done.output is not None:
        return f"written to {done.output}"
    suffix = done.source.suffix or ".c3d"
    return f"dry run, no filled file was written; write it with: -o OUT{suffix}"


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
                "reason": with_options(span.reason),
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
