"""Short gaps that are filled over time before anything is predicted by regression.

An estimate over time is kept where a regression could gain little: where its expected error is
below the measurement noise, or below a share of the expected error of a single model, which is
fitted once for each marker. The samples that are kept count as known
afterwards, so that gaps of other markers at the same time are not divided by them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from priorfill.gaps import Gap, gap_groups
from priorfill.gp.ensemble import regress
from priorfill.methods.gpr.gap_segments import GapSegment, SegmentBatch
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.prediction import OVER_TIME
from priorfill.methods.gpr.short_gaps.estimate import ShortGapEstimate, estimate_short_gaps
from priorfill.methods.gpr.training.own_clip import OwnClipProblems
from priorfill.methods.task import Estimate, Note, Task
from priorfill.methods.task_parts import wanted_samples

__all__ = ["ShortGapFill"]


@dataclass(frozen=True, eq=False)
class ShortGapFill:
    """The short gaps of a task: those that are filled over time, and the rest of the task.

    Attributes
    ----------
    task : Task
        The task.
    rest : Task
        The same in which the kept estimates are known samples.
    kept : tuple of ShortGapEstimate
        The estimates that fill their gaps.
    others : tuple of ShortGapEstimate
        Estimates that fill their gaps if the regression's expected error is no smaller.
    """

    task: Task
    rest: Task
    kept: tuple[ShortGapEstimate, ...]
    others: tuple[ShortGapEstimate, ...]
    _max_expected_error: float

    @classmethod
    def of(cls, task: Task, options: GPROptions) -> ShortGapFill:
        """Estimate the short gaps of a task, and choose those that are filled over time."""
        kept: list[ShortGapEstimate] = []
        others: list[ShortGapEstimate] = []
        rest = task
        limits = options.short_gaps
        longest = limits.max_seconds * task.rate
        gaps = [g for group in task.groups for g in group.gaps if g.frames <= longest]
        if gaps and task.learn_from_clip:
            geometry = task.geometry.distance, task.geometry.spread
            found = estimate_short_gaps(task.positions, gaps, task.rate, geometry, limits)
            kept = [one for one in found if one.rms <= limits.measurement_noise]
            rest = _with_known(task, kept)
            # a blackout is not predicted by a regression, and not marker by marker
            others = [
                one
                for one in found
                if one.rms > limits.measurement_noise and _segment(rest, one.gap).has_enough_visible
            ]
            better = _better_than_regression(rest, others, options)
            if better:
                kept += better
                chosen = {id(one) for one in better}
                others = [one for one in others if id(one) not in chosen]
                rest = _with_known(task, kept)
        return cls(
            task,
            rest,
            tuple(kept),
            tuple(others),
            options.max_expected_error,
        )

    def put_into(self, estimate: Estimate) -> None:
        """Put the estimates over time into the estimate of the rest."""
        assert estimate.error_bound_90 is not None
        chosen = list(self.kept)
        for one in self.others:
            place = (slice(one.gap.start, one.gap.stop), one.gap.marker)
            found = estimate.expected_rms[place]
            rms = float(np.sqrt((found**2).mean()))  # NaN where a sample is not filled
            if one.rms <= self._max_expected_error and not one.rms > rms:
                chosen.append(one)
        replaced = {(one.gap.marker, one.gap.start): one.gap.stop for one in chosen}
        starts = {
            marker: np.sort([start for m, start in replaced if m == marker])
            for marker in {m for m, _ in replaced}
        }

        def inside(note: Note) -> bool:
            own = starts.get(note.marker, np.empty(0))
            at = int(np.searchsorted(own, note.start, "right")) - 1
            return at >= 0 and note.start < replaced[note.marker, int(own[at])]

        estimate.notes[:] = [note for note in estimate.notes if not inside(note)]
        for one in chosen:
            gap = one.gap
            place = (slice(gap.start, gap.stop), gap.marker)
            estimate.positions[place] = one.positions
            estimate.expected_rms[place] = one.expected_rms
            estimate.error_bound_90[place] = one.bound_factor * one.expected_rms
            estimate.notes.append(
                Note(gap.marker, gap.start, gap.stop, OVER_TIME, source_clips=(self.task.name,))
            )


def _with_known(task: Task, kept: Sequence[ShortGapEstimate]) -> Task:
    """Return a task in which the samples of some estimates are known."""
    if not kept:
        return task
    positions = task.positions.copy()
    missing = wanted_samples(task)
    for one in kept:
        place = (slice(one.gap.start, one.gap.stop), one.gap.marker)
        positions[place] = one.positions
        missing[place] = False
    return replace(
        task,
        positions=positions,
        groups=tuple(gap_groups(missing)),
        known_geometry=task.geometry.completed(positions),
    )


def _better_than_regression(
    task: Task, estimates: Sequence[ShortGapEstimate], options: GPROptions
) -> list[ShortGapEstimate]:
    """Return the estimates whose expected error is below a share of that of a regression."""
    by_marker: dict[int, list[ShortGapEstimate]] = {}
    for one in estimates:
        by_marker.setdefault(one.gap.marker, []).append(one)
    problems = OwnClipProblems(task, 0, options.training, options.spline_nodes, options.correlation)
    better: list[ShortGapEstimate] = []
    for some in by_marker.values():
        task.checkpoint()
        error = _regression_error(
            task, max((one.gap for one in some), key=lambda gap: gap.frames), problems, options
        )
        better += [one for one in some if one.rms <= options.short_gaps.regression_share * error]
    return better


def _regression_error(
    task: Task, gap: Gap, problems: OwnClipProblems, options: GPROptions
) -> float:
    """Return the expected rms error (mm) of one model in a gap; 0 without training."""
    own = problems.problem_for(SegmentBatch((_segment(task, gap),)), None)
    if own is None:
        return 0.0
    found = regress(
        [own.problem],
        options.models.short_segment[:1],
        gap.frames / task.rate,
        own.inside,
        options=options.ensemble,
    )
    return float(np.sqrt((found.expected_rms[own.inside] ** 2).mean()))


def _segment(task: Task, gap: Gap) -> GapSegment:
    """Return a gap as a segment of its own."""
    visible = np.logical_and.reduce(task.valid[gap.start : gap.stop], axis=0)
    visible[gap.marker] = False
    return GapSegment(np.array([gap.marker]), gap.start, gap.stop, np.flatnonzero(visible))
