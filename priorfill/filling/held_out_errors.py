"""Expected errors of methods that predict none: those of artificial gaps like the real ones.

The missing samples of each gap group are removed a second time, shifted to frames in which the
same markers are measured, and the method fills both. The errors of the copies are the expected
errors of the gaps. A gap at the clip's start or end is lengthened by as many frames as it has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MethodError
from priorfill.gaps import Gap, gap_groups
from priorfill.geometry.distances import norms
from priorfill.gp.calibration import MIN_EXPECTED_RMS
from priorfill.methods.task import Estimate, Task

__all__ = ["HELD_OUT_BOUND_FACTOR", "with_held_out_errors"]

ROUNDS = 2
"""Times that each gap is copied. Each costs as much as the fill itself."""

HELD_OUT_BOUND_FACTOR = 2.1
"""Ratio of the 90 % bound to the rms error of the copies: larger than
`priorfill.gp.calibration.BOUND_FACTOR`, because that error is an estimate from few gaps. It covers
about nine errors in ten over methods in ``scripts/studies/plausibility_study.py``."""

_Fill = Callable[[Task], Estimate]


@dataclass(frozen=True)
class _Copy:
    """An artificial gap, and the real one that it resembles."""

    of: Gap
    start: int
    stop: int


def with_held_out_errors(task: Task, estimate: Estimate, fill: _Fill) -> Estimate:
    """Return an estimate with expected errors from artificial gaps.

    Parameters
    ----------
    task : Task
        The task.
    estimate : Estimate
        Of a method that predicts no errors. Its own expected errors are kept where it has any.
    fill : callable
        The method.

    Returns
    -------
    Estimate
        The expected error is the same throughout a gap; unknown for gaps of markers that are not
        measured long enough elsewhere.
    """
    squares: dict[Gap, list[float]] = {}
    used = np.zeros_like(task.valid)
    for number in range(ROUNDS):
        copies = _copies(task, used, number)
        if not copies:
            break
        for gap, square in _errors(task, copies, fill):
            squares.setdefault(gap, []).append(square)
    unknown = np.isnan(estimate.expected_rms)
    for gap, found in squares.items():
        inside = slice(gap.start, gap.stop), gap.marker
        rms = max(float(np.sqrt(np.mean(found))), MIN_EXPECTED_RMS)
        filled = unknown[inside] & np.isfinite(estimate.positions[inside]).all(axis=1)
        estimate.expected_rms[inside][filled] = rms
    if estimate.error_bound_90 is not None:
        return estimate
    return replace(estimate, error_bound_90=HELD_OUT_BOUND_FACTOR * estimate.expected_rms)


def _copies(task: Task, used: NDArray[np.bool_], number: int) -> list[_Copy]:
    """Choose artificial gaps, and mark their samples as used."""
    copies: list[_Copy] = []
    for group in task.groups:
        rest = [gap for gap in group.gaps if gap.start > 0 and gap.stop < len(task.positions)]
        while rest:  # those that fit together, then those that are left
            shift = _shift(task, used, rest, number)
            placed = []
            for gap in rest:
                start, stop = gap.start + shift, gap.stop + shift
                if shift and _is_free(task, used, start - 1, stop + 1, gap.marker):
                    placed.append(gap)
                    copies.append(_Copy(gap, start, stop))
                    used[start:stop, gap.marker] = True
            if not placed:
                break
            rest = [gap for gap in rest if gap not in placed]
        if number:  # a gap at an end can be lengthened only once
            continue
        for gap in group.gaps:
            start, stop = gap.stop, gap.stop + gap.frames
            if gap.stop == len(task.positions):
                start, stop = gap.start - gap.frames, gap.start
            elif gap.start > 0:
                continue
            if _is_free(task, used, start - 1, stop + 1, gap.marker, at_end=True):
                copies.append(_Copy(gap, start, stop))
                used[start:stop, gap.marker] = True
    return copies


def _shift(task: Task, used: NDArray[np.bool_], gaps: Sequence[Gap], number: int) -> int:
    """Return the shift at which most samples of some gaps are measured, the smallest one; or 0.

    Copies of different rounds are on different sides of the gaps if possible.
    """
    frames = len(task.positions)
    shifts = np.arange(1 - frames, frames)
    score = np.zeros(len(shifts))
    for gap in gaps:
        free = task.valid[:, gap.marker] & ~used[:, gap.marker]
        taken = np.concatenate([[0], np.cumsum(~free)])
        first, last = gap.start + shifts - 1, gap.stop + shifts + 1
        inside = (first >= 0) & (last <= frames)
        clear = taken[np.where(inside, last, 0)] == taken[np.where(inside, first, 0)]
        score += gap.frames * (inside & clear)
    if not score.any():
        return 0
    side = (shifts > 0) == (number % 2 == 0)
    best = np.lexsort((np.abs(shifts), ~side, -score))[0]
    return int(shifts[best])


def _is_free(
    task: Task,
    used: NDArray[np.bool_],
    start: int,
    stop: int,
    marker: int,
    *,
    at_end: bool = False,
) -> bool:
    """Whether a marker is measured and not used in some frames; next to a gap but for its edge."""
    frames = slice(max(start, 0), stop)
    if not (start + at_end >= 0 and stop - at_end <= len(task.positions)):
        return False
    free = task.valid[frames, marker] & ~used[frames, marker]
    return int((~free).sum()) <= at_end and len(free) > 2


def _errors(task: Task, copies: list[_Copy], fill: _Fill) -> list[tuple[Gap, float]]:
    """Return the mean squared error (mm²) of each artificial gap that the method fills."""
    positions = task.positions.copy()
    for copy in copies:
        positions[copy.start : copy.stop, copy.of.marker] = np.nan
    missing = np.isnan(positions[..., 0])
    removed = missing & task.valid
    groups = tuple(
        group
        for group in gap_groups(missing)
        if any(removed[gap.start : gap.stop, gap.marker].any() for gap in group.gaps)
    )
    try:
        found = fill(replace(task, positions=positions, groups=groups, known_geometry=None))
    except MethodError:  # too little is left to learn from
        return []
    errors = []
    for copy in copies:
        inside = slice(copy.start, copy.stop), copy.of.marker
        apart = norms(found.positions[inside] - task.positions[inside])
        if np.isfinite(apart).all():
            errors.append((copy.of, float((apart**2).mean())))
    return errors
