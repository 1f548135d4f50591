"""What became of an open trial as lines of text, for the terminal of a program."""

from __future__ import annotations

import math

from priorfill.errors import escaped
from priorfill.filling.result import Result
from priorfill.integrations.open_trial import TrialResult
from priorfill.report.result_summary import worst_first

__all__ = ["outcome", "report_lines"]

_COLUMNS = ("marker", "frames", "s", "filled", "expected mean error mm", "error bound 90 mm")

_MAX_GAPS = 40
"""Gaps in the table."""


def outcome(done: TrialResult) -> str:
    """Return what was filled and set, in a line.

    Parameters
    ----------
    done : TrialResult
        Of `priorfill.integrations.open_trial.fill_trial`.
    """
    result = done.result
    requested = [gap for gap in result.gaps if gap.requested]
    if not requested:
        return f"{done.trial} has no gaps to fill; nothing was set in {done.program}"
    complete = sum(gap.complete for gap in requested)
    filled = (
        f"filled {int(result.filled.sum())} samples with {result.method}; "
        f"{complete} of {len(requested)} gaps complete"
    )
    if done.dry_run:
        return f"{filled}; nothing was set in {done.program} (preview)"
    refused = f", {len(done.refused)} not set" if done.refused else ""
    return f"{filled}; {len(done.set_markers)} markers set in {done.program}{refused}, not saved"


def report_lines(done: TrialResult) -> list[str]:
    """Return the table of gaps, notes, and what stays missing; the last line is the outcome.

    Parameters
    ----------
    done : TrialResult
        Of `priorfill.integrations.open_trial.fill_trial`.

    Returns
    -------
    list of str
        Without control characters.
    """
    result = done.result
    lines = _table(result)
    lines += [f"note: {note}" for note in (*done.notes, *result.notes)]
    for gap in result.gaps:
        for span in gap.unfilled:
            first = result.clip.first_frame
            kind = "unfilled" if span.requested else "left alone"
            frames = f"{first + span.start}-{first + span.stop - 1}"
            lines.append(f"{kind}: {gap.label} {frames}: {span.reason}")
    if done.uncertainty is not None:
        lines.append(f"expected error of each filled sample: {done.uncertainty}")
    return [escaped(line) for line in (*lines, outcome(done))]


def _table(result: Result) -> list[str]:
    """Return a row for each gap, the worst first, in columns of equal width."""
    first = result.clip.first_frame
    rows = [
        (
            gap.label,
            f"{first + gap.start}-{first + gap.stop - 1}",
            f"{gap.frames / result.clip.rate:.2f}",
            f"{gap.filled} of {gap.frames}",
            _mm(gap.expected_mean_error_mm),
            _mm(gap.error_bound_90_mm),
        )
        for gap in worst_first(result.gaps)[:_MAX_GAPS]
    ]
    if not rows:
        return []
    widths = [max(map(len, column)) for column in zip(_COLUMNS, *rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in (_COLUMNS, *rows)
    ]
    rest = len(result.gaps) - len(rows)
    return [*lines, *([f"... and {rest} more gaps"] if rest else [])]


def _mm(value: float) -> str:
    """Return a length for the table."""
    return f"{value:.1f}" if math.isfinite(value) else "-"
