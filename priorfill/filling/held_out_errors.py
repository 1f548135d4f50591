"""Expected errors of methods that predict none: those of artificial gaps like the real ones.

The missing samples of each gap group are removed a second time, shifted to frames in which the
same markers are measured, and the method fills both. The errors of the copies are the expected
errors of the gaps. A gap at the clip's start or end is lengthened by as many frames as it has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MethodError
from priorfill.gaps import Gap, gap_groups, runs
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

MAX_PAIRS = 100_000
"""Pairs of a gap and a span of measured frames that are compared at once, to limit the memory."""

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
            placed = set()
            for gap in rest:
                start, stop = gap.start + shift, gap.stop + shift
                if shift and _is_free(task, used, start - 1, stop + 1, gap.marker):
                    placed.add(gap)
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
    change = np.zeros(2 * frames)  # of the score from each shift to the next, from 1 - frames
    for marker, some in _by_marker(gaps):
        edges = np.array([(gap.start - 1, gap.stop + 1) for gap in some], dtype=np.intp)
        spans = np.array(list(runs(task.valid[:, marker] & ~used[:, marker])), dtype=np.intp)
        spans = spans.reshape(-1, 2)
        spans = spans[np.ptp(spans, axis=1) >= np.ptp(edges, axis=1).min()]
        batch = max(MAX_PAIRS // max(len(spans), 1), 1)
        for first, last in (edges[i : i + batch].T for i in range(0, len(edges), batch)):
            # a gap and the frames next to it fit into a span at these shifts
            least, most = spans[:, :1] - first, spans[:, 1:] - last
            fits = least <= most
            weight = np.broadcast_to(last - first - 2, fits.shape)[fits]
            np.add.at(change, least[fits] + frames - 1, weight)
            np.subtract.at(change, most[fits] + frames, weight)
    score = np.cumsum(change[:-1])
    if not score.any():
        return 0
    best = np.flatnonzero(score == score.max()) - (frames - 1)
    side = (best > 0) == (number % 2 == 0)
    return int(best[np.lexsort((np.abs(best), ~side))[0]])


def _by_marker(gaps: Sequence[Gap]) -> Iterable[tuple[int, list[Gap]]]:
    """Return the gaps of each marker."""
    found: dict[int, list[Gap]] = {}
    for gap in gaps:
        found.setdefault(gap.marker, []).append(gap)
    return found.items()


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
