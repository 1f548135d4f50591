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
        shifts = _Shifts(task, used, rest)
        while rest:  # those that fit together, then those that are left
            shift = shifts.best(number)
            placed = shifts.fitting(rest, shift) if shift else set()
            if not placed:
                break
            left = [gap for gap in rest if gap not in placed]
            shifts.place(rest, left, shift)
            copies += [
                _Copy(gap, gap.start + shift, gap.stop + shift) for gap in rest if gap in placed
            ]
            rest = left
        if number:  # a gap at an end can be lengthened only once
            continue
        for gap in group.gaps:
            start, stop = gap.stop, gap.stop + gap.frames
            if gap.stop == len(task.positions):
                start, stop = gap.start - gap.frames, gap.start
            elif gap.start > 0:
                continue
            if _is_free_at_end(task, used, start - 1, stop + 1, gap.marker):
                copies.append(_Copy(gap, start, stop))
                used[start:stop, gap.marker] = True
    return copies


class _Shifts:
    """How many samples of some gaps are measured and not used, shifted by each number of frames.

    Parameters
    ----------
    task : Task
        The task.
    used : ndarray of bool [shape=(frames, markers)]
        Samples that are used; `place` marks others.
    gaps : sequence of Gap
        The gaps.
    """

    def __init__(self, task: Task, used: NDArray[np.bool_], gaps: Sequence[Gap]) -> None:
        self._valid = task.valid
        self._used = used
        self._frames = len(task.positions)
        self._taken: dict[int, NDArray[np.int32]] = {}
        # of the score from each shift to the next, from 1 - frames; whole numbers, so exact
        self._change = np.zeros(2 * self._frames)
        for marker, some in _by_marker(gaps).items():
            self._add(marker, some, 1.0)

    def best(self, number: int) -> int:
        """Return the shift at which most samples are measured, the smallest one; or 0.

        Copies of different rounds are on different sides of the gaps if possible.
        """
        score = np.cumsum(self._change[:-1])
        if not score.any():
            return 0
        best = np.flatnonzero(score == score.max()) - (self._frames - 1)
        side = (best > 0) == (number % 2 == 0)
        return int(best[np.lexsort((np.abs(best), ~side))[0]])

    def fitting(self, gaps: Sequence[Gap], shift: int) -> set[Gap]:
        """Return the gaps whose frames, and those next to them, are measured and not used."""
        found: set[Gap] = set()
        for marker, some in _by_marker(gaps).items():
            taken = self._taken_before(marker)
            start, stop = _edges(some).T + shift
            inside = (start >= 0) & (stop <= self._frames)
            free = taken[np.where(inside, stop, 0)] == taken[np.where(inside, start, 0)]
            found.update(some[i] for i in np.flatnonzero(inside & free))
        return found

    def place(self, gaps: Sequence[Gap], left: Sequence[Gap], shift: int) -> None:
        """Use the samples of the gaps that are not left, in shifted frames."""
        before, after = _by_marker(gaps), _by_marker(left)
        for marker, some in before.items():
            rest = after.get(marker, [])
            if len(rest) == len(some):
                continue
            self._add(marker, some, -1.0)
            self._taken.pop(marker, None)
            kept = set(rest)
            for gap in some:
                if gap not in kept:
                    self._used[gap.start + shift : gap.stop + shift, marker] = True
            self._add(marker, rest, 1.0)

    def _taken_before(self, marker: int) -> NDArray[np.int32]:
        """Return how many samples before each frame are not free [shape=(frames + 1,)]."""
        if marker not in self._taken:
            taken = np.zeros(self._frames + 1, dtype=np.int32)
            np.cumsum(~self._free(marker), out=taken[1:])
            self._taken[marker] = taken
        return self._taken[marker]

    def _free(self, marker: int) -> NDArray[np.bool_]:
        return self._valid[:, marker] & ~self._used[:, marker]

    def _add(self, marker: int, gaps: Sequence[Gap], sign: float) -> None:
        """Add the samples of a marker's gaps."""
        if not gaps:
            return
        edges = _edges(gaps)
        free = np.concatenate([[False], self._free(marker), [False]])
        spans = np.flatnonzero(free[1:] != free[:-1]).reshape(-1, 2)
        spans = spans[np.ptp(spans, axis=1) >= np.ptp(edges, axis=1).min()]
        batch = max(MAX_PAIRS // max(len(spans), 1), 1)
        for first, last in (edges[i : i + batch].T for i in range(0, len(edges), batch)):
            # a gap and the frames next to it fit into a span at these shifts
            least, most = spans[:, :1] - first, spans[:, 1:] - last
            fits = least <= most
            weight = sign * np.broadcast_to(last - first - 2, fits.shape)[fits]
            np.add.at(self._change, least[fits] + self._frames - 1, weight)
            np.subtract.at(self._change, most[fits] + self._frames, weight)


def _edges(gaps: Sequence[Gap]) -> NDArray[np.intp]:
    """Return the frames of gaps with one more on either side [shape=(gaps, 2)]."""
    return np.array([(gap.start - 1, gap.stop + 1) for gap in gaps], dtype=np.intp)


def _by_marker(gaps: Sequence[Gap]) -> dict[int, list[Gap]]:
    """Return the gaps of each marker."""
    found: dict[int, list[Gap]] = {}
    for gap in gaps:
        found.setdefault(gap.marker, []).append(gap)
    return found


def _is_free_at_end(
    task: Task, used: NDArray[np.bool_], start: int, stop: int, marker: int
) -> bool:
    """Whether a marker is measured and not used in some frames but for one next to a gap."""
    frames = slice(max(start, 0), stop)
    if start + 1 < 0 or stop - 1 > len(task.positions):
        return False
    free = task.valid[frames, marker] & ~used[frames, marker]
    return int((~free).sum()) <= 1 and len(free) > 2


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
