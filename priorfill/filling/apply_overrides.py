"""Fill a clip as it was decided: several methods, each for its gaps, and one result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts import Artefact, without_artefacts
from priorfill.clip import Clip
from priorfill.database import PriorDatabase, Selection
from priorfill.filling.fill_clip import after_rejecting, expected_errors, fill
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.overrides import LEAVE, Override, Overrides
from priorfill.filling.result import FilledGap, Result
from priorfill.gaps import Gap, runs
from priorfill.markers.marker_set import MarkerSet
from priorfill.methods import resolve

__all__ = ["fill_with_overrides"]

_OTHERS = "filled by another method"
"""Reason for which a method leaves alone what is decided otherwise; nobody sees it."""


@dataclass(frozen=True)
class _Part(GapFilter):
    """What is left of a clip for one method."""

    alone: tuple[tuple[Gap, str], ...] = ()

    def left_alone(self, clip: Clip) -> list[tuple[Gap, str]]:
        """Return what is not to be filled, which was found out before."""
        del clip
        return list(self.alone)


def fill_with_overrides(
    clip: Clip,
    overrides: Overrides,
    *,
    method: str = "auto",
    gap_filter: GapFilter | None = None,
    database: PriorDatabase | str | Path | None = None,
    marker_set: MarkerSet | None = None,
    progress: Callable[[int, int], None] | None = None,
    selection: Selection | None = None,
    trust_filled: bool = False,
    same_subject: Sequence[Clip] = (),
    reject_artefacts: bool = False,
) -> Result:
    """Fill the gaps of a clip, some of them by another method than the rest, or not at all.

    Parameters
    ----------
    clip : Clip
        With gaps.
    decisions : Decisions
        What is to be done with which.
    method : str
        For gaps on which nothing is decided.
    scope : Scope, optional
        Which gaps to fill. What it leaves alone stays alone, whatever is decided.
    database, marker_set, progress, selection, trust_filled, companions, reject_outliers
        As `priorfill.fill` takes them.

    Returns
    -------
    Result
        Samples that were taken as missing and could not be filled are in it as they were
        measured, with a note.

    Raises
    ------
    PriorfillError
        As `priorfill.fill` does, and an OptionError where decisions do not fit the clip.
    """
    measured = clip
    artefacts: tuple[Artefact, ...] = ()
    if reject_artefacts:
        clip, artefacts = without_artefacts(measured)
    decided = overrides.apply(clip)
    asked = (gap_filter or GapFilter()).left_alone(decided.clip)
    default = resolve(method)
    does = [default, *(one.do for one in overrides.entries)]
    names = list(dict.fromkeys(does))  # what can become of a sample, the default first
    what = np.array([names.index(one) for one in does])[decided.fate]
    open_ = decided.clip.missing.copy()
    for gap, _ in asked:
        open_[gap.start : gap.stop, gap.marker] = False
    if LEAVE in names:
        left = open_ & (what == names.index(LEAVE))
        asked += _pieces(left, f"left alone by {overrides.path}")
        open_ &= ~left
    used = [number for number in range(len(names)) if (open_ & (what == number)).any()]
    results = [
        fill(
            decided.clip,
            method=names[number],
            gap_filter=_Part(alone=(*asked, *_pieces(open_ & (what != number), _OTHERS))),
            database=database,
            marker_set=marker_set,
            progress=progress,
            selection=selection,
            trust_filled=trust_filled,
            same_subject=same_subject,
        )
        for number in used or [0]
    ]
    return after_rejecting(_joined(clip, decided, results), measured, artefacts)


def _pieces(mask: NDArray[np.bool_], reason: str) -> list[tuple[Gap, str]]:
    """Return the runs of a mask [shape=(frames, markers)] as what is left alone."""
    return [
        (Gap(start, stop, marker), reason)
        for marker in range(mask.shape[1])
        for start, stop in runs(mask[:, marker])
    ]


def _joined(clip: Clip, decided: Override, results: Sequence[Result]) -> Result:
    """Make one result of those of several methods, which fill different samples."""
    first = results[0]
    positions = decided.clip.positions.copy()
    filled = np.zeros_like(decided.removed)
    expected_rms, bound = np.full(filled.shape, np.nan), np.full(filled.shape, np.nan)
    for result in results:
        positions[result.filled] = result.clip.positions[result.filled]
        expected_rms[result.filled] = result.expected_rms[result.filled]
        bound[result.filled] = result.error_bound_90[result.filled]
        filled |= result.filled
    notes = [*decided.notes, *(note for result in results for note in result.notes)]
    kept = decided.removed & ~filled
    if kept.any():
        positions[kept] = clip.positions[kept]
        labels = ", ".join(clip.labels[marker] for marker in np.flatnonzero(kept.any(axis=0)))
        notes.append(
            f"{int(kept.sum())} samples of {labels} that were taken as missing could not be "
            "filled; they are written as they were"
        )
    by_gap = zip(*(result.gaps for result in results), strict=True)
    return replace(
        first,
        clip=clip.with_positions(positions),
        filled=filled,
        expected_rms=expected_rms,
        error_bound_90=bound,
        gaps=tuple(_joined_gap(clip, same, expected_rms, bound) for same in by_gap),
        method=" and ".join(result.method for result in results),
        notes=tuple(dict.fromkeys(notes)),
    )


def _joined_gap(
    clip: Clip,
    same: Sequence[FilledGap],
    expected_rms: NDArray[np.float64],
    bound: NDArray[np.float64],
) -> FilledGap:
    """Make one account of those of several methods on the same gap."""
    first = same[0]
    inside = slice(first.start, first.stop), clip.labels.index(first.label)
    error, mean, common = expected_errors(expected_rms[inside], bound[inside])
    left = {part for gap in same for part in gap.unfilled if part.reason != _OTHERS}
    did = [gap for gap in same if gap.filled] or [
        gap for gap in same if any(part.requested for part in gap.unfilled)
    ]
    return replace(
        first,
        filled=sum(gap.filled for gap in same),
        expected_rms=error,
        expected_mean_error=mean,
        error_bound_90=common,
        method=" and ".join(gap.method for gap in did) or first.method,
        sources=tuple(dict.fromkeys(how for gap in same for how in gap.sources)),
        training_poses=max(gap.training_poses for gap in same),
        unfilled=tuple(sorted(left, key=lambda part: (part.start, part.reason))),
        source_clips=tuple(dict.fromkeys(take for gap in did for take in gap.source_clips)),
    )
