"""Summaries of outcomes by method, clip, marker and length of gap, and comparisons of methods.

Errors are over filled samples, and the share filled is given with them. Methods are compared over
the samples that all of them filled, so that a method gains nothing by leaving difficult samples
out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.evaluation.evaluation_plan import EvaluationPlan, FillJob
from priorfill.evaluation.gap_case import FillOutcome, GapCase, GapSource
from priorfill.evaluation.metrics import (
    ERROR,
    ErrorSummary,
    SampleErrors,
    summarise,
)
from priorfill.gaps import Gap

__all__ = [
    "LENGTHS",
    "MIN_COMPARED_SHARE",
    "GapRow",
    "MethodComparison",
    "MethodPair",
    "MethodRow",
    "compare",
    "gap_rows",
    "length_class",
    "length_rows",
    "marker_rows",
    "method_row",
    "pairs",
]

MIN_COMPARED_SHARE = 0.5
"""Share of the samples that a method must fill to be compared with the others: with less, the
samples filled by all methods would be few and easy."""

LENGTHS = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""s. Limits of the classes of gap length; a last class has all longer gaps."""

FillOutcomes = Mapping[FillJob, FillOutcome]


@dataclass(frozen=True)
class GapRow:
    """The errors of a method in a gap, and what it filled the gap from.

    Attributes
    ----------
    method, clip, case : str
        Names of the method, the clip and the case.
    copy : int
        Copy of the case.
    marker, segment, marker_set : str
        The marker, its segment, and its marker set.
    first_frame, frames : int
        First frame, as numbered in the file, and length.
    seconds : float
        Length.
    errors : ErrorSummary
        Errors of its samples.
    sources : tuple of str
        What it was filled from.
    source_clips : tuple of str
        Names of the recordings in the training data.
    training_poses : int
        Number of training poses or windows.
    unfilled : tuple of str
        Reasons why samples were not filled.
    """

    method: str
    clip: str
    case: str
    copy: int
    marker: str
    segment: str
    marker_set: str
    first_frame: int
    frames: int
    seconds: float
    errors: ErrorSummary
    sources: tuple[str, ...]
    source_clips: tuple[str, ...]
    training_poses: int
    unfilled: tuple[str, ...]


@dataclass(frozen=True)
class MethodRow:
    """The errors of a method in some cases.

    Attributes
    ----------
    method, clip : str
        The method; the clip, empty for all of them.
    cases, gaps : int
        Number of cases and of gaps.
    errors : ErrorSummary
        Errors of all samples.
    joint_angle : float
        Mean error of the joint angles (degrees); NaN where none is defined.
    joints : dict of str to float
        Mean errors by joint (degrees).
    seconds : float
        Total CPU time.
    refused : dict of str to int
        Reasons why the method could not work, with the number of cases.
    """

    method: str
    clip: str
    cases: int
    gaps: int
    errors: ErrorSummary
    joint_angle: float
    joints: dict[str, float]
    seconds: float
    refused: dict[str, int]


@dataclass(frozen=True)
class MethodComparison:
    """Methods compared over the samples that all of them filled.

    Attributes
    ----------
    methods : dict of str to ErrorSummary
        The methods compared, that with the smallest mean error first.
    samples, of : int
        Number of samples that all of these filled, and of all samples.
    left_out : tuple of str
        Methods that filled less than `MIN_COMPARED_SHARE` of the samples.
    """

    methods: dict[str, ErrorSummary]
    samples: int
    of: int
    left_out: tuple[str, ...]

    @property
    def best(self) -> str | None:
        """The method with the smallest mean error; None where nothing was filled."""
        return next(iter(self.methods), None) if self.samples else None


@dataclass(frozen=True)
class MethodPair:
    """Two methods compared over the samples that both filled.

    Attributes
    ----------
    first, second : str
        The methods.
    samples : int
        Number of samples that both filled.
    first_mean, second_mean : float
        Mean errors of these samples (mm).
    gaps : int
        Number of gaps with such samples.
    first_better : float
        Share of these gaps in which the first method has the smaller error; ties count one half.
    """

    first: str
    second: str
    samples: int
    first_mean: float
    second_mean: float
    gaps: int
    first_better: float


def _of(
    outcomes: FillOutcomes, plan: EvaluationPlan, method: str, clip: int | None = None
) -> list[tuple[GapCase, FillOutcome]]:
    """Return the cases of a method with its outcomes, of one clip or of all."""
    return [
        (case, outcomes[FillJob(number, method)])
        for number, case in enumerate(plan.cases)
        if clip is None or case.clip == clip
    ]


def _concatenated(parts: Iterable[SampleErrors]) -> SampleErrors:
    """Return the samples of several cases, concatenated."""
    return np.concatenate(list(parts), axis=1)


def _by_gap(gaps: Sequence[Gap]) -> list[tuple[Gap, slice]]:
    """Return gaps with the slices of their samples."""
    stops = np.cumsum([0, *(gap.frames for gap in gaps)])
    return [(gap, slice(int(a), int(b))) for gap, (a, b) in zip(gaps, pairwise(stops), strict=True)]


def method_row(
    outcomes: FillOutcomes, plan: EvaluationPlan, method: str, clip: int | None = None
) -> MethodRow:
    """Return the errors of a method in all cases, or in those of one clip with cases."""
    some = _of(outcomes, plan, method, clip)
    joints: dict[str, list[NDArray[np.float64]]] = {}
    refused: dict[str, int] = {}
    for _, outcome in some:
        for name, off in outcome.joints.items():
            joints.setdefault(name, []).append(off)
        if outcome.refused:
            refused[outcome.refused] = refused.get(outcome.refused, 0) + 1
    angles = [off for several in joints.values() for off in several]
    return MethodRow(
        method=method,
        clip="" if clip is None else plan.sources[clip].clip.name,
        cases=len(some),
        gaps=sum(len(case.gaps) for case, _ in some),
        errors=summarise(_concatenated(outcome.samples for _, outcome in some)),
        joint_angle=float(np.concatenate(angles).mean()) if angles else float("nan"),
        joints={name: float(np.concatenate(off).mean()) for name, off in sorted(joints.items())},
        seconds=sum(outcome.seconds for _, outcome in some),
        refused=refused,
    )


def gap_rows(outcomes: FillOutcomes, plan: EvaluationPlan) -> list[GapRow]:
    """Return a row per gap and method."""
    rows = []
    for method in plan.methods:
        for case, outcome in _of(outcomes, plan, method):
            clip, marker_set = plan.sources[case.clip].clip, plan.marker_sets[case.clip]
            for number, (gap, place) in enumerate(_by_gap(case.gaps)):
                label = clip.labels[gap.marker]
                source = (
                    GapSource(unfilled=(outcome.refused,))
                    if outcome.refused
                    else outcome.gap_sources[number]
                )
                rows.append(
                    GapRow(
                        method=method,
                        clip=clip.name,
                        case=case.name,
                        copy=case.copy,
                        marker=label,
                        segment=marker_set.segment.get(label, ""),
                        marker_set=marker_set.name,
                        first_frame=clip.first_frame + gap.start,
                        frames=gap.frames,
                        seconds=gap.frames / clip.rate,
                        errors=summarise(outcome.samples[:, place]),
                        sources=source.sources,
                        source_clips=source.source_clips,
                        training_poses=source.training_poses,
                        unfilled=source.unfilled,
                    )
                )
    return rows


def marker_rows(
    outcomes: FillOutcomes, plan: EvaluationPlan
) -> dict[tuple[str, str, str], tuple[int, ErrorSummary]]:
    """Return the number of gaps and the errors by marker set, marker and method."""
    found: dict[tuple[str, str, str], list[SampleErrors]] = {}
    for method in plan.methods:
        for case, outcome in _of(outcomes, plan, method):
            name = plan.marker_sets[case.clip].name
            labels = plan.sources[case.clip].clip.labels
            for gap, place in _by_gap(case.gaps):
                key = (name, labels[gap.marker], method)
                found.setdefault(key, []).append(outcome.samples[:, place])
    # in the order of the markers in the clips
    order = dict.fromkeys(
        (marker_set.name, label)
        for source, marker_set in zip(plan.sources, plan.marker_sets, strict=True)
        for label in source.clip.labels
    )
    return {
        (*marker, method): (
            len(found[(*marker, method)]),
            summarise(_concatenated(found[(*marker, method)])),
        )
        for marker in order
        for method in plan.methods
        if (*marker, method) in found
    }


def length_class(seconds: float) -> str:
    """Return the class of gap length.

    Examples
    --------
    >>> length_class(0.3)
    '0.25-0.5 s'
    """
    for low, high in pairwise(LENGTHS):
        if seconds <= high:
            return f"{low:g}-{high:g} s"
    return f"> {LENGTHS[-1]:g} s"


def length_rows(
    outcomes: FillOutcomes, plan: EvaluationPlan
) -> dict[tuple[str, str], tuple[int, ErrorSummary]]:
    """Return the number of gaps and the errors by class of length and method."""
    found: dict[tuple[str, str], list[SampleErrors]] = {}
    for method in plan.methods:
        for case, outcome in _of(outcomes, plan, method):
            rate = plan.sources[case.clip].clip.rate
            for gap, place in _by_gap(case.gaps):
                key = (length_class(gap.frames / rate), method)
                found.setdefault(key, []).append(outcome.samples[:, place])
    order = [length_class(high) for high in LENGTHS[1:]] + [length_class(np.inf)]
    return {
        (name, method): (len(found[name, method]), summarise(_concatenated(found[name, method])))
        for name in order
        for method in plan.methods
        if (name, method) in found
    }


def compare(outcomes: FillOutcomes, plan: EvaluationPlan) -> MethodComparison:
    """Compare methods over the samples that all of them filled."""
    samples_of = {
        m: _concatenated(outcome.samples for _, outcome in _of(outcomes, plan, m))
        for m in plan.methods
    }
    filled = {method: np.isfinite(samples[ERROR]) for method, samples in samples_of.items()}
    compared = [m for m in plan.methods if filled[m].mean() >= MIN_COMPARED_SHARE]
    common = np.logical_and.reduce([filled[m] for m in compared]) if compared else np.zeros(0, bool)
    found = {method: summarise(samples_of[method][:, common]) for method in compared}
    order = sorted(found, key=lambda method: found[method].mean)
    return MethodComparison(
        methods={method: found[method] for method in order},
        samples=int(common.sum()),
        of=sum(case.samples for case in plan.cases),
        left_out=tuple(m for m in plan.methods if m not in compared),
    )


def pairs(outcomes: FillOutcomes, plan: EvaluationPlan) -> list[MethodPair]:
    """Compare all pairs of methods over the samples that both filled."""
    errors = {
        method: _concatenated(outcome.samples for _, outcome in _of(outcomes, plan, method))[ERROR]
        for method in plan.methods
    }
    frames = np.array([gap.frames for case in plan.cases for gap in case.gaps])
    starts = np.concatenate([[0], np.cumsum(frames)[:-1]])
    return [
        _pair(first, second, errors, starts)
        for i, first in enumerate(plan.methods)
        for second in plan.methods[i + 1 :]
    ]


def _pair(
    first: str,
    second: str,
    errors: Mapping[str, NDArray[np.float32]],
    starts: NDArray[np.intp],
) -> MethodPair:
    """Compare two methods; ``starts`` has the first sample of each gap."""
    both = np.isfinite(errors[first]) & np.isfinite(errors[second])
    a, b = (np.where(both, errors[m], np.float32(0)).astype(np.float64) for m in (first, second))
    samples = int(both.sum())
    compared = np.add.reduceat(both, starts) > 0
    sign = np.sign(np.add.reduceat(b - a, starts))[compared]
    unknown = float("nan")
    return MethodPair(
        first,
        second,
        samples,
        float(a.sum() / samples) if samples else unknown,
        float(b.sum() / samples) if samples else unknown,
        int(compared.sum()),
        float((1 + sign).mean() / 2) if samples else unknown,
    )
