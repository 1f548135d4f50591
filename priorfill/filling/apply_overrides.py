"""Divide the gaps of a clip among methods as overrides specify, and join the results."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.filling.assemble import expected_errors
from priorfill.filling.assign_overrides import AppliedOverrides
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.overrides import Overrides
from priorfill.filling.result import FilledGap, Result
from priorfill.filling.run_settings import RunSettings
from priorfill.gaps import Gap, GapGroup, find_gaps, runs
from priorfill.markers.phantoms import Phantom

__all__ = ["MethodRun", "join_runs", "plan_runs"]

IN_ANOTHER_WAY = "filled in another way"
"""Reason for which one of several runs leaves a gap alone; dropped when runs are joined."""


@dataclass(frozen=True)
class MethodRun:
    """The gaps of a clip that are filled in one way.

    Attributes
    ----------
    settings : RunSettings
        The method, and what it sees and learns from.
    left_alone : tuple of (Gap, str)
        Missing samples that it does not fill, with the reason.
    skipped : tuple of (Gap, str)
        Those of them that decide which gap groups the method gets: groups with a sample that is
        not among them. What else is left alone in these groups is dropped from the estimate.
    groups : tuple of GapGroup
        These gap groups.
    """

    settings: RunSettings
    left_alone: tuple[tuple[Gap, str], ...]
    skipped: tuple[tuple[Gap, str], ...]
    groups: tuple[GapGroup, ...] = ()

    @property
    def method(self) -> str:
        """The method."""
        return self.settings.method

    @property
    def samples(self) -> int:
        """Number of missing samples of the gap groups."""
        return sum(group.samples for group in self.groups)


def plan_runs(
    clip: Clip,
    settings: Sequence[RunSettings | None],
    gap_filter: GapFilter,
    applied: AppliedOverrides | None = None,
    overrides: Overrides | None = None,
    phantoms: Sequence[Phantom] = (),
) -> tuple[MethodRun, ...]:
    """Divide the gaps of a clip among methods.

    Parameters
    ----------
    clip : Clip
        The clip, without samples that are treated as missing.
    settings : sequence of (RunSettings or None)
        For gaps without an override, then for each override.
    gap_filter : GapFilter
        The gaps to fill; those that it leaves alone stay alone, whatever the overrides are.
    applied, overrides : AppliedOverrides, Overrides, optional
        What the overrides mean for the clip, and the overrides.
    phantoms : sequence of Phantom
        Trajectories to be left alone, unless the gap filter names markers.

    Returns
    -------
    tuple of MethodRun
        At least one: a method also reports on clips without a gap to fill. That of the default
        gets the same gap groups whatever the overrides are, so that gaps without an override are
        filled as if there were none.
    """
    default = settings[0]
    assert default is not None
    filtered = gap_filter.left_alone(clip)
    if phantoms and not gap_filter.markers:
        reasons = {phantom.marker: phantom.reason for phantom in phantoms}
        filtered = [item for item in filtered if item[0].marker not in reasons]
        filtered += [
            (gap, reasons[gap.marker]) for gap in find_gaps(clip.missing) if gap.marker in reasons
        ]
    if applied is None or overrides is None:
        return (MethodRun(default, tuple(filtered), tuple(filtered)),)
    kinds: list[RunSettings] = []
    for one in settings:
        if one is not None and one not in kinds:
            kinds.append(one)
    leaving = len(kinds)
    kind_of = np.array([leaving if one is None else kinds.index(one) for one in settings])
    kind = kind_of[applied.number]
    open_ = clip.missing
    for gap, _ in filtered:
        open_[gap.start : gap.stop, gap.marker] = False
    left = open_ & (kind == leaving)
    left_alone = [*filtered, *_as_left_alone(left, f"left alone by {overrides.name}")]
    open_ &= ~left
    used = [number for number in range(len(kinds)) if (open_ & (kind == number)).any()]
    runs_of_kinds = []
    for number in used or [0]:
        alone = (*left_alone, *_as_left_alone(open_ & (kind != number), IN_ANOTHER_WAY))
        skipped = tuple(filtered) if number == 0 else alone
        runs_of_kinds.append(MethodRun(kinds[number], alone, skipped))
    return tuple(runs_of_kinds)


def join_runs(clip: Clip, applied: AppliedOverrides, results: Sequence[Result]) -> Result:
    """Make one result of those of several methods, which fill different samples.

    Parameters
    ----------
    clip : Clip
        The clip before overrides removed samples.
    applied : AppliedOverrides
        What the overrides mean for it.
    results : sequence of Result
        One for each method.

    Returns
    -------
    Result
        Samples that were treated as missing and could not be filled keep their measured position;
        a note names them.
    """
    positions = applied.clip.positions.copy()
    filled = np.zeros_like(applied.removed)
    expected_rms, bound = np.full(filled.shape, np.nan), np.full(filled.shape, np.nan)
    for result in results:
        positions[result.filled] = result.clip.positions[result.filled]
        expected_rms[result.filled] = result.expected_rms_mm[result.filled]
        bound[result.filled] = result.error_bound_90_mm[result.filled]
        filled |= result.filled
    notes = [*applied.notes, *(note for result in results for note in result.notes)]
    kept = applied.removed & ~filled
    if kept.any():
        positions[kept] = clip.positions[kept]
        labels = ", ".join(clip.labels[marker] for marker in np.flatnonzero(kept.any(axis=0)))
        notes.append(
            f"{int(kept.sum())} samples of {labels} that were treated as missing could not be "
            "filled; they are written as measured"
        )
    doubtful = [result.doubtful for result in results if result.doubtful is not None]
    clips = dict.fromkeys(clip for one in results for clip in one.provenance.source_clips)
    by_gap = zip(*(result.gaps for result in results), strict=True)
    return replace(
        results[0],
        clip=clip.with_positions(positions),
        filled=filled,
        expected_rms_mm=expected_rms,
        error_bound_90_mm=bound,
        gaps=tuple(_join_gap(clip, same, expected_rms, bound) for same in by_gap),
        method=_joined_names(result.method for result in results),
        doubtful=np.logical_or.reduce(doubtful) if doubtful else None,
        notes=tuple(dict.fromkeys(notes)),
        provenance=replace(results[0].provenance, source_clips=tuple(clips)),
    )


def _joined_names(methods: Iterable[str]) -> str:
    """Return the names of methods, each once."""
    return " and ".join(dict.fromkeys(methods))


def _as_left_alone(mask: NDArray[np.bool_], reason: str) -> list[tuple[Gap, str]]:
    """Return the runs of a mask [shape=(frames, markers)] as samples to be left alone."""
    return [
        (Gap(start, stop, marker), reason)
        for marker in range(mask.shape[1])
        for start, stop in runs(mask[:, marker])
    ]


def _join_gap(
    clip: Clip,
    same: Sequence[FilledGap],
    expected_rms: NDArray[np.float64],
    error_bound_90: NDArray[np.float64],
) -> FilledGap:
    """Make one record of those of several methods on the same gap."""
    first = same[0]
    inside = slice(first.start, first.stop), clip.labels.index(first.label)
    rms, mean, bound = expected_errors(expected_rms[inside], error_bound_90[inside])
    unfilled = {span for gap in same for span in gap.unfilled if span.reason != IN_ANOTHER_WAY}
    working = [gap for gap in same if gap.filled] or [gap for gap in same if gap.requested]
    return replace(
        first,
        filled=sum(gap.filled for gap in same),
        expected_rms_mm=rms,
        expected_mean_error_mm=mean,
        error_bound_90_mm=bound,
        method=_joined_names(gap.method for gap in working) or first.method,
        sources=tuple(dict.fromkeys(source for gap in same for source in gap.sources)),
        training_poses=max(gap.training_poses for gap in same),
        unfilled=tuple(sorted(unfilled, key=lambda span: (span.start, span.reason))),
        source_clips=tuple(dict.fromkeys(name for gap in working for name in gap.source_clips)),
        expected_mean_error_without_database_mm=float("nan"),
    )
