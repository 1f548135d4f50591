"""The methods of Li et al. 2020 on a task.

Departures from the paper, and from the program that its authors published:

* Eq. (3) is solved as a least-squares problem; see `eigenspaces.transformation`.
* U_i0 and U_10 of `pca_pieces`, Eqs. (5) and (8), are rotated to be nearest to U_N0; see
  `eigenspaces.train_windows`. (The published program fits T with U_i0 and applies it to U_N0.)
* Windows of the database are chosen by their similarity to the clip; see `training_windows`. The
  clip's own complete frames are a further window, and the only one without a database.
* The template of the clip masks markers, not samples: a marker with a gap is masked in all frames
  of all windows, as in the published comparison. If that leaves fewer than three markers, each gap
  group has its own template; and if that does, too, each set of missing markers.
* As in the published comparison, the mean of the visible markers is first subtracted from each
  frame, and coordinates are divided by their standard deviations and weighted by the distance of
  their marker from the markers with gaps.
* Trajectories of `pca_frames`, Eqs. (9)-(16), are windows around each gap, not of the clip's
  length, and centred by their measured frames. The published scripts subtract the mean of the truth
  in one place and the last measured frame in another; and they use as many eigenvectors as a frame
  has coordinates, hardly fewer than there are measured frames. Here coordinates that the measured
  frames hardly determine are shrunk towards zero, by their usual size: the more, the worse the
  halves of the training trajectories complete each other, and until errors are amplified by at most
  `MAX_AMPLIFICATION`; see `eigenspaces.complete_frames`. Gaps of some markers are filled, too, from
  each marker's own trajectory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MethodError
from priorfill.gaps import Gap, find_gaps, runs
from priorfill.methods.li2020 import eigenspaces
from priorfill.methods.li2020.li2020_options import Li2020Options
from priorfill.methods.li2020.training_windows import (
    TrainingWindow,
    choose_windows,
    shows_all,
)
from priorfill.methods.task import Estimate, Progress, Task, no_progress
from priorfill.signal.resample import resample

__all__ = ["pca_frames", "pca_pieces", "pca_train"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

Complete = Callable[[list[Array], list[Array], Array, Li2020Options], Array]
"""Function that completes a masked clip from windows and the same windows masked."""

MIN_VISIBLE = 3
"""Markers that a template must leave visible; with fewer it is split, if possible."""

MIN_TRAINING_FRAMES = 2
"""Complete frames needed: the standard deviation of one is undefined."""

BATCH_FRAMES = 256
"""Frames whose distances are computed at once; limits the memory to a few MB."""

SHRINKAGES = (1.0, 10.0, 100.0)
"""Factors of the relative standard deviation; the best one is used. With few trajectories, as for
long gaps, those of the gap are less similar to the training trajectories than these are to each
other."""

MAX_AMPLIFICATION = 15.0
"""Maximum factor by which errors of the measured frames are amplified in the missing ones; the
shrinkage is doubled until it holds."""

MAX_TRAJECTORIES = 6000
"""Maximum number of training trajectories; more are nearly the same, shifted in time."""


def _train(full: list[Array], masked: list[Array], clip: Array, options: Li2020Options) -> Array:
    spaces = eigenspaces.train(
        np.concatenate(full),
        np.concatenate(masked),
        share=options.min_singular_share,
        rank=options.rank,
    )
    return spaces.complete(clip)


def _train_windows(
    full: list[Array], masked: list[Array], clip: Array, options: Li2020Options
) -> Array:
    spaces = eigenspaces.train_windows(
        full, masked, share=options.min_singular_share, rank=options.rank
    )
    return spaces.complete(clip)


def _coordinates(positions: Array) -> Array:
    return positions.reshape(len(positions), -1)


@dataclass(frozen=True, eq=False)
class _TrainingData:
    """The training data of `pca_train` and `pca_pieces`.

    Attributes
    ----------
    markers : ndarray of int
        Markers of the clip that all frames of all windows show.
    windows : list of ndarray [shape=(rows, 1 + 3 markers)]
        The triangular factor of each window's frames, with a column of ones before them: its rows
        have the same sums and products as the frames.
    distances : ndarray [shape=(markers, markers), mm]
        Mean distances of markers.
    takes : tuple of str
        Names of the recordings, without the clip.
    """

    markers: Ints
    windows: list[Array]
    distances: Array
    takes: tuple[str, ...]


def _condensed(frames: Array) -> Array:
    rows = np.concatenate([np.ones((len(frames), 1)), _coordinates(frames)], axis=1)
    return eigenspaces.triangular(rows)


def _mean_distances(windows: list[Array]) -> Array:
    """Return the mean distances of markers over all frames of some windows."""
    markers = windows[0].shape[1]
    total = np.zeros((markers, markers))
    for window in windows:
        for start in range(0, len(window), BATCH_FRAMES):
            some = window[start : start + BATCH_FRAMES]
            total += np.linalg.norm(some[:, :, None] - some[:, None], axis=3).sum(axis=0)
    distances: Array = total / sum(len(window) for window in windows)
    return distances


def _complete(positions: Array) -> Array:
    """Return the frames that show every marker."""
    return positions[~np.isnan(positions[..., 0]).any(axis=1)]


def _marker_sets(task: Task) -> Iterator[Ints]:
    """Yield sets of markers to fill, the largest first, which the takes may not show."""
    seen = task.valid.any(axis=0)
    largest = seen.copy()
    for take in task.takes:
        if shows_all(take, np.flatnonzero(seen)):
            largest |= take.shown > 0
    yield np.flatnonzero(largest)
    if largest.sum() > seen.sum():
        yield np.flatnonzero(seen)


def _training_data(task: Task, options: Li2020Options) -> _TrainingData:
    """Collect the training data of a task."""
    for markers in _marker_sets(task):
        clip = task.positions[:, markers]
        chosen = choose_windows(clip, task.rate, task.takes, markers, options)
        windows = [
            frames
            for frames in [_complete(clip), *(_complete(window.positions) for window in chosen)]
            if len(frames)
        ]
        if sum(len(frames) for frames in windows) >= MIN_TRAINING_FRAMES:
            return _TrainingData(
                markers,
                [_condensed(frames) for frames in windows],
                _mean_distances(windows),
                tuple(dict.fromkeys(window.name for window in chosen)),
            )
    raise MethodError(
        f"{task.name}: fewer than {MIN_TRAINING_FRAMES} frames of the clip and of the other "
        "recordings show all its markers; give a database with recordings that do"
    )


def _parts(missing: Bools) -> Iterator[tuple[Ints, Bools]]:
    """Yield frames that share a template, and which markers the template masks."""
    seen = ~np.logical_and.reduce(missing, axis=1)
    if not missing[seen].any():
        return
    template = np.logical_or.reduce(missing[seen], axis=0)
    if (~template).sum() >= MIN_VISIBLE:
        yield np.flatnonzero(seen & missing.any(axis=1)), template
        return
    rest = []
    for start, stop in runs(np.logical_or.reduce(missing, axis=1) & seen):
        template = np.logical_or.reduce(missing[start:stop], axis=0)
        if (~template).sum() >= MIN_VISIBLE:
            yield np.arange(start, stop), template
        else:
            rest.append(np.arange(start, stop))
    if rest:
        frames = np.concatenate(rest)
        patterns, which = np.unique(missing[frames], axis=0, return_inverse=True)
        for number, pattern in enumerate(patterns):
            yield frames[which.ravel() == number], pattern


def _without_mean(rows: Array, visible: Bools) -> tuple[Array, Array]:
    """Subtract the mean of the visible markers from rows of coordinates.

    Returns
    -------
    rest, mean : ndarray [shape=(rows, markers, 3)], [shape=(rows, 1, 3)]
    """
    points = rows.reshape(len(rows), len(visible), 3)
    mean = points[:, visible].mean(axis=1, keepdims=True)
    return points - mean, mean


def _filled_part(
    clip: Array,
    template: Bools,
    training: _TrainingData,
    complete: Complete,
    options: Li2020Options,
) -> Array:
    """Complete the masked markers of some frames [shape=(frames, markers, 3)]."""
    visible = ~template
    ones = [window[:, :1] for window in training.windows]
    frames = sum(float((one**2).sum()) for one in ones)
    rests = [_coordinates(_without_mean(window[:, 1:], visible)[0]) for window in training.windows]
    mean = np.sum([one.T @ rest for one, rest in zip(ones, rests, strict=True)], axis=0) / frames
    centred = [rest - one @ mean for one, rest in zip(ones, rests, strict=True)]
    squares = np.sum([(rows**2).sum(axis=0) for rows in centred], axis=0)
    sd = np.sqrt(squares / max(frames - 1.0, 1.0))
    # the standard deviation of a constant coordinate is a rounding error
    sd[sd <= eigenspaces.MIN_SINGULAR_RATIO * max(sd.max(), 1.0)] = 1.0

    distance = training.distances[template].min(axis=0)
    weight = np.where(
        template, options.gap_weight, np.exp(-(distance**2) / (2.0 * options.sigma**2))
    )
    scale = np.repeat(weight, 3) / sd
    shown = np.repeat(visible, 3)
    full = [rows * scale for rows in centred]
    masked = [rows * shown for rows in full]
    rest, middle = _without_mean(_coordinates(clip), visible)
    own = np.where(shown, (_coordinates(rest) - mean) * scale, 0.0)
    completed = complete(full, masked, own, options)
    filled = np.full_like(completed, np.nan)
    filled[:, ~shown] = completed[:, ~shown] / scale[~shown] + mean[0, ~shown]
    return filled.reshape(clip.shape) + middle


def _by_markers(
    task: Task,
    progress: Progress,
    options: Li2020Options,
    complete: Complete,
    source: str,
) -> Estimate:
    """Fill missing markers from the visible markers of the same frames."""
    positions = task.positions.copy()
    takes: tuple[str, ...] = ()
    if task.groups:
        training = _training_data(task, options)
        takes = training.takes
        clip = task.positions[:, training.markers]
        for frames, template in _parts(np.isnan(clip[..., 0])):
            found = _filled_part(clip[frames], template, training, complete, options)
            here = np.ix_(frames, training.markers)
            positions[here] = np.where(np.isnan(positions[here]), found, positions[here])
            progress(int(np.isnan(clip[frames, :, 0]).sum()))

    def reason(gap: Gap) -> str:
        if task.valid[:, gap.marker].any():
            return "no marker is visible; pca-frames fills whole frames"
        return "it is never visible, and no other recording shows it with the other markers"

    others = f", with {len(takes)} other recordings" if takes else ""
    return Estimate.without_errors(task, positions, source + others, reason, takes)


def pca_train(
    task: Task, progress: Progress = no_progress, options: Li2020Options | None = None
) -> Estimate:
    """Fill gaps by the eigenvectors of training windows, Eqs. (1)-(4).

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
        Frames without any visible marker stay missing. Errors are not predicted.

    Raises
    ------
    MethodError
        Where fewer than two frames of the clip and the takes show all markers.

    See Also
    --------
    pca_pieces : With eigenvectors of each window.
    pca_frames : For gaps of all markers.
    """
    source = "eigenspaces of complete frames"
    return _by_markers(task, progress, options or Li2020Options(), _train, source)


def pca_pieces(
    task: Task, progress: Progress = no_progress, options: Li2020Options | None = None
) -> Estimate:
    """Fill gaps by eigenvectors of each masked window, Eqs. (5)-(8); see `pca_train`."""
    source = "eigenspaces of each window"
    return _by_markers(task, progress, options or Li2020Options(), _train_windows, source)


class _Trajectories:
    """Training trajectories of any length, of the clip and of windows of the database."""

    def __init__(self, task: Task, options: Li2020Options) -> None:
        self._options = options
        self._sources = [task.positions]
        self.takes: tuple[str, ...] = ()
        seen = np.flatnonzero(task.valid.any(axis=0))
        if len(seen):
            chosen = choose_windows(task.positions[:, seen], task.rate, task.takes, seen, options)
            self._sources += [_at_rate(window, task.rate) for window in chosen]
            self.takes = tuple(dict.fromkeys(window.name for window in chosen))
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
            stride = max(1, int(self._options.stride * length))
            found = [
                part
                for positions in self._sources
                for start in range(0, len(positions) - length + 1, stride)
                if (part := _unbroken(positions[start : start + length])).size
            ]
            found = found[:: 1 + sum(map(len, found)) // MAX_TRAJECTORIES]
            middle = (len(found) + 1) // 2
            halves = [found[:middle], found[middle:]]
            self._known[length] = [
                eigenspaces.triangular(np.concatenate(half)) for half in halves if half
            ]
        return self._known[length]


def _unbroken(window: Array) -> Array:
    """Return the trajectories of markers visible throughout, as rows."""
    visible = ~np.isnan(window[..., 0]).any(axis=0)
    return window[:, visible].reshape(len(window), -1).T


def _at_rate(window: TrainingWindow, rate: float) -> Array:
    """Return the positions of a window at a rate (Hz)."""
    return resample(window.positions, window.rate, rate)


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
    trajectories = _Trajectories(task, options) if task.groups else None
    positions = task.positions.copy()
    spans: dict[tuple[int, int], list[int]] = {}
    for gap in find_gaps(~task.valid) if trajectories is not None else ():
        spans.setdefault((gap.start, gap.stop), []).append(gap.marker)
    for (start, stop), markers in spans.items():
        context = max(options.min_context_frames, round(options.context * (stop - start)))
        begin, end = max(start - context, 0), min(stop + context, len(positions))
        window = task.positions[begin:end]
        assert trajectories is not None
        halves = trajectories.of(end - begin)
        if not halves:
            continue
        patterns, which = np.unique(task.valid[begin:end, markers], axis=1, return_inverse=True)
        for number, shown in enumerate(patterns.T):
            if not shown.any():
                continue
            those = np.array(markers)[which.ravel() == number]
            found = _completed(window[:, those], shown, halves, options)
            positions[start:stop, those] = found[start - begin : stop - begin]
    progress(task.samples)

    def reason(gap: Gap) -> str:
        if task.valid[:, gap.marker].any():
            return (
                f"no recording shows a marker for {gap.frames} frames and the frames around them; "
                "give longer recordings"
            )
        return "it is never visible; use a method that learns from other markers"

    takes = trajectories.takes if trajectories is not None else ()
    source = "eigenspaces of trajectories"
    return Estimate.without_errors(task, positions, source, reason, takes)


def _best_shrinkage(halves: list[Array], shown: Bools, options: Li2020Options) -> float:
    """Return the shrinkage with which the halves of some trajectories best complete each other.

    Trajectories of the same frames would complete each other too well, so with one half only it is
    the largest.
    """
    if len(halves) < 2:
        return SHRINKAGES[-1]
    errors = np.zeros(len(SHRINKAGES))
    for one, other in permutations(halves, 2):
        space = eigenspaces.trajectory_space(
            one, share=options.trajectory_singular_share, rank=options.rank
        )
        for number, shrinkage in enumerate(SHRINKAGES):
            found = eigenspaces.complete_frames(other[:, shown].T, space, shown, shrinkage)
            errors[number] += ((found - other[:, ~shown].T) ** 2).sum()
    return SHRINKAGES[int(errors.argmin())]


def _amplification(space: eigenspaces.TrajectorySpace, shown: Bools, shrinkage: float) -> float:
    """Return the maximum factor by which errors of the measured frames are amplified."""
    unit = np.eye(int(shown.sum()))
    return float(np.linalg.norm(eigenspaces.complete_frames(unit, space, shown, shrinkage), 2))


def _completed(window: Array, shown: Bools, halves: list[Array], options: Li2020Options) -> Array:
    """Complete markers that are missing in the same frames [shape=(frames, markers, 3)]."""
    centred = [half - half[:, shown].mean(axis=1, keepdims=True) for half in halves]
    space = eigenspaces.trajectory_space(
        np.concatenate(centred), share=options.trajectory_singular_share, rank=options.rank
    )
    shrinkage = _best_shrinkage(centred, shown, options)
    while (
        _amplification(space, shown, shrinkage) > MAX_AMPLIFICATION
        and (space.relative_std > 0).any()
    ):
        shrinkage *= 2.0
    visible = window[shown].reshape(int(shown.sum()), -1)
    middle = visible.mean(axis=0)
    completed = np.array(window)
    found = eigenspaces.complete_frames(visible - middle, space, shown, shrinkage)
    completed[~shown] = (found + middle).reshape(-1, *window.shape[1:])
    return completed
