"""The default method: Gaussian-process regression on the clip's own poses and the database's.

The energy, its levels and its solver are those of Baumann et al. 2011 (`priorfill.energy`). The
targets of the energy differ:

* The training poses are the clip's own frames: same subject, same markers, same session.
  The database is used where the clip has too few of them, above all for markers that it never
  shows (`priorfill.methods.gpr.dropout`).
* Instead of the mean of the nearest neighbours, the target is a Gaussian-process regression from
  the visible markers (`priorfill.gp.ensemble`), weighted by the inverse of its variance.
* Predictions below the floor are raised, and predictions that jitter more than measured samples
  are smoothed (`priorfill.methods.gpr.postprocess`).
* Target velocities and accelerations are differences of the same prediction, beyond the edges of
  the gap as well, so that the fill joins the measured samples continuously.
* Incomplete frames are no training poses in the first pass. Where too few remain, a second pass
  uses frames completed by the first one.
* Short gaps are interpolated over time where a regression could not do much better
  (`priorfill.methods.gpr.short_gaps`).
* Other short gaps without a better prediction are interpolated over time
  (`priorfill.signal.gp_interpolation`).
* Blackouts are filled by the movement before, after, and elsewhere
  (`priorfill.methods.gpr.blackout`).
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.energy.multiresolution import levels_for, solve_levels
from priorfill.energy.solver import minimise
from priorfill.gaps import GapGroup
from priorfill.methods.gpr.energy_targets import targets_from
from priorfill.methods.gpr.gap_segments import GapSegment, SegmentBatch
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.postprocess import PostProcessor
from priorfill.methods.gpr.predict import SegmentPredictor
from priorfill.methods.gpr.prediction import SegmentPrediction, notes_on_unfilled
from priorfill.methods.gpr.segment_batches import plan_batches
from priorfill.methods.gpr.short_gaps.fill_short_gaps import ShortGapFill
from priorfill.methods.task import Estimate, Progress, Task, no_progress
from priorfill.methods.task_parts import wanted_samples
from priorfill.runtime.free_memory import release_free_memory
from priorfill.runtime.threads import Map, by_frames, map_in_threads
from priorfill.signal.resample import Resolution

__all__ = ["fill"]

FIRST_SHARE = 0.5
"""Share of the progress of a segment after the first of two passes."""

_Predictions = tuple[tuple[SegmentPrediction, ...], ...]
"""The predictions of each segment: none, one, or one for each of some of its markers."""

_Changes = dict[int, tuple[SegmentPrediction, ...]]
"""New predictions, by the number of the segment."""


def fill(
    task: Task,
    progress: Progress = no_progress,
    options: GPROptions | None = None,
) -> Estimate:
    """Fill the gaps of a task by Gaussian-process regression.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    progress : callable
        Called with the number of samples done since the last call.
    options : GPROptions, optional
        Of the method.

    Returns
    -------
    Estimate
        Markers that neither the clip nor the takes show, and samples whose expected error exceeds
        `GPROptions.max_expected_error`, stay missing, with a note.

    See Also
    --------
    priorfill.fill : Fills a clip by any method.
    priorfill.methods.gpr.options.GPROptions : The options.
    """
    options = options or GPROptions()
    short = ShortGapFill.of(task, options)
    progress(sum(one.gap.frames for one in short.kept))
    estimate = _fill_rest(short.rest, progress, options)
    short.put_into(estimate)
    return estimate


def _fill_rest(task: Task, progress: Progress, options: GPROptions) -> Estimate:
    """Fill what is not filled over time before; parameters as of `fill`."""
    setup = _Setup.of(task, options)
    # Batches are predicted independently, so the result does not depend on how many are predicted
    # at a time.
    with map_in_threads() as map_batches:
        setup.predictor.map_function = map_batches
        first, solutions = _first_pass(setup, map_batches, progress)
        # Arrays of a long clip are made one after the other, when the regressions' memory is free.
        release_free_memory(task.positions.nbytes)
        positions = np.empty_like(task.positions)
        by_frames(np.copyto, positions, task.positions)
        elsewhere = _filled_elsewhere(task)
        if task.completed is not None:
            positions[elsewhere] = task.completed[elsewhere]
        for number, solution in solutions.items():
            _put(positions, task.groups[number], solution)
        changes: _Changes = {}
        if task.completed is None:
            changes = _second_pass(setup, positions, first, map_batches, progress)
            release_free_memory(task.positions.nbytes)
    expected_rms, bound = (np.empty(task.positions.shape[:2]) for _ in range(2))
    by_frames(_blank, expected_rms, bound)
    estimate = Estimate(positions, expected_rms, error_bound_90=bound)
    for number in solutions:
        _put_errors(estimate, setup.parts(first, number))
    predictions = _replaced(first, changes)
    setup.solve(estimate, predictions, changes)
    if task.learn_from_clip:
        predictions = _interpolate_over_time(setup, estimate, predictions)
        predictions = _fill_blackouts(setup, estimate, predictions)
        predictions = _interpolate_remaining(setup, estimate, predictions)
    for segment, parts in zip(setup.segments, predictions, strict=True):
        predicted = {int(marker) for part in parts for marker in part.segment.markers}
        estimate.notes.extend(note for part in parts for note in part.notes)
        unfilled = notes_on_unfilled(segment, task)
        estimate.notes.extend(note for note in unfilled if note.marker not in predicted)
    _drop_uncertain(estimate, options.max_expected_error)
    estimate.positions[elsewhere] = np.nan
    return estimate


def _filled_elsewhere(task: Task) -> NDArray[np.bool_]:
    """Return the missing samples that an earlier call filled [shape=(frames, markers)]."""
    if task.completed is None:
        return np.zeros(task.valid.shape, dtype=bool)
    filled: NDArray[np.bool_] = ~task.valid & ~np.isnan(task.completed[..., 0])
    return filled & ~wanted_samples(task)


@dataclass(frozen=True, eq=False)
class _Setup:
    """What all steps of a fill use, and none changes.

    Attributes
    ----------
    segments : tuple of GapSegment
        In order of time, so that those of each gap group follow one another.
    group_of : tuple of int
        Number of the gap group of each segment.
    group_slices : tuple of slice
        The segments of each gap group.
    batches : tuple of SegmentBatch
        What each regression predicts.
    members : tuple of tuple of int
        The segments of each batch, by their number.
    """

    task: Task
    options: GPROptions
    predictor: SegmentPredictor
    postprocess: PostProcessor
    levels: Sequence[Resolution]
    segments: tuple[GapSegment, ...]
    group_of: tuple[int, ...]
    group_slices: tuple[slice, ...]
    batches: tuple[SegmentBatch, ...]
    members: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, task: Task, options: GPROptions) -> _Setup:
        """Divide the gap groups into segments, and prepare their prediction."""
        count = levels_for(task.rate)
        # the differences at the coarsest level extend two of its steps beyond a segment
        predictor = SegmentPredictor(task, 2 * 2 ** (count - 1), options)
        batches = plan_batches(task.groups, task.valid, task.geometry.distance, options.segments)
        segments = sorted(
            (segment for batch in batches for segment in batch.segments),
            key=lambda segment: (segment.start, segment.markers[0]),
        )
        number_of = {id(segment): number for number, segment in enumerate(segments)}
        starts = [segment.start for segment in segments]
        edges = [bisect_left(starts, group.start) for group in task.groups]
        group_slices = tuple(slice(*pair) for pair in pairwise([*edges, len(segments)]))
        return cls(
            task,
            options,
            predictor,
            PostProcessor(task, options.floor, options.smoothing),
            [Resolution(task.positions, task.rate, 2**i) for i in range(count)],
            tuple(segments),
            tuple(
                number
                for number, inside in enumerate(group_slices)
                for _ in range(inside.start, inside.stop)
            ),
            group_slices,
            tuple(batches),
            tuple(tuple(number_of[id(one)] for one in batch.segments) for batch in batches),
        )

    def predict(
        self, batch: SegmentBatch, completed: NDArray[np.float64] | None
    ) -> list[tuple[SegmentPrediction, ...]]:
        """Predict the segments of a batch, and post-process the predictions."""
        found = self.predictor.predict_batch(batch, completed)
        return [tuple(self.postprocess(part) for part in parts) for parts in found]

    def solve(self, estimate: Estimate, predictions: _Predictions, changed: Iterable[int]) -> None:
        """Minimise the energy of the gap groups of changed segments, into the estimate."""
        for number in sorted({self.group_of[index] for index in changed}):
            solution = self.solution(predictions, number)
            if solution is not None:
                _put(estimate.positions, self.task.groups[number], solution)
                _put_errors(estimate, self.parts(predictions, number))

    def parts(
        self, predictions: Sequence[tuple[SegmentPrediction, ...]], number: int
    ) -> list[SegmentPrediction]:
        """Return the predictions of a gap group."""
        return [part for parts in predictions[self.group_slices[number]] for part in parts]

    def solution(
        self, predictions: Sequence[tuple[SegmentPrediction, ...]], number: int
    ) -> NDArray[np.float64] | None:
        """Minimise the energy of a gap group; None where nothing is predicted.

        Returns
        -------
        ndarray [shape=(frames of the group, markers of the group, 3), mm] or None
        """
        parts = self.parts(predictions, number)
        if not parts:
            return None
        group = self.task.groups[number]
        targets = targets_from(parts, group, self.options.joining)
        return solve_levels(self.levels, group, targets, minimise)


def _blank(*values: NDArray[np.float64]) -> None:
    """Set values to NaN."""
    for some in values:
        some[:] = np.nan


def _put(positions: NDArray[np.float64], group: GapGroup, solution: NDArray[np.float64]) -> None:
    """Put the solution of a gap group into positions."""
    positions[group.start : group.stop, list(group.markers)] = solution


def _put_errors(estimate: Estimate, parts: Iterable[SegmentPrediction]) -> None:
    """Put the expected errors of predictions into an estimate."""
    assert estimate.error_bound_90 is not None
    for part in parts:
        segment = part.segment
        expected_rms = part.expected_rms[segment.start - part.first : segment.stop - part.first]
        place = (slice(segment.start, segment.stop), segment.markers)
        estimate.expected_rms[place] = expected_rms
        estimate.error_bound_90[place] = part.bound_factor * expected_rms


def _first_pass(
    setup: _Setup, map_batches: Map, progress: Progress
) -> tuple[_Predictions, dict[int, NDArray[np.float64]]]:
    """Predict all segments, and solve all gap groups.

    Training poses are measured, or completed by an earlier call; then this pass is the only one.

    Returns
    -------
    predictions : tuple of tuple of SegmentPrediction
    solutions : dict of int to ndarray
        By the number of the gap group; see `_Setup.solution`.
    """
    completed = setup.task.completed
    predictions: list[tuple[SegmentPrediction, ...]] = [()] * len(setup.segments)
    solutions: dict[int, NDArray[np.float64]] = {}
    left = Counter(setup.group_of)
    found = map_batches(lambda batch: setup.predict(batch, completed), setup.batches)
    for members, batch in zip(setup.members, found, strict=True):
        for index, parts in zip(members, batch, strict=True):
            predictions[index] = parts
            share = 1.0 if completed is not None or _is_final(parts) else FIRST_SHARE
            progress(_samples(setup.segments[index]) * share)
            group = setup.group_of[index]
            left[group] -= 1
            if not left[group]:
                solution = setup.solution(predictions, group)
                if solution is not None:
                    solutions[group] = solution
    return tuple(predictions), solutions


def _second_pass(
    setup: _Setup,
    completed: NDArray[np.float64],
    first: _Predictions,
    map_batches: Map,
    progress: Progress,
) -> _Changes:
    """Predict batches with few training poses again, with poses completed by the first pass."""
    again = [
        number
        for number, members in enumerate(setup.members)
        if not all(_is_final(first[index]) for index in members)
    ]
    batches = [setup.batches[number] for number in again]
    found = map_batches(lambda batch: setup.predict(batch, completed), batches)
    changes: _Changes = {}
    for number, batch in zip(again, found, strict=True):
        for index, parts in zip(setup.members[number], batch, strict=True):
            changes[index] = parts
            if not _is_final(first[index]):
                progress(_samples(setup.segments[index]) * (1.0 - FIRST_SHARE))
    return changes


def _interpolate_over_time(
    setup: _Setup, estimate: Estimate, predictions: _Predictions
) -> _Predictions:
    """Interpolate over time where that has a smaller expected error than other recordings.

    Predictions from the clip's own frames are kept.
    """
    candidates = [
        i
        for i, segment in enumerate(setup.segments)
        if segment.has_enough_visible and not _from_own_frames(segment, predictions[i])
    ]
    changes: _Changes = {}
    changed = []
    with _hidden(estimate.positions, [setup.segments[i] for i in candidates]) as positions:
        for i in candidates:
            interpolated = setup.predictor.interpolate(setup.segments[i], positions)
            better, rest = _better(interpolated, predictions[i])
            changes[i] = (*rest, *better)
            if better:
                changed.append(i)
    predictions = _replaced(predictions, changes)
    setup.solve(estimate, predictions, changed)
    return predictions


def _fill_blackouts(setup: _Setup, estimate: Estimate, predictions: _Predictions) -> _Predictions:
    """Fill blackouts, when everything that the visible markers predict has been filled."""
    blackouts = _blackouts(setup.segments)
    indices = [i for blackout in blackouts for i in blackout]
    changes: _Changes = {}
    with _hidden(estimate.positions, [setup.segments[i] for i in indices]) as positions:
        for blackout in blackouts:
            segments = [setup.segments[i] for i in blackout]
            found = setup.predictor.predict_blackout(segments, positions)
            for i, segment in zip(blackout, segments, strict=True):
                changes[i] = tuple(
                    setup.postprocess.enforce_floor(part)  # curves over time do not jitter
                    for part in found
                    if part.first == segment.start and part.segment.markers[0] in segment.markers
                )
    predictions = _replaced(predictions, changes)
    setup.solve(estimate, predictions, indices)
    return predictions


def _interpolate_remaining(
    setup: _Setup, estimate: Estimate, predictions: _Predictions
) -> _Predictions:
    """Interpolate short gaps that nothing else predicts between single samples."""
    changes: _Changes = {}
    for i, segment in enumerate(setup.segments):
        predicted = [part.segment.markers for part in predictions[i]]
        rest = np.setdiff1d(segment.markers, np.concatenate([*predicted, [-1]]))
        if len(rest):
            remaining = replace(segment, markers=rest.astype(np.intp))
            found = setup.predictor.interpolate_remaining(remaining, estimate.positions)
            if found:
                changes[i] = (*predictions[i], *found)
    predictions = _replaced(predictions, changes)
    setup.solve(estimate, predictions, changes)
    return predictions


def _replaced(predictions: _Predictions, changes: _Changes) -> _Predictions:
    """Return predictions with those of some segments replaced."""
    return tuple(changes.get(i, parts) for i, parts in enumerate(predictions))


def _samples(segment: GapSegment) -> int:
    """Return the number of samples of a segment."""
    return (segment.stop - segment.start) * len(segment.markers)


def _is_final(parts: Sequence[SegmentPrediction]) -> bool:
    """Whether the second pass need not predict a segment again."""
    return all(part.complete for part in parts)


def _from_own_frames(segment: GapSegment, parts: Sequence[SegmentPrediction]) -> bool:
    """Whether all markers of a segment are predicted from the clip's own frames."""
    own = sum(len(part.segment.markers) for part in parts if part.from_own_frames)
    return own == len(segment.markers)


def _blackouts(segments: Sequence[GapSegment]) -> list[list[int]]:
    """Return the segments of each blackout, by their index: those that overlap or touch."""
    unseen = [i for i, segment in enumerate(segments) if not segment.has_enough_visible]
    blackouts: list[list[int]] = []
    stop = -1
    for i in sorted(unseen, key=lambda i: segments[i].start):
        if segments[i].start > stop:
            blackouts.append([])
        blackouts[-1].append(i)
        stop = max(stop, segments[i].stop)
    return blackouts


@contextmanager
def _hidden(
    positions: NDArray[np.float64], segments: Sequence[GapSegment]
) -> Iterator[NDArray[np.float64]]:
    """Yield positions in which some segments are missing, and restore them afterwards.

    The array itself is changed meanwhile, because a copy of a long clip is large.
    """
    places = [(slice(s.start, s.stop), s.markers) for s in segments]
    hidden = [positions[place] for place in places]
    for place in places:
        positions[place] = np.nan
    try:
        yield positions
    finally:
        for place, values in zip(places, hidden, strict=True):
            positions[place] = values


def _drop_uncertain(estimate: Estimate, max_expected_error: float) -> None:
    """Leave samples missing whose expected error exceeds a maximum (mm)."""
    estimate.drop(
        estimate.expected_rms > max_expected_error,
        "the visible markers do not determine it: expected error above "
        f"{max_expected_error:.0f} mm",
    )


def _better(
    interpolated: Sequence[SegmentPrediction], found: Sequence[SegmentPrediction]
) -> tuple[list[SegmentPrediction], list[SegmentPrediction]]:
    """Choose the interpolations with a smaller expected error than the predictions.

    Parameters
    ----------
    interpolated : sequence of SegmentPrediction
        Of one marker each.
    found : sequence of SegmentPrediction
        Predictions for the same segment.

    Returns
    -------
    better : list of SegmentPrediction
        The chosen interpolations.
    rest : list of SegmentPrediction
        The predictions of the other markers.
    """
    expected = {
        int(marker): (0.0 if part.from_own_frames else float(np.sqrt((expected_rms**2).mean())))
        for part in found
        for marker, expected_rms in zip(part.segment.markers, part.expected_rms.T, strict=True)
    }
    better = [
        part
        for part in interpolated
        if np.sqrt((part.expected_rms**2).mean())
        < expected.get(int(part.segment.markers[0]), np.inf)
    ]
    chosen = [int(part.segment.markers[0]) for part in better]
    columns = [np.flatnonzero(~np.isin(part.segment.markers, chosen)) for part in found]
    rest = [part.for_markers(kept) for part, kept in zip(found, columns, strict=True) if len(kept)]
    return better, rest
