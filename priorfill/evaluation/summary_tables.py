"""What outcomes say together: by method, clip, marker, length of gap, and method against method.

Errors are over filled samples; the share filled stands beside them. Methods are compared with each
other over samples that all of them filled: who leaves out what is hard must not look better.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.evaluation.evaluation_plan import EvaluationPlan, FillJob
from priorfill.evaluation.gap_case import FillOutcome, GapCase
from priorfill.evaluation.metrics import (
    ERROR,
    ErrorSummary,
    SampleErrors,
    summarise,
)
from priorfill.gaps import Gap

__all__ = [
    "COMPARED_SHARE",
    "LENGTHS",
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

COMPARED_SHARE = 0.5
"""Methods that fill less of the samples are not compared with the others: the samples that all
filled would be few, and easy ones."""

LENGTHS = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""s. Classes of length of gaps; the last is of longer ones."""

FillOutcomes = Mapping[FillJob, FillOutcome]


@dataclass(frozen=True)
class GapRow:
    """A gap filled by a method.

    Attributes
    ----------
    method, clip, case : str
        Which method, clip and case.
    copy : int
        Copy of the case.
    marker, segment, marker_set : str
        The marker, the segment that it sits on, the set that it is of.
    start, frames : int
        First frame, by the file's own numbers, and length.
    seconds : float
        Length.
    errors : ErrorSummary
        Of its samples.
    how : str
        What it was filled from, and why a part was not.
    """

    method: str
    clip: str
    case: str
    copy: int
    marker: str
    segment: str
    marker_set: str
    start: int
    frames: int
    seconds: float
    errors: ErrorSummary
    how: str


@dataclass(frozen=True)
class MethodRow:
    """A method on some cases.

    Attributes
    ----------
    method, clip : str
        The method; the clip, empty for all of them.
    cases, gaps : int
        What there was to fill.
    errors : ErrorSummary
        Over all samples.
    joint_angle : float
        Mean error of the joint angles (degrees); NaN where none is defined.
    joints : dict of str to float
        The same by joint.
    seconds : float
        In all.
    refused : dict of str to int
        Why it could not work, and on how many cases.
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
    """Methods over the samples that all of them filled.

    Attributes
    ----------
    methods : dict of str to ErrorSummary
        The methods compared, the best (least mean error) first.
    samples, of : int
        Samples that all of these filled, and all samples.
    left_out : tuple of str
        Methods that filled less than `COMPARED_SHARE` of the samples.
    """

    methods: dict[str, ErrorSummary]
    samples: int
    of: int
    left_out: tuple[str, ...]

    @property
    def best(self) -> str | None:
        """The method of the least mean error; None where nothing was filled."""
        return next(iter(self.methods), None) if self.samples else None


@dataclass(frozen=True)
class MethodPair:
    """Two methods over the samples that both filled.

    Attributes
    ----------
    first, second : str
        The methods.
    samples : int
        That both filled.
    first_mean, second_mean : float
        Mean errors over these (mm).
    gaps : int
        Gaps with such samples.
    first_better : float
        Share of these gaps in which the first one errs less; ties count half.
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
    """Return a method's outcomes, of one clip or of all."""
    return [
        (case, outcomes[FillJob(number, method)])
        for number, case in enumerate(plan.cases)
        if clip is None or case.clip == clip
    ]


def _joined(several: Iterable[SampleErrors]) -> SampleErrors:
    """Return the samples of several cases as one."""
    return np.concatenate(list(several), axis=1)


def _by_gap(gaps: Sequence[Gap]) -> list[tuple[Gap, slice]]:
    """Return gaps with the place of their samples."""
    stops = np.cumsum([0, *(gap.frames for gap in gaps)])
    return [(gap, slice(int(a), int(b))) for gap, (a, b) in zip(gaps, pairwise(stops), strict=True)]


def method_row(
    outcomes: FillOutcomes, plan: EvaluationPlan, method: str, clip: int | None = None
) -> MethodRow:
    """Return what a method made of all cases, or of those of one clip, which has some."""
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
        errors=summarise(_joined(outcome.samples for _, outcome in some)),
        joint_angle=float(np.concatenate(angles).mean()) if angles else float("nan"),
        joints={name: float(np.concatenate(off).mean()) for name, off in sorted(joints.items())},
        seconds=sum(outcome.seconds for _, outcome in some),
        refused=refused,
    )


def gap_rows(outcomes: FillOutcomes, plan: EvaluationPlan) -> list[GapRow]:
    """Return a row for each gap and method."""
    rows = []
    for method in plan.methods:
        for case, outcome in _of(outcomes, plan, method):
            clip, marker_set = plan.sources[case.clip].clip, plan.marker_sets[case.clip]
            for number, (gap, place) in enumerate(_by_gap(case.gaps)):
                label = clip.labels[gap.marker]
                rows.append(
                    GapRow(
                        method=method,
                        clip=clip.name,
                        case=case.name,
                        copy=case.copy,
                        marker=label,
                        segment=marker_set.segment.get(label, ""),
                        marker_set=marker_set.name,
                        start=clip.first_frame + gap.start,
                        frames=gap.frames,
                        seconds=gap.frames / clip.rate,
                        errors=summarise(outcome.samples[:, place]),
                        how=outcome.refused or outcome.how[number],
                    )
                )
    return rows


def marker_rows(
    outcomes: FillOutcomes, plan: EvaluationPlan
) -> dict[tuple[str, str, str], tuple[int, ErrorSummary]]:
    """Return gaps and errors by marker set, marker and method."""
    found: dict[tuple[str, str, str], list[SampleErrors]] = {}
    for method in plan.methods:
        for case, outcome in _of(outcomes, plan, method):
            name = plan.marker_sets[case.clip].name
            labels = plan.sources[case.clip].clip.labels
            for gap, place in _by_gap(case.gaps):
                key = (name, labels[gap.marker], method)
                found.setdefault(key, []).append(outcome.samples[:, place])
    # in the order of the clips' own markers
    order = dict.fromkeys(
        (marker_set.name, label)
        for source, marker_set in zip(plan.sources, plan.marker_sets, strict=True)
        for label in source.clip.labels
    )
    return {
        (*marker, method): (
            len(found[(*marker, method)]),
            summarise(_joined(found[(*marker, method)])),
        )
        for marker in order
        for method in plan.methods
        if (*marker, method) in found
    }


def length_class(seconds: float) -> str:
    """Return the class of length of a gap."""
    for low, high in pairwise(LENGTHS):
        if seconds <= high:
            return f"{low:g}-{high:g} s"
    return f"> {LENGTHS[-1]:g} s"


def length_rows(
    outcomes: FillOutcomes, plan: EvaluationPlan
) -> dict[tuple[str, str], tuple[int, ErrorSummary]]:
    """Return gaps and errors by class of length and method, the shortest first."""
    found: dict[tuple[str, str], list[SampleErrors]] = {}
    for method in plan.methods:
        for case, outcome in _of(outcomes, plan, method):
            rate = plan.sources[case.clip].clip.rate
            for gap, place in _by_gap(case.gaps):
                key = (length_class(gap.frames / rate), method)
                found.setdefault(key, []).append(outcome.samples[:, place])
    order = [length_class(high) for high in LENGTHS[1:]] + [length_class(np.inf)]
    return {
        (name, method): (len(found[name, method]), summarise(_joined(found[name, method])))
        for name in order
        for method in plan.methods
        if (name, method) in found
    }


def compare(outcomes: FillOutcomes, plan: EvaluationPlan) -> MethodComparison:
    """Compare methods over the samples that all of them filled."""
    whole = {
        m: _joined(outcome.samples for _, outcome in _of(outcomes, plan, m)) for m in plan.methods
    }
    filled = {method: np.isfinite(samples[ERROR]) for method, samples in whole.items()}
    compared = [m for m in plan.methods if filled[m].mean() >= COMPARED_SHARE]
    common = np.logical_and.reduce([filled[m] for m in compared]) if compared else np.zeros(0, bool)
    found = {method: summarise(whole[method][:, common]) for method in compared}
    order = sorted(found, key=lambda method: found[method].mean)
    return MethodComparison(
        methods={method: found[method] for method in order},
        samples=int(common.sum()),
        of=sum(case.samples for case in plan.cases),
        left_out=tuple(m for m in plan.methods if m not in compared),
    )


def pairs(outcomes: FillOutcomes, plan: EvaluationPlan) -> list[MethodPair]:
    """Compare every two methods over the samples that both filled."""
    whole = {
        method: _joined(outcome.samples for _, outcome in _of(outcomes, plan, method))[ERROR]
        for method in plan.methods
    }
    frames = np.array([gap.frames for case in plan.cases for gap in case.gaps])
    starts = np.concatenate([[0], np.cumsum(frames)[:-1]])
    found = []
    for i, first in enumerate(plan.methods):
        for second in plan.methods[i + 1 :]:
            both = np.isfinite(whole[first]) & np.isfinite(whole[second])
            a, b = (
                np.where(both, whole[m], np.float32(0)).astype(np.float64) for m in (first, second)
            )
            samples = int(both.sum())
            touched = np.add.reduceat(both, starts) > 0
            ahead = np.sign(np.add.reduceat(b - a, starts))[touched]
            found.append(
                MethodPair(
                    first,
                    second,
                    samples,
                    float(a.sum() / samples) if samples else float("nan"),
                    float(b.sum() / samples) if samples else float("nan"),
                    int(touched.sum()),
                    float((1 + ahead).mean() / 2) if samples else float("nan"),
                )
            )
    return found
