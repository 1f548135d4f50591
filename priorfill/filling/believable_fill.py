"""Fill a clip by a method, and keep what can be believed.

A method sees neither samples in doubt nor ends that show fewer than three markers. Its fill is
checked; what fails is filled once more without the measured samples that may be the cause, and
left missing if it fails again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.filling.held_out_errors import with_held_out_errors
from priorfill.filling.plausibility import CRITERIA, JUMP, SPEED, PlausibilityCheck
from priorfill.filling.plausibility_options import PlausibilityOptions
from priorfill.filling.seen_clip import SeenClip
from priorfill.gaps import Gap, GapGroup, gap_groups
from priorfill.geometry.axes import to_upright
from priorfill.gp.calibration import BOUND_FACTOR, MEAN_FACTOR
from priorfill.methods.task import Estimate, Note, Task
from priorfill.methods.task_parts import wanted_samples
from priorfill.runtime.free_memory import release_free_memory
from priorfill.runtime.threads import by_frames
from priorfill.search.takes import Take

__all__ = ["BelievableFill", "FillTask"]

_Bool = NDArray[np.bool_]

SHORT_SECONDS = 0.2
"""s. Length of gaps that are always filled again with others of their gap group."""

FillTask = Callable[[Task], Estimate]
"""A method with its options."""


@dataclass(frozen=True, eq=False)
class BelievableFill:
    """Fills a clip by a method, and checks the fill.

    Attributes
    ----------
    seen : SeenClip
        What the method sees of the clip.
    takes : tuple of Take
        Recordings to learn from.
    left_alone : sequence of (Gap, str)
        Missing samples that are not to be filled; gap groups of these alone are skipped.
    options : PlausibilityOptions
        Limits of the check.
    max_error : float or None
        mm. Samples with a greater expected mean error stay missing; None: no limit.
    estimate_errors : bool
        Whether expected errors are found from artificial gaps where the method predicts none.
    learn_from_clip : bool
        Whether the method may learn from the clip's own frames.
    checkpoint : callable
        Called often; what it raises stops the fill.
    """

    seen: SeenClip
    takes: tuple[Take, ...]
    left_alone: Sequence[tuple[Gap, str]]
    options: PlausibilityOptions
    max_error: float | None = None
    estimate_errors: bool = True
    learn_from_clip: bool = True
    checkpoint: Callable[[], None] = lambda: None

    def __call__(self, method: FillTask) -> tuple[Estimate, _Bool]:
        """Return the estimate, and the samples that were hidden for it.

        Parameters
        ----------
        method : callable
            The method. It may be called several times: for expected errors, and again where a fill
            is not believed.

        Returns
        -------
        estimate : Estimate
            For all frames of the clip. Samples that are not believed are missing, with a note.
        hidden : ndarray of bool [shape=(frames, markers)]
            Measured samples of the clip that were not learnt from.
        """
        seen = self.seen
        estimate = self._estimate(self._task(seen), method)
        failures = self._failures(seen, estimate)
        if failures:
            repeated = self._repeated(seen, estimate, failures, method)
            if repeated is not None:
                seen, estimate = repeated
                failures = self._failures(seen, estimate)
            self._drop_failures(seen, estimate, failures)
        self._drop_next_to_doubtful(seen, estimate)
        if self.max_error is not None:
            _drop_uncertain(estimate, ~seen.geometry.valid, self.max_error)
        return seen.in_whole_clip(estimate), seen.hidden

    def _estimate(self, task: Task, method: FillTask) -> Estimate:
        """Fill a task by the method, with expected errors."""
        estimate = method(task)
        filled = np.concatenate(by_frames(_blank_infinite, estimate.positions))
        filled &= ~task.valid
        if self.estimate_errors and np.isnan(estimate.expected_rms[filled]).any():
            estimate = with_held_out_errors(task, estimate, method)
        return estimate

    def _task(self, seen: SeenClip) -> Task:
        geometry, clip = seen.geometry, seen.clip
        return Task(
            geometry.positions,
            clip.labels,
            clip.rate,
            geometry.marker_set,
            seen.groups(self.left_alone),
            self.takes,
            clip.name,
            clip.subject,
            geometry,
            self.learn_from_clip,
            self.checkpoint,
        )

    def _check(self, seen: SeenClip) -> PlausibilityCheck:
        return PlausibilityCheck(seen.geometry, seen.clip.rate, self.options)

    def _failures(self, seen: SeenClip, estimate: Estimate) -> dict[str, _Bool]:
        """Return the samples that fail each criterion [shape=(frames, markers)]."""
        bound = estimate.error_bound_90
        if bound is None:
            bound = BOUND_FACTOR * estimate.expected_rms
        release_free_memory(estimate.positions.nbytes)  # of the method
        failures = self._check(seen).failures(estimate.positions, estimate.expected_rms, bound)
        release_free_memory(estimate.positions.nbytes)
        return failures

    def _repeated(
        self, seen: SeenClip, estimate: Estimate, failures: dict[str, _Bool], method: FillTask
    ) -> tuple[SeenClip, Estimate] | None:
        """Fill again without suspicious samples; None where nothing is gained."""
        failing = np.logical_or.reduce(list(failures.values()))
        edges = np.logical_or.reduce(
            [failures[name] for name in (SPEED, JUMP) if name in failures] or [failing & False]
        )
        suspects = self._check(seen).suspects(failing, edges)
        if not suspects.any():
            return None
        start, stop = seen.frames
        hidden = seen.hidden.copy()
        hidden[start:stop] |= suspects
        other = replace(seen, hidden=hidden)
        if other.frames != seen.frames:  # the suspects are most of what the ends show
            return None
        task = self._task(other)
        doubted = failing | suspects
        completed = np.where(doubted[..., None], np.nan, estimate.positions)
        task = replace(task, groups=_to_repeat(task, suspects), completed=completed)
        found = _joined(estimate, self._estimate(task, method), wanted_samples(task))
        left = np.logical_or.reduce([failing & False, *self._failures(other, found).values()])
        believed = failing & ~left & ~np.isnan(found.positions[..., 0])
        return (other, found) if believed.any() and left.sum() < failing.sum() else None

    def _drop_failures(
        self, seen: SeenClip, estimate: Estimate, failures: dict[str, _Bool]
    ) -> None:
        """Leave samples missing that fail a criterion, and those of the same fill around them."""
        check = self._check(seen)
        filled = ~seen.geometry.valid & ~np.isnan(estimate.positions[..., 0])
        for name, reason in CRITERIA.items():
            if name in failures:
                dropped = check.around(failures[name], filled)
                estimate.drop(dropped & ~np.isnan(estimate.positions[..., 0]), reason)

    def _drop_next_to_doubtful(self, seen: SeenClip, estimate: Estimate) -> None:
        """Leave the last sample before one in doubt missing where the two do not join."""
        if not seen.hidden.any():
            return
        start, stop = seen.frames
        measured = to_upright(seen.clip.positions[start:stop], seen.clip.up)
        doubtful = np.where(seen.hidden[start:stop, :, None], measured, np.nan)
        estimate.drop(
            self._check(seen).next_to_doubtful(estimate.positions, doubtful),
            "too far from the next sample, which is in doubt",
        )


def _blank_infinite(positions: NDArray[np.float64]) -> _Bool:
    """Blank samples that are not finite in place; return the others [shape=(frames, markers)]."""
    finite: _Bool = np.isfinite(positions[..., 0])  # faster than `all` over three
    for axis in (1, 2):
        finite &= np.isfinite(positions[..., axis])
    positions[~finite] = np.nan
    return finite


def _to_repeat(task: Task, suspects: _Bool) -> tuple[GapGroup, ...]:
    """Return the gap groups of gaps with suspicious samples, and of short gaps next to them.

    Other gaps whose fill failed have no suspicious samples that could be the cause. Short gaps take
    little time, and their markers are visible again once they are filled.
    """
    short = SHORT_SECONDS * task.rate
    missing = np.zeros_like(suspects)
    for group in task.groups:
        if not suspects[group.start : group.stop, list(group.markers)].any():
            continue
        for gap in group.gaps:
            inside = (slice(gap.start, gap.stop), gap.marker)
            missing[inside] = gap.frames <= short or suspects[inside].any()
    return tuple(gap_groups(missing))


def _joined(first: Estimate, second: Estimate, inside: _Bool) -> Estimate:
    """Return an estimate in which some samples are those of another one."""

    def concerned(note: Note) -> bool:
        return bool(inside[note.start : note.stop, note.marker].any())

    bounds = [
        BOUND_FACTOR * one.expected_rms if one.error_bound_90 is None else one.error_bound_90
        for one in (first, second)
    ]
    return Estimate(
        np.where(inside[..., None], second.positions, first.positions),
        np.where(inside, second.expected_rms, first.expected_rms),
        [
            *(note for note in first.notes if not concerned(note)),
            *(note for note in second.notes if concerned(note)),
        ],
        np.where(inside, bounds[1], bounds[0]),
    )


def _drop_uncertain(estimate: Estimate, missing: _Bool, max_error: float) -> None:
    """Leave samples missing whose expected mean error exceeds a limit (mm), or is unknown."""
    filled = missing & ~np.isnan(estimate.positions[..., 0])
    expected = MEAN_FACTOR * estimate.expected_rms
    unknown = filled & np.isnan(expected)
    with np.errstate(invalid="ignore"):
        uncertain = filled & (expected > max_error)
    estimate.drop(uncertain, f"its expected mean error exceeds the limit of {max_error:g} mm")
    estimate.drop(
        unknown,
        f"its expected error is unknown, so it may exceed the limit of {max_error:g} mm",
    )
