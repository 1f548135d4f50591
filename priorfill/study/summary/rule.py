"""Which trials need a hand: the rule of a summary, and its reasons for a trial."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Literal

from priorfill.runtime.option_texts import first_names
from priorfill.study.summary.limits import SummaryLimits
from priorfill.study.summary.trial_figures import LeftSamples, TrialFigures, TrialGap

if TYPE_CHECKING:
    from priorfill.study.job import JobOutcome

__all__ = ["GROUPS", "Attention", "attention", "rule_text"]

Group = Literal["failed", "record again", "look at", "good"]
"""What a person has to do about a trial."""

GROUPS: tuple[Group, ...] = ("failed", "record again", "look at", "good")
"""The groups, worst first."""

MAX_REASONS = 5
"""Reasons of a trial; more are counted."""

MAX_LOST = 2
"""Lost gaps of a trial that are reasons of their own; more are counted, so that the other reasons
are seen as well."""

MAX_NAMES = 3
"""Markers named in a reason; more are counted."""


@dataclass(frozen=True)
class Attention:
    """The group of a trial.

    Attributes
    ----------
    group : str
        ``failed``, ``record again``, ``look at`` or ``good``.
    reasons : tuple of str
        Why, the gravest first; empty for a good one.
    """

    group: Group
    reasons: tuple[str, ...]


def rule_text(limits: SummaryLimits) -> dict[Group, str]:
    """Return the rule as a sentence for each group.

    Parameters
    ----------
    limits : SummaryLimits
        From which values on a trial needs a hand.

    Examples
    --------
    >>> rule_text(SummaryLimits())["failed"]
    'No output was written.'
    """
    long, error = f"{limits.long:g} s", f"{limits.error:g} mm"
    length = "" if limits.gap is None else f"a gap is longer than {long}, "
    return {
        "failed": "No output was written.",
        "record again": f"A gap is longer than {long}, and either more than {long} of it stay "
        f"missing, or its expected mean error is above {error} or unknown.",
        "look at": f"Samples stay missing, {length}the expected mean error of a gap is above "
        f"{error} or unknown, or measured samples may be wrong.",
        "good": "None of these. A marker that no trial of a folder ever shows counts for none of "
        "them: it was not placed, or has another name.",
    }


def attention(
    trial: TrialFigures, limits: SummaryLimits, absent: Collection[str] = ()
) -> Attention:
    """Return the group of a trial, with reasons.

    Parameters
    ----------
    trial : TrialFigures
        The trial.
    limits : SummaryLimits
        From which values on it needs a hand.
    absent : collection of str
        Markers that do not count.
    """
    if trial.failed:
        return Attention("failed", (_failure(trial.outcome),))
    gaps = [gap for gap in trial.gaps if gap.wanted and gap.marker not in absent]
    lost = sorted((gap for gap in gaps if _is_lost(gap, limits)), key=_error, reverse=True)
    reasons = [f"{gap.marker}: {_lost_text(gap)}" for gap in lost[:MAX_LOST]]
    if len(lost) > MAX_LOST:
        reasons.append(f"and {len(lost) - MAX_LOST} more such gaps")
    reasons += _looks(trial, [gap for gap in gaps if gap not in lost], limits)
    if len(reasons) > MAX_REASONS:
        reasons[MAX_REASONS - 1 :] = [f"and {len(reasons) - MAX_REASONS + 1} more reasons"]
    group: Group = "record again" if lost else "look at" if reasons else "good"
    return Attention(group, tuple(reasons))


def _failure(outcome: JobOutcome) -> str:
    """Return why a job failed, without the name of its file, which is next to it."""
    reason = outcome.reason
    for name in (outcome.source, outcome.name, PurePosixPath(outcome.name).name):
        reason = reason.removeprefix(f"{name}: ")
    return reason or "no reason is known"


def _is_lost(gap: TrialGap, limits: SummaryLimits) -> bool:
    """Return whether a gap is too long for so uncertain a fill."""
    left = gap.seconds * gap.left / gap.frames
    return gap.seconds > limits.long and (left > limits.long or _is_uncertain(gap, limits))


def _error(gap: TrialGap) -> float:
    """Return the expected mean error of a gap (mm); an unknown one is the greatest."""
    return gap.error if math.isfinite(gap.error) else math.inf


def _is_uncertain(gap: TrialGap, limits: SummaryLimits) -> bool:
    """Return whether what is filled of a gap may be wrong."""
    return gap.filled > 0 and not gap.error <= limits.error


def _lost_text(gap: TrialGap) -> str:
    where = f"frames {gap.first_frame}-{gap.last_frame} ({gap.seconds:.2f} s)"
    if not gap.filled:
        return f"{where} stay missing"
    left = f", {gap.left} frames stay missing" if gap.left else ""
    return f"{where}: {_error_text(gap)}{left}"


def _error_text(gap: TrialGap) -> str:
    if not math.isfinite(gap.error):
        return "how far off the fill is, is not known"
    return f"expected error {gap.error:.0f} mm"


def _looks(trial: TrialFigures, gaps: list[TrialGap], limits: SummaryLimits) -> Iterator[str]:
    """Yield why a trial should be looked at, apart from gaps that are lost."""
    uncertain = [gap for gap in gaps if _is_uncertain(gap, limits)]
    if uncertain:
        worst = max(uncertain, key=_error)
        others = f"above {limits.error:g} mm or unknown"
        yield _gap_text(worst, _error_text(worst), len(uncertain), others)
    long = [gap for gap in gaps if gap.seconds > limits.long and gap not in uncertain]
    if long and limits.gap is not None:
        longest = max(long, key=lambda gap: gap.seconds)
        others = f"longer than {limits.long:g} s"
        yield _gap_text(longest, f"{longest.seconds:.2f} s long", len(long), others)
    if trial.doubtful:
        kinds = ", ".join(
            f"{kind.replace('_', ' ')} ({count})" for kind, count in trial.artefacts.items()
        )
        yield f"measured samples may be wrong: {kinds}"
    markers = {gap.marker for gap in gaps if gap.left}
    for one in trial.left:
        if one.requested and markers.intersection(one.markers):
            yield _left_text(one)


def _left_text(left: LeftSamples) -> str:
    names = first_names(left.markers, MAX_NAMES)
    return f"{left.samples} samples of {names} stay missing: {left.reason}"


def _gap_text(gap: TrialGap, what: str, gaps: int, others: str) -> str:
    """Return what is the matter with the worst of some gaps."""
    text = f"{gap.marker}, frames {gap.first_frame}-{gap.last_frame}: {what}"
    return text if gaps == 1 else f"{text}, the worst of {gaps} gaps {others}"
