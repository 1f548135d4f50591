"""The summary of a study: trials worst first, markers, folders, and what happened in a sentence."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from priorfill.study.job import FAILED, FILLED, INCOMPLETE, NO_GAPS, JobOutcome
from priorfill.study.summary.limits import SummaryLimits
from priorfill.study.summary.marker_figures import StudyMarker, absent_markers, study_markers
from priorfill.study.summary.rule import GROUPS, Attention, attention
from priorfill.study.summary.trial_figures import TrialFigures, mean_error, trial_figures

__all__ = ["StudyContents", "StudyPart", "StudySummary", "SummaryTrial", "summarise_study"]


@dataclass(frozen=True)
class StudyContents:
    """What a summary states besides the outcomes.

    Attributes
    ----------
    name : str
        Of the study.
    waiting : tuple of str
        Names of the jobs that have no outcome yet.
    seconds : float
        Wall time of the study (s); NaN where unknown.
    """

    name: str = "study"
    waiting: tuple[str, ...] = ()
    seconds: float = math.nan


@dataclass(frozen=True)
class SummaryTrial:
    """A trial with the group that it belongs to.

    Attributes
    ----------
    figures : TrialFigures
        Its figures.
    attention : Attention
        Its group, with reasons.
    """

    figures: TrialFigures
    attention: Attention


@dataclass(frozen=True)
class StudyPart:
    """The trials of a folder or of a subject.

    Attributes
    ----------
    name : str
        Path of the folder within the study, ``.`` for the study itself; or name of the subject.
    subjects, folders : tuple of str
        Names of the subjects in its files, and the folders that these are in.
    trials : int
        Number of trials.
    groups : mapping of str to int
        Number of trials by group.
    missing, samples, filled, left : int
        Number of samples in gaps, of all samples (0 where unknown), of the filled ones, and of
        those that were to be filled and are missing.
    error : float
        Expected mean error over the filled samples (mm); NaN where unknown.
    worst_marker : str
        The marker with most frames to be filled, except one that is absent; empty without gaps.
    absent : tuple of str
        Markers that are missing in every trial from the first to the last frame.
    seconds : float
        Wall time of its jobs (s).
    """

    name: str
    subjects: tuple[str, ...]
    folders: tuple[str, ...]
    trials: int
    groups: Mapping[str, int]
    missing: int
    samples: int
    filled: int
    left: int
    error: float
    worst_marker: str
    absent: tuple[str, ...]
    seconds: float


@dataclass(frozen=True)
class StudySummary:
    """A study, as a person reads it.

    Attributes
    ----------
    trials : tuple of SummaryTrial
        Worst first.
    markers : tuple of StudyMarker
        Those with gaps; the one with most frames to be filled first.
    folders, subjects : tuple of StudyPart
        By name; without subjects that have none.
    limits : SummaryLimits
        Of the rule.
    contents : StudyContents
        What else is known.
    """

    trials: tuple[SummaryTrial, ...]
    markers: tuple[StudyMarker, ...]
    folders: tuple[StudyPart, ...]
    subjects: tuple[StudyPart, ...]
    limits: SummaryLimits
    contents: StudyContents

    @property
    def groups(self) -> dict[str, int]:
        """Number of trials by group."""
        counts = Counter(one.attention.group for one in self.trials)
        return {group: counts[group] for group in GROUPS}

    @property
    def statuses(self) -> dict[str, int]:
        """Number of trials by status."""
        counts = Counter(one.figures.outcome.status for one in self.trials)
        return {status: counts[status] for status in (FILLED, INCOMPLETE, NO_GAPS, FAILED)}

    @property
    def facts(self) -> dict[str, str]:
        """Names of the databases and methods that the trials were filled with."""
        figures = [one.figures for one in self.trials]
        parts = [
            ("Database", [Path(one.database).name for one in figures if one.database]),
            ("Method", [one.method for one in figures if one.method]),
        ]
        return {name: ", ".join(dict.fromkeys(values)) for name, values in parts if values}

    @property
    def sentence(self) -> str:
        """What happened."""
        statuses = self.statuses
        parts = [
            (statuses[FILLED], "filled completely"),
            (statuses[INCOMPLETE], "filled in part"),
            (statuses[NO_GAPS], "without gaps"),
            (statuses[FAILED], "failed"),
            (len(self.contents.waiting), "not done yet"),
        ]
        trials = len(self.trials) + len(self.contents.waiting)
        return f"{_count(trials, 'trial')}: {_listed(parts) or 'nothing was done'}."

    @property
    def to_do(self) -> str:
        """What a person has to do, in a sentence."""
        groups = self.groups
        hands = len(self.trials) - groups["good"]
        if not hands:
            return "None needs a hand."
        parts = [
            (groups["failed"], "failed"),
            (groups["record again"], "to record again"),
            (groups["look at"], "to look at"),
        ]
        return f"{hands:,} need{'s' if hands == 1 else ''} a hand: {_listed(parts)}."


def summarise_study(
    outcomes: Iterable[JobOutcome],
    limits: SummaryLimits | None = None,
    contents: StudyContents | None = None,
) -> StudySummary:
    """Return the summary of a study.

    Parameters
    ----------
    outcomes : iterable of JobOutcome
        In any order.
    limits : SummaryLimits, optional
        From which values on a trial needs a hand.
    contents : StudyContents, optional
        What else is known.

    Examples
    --------
    >>> gap = {"marker": "C7", "frames": 9, "seconds": 0.09, "filled": 9}
    >>> gap["expected_mean_error_mm"] = 3.0
    >>> done = JobOutcome("a.c3d", "/in/a.c3d", "/out/a.c3d", "filled", facts={"gaps": [gap]})
    >>> lost = JobOutcome("b.c3d", "/in/b.c3d", "/out/b.c3d", "failed", reason="no markers")
    >>> summary = summarise_study([done, lost])
    >>> summary.sentence, summary.to_do
    ('2 trials: 1 filled completely, 1 failed.', '1 needs a hand: 1 failed.')
    """
    limits = limits or SummaryLimits()
    figures = sorted((_figures(one) for one in outcomes), key=_by_name)
    by_folder: dict[str, list[TrialFigures]] = {}
    for one in figures:
        by_folder.setdefault(one.folder, []).append(one)
    absent = {name: absent_markers(own) for name, own in by_folder.items()}
    rated = {
        name: [SummaryTrial(one, attention(one, limits, absent[name])) for one in own]
        for name, own in by_folder.items()
    }
    trials = sorted(chain.from_iterable(rated.values()), key=lambda one: _by_name(one.figures))
    return StudySummary(
        trials=tuple(sorted(trials, key=_badness)),
        markers=study_markers(figures, absent),
        folders=tuple(_part(name, own, absent[name]) for name, own in rated.items()),
        subjects=_subjects(trials),
        limits=limits,
        contents=contents or StudyContents(),
    )


def _figures(outcome: JobOutcome) -> TrialFigures:
    """Return the figures of a trial; a damaged record must not cost the summary."""
    try:
        return trial_figures(outcome)
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError):
        reason = (
            "the record of its fill is damaged; remove it from .priorfill/records, and the same "
            "command fills the file again"
        )
        return trial_figures(replace(outcome, status=FAILED, reason=reason, facts={}))


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Return by what names are sorted so that numbers in them count as numbers.

    Parameters
    ----------
    name : str
        A path with ``/``.

    Examples
    --------
    >>> sorted(["P10/a", "P9/a", "p9/B"], key=natural_key)
    ['P9/a', 'p9/B', 'P10/a']
    """
    parts = re.split(r"([0-9]+)", name.casefold())
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


def _by_name(trial: TrialFigures) -> tuple[list[tuple[int, int, str]], str]:
    return natural_key(trial.outcome.name), trial.outcome.name


def _badness(trial: SummaryTrial) -> tuple[int, bool, int, float, float]:
    """Return by what trials are sorted, those that are equal staying in order of their names."""
    figures, longest, worst = trial.figures, trial.figures.longest, trial.figures.least_certain
    return (
        GROUPS.index(trial.attention.group),
        not figures.gaps,
        -figures.left_samples,
        -worst.error if worst else 0.0,
        -longest.seconds if longest else 0.0,
    )


def _subjects(trials: Sequence[SummaryTrial]) -> tuple[StudyPart, ...]:
    """Return the trials of each subject, by name."""
    by_subject: dict[str, list[SummaryTrial]] = {}
    for trial in trials:
        for subject in dict.fromkeys(trial.figures.subjects):
            by_subject.setdefault(subject, []).append(trial)
    return tuple(
        _part(name, own, absent_markers([one.figures for one in own]))
        for name, own in sorted(by_subject.items(), key=lambda item: natural_key(item[0]))
    )


def _part(name: str, trials: Sequence[SummaryTrial], absent: frozenset[str]) -> StudyPart:
    figures = [one.figures for one in trials]
    groups = Counter(one.attention.group for one in trials)
    lost: Counter[str] = Counter()
    for one in figures:
        lost.update({marker.label: marker.filled + marker.left for marker in one.markers})
    present = [label for label, frames in lost.most_common() if frames and label not in absent]
    return StudyPart(
        name=name,
        subjects=tuple(dict.fromkeys(subject for one in figures for subject in one.subjects)),
        folders=tuple(dict.fromkeys(one.folder for one in figures)),
        trials=len(trials),
        groups={group: groups[group] for group in GROUPS},
        missing=sum(one.missing for one in figures),
        samples=sum(one.samples for one in figures),
        filled=sum(one.filled for one in figures),
        left=sum(one.left_samples for one in figures),
        error=mean_error(figures),
        worst_marker=present[0] if present else "",
        absent=tuple(sorted(absent)),
        seconds=sum(one.outcome.seconds for one in figures),
    )


def _count(number: int, name: str) -> str:
    return f"{number:,} {name}{'' if number == 1 else 's'}"


def _listed(parts: Iterable[tuple[int, str]]) -> str:
    return ", ".join(f"{number:,} {what}" for number, what in parts if number)
