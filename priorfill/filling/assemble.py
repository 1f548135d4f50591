"""Put what a method estimated into the clip, and sum up each gap."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts import Artefact, artefact_samples
from priorfill.clip import Clip
from priorfill.filling.result import FilledGap, Result, UnfilledSpan
from priorfill.gaps import Gap, find_gaps, runs
from priorfill.geometry.axes import from_upright
from priorfill.gp.calibration import BOUND_FACTOR, MEAN_FACTOR, common_bound
from priorfill.methods.task import Estimate, Note
from priorfill.runtime.threads import by_frames

__all__ = ["FilledSamples", "expected_errors", "filled_samples", "restore_rejected", "sum_up_gaps"]

NO_POSITION = "the method gave no finite position"
"""Reason given for a frame that the method left missing without a note."""


@dataclass(frozen=True, eq=False)
class FilledSamples:
    """The filled samples of a clip.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The clip's positions with the filled samples, in the clip's own axes.
    filled : ndarray of bool [shape=(frames, markers)]
        Which samples were filled.
    expected_rms : ndarray [shape=(frames, markers), mm]
        Expected rms error of each filled sample; NaN elsewhere and where unknown.
    error_bound_90 : ndarray [shape=(frames, markers), mm]
        Bound below which 90 % of the errors are expected; NaN likewise.
    not_kept_rms : ndarray [shape=(frames, markers), mm] or None
        Expected rms error of positions that were not kept; NaN elsewhere. None: there are none.
    """

    positions: NDArray[np.float64]
    filled: NDArray[np.bool_]
    expected_rms: NDArray[np.float64]
    error_bound_90: NDArray[np.float64]
    not_kept_rms: NDArray[np.float64] | None = None


def filled_samples(
    clip: Clip, estimate: Estimate, left_alone: Iterable[tuple[Gap, str]]
) -> FilledSamples:
    """Put the finite positions of an estimate into the requested samples of a clip.

    Parameters
    ----------
    clip : Clip
        The clip with gaps.
    estimate : Estimate
        Of a method. Its arrays are reused, because those of a long clip are large.
    left_alone : iterable of (Gap, str)
        Samples that stay missing whatever the estimate is, with the reason.

    Returns
    -------
    FilledSamples
        Measured samples keep their bits.
    """
    requested = clip.missing
    for gap, _ in left_alone:
        requested[gap.start : gap.stop, gap.marker] = False
    filled = requested.copy()
    filled[requested] = np.isfinite(estimate.positions[requested]).all(axis=1)
    positions = from_upright(estimate.positions, clip.up)
    if np.may_share_memory(positions, clip.positions):  # a method that filled nothing
        positions = positions.copy()
    by_frames(_copy_measured, positions, clip.positions, filled)
    positions.setflags(write=False)
    expected_rms, bound = estimate.expected_rms, estimate.error_bound_90
    not_kept_rms = None
    if any(by_frames(lambda *some: _not_kept(*some).any(), requested, filled, expected_rms)):
        not_kept = _not_kept(requested, filled, expected_rms)
        not_kept_rms = np.where(not_kept, expected_rms, np.nan)
    if bound is None:
        bound = BOUND_FACTOR * expected_rms
    by_frames(_blank_others, filled, expected_rms, bound)
    return FilledSamples(positions, filled, expected_rms, bound, not_kept_rms)


def _not_kept(
    requested: NDArray[np.bool_], filled: NDArray[np.bool_], expected_rms: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return which requested samples have an expected error but no position."""
    return requested & ~filled & np.isfinite(expected_rms)


def _blank_others(filled: NDArray[np.bool_], *values: NDArray[np.float64]) -> None:
    """Blank the values of all samples that are not filled, in place."""
    others = ~filled
    for some in values:
        some[others] = np.nan


def _copy_measured(
    positions: NDArray[np.float64], measured: NDArray[np.float64], filled: NDArray[np.bool_]
) -> None:
    """Replace all positions but those of filled samples by measured ones."""
    np.copyto(positions, measured, where=~filled[..., None])


def sum_up_gaps(
    clip: Clip,
    samples: FilledSamples,
    method: str,
    notes: Iterable[Note],
    left_alone: Iterable[tuple[Gap, str]],
) -> tuple[FilledGap, ...]:
    """Describe what became of each gap of a clip.

    Parameters
    ----------
    clip : Clip
        The clip with gaps.
    samples : FilledSamples
        What was filled.
    method : str
        The method.
    notes : iterable of Note
        What the method reports about runs of missing samples.
    left_alone : iterable of (Gap, str)
        Samples that were not to be filled, with the reason.

    Returns
    -------
    tuple of FilledGap
        In order of time.
    """
    gaps = find_gaps(clip.missing)
    of_marker: dict[int, list[Gap]] = defaultdict(list)
    for gap in gaps:
        of_marker[gap.marker].append(gap)
    notes_of: dict[Gap, list[Note]] = defaultdict(list)
    for note in notes:
        for gap in _overlapping(of_marker[note.marker], note.start, note.stop):
            notes_of[gap].append(note)
    alone_of: dict[Gap, list[UnfilledSpan]] = defaultdict(list)
    for alone, reason in left_alone:
        span = UnfilledSpan(alone.start, alone.stop, reason, requested=False)
        for gap in _overlapping(of_marker[alone.marker], alone.start, alone.start + 1):
            alone_of[gap].append(span)
    return tuple(
        _sum_up(clip.labels[gap.marker], gap, samples, method, notes_of[gap], alone_of[gap])
        for gap in gaps
    )


def _overlapping(gaps: Sequence[Gap], start: int, stop: int) -> Sequence[Gap]:
    """Return the gaps of a marker, given in order of time, that have some of the frames."""
    first = bisect_right(gaps, start, key=lambda gap: gap.stop)
    return gaps[first : bisect_left(gaps, stop, key=lambda gap: gap.start)]


def restore_rejected(result: Result, measured: Clip, artefacts: tuple[Artefact, ...]) -> Result:
    """Put rejected samples that were not filled back into the result.

    Parameters
    ----------
    result : Result
        Of the clip without the samples of its artefacts.
    measured : Clip
        The clip as it was measured.
    artefacts : tuple of Artefact
        Why samples were rejected; without any, the result is returned unchanged.

    Returns
    -------
    Result
        With the rejected samples and their artefacts.
    """
    if not artefacts:
        return result
    rejected = artefact_samples(artefacts, measured.labels, measured.frames) & ~measured.missing
    positions = np.where(result.clip.missing[..., None], measured.positions, result.clip.positions)
    clip = result.clip.with_positions(positions)
    return replace(result, clip=clip, rejected=rejected, artefacts=artefacts)


def expected_errors(
    expected_rms: NDArray[np.float64], error_bound_90: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Sum up the expected errors of the samples of a gap.

    Parameters
    ----------
    expected_rms, error_bound_90 : ndarray [shape=(frames,), mm]
        Of each sample; NaN where it was not filled or the value is unknown.

    Returns
    -------
    tuple of float
        Expected rms error, expected mean error, and the distance below which 90 % of the errors of
        all samples together are expected to lie (mm); NaN where unknown.
    """
    known = expected_rms[np.isfinite(expected_rms)]
    bounds = error_bound_90[np.isfinite(error_bound_90)]
    return (
        float(np.sqrt((known**2).mean())) if len(known) else float("nan"),
        MEAN_FACTOR * float(known.mean()) if len(known) else float("nan"),
        common_bound(bounds) if len(bounds) else float("nan"),
    )


def _sum_up(
    label: str,
    gap: Gap,
    samples: FilledSamples,
    method: str,
    notes: Sequence[Note],
    left_alone: list[UnfilledSpan],
) -> FilledGap:
    """Describe what became of one gap."""
    inside = slice(gap.start, gap.stop), gap.marker
    rms, mean, bound = expected_errors(samples.expected_rms[inside], samples.error_bound_90[inside])
    filled = samples.filled[inside]
    failed = ~filled
    for span in left_alone:
        failed[span.start - gap.start : span.stop - gap.start] = False
    unfilled = [*left_alone, *_unfilled_spans(gap, failed, samples, notes)]
    used = [note for note in notes if note.filled] if filled.any() else []
    return FilledGap(
        label=label,
        start=gap.start,
        stop=gap.stop,
        filled=int(filled.sum()),
        expected_rms_mm=rms,
        expected_mean_error_mm=mean,
        error_bound_90_mm=bound,
        method=method,
        sources=tuple(dict.fromkeys(note.source for note in used)),
        training_poses=max((note.training_poses for note in used), default=0),
        unfilled=tuple(sorted(unfilled, key=lambda span: span.start)),
        source_clips=tuple(dict.fromkeys(name for note in notes for name in note.source_clips)),
        expected_mean_error_without_database_mm=_error_without_database(gap, samples, used),
    )


def _error_without_database(gap: Gap, samples: FilledSamples, notes: Sequence[Note]) -> float:
    """Return the mean error (mm) expected without the database; NaN where it is unknown."""
    rms = samples.expected_rms[gap.start : gap.stop, gap.marker].copy()
    known = False
    for note in notes:
        if np.isfinite(note.relative_error):
            rms[max(note.start - gap.start, 0) : note.stop - gap.start] /= note.relative_error
            known = True
    return expected_errors(rms, rms)[1] if known else float("nan")


def _unfilled_spans(
    gap: Gap, failed: NDArray[np.bool_], samples: FilledSamples, notes: Sequence[Note]
) -> Iterator[UnfilledSpan]:
    """Yield the runs of frames of a gap that were not filled for the same reason."""
    reasons = [note for note in notes if not note.filled]
    number = np.full(gap.frames, -1)
    for index, note in reversed(
        list(enumerate(reasons))
    ):  # the first reason given takes precedence
        number[max(note.start - gap.start, 0) : max(note.stop - gap.start, 0)] = index
    texts = [*(note.source for note in reasons), NO_POSITION]  # -1 is the last one
    for first, last in runs(failed):
        changes = [
            i
            for i in range(first + 1, last)
            if number[i] >= 0 and texts[number[i]] != texts[number[i - 1]]
        ]
        for start, stop in pairwise([first, *changes, last]):
            start, stop = start + gap.start, stop + gap.start
            error = None
            if samples.not_kept_rms is not None:
                rms = samples.not_kept_rms[start:stop, gap.marker]
                rms = rms[np.isfinite(rms)]
                error = MEAN_FACTOR * float(rms.max()) if len(rms) else None
            yield UnfilledSpan(
                start, stop, texts[number[start - gap.start]], expected_mean_error_mm=error
            )
