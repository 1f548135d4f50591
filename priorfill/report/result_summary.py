"""The gaps of a result from the worst to the best, and a summary of each marker."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.filling.result import FilledGap, Result

__all__ = [
    "MarkerSummary",
    "gap_cells",
    "mm_text",
    "share_text",
    "summarise_markers",
    "summary_text",
    "worst_first",
]


@dataclass(frozen=True)
class MarkerSummary:
    """What became of the gaps of a marker.

    Attributes
    ----------
    label : str
        The marker.
    gaps, frames, filled : int
        Number of its gaps, of their frames, and of the frames that were filled.
    unfilled : int
        Number of frames that were to be filled and are missing.
    expected_mean_error_mm : float
        Expected mean error over the filled frames of all gaps with a known one; NaN without any.
    error_bound_90_mm : float
        The largest of the bounds of its gaps; NaN where none is known.
    """

    label: str
    gaps: int
    frames: int
    filled: int
    unfilled: int
    expected_mean_error_mm: float
    error_bound_90_mm: float


def worst_first(gaps: Iterable[FilledGap]) -> list[FilledGap]:
    """Return gaps in the order in which they should be looked at.

    Those with most unfilled frames come first, then those filled with the greatest expected mean
    error, or the longest where it is unknown; gaps that were not to be filled come last.

    Parameters
    ----------
    gaps : iterable of FilledGap
        Of a result.
    """
    return sorted(gaps, key=_badness, reverse=True)


def summarise_markers(gaps: Iterable[FilledGap]) -> list[MarkerSummary]:
    """Return a summary for each marker with gaps, the worst marker first.

    Parameters
    ----------
    gaps : iterable of FilledGap
        Of a result.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> short = pf.GapFilter(max_gap=0.3)
    >>> result = pf.fill(make_demo_clip()[1], method="linear", gap_filter=short)
    >>> worst = summarise_markers(result.gaps)[0]
    >>> worst.gaps, worst.filled + worst.unfilled == worst.frames
    (2, False)
    """
    by_label: dict[str, list[FilledGap]] = {}
    for gap in worst_first(gaps):
        by_label.setdefault(gap.label, []).append(gap)
    summaries = [_summary(label, own) for label, own in by_label.items()]
    # the order of the worst gap of each marker, except that unfilled frames are counted together
    return sorted(summaries, key=lambda one: -one.unfilled)


def gap_cells(clip: Clip, gap: FilledGap) -> tuple[str, str, str, str, str, str]:
    """Return marker, frames, seconds, filled share, mean error and bound of a gap for a table.

    Parameters
    ----------
    clip : Clip
        The clip; its numbering of frames is used.
    gap : FilledGap
        One of its gaps.
    """
    return (
        gap.label,
        f"{clip.first_frame + gap.start}-{clip.first_frame + gap.stop - 1}",
        f"{gap.frames / clip.rate:.2f}",
        share_text(gap.filled, gap.frames),
        mm_text(gap.expected_mean_error_mm),
        mm_text(gap.error_bound_90_mm),
    )


def share_text(filled: int, frames: int) -> str:
    """Return a share in percent, which is 100 or 0 only where all or none were filled.

    Parameters
    ----------
    filled, frames : int
        Number of filled frames, and of all.
    """
    percent = round(100 * filled / frames)
    if 0 < filled < frames:
        percent = min(max(percent, 1), 99)
    return f"{percent} %"


def mm_text(value: float) -> str:
    """Return a length (mm) for a table; a dash where it is unknown.

    Parameters
    ----------
    value : float
        mm.
    """
    return f"{value:.1f}" if math.isfinite(value) else "-"


def summary_text(result: Result) -> str:
    """Return the numbers of filled samples and complete gaps in a line.

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    requested = [gap for gap in result.gaps if gap.requested]
    complete = sum(gap.complete for gap in requested)
    alone = len(result.gaps) - len(requested)
    return (
        f"filled {int(result.filled.sum())} samples with {result.method}; "
        f"{complete} of {len(requested)} gaps complete" + (f", {alone} left alone" if alone else "")
    )


def _summary(label: str, gaps: list[FilledGap]) -> MarkerSummary:
    known = [gap for gap in gaps if math.isfinite(gap.expected_mean_error_mm)]
    filled = sum(gap.filled for gap in known)
    bounds = [gap.error_bound_90_mm for gap in gaps if math.isfinite(gap.error_bound_90_mm)]
    return MarkerSummary(
        label=label,
        gaps=len(gaps),
        frames=sum(gap.frames for gap in gaps),
        filled=sum(gap.filled for gap in gaps),
        unfilled=sum(_unfilled(gap) for gap in gaps),
        expected_mean_error_mm=(
            sum(gap.filled * gap.expected_mean_error_mm for gap in known) / filled
            if filled
            else math.nan
        ),
        error_bound_90_mm=max(bounds, default=math.nan),
    )


def _unfilled(gap: FilledGap) -> int:
    """Return the number of frames that were to be filled and are missing."""
    return sum(span.stop - span.start for span in gap.unfilled if span.requested)


def _badness(gap: FilledGap) -> tuple[bool, int, float, int]:
    error = gap.expected_mean_error_mm
    return gap.requested, _unfilled(gap), error if math.isfinite(error) else -1.0, gap.frames
