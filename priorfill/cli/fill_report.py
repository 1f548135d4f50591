"""What ``priorfill fill`` prints: a table of the gaps, and notes on stderr."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import count
from string import ascii_lowercase
from typing import TYPE_CHECKING

from priorfill.cli.artefacts import (
    print_artefacts,
    print_left_as_measured,
    warn_of_artefacts,
)
from priorfill.cli.output import MAX_ROWS, print_line, print_table, some_names
from priorfill.report.result_summary import (
    gap_cells,
    mm_text,
    share_text,
    summarise_markers,
    summary_text,
    worst_first,
)

if TYPE_CHECKING:
    from priorfill.filling.fill_file import FileResult
    from priorfill.filling.result import Result

__all__ = [
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


def print_fill(done: FileResult, *, every_row: bool = False) -> None:
    """Print what was done.

    Parameters
    ----------
    done : FileResult
        The fill.
    every_row : bool
        Print all rows of long tables.
    """
    from priorfill.artefacts.artefact_facts import artefact_facts

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
    if done.companions:
        print_line(f"with {', '.join(path.name for path in done.companions)}")
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
    from priorfill.artefacts.artefact_facts import artefact_facts

    result = done.result
    source = result.clip.source
    for note in (
        *(source.notes if source is not None else ()),
        *result.notes,
        *done.report.notes,
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
    from priorfill.formats.bids.names import MOTION, is_motion  # NumPy comes with it

    suffix = done.source.suffix or ".c3d"
    if is_motion(done.source):
        suffix = MOTION
    return f"dry run, no filled file was written; write it with: -o OUT{suffix}"
