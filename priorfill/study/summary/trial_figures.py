"""What a summary states of one trial: figures from the outcome of its job."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Any, Protocol

from priorfill.study.job import FAILED, JobOutcome

__all__ = [
    "LeftSamples",
    "TrialFigures",
    "TrialGap",
    "TrialMarker",
    "mean_error",
    "trial_figures",
]


@dataclass(frozen=True)
class TrialGap:
    """A gap of a trial.

    Attributes
    ----------
    marker : str
        Its label, without the subject.
    first_frame, last_frame, frames : int
        Frames as the file numbers them, and their number.
    seconds : float
        Length (s).
    filled : int
        Number of filled frames.
    left : int
        Number of frames that were to be filled and are missing.
    error, bound : float
        Expected mean error, and the bound of 90 % of the errors (mm); NaN where unknown.
    throughout : bool
        Whether the marker is missing in the whole trial.
    """

    marker: str
    first_frame: int
    last_frame: int
    frames: int
    seconds: float
    filled: int
    left: int
    error: float
    bound: float
    throughout: bool

    @property
    def wanted(self) -> bool:
        """Whether at least a part of it was to be filled."""
        return self.filled + self.left > 0


@dataclass(frozen=True)
class TrialMarker:
    """What became of a marker with gaps in a trial; subjects with the same label together.

    Attributes
    ----------
    label : str
        Without the subject.
    gaps, frames, filled, left : int
        Number of its gaps, of their frames, of the filled ones, and of those that were to be filled
        and are missing.
    share : float
        Missing share of the frames; NaN where the number of frames is unknown.
    longest : float
        Its longest gap (s).
    error : float
        Expected mean error over all filled frames (mm); NaN where unknown.
    worst : float
        The greatest expected mean error of its gaps (mm).
    throughout : bool
        Whether it is missing in the whole trial.
    """

    label: str
    gaps: int
    frames: int
    filled: int
    left: int
    share: float
    longest: float
    error: float
    worst: float
    throughout: bool


@dataclass(frozen=True)
class LeftSamples:
    """Samples that stay missing for one reason.

    Attributes
    ----------
    reason : str
        A sentence.
    requested : bool
        Whether they were to be filled.
    samples : int
        Their number.
    markers : tuple of str
        Their labels.
    first_frame, last_frame : int
        Frames that they are within, as the file numbers them.
    """

    reason: str
    requested: bool
    samples: int
    markers: tuple[str, ...]
    first_frame: int
    last_frame: int


@dataclass(frozen=True)
class TrialFigures:
    """Figures of a trial; all zero or NaN where its job failed.

    Attributes
    ----------
    outcome : JobOutcome
        What they are from, without its facts, which can be large.
    folder : str
        Path of its folder within the study; ``.`` for the study itself.
    subjects : tuple of str
        Names of the subjects; those without a name left out.
    frames : int
        Number of frames; 0 where unknown.
    samples : int
        Number of frames times markers; 0 where unknown.
    rate : float
        Frame rate (Hz); NaN where unknown.
    method, marker_set, database : str
        Their names, and the path of the database; empty where unknown or none.
    notes : tuple of str
        What the fill notes.
    gaps : tuple of TrialGap
        Worst first: most frames left, then the greatest expected error, then the longest.
    markers : tuple of TrialMarker
        Those with gaps, by label.
    left : tuple of LeftSamples
        What stays missing and why, most samples first.
    artefacts : mapping of str to int
        Number of artefacts by kind.
    doubtful : int
        Number of artefacts that stay as measured.
    """

    outcome: JobOutcome
    folder: str
    subjects: tuple[str, ...]
    frames: int
    samples: int
    rate: float
    method: str
    marker_set: str
    database: str
    notes: tuple[str, ...]
    gaps: tuple[TrialGap, ...]
    markers: tuple[TrialMarker, ...]
    left: tuple[LeftSamples, ...]
    artefacts: Mapping[str, int]
    doubtful: int

    @property
    def failed(self) -> bool:
        """Whether the job failed."""
        return self.outcome.status == FAILED

    @property
    def missing(self) -> int:
        """Number of samples in gaps."""
        return sum(gap.frames for gap in self.gaps)

    @property
    def filled(self) -> int:
        """Number of filled samples."""
        return sum(gap.filled for gap in self.gaps)

    @property
    def kept(self) -> int:
        """Number of samples in gaps that were not to be filled."""
        return self.missing - self.filled - self.left_samples

    @property
    def left_samples(self) -> int:
        """Number of samples that were to be filled and are missing."""
        return sum(gap.left for gap in self.gaps)

    @property
    def missing_share(self) -> float:
        """Share of the samples that are in gaps; NaN where unknown."""
        return self.missing / self.samples if self.samples else math.nan

    @property
    def longest(self) -> TrialGap | None:
        """The longest gap that was to be filled."""
        wanted = [gap for gap in self.gaps if gap.wanted]
        return max(wanted, key=lambda gap: gap.seconds, default=None)

    @property
    def least_certain(self) -> TrialGap | None:
        """The gap with the greatest expected mean error."""
        known = [gap for gap in self.gaps if math.isfinite(gap.error)]
        return max(known, key=lambda gap: gap.error, default=None)

    @property
    def error(self) -> float:
        """Expected mean error over all filled samples (mm); NaN where unknown."""
        return mean_error(self.gaps)

    @property
    def bound(self) -> float:
        """The greatest 90 % bound of the gaps (mm); NaN where unknown."""
        return max((gap.bound for gap in self.gaps if math.isfinite(gap.bound)), default=math.nan)


def trial_figures(outcome: JobOutcome) -> TrialFigures:
    """Return the figures of a trial.

    Values that the facts lack, as those of another version may, count as unknown.

    Parameters
    ----------
    outcome : JobOutcome
        Of its job.

    Examples
    --------
    >>> gap = {"marker": "C7", "frames": 9, "seconds": 0.09, "filled": 9}
    >>> facts = {"gaps": [gap], "frames": 300}
    >>> outcome = JobOutcome("P01/a.c3d", "/in/a.c3d", "/out/a.c3d", "filled", facts=facts)
    >>> figures = trial_figures(outcome)
    >>> figures.folder, figures.filled, figures.markers[0].share
    ('P01', 9, 0.03)
    """
    facts = outcome.facts
    frames = int(facts.get("frames") or 0)
    subjects = facts.get("subjects") or ()
    gaps = sorted((_gap(one, frames) for one in facts.get("gaps") or ()), key=_badness)
    artefacts: dict[str, int] = {}
    for one in facts.get("artefacts") or ():
        artefacts[str(one["kind"])] = artefacts.get(str(one["kind"]), 0) + 1
    rejected = bool((facts.get("provenance") or {}).get("reject_artefacts"))
    return TrialFigures(
        outcome=replace(outcome, facts={}),
        folder=str(PurePosixPath(outcome.name).parent),
        subjects=tuple(str(one["subject"]) for one in subjects if one.get("subject")),
        frames=frames,
        samples=int(facts.get("samples") or 0),
        rate=_number(facts.get("rate")),
        method=str(facts.get("method") or ""),
        marker_set=str(facts.get("marker_set") or ""),
        database=str(facts.get("database") or ""),
        notes=tuple(str(note) for note in facts.get("notes") or ()),
        gaps=tuple(gaps),
        markers=tuple(_markers(gaps, frames, facts.get("gaps") or ())),
        left=tuple(_left(facts.get("gaps") or ())),
        artefacts=artefacts,
        doubtful=0 if rejected else sum(artefacts.values()),
    )


def _gap(facts: Mapping[str, Any], frames: int) -> TrialGap:
    length = int(facts["frames"])
    spans = facts.get("unfilled") or ()
    return TrialGap(
        marker=str(facts["marker"]),
        first_frame=int(facts.get("first_frame") or 0),
        last_frame=int(facts.get("last_frame") or 0),
        frames=length,
        seconds=float(facts["seconds"]),
        filled=int(facts["filled"]),
        left=sum(_length(span) for span in spans if span.get("requested", True)),
        error=_number(facts.get("expected_mean_error_mm")),
        bound=_number(facts.get("error_bound_90_mm")),
        throughout=length == frames,
    )


def _badness(gap: TrialGap) -> tuple[int, float, float]:
    return -gap.left, -gap.error if math.isfinite(gap.error) else 0.0, -gap.seconds


def _markers(
    gaps: Sequence[TrialGap], frames: int, facts: Sequence[Mapping[str, Any]]
) -> Iterable[TrialMarker]:
    """Yield the markers with gaps, by label."""
    by_label: dict[str, list[TrialGap]] = {}
    for gap in gaps:
        by_label.setdefault(gap.marker, []).append(gap)
    subjects: dict[str, set[str]] = {}
    for one in facts:
        subjects.setdefault(str(one["marker"]), set()).add(str(one.get("subject", "")))
    for label, own in sorted(by_label.items()):
        missing = sum(gap.frames for gap in own)
        errors = [gap.error for gap in own if math.isfinite(gap.error)]
        yield TrialMarker(
            label=label,
            gaps=len(own),
            frames=missing,
            filled=sum(gap.filled for gap in own),
            left=sum(gap.left for gap in own),
            share=missing / (frames * len(subjects[label])) if frames else math.nan,
            longest=max(gap.seconds for gap in own),
            error=mean_error(own),
            worst=max(errors, default=math.nan),
            throughout=any(gap.throughout for gap in own),
        )


def _left(gaps: Sequence[Mapping[str, Any]]) -> list[LeftSamples]:
    """Return what stays missing, one entry a reason."""
    found: dict[tuple[bool, str], list[tuple[str, Mapping[str, Any]]]] = {}
    for gap in gaps:
        for span in gap.get("unfilled") or ():
            why = bool(span.get("requested", True)), str(span.get("reason", ""))
            found.setdefault(why, []).append((str(gap["marker"]), span))
    left = [
        LeftSamples(
            reason=reason,
            requested=requested,
            samples=sum(_length(span) for _, span in spans),
            markers=tuple(dict.fromkeys(marker for marker, _ in spans)),
            first_frame=min(int(span["first_frame"]) for _, span in spans),
            last_frame=max(int(span["last_frame"]) for _, span in spans),
        )
        for (requested, reason), spans in found.items()
    ]
    return sorted(left, key=lambda one: (not one.requested, -one.samples))


def _length(span: Mapping[str, Any]) -> int:
    return int(span["last_frame"]) - int(span["first_frame"]) + 1


class _Filled(Protocol):
    """Gaps, markers and trials: filled samples, and their expected mean error (mm)."""

    @property
    def filled(self) -> int: ...

    @property
    def error(self) -> float: ...


def mean_error(parts: Iterable[_Filled]) -> float:
    """Return the expected mean error over all filled samples (mm); NaN where unknown.

    Parameters
    ----------
    parts : iterable of TrialGap, TrialMarker or TrialFigures
        What has been filled.
    """
    known = [one for one in parts if one.filled and math.isfinite(one.error)]
    filled = sum(one.filled for one in known)
    return sum(one.filled * one.error for one in known) / filled if filled else math.nan


def _number(value: object) -> float:
    try:
        return float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:  # an integer of a damaged record
        return math.nan
