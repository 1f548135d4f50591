"""Markers over a study: which of them falls off, in which trials, and for how long."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from priorfill.study.summary.trial_figures import TrialFigures, TrialMarker, mean_error

__all__ = ["StudyMarker", "absent_markers", "study_markers"]

MIN_TRIALS = 2
"""Trials of a folder from which on a marker that none of them shows counts as absent."""


@dataclass(frozen=True)
class StudyMarker:
    """A marker over all trials in which it has gaps.

    Attributes
    ----------
    label : str
        Without the subject.
    trials : int
        Number of trials in which it has gaps.
    gaps, frames, filled, left : int
        Number of its gaps, of their frames, of the filled ones, and of those that were to be filled
        and are missing.
    left_trials, throughout_trials : int
        Number of trials in which frames of it stay missing, and in which it is never measured.
    share : float
        Missing share of the frames of these trials; NaN where unknown.
    longest : float
        Its longest gap (s).
    error : float
        Expected mean error over its filled frames (mm); NaN where unknown.
    worst : float
        The greatest expected mean error of its gaps (mm); NaN where unknown.
    absent : tuple of str
        Folders in which no trial shows it.
    """

    label: str
    trials: int
    gaps: int
    frames: int
    filled: int
    left: int
    left_trials: int
    throughout_trials: int
    share: float
    longest: float
    error: float
    worst: float
    absent: tuple[str, ...]


def absent_markers(trials: Sequence[TrialFigures]) -> frozenset[str]:
    """Return the markers that no trial of a folder shows, although each has their labels.

    They were not placed, or have other names; a single trial cannot tell.

    Parameters
    ----------
    trials : sequence of TrialFigures
        Of one folder; failed ones do not count.
    """
    known = [one for one in trials if not one.failed]
    if len(known) < MIN_TRIALS:
        return frozenset()
    return frozenset.intersection(
        *(frozenset(marker.label for marker in one.markers if marker.throughout) for one in known)
    )


def study_markers(
    trials: Iterable[TrialFigures], absent: Mapping[str, frozenset[str]]
) -> tuple[StudyMarker, ...]:
    """Return the markers with gaps, that with most frames to be filled first.

    Frames that were to be left alone, and those of folders in which it is absent, do not count.

    Parameters
    ----------
    trials : iterable of TrialFigures
        All of the study.
    absent : mapping of str to frozenset of str
        Markers that no trial of a folder shows, by folder.
    """
    by_label: dict[str, list[tuple[TrialFigures, TrialMarker]]] = {}
    for trial in trials:
        for marker in trial.markers:
            by_label.setdefault(marker.label, []).append((trial, marker))
    lost = {label: _lost(label, own, absent) for label, own in by_label.items()}
    return tuple(
        _marker(label, by_label[label], absent)
        for label in sorted(by_label, key=lambda label: (-lost[label], label))
    )


def _lost(
    label: str,
    own: Sequence[tuple[TrialFigures, TrialMarker]],
    absent: Mapping[str, frozenset[str]],
) -> int:
    """Return the number of frames to be filled, where the folder has the marker."""
    return sum(
        marker.filled + marker.left for trial, marker in own if label not in absent[trial.folder]
    )


def _marker(
    label: str,
    own: Sequence[tuple[TrialFigures, TrialMarker]],
    absent: Mapping[str, frozenset[str]],
) -> StudyMarker:
    markers = [marker for _, marker in own]
    frames = sum(marker.frames for marker in markers)
    # frames of a marker of two subjects count for both
    whole = [one.frames / one.share if one.share else math.nan for one in markers]
    folders = dict.fromkeys(trial.folder for trial, _ in own)
    return StudyMarker(
        label=label,
        trials=len(markers),
        gaps=sum(one.gaps for one in markers),
        frames=frames,
        filled=sum(one.filled for one in markers),
        left=sum(one.left for one in markers),
        left_trials=sum(one.left > 0 for one in markers),
        throughout_trials=sum(one.throughout for one in markers),
        share=frames / sum(whole),
        longest=max(one.longest for one in markers),
        error=mean_error(markers),
        worst=max((one.worst for one in markers if math.isfinite(one.worst)), default=math.nan),
        absent=tuple(name for name in folders if label in absent[name]),
    )
