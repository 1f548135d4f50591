"""Complete frames from the eigenvectors of trajectories, Eqs. (9)-(16) of Li et al. 2020.

Departures from the paper, and from the program that its authors published:

* Trajectories are windows around each gap, not of the clip's length, and centred by their measured
  frames. The published scripts subtract the mean of the truth in one place and the last measured
  frame in another; and they use as many eigenvectors as a frame has coordinates, hardly fewer than
  there are measured frames.
* Coordinates that the measured frames hardly determine are shrunk towards zero, by their usual
  size: the more, the worse the halves of the training trajectories complete each other, and until
  errors are amplified by at most `MAX_AMPLIFICATION`; see `eigenspaces.complete_frames`.
* Gaps of some markers are filled, too, from each marker's own trajectory.
* The paper does not state the weights W of measured frames, Eqs. (13)-(16). They are equal, or fall
  with the distance in time from the missing frames; see `Li2020Options.frame_sigma`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap, find_gaps
from priorfill.methods.li2020 import eigenspaces
from priorfill.methods.li2020.li2020_options import Li2020Options
from priorfill.methods.li2020.piece_sources import PieceSources, stretch
from priorfill.methods.task import Estimate, Progress, Task, no_progress

__all__ = ["pca_frames"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

SHRINKAGES = (1.0, 10.0, 100.0)
"""Factors of the relative standard deviation; the best one is used. With few trajectories, as for
long gaps, those of the gap are less similar to the training trajectories than these are to each
other."""

MAX_AMPLIFICATION = 15.0
"""Maximum factor by which errors of the measured frames are amplified in the missing ones; the
shrinkage is doubled until it holds."""

MAX_TRAJECTORIES = 6000
"""Maximum number of training trajectories; more are nearly the same, shifted in time."""


class _Trajectories:
    """Training trajectories of any length, of the clip and of windows of the database."""

    def __init__(self, task: Task, options: Li2020Options) -> None:
        self._sources = PieceSources(task, np.flatnonzero(task.valid.any(axis=0)), options)
        self.takes = self._sources.takes
        self._known: dict[int, list[Array]] = {}

    def of(self, length: int) -> list[Array]:
        """Return the triangular factors of the earlier and the later trajectories of a length.

        Returns
        -------
        list of ndarray [shape=(n, length)]
            Two, from different frames; one if only one window has this length; none if no window
            has.
        """
        if length not in self._known:
            pieces = map(_unbroken, self._sources.pieces(length))
            found = [trajectories for trajectories in pieces if trajectories.size]
            found = found[:: 1 + sum(map(len, found)) // MAX_TRAJECTORIES]
            middle = (len(found) + 1) // 2
            halves = [found[:middle], found[middle:]]
            self._known[length] = [
                eigenspaces.triangular(np.concatenate(half)) for half in halves if half
            ]
        return self._known[length]


def _unbroken(piece: Array) -> Array:
    """Return the trajectories of markers visible throughout, as rows."""
    visible = ~np.isnan(piece[..., 0]).any(axis=0)
    return piece[:, visible].reshape(len(piece), -1).T


def pca_frames(
    task: Task, progress: Progress = no_progress, options: Li2020Options | None = None
) -> Estimate:
    """Fill complete missing frames by the eigenvectors of trajectories, Eqs. (9)-(16).

    Parameters
    ----------
    task : Task
        The clip, and the takes from which training windows are chosen.
    progress : callable
        Called with the number of samples done since the last call.
    options : Li2020Options, optional
        The defaults if not given.

    Returns
    -------
    Estimate
        Gaps that are longer than all training data, and markers that are never visible, stay
        missing. Errors are not predicted.

    See Also
    --------
    pca_train : For gaps of some markers.
    """
    options = options or Li2020Options()
    positions = task.positions.copy()
    takes = _fill_gaps(task, positions, options) if task.groups else ()
    progress(task.samples)

    def reason(gap: Gap) -> str:
        if task.valid[:, gap.marker].any():
            return (
                f"no recording shows a marker for {gap.frames} frames and the frames around them; "
                "give longer recordings"
            )
        return "it is never visible; use a method that learns from other markers"

    source = "eigenspaces of trajectories"
    return Estimate.without_errors(task, positions, source, reason, takes)


def _fill_gaps(task: Task, positions: Array, options: Li2020Options) -> tuple[str, ...]:
    """Write what is found into ``positions``; return the recordings that are learnt from."""
    trajectories = _Trajectories(task, options)
    spans: dict[tuple[int, int], list[int]] = {}
    for gap in find_gaps(~task.valid):
        spans.setdefault((gap.start, gap.stop), []).append(gap.marker)
    for (start, stop), markers in spans.items():
        begin, end = stretch(start, stop, len(positions), options)
        window = task.positions[begin:end]
        halves = trajectories.of(end - begin)
        if not halves:
            continue
        patterns, which = np.unique(task.valid[begin:end, markers], axis=1, return_inverse=True)
        for number, shown in enumerate(patterns.T):
            if not shown.any():
                continue
            those = np.array(markers)[which.ravel() == number]
            measured = _Measured(shown, _frame_weights(shown, options))
            found = _completed(window[:, those], measured, halves, options)
            positions[start:stop, those] = found[start - begin : stop - begin]
    return trajectories.takes


def _frame_weights(shown: Bools, options: Li2020Options) -> Array:
    """Return the diagonal of W: the weight of each measured frame."""
    times, missing = np.flatnonzero(shown), np.flatnonzero(~shown)
    if options.frame_sigma is None:
        return np.ones(len(times))
    frames = abs(times[:, None] - missing).min(axis=1) / len(missing)
    weights: Array = np.exp(-((frames / options.frame_sigma) ** 2) / 2.0)
    return weights


@dataclass(frozen=True, eq=False)
class _Measured:
    """Which frames are measured [shape=(frames,)], and their weights [shape=(measured,)]."""

    shown: Bools
    weights: Array

    def complete(
        self, visible: Array, space: eigenspaces.TrajectorySpace, shrinkage: float
    ) -> Array:
        """Return the missing frames of trajectories [shape=(missing, n)]."""
        return eigenspaces.complete_frames(
            visible, space, self.shown, shrinkage, weights=self.weights
        )


def _best_shrinkage(halves: list[Array], measured: _Measured, options: Li2020Options) -> float:
    """Return the shrinkage with which the halves of some trajectories best complete each other.

    Trajectories of the same frames would complete each other too well, so with one half only it is
    the largest.
    """
    if len(halves) < 2:
        return SHRINKAGES[-1]
    shown = measured.shown
    errors = np.zeros(len(SHRINKAGES))
    for one, other in permutations(halves, 2):
        space = eigenspaces.trajectory_space(
            one, share=options.trajectory_singular_share, rank=options.rank
        )
        for number, shrinkage in enumerate(SHRINKAGES):
            found = measured.complete(other[:, shown].T, space, shrinkage)
            errors[number] += ((found - other[:, ~shown].T) ** 2).sum()
    return SHRINKAGES[int(errors.argmin())]


def _amplification(
    space: eigenspaces.TrajectorySpace, measured: _Measured, shrinkage: float
) -> float:
    """Return the maximum factor by which errors of the measured frames are amplified."""
    unit = np.eye(int(measured.shown.sum()))
    return float(np.linalg.norm(measured.complete(unit, space, shrinkage), 2))


def _completed(
    window: Array, measured: _Measured, halves: list[Array], options: Li2020Options
) -> Array:
    """Complete markers that are missing in the same frames [shape=(frames, markers, 3)]."""
    shown = measured.shown
    centred = [half - half[:, shown].mean(axis=1, keepdims=True) for half in halves]
    space = eigenspaces.trajectory_space(
        np.concatenate(centred), share=options.trajectory_singular_share, rank=options.rank
    )
    shrinkage = _best_shrinkage(centred, measured, options)
    while (
        _amplification(space, measured, shrinkage) > MAX_AMPLIFICATION
        and (space.relative_std > 0).any()
    ):
        shrinkage *= 2.0
    visible = window[shown].reshape(int(shown.sum()), -1)
    middle = visible.mean(axis=0)
    completed = np.array(window)
    found = measured.complete(visible - middle, space, shrinkage)
    completed[~shown] = (found + middle).reshape(-1, *window.shape[1:])
    return completed
