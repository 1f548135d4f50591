"""The methods of Li et al. 2020 on a task.

Where they depart from the paper, and from the program that its authors published:

* Eq. (3) is solved as least squares; see `eigenspaces.transformation`.
* U_i0 and U_10 of `pca_pieces` are turned to be nearest to U_N0; see `eigenspaces.train_pieces`.
  (The published program learns T with the U_i0 and applies it to U_N0.)
* Pieces of the database are chosen by their likeness to the clip; see `training_windows`. The clip's own
  whole frames are one piece more, and the only one without a database.
* The clip's template masks markers, not samples: a marker with a gap is masked in all frames of all
  pieces, as in the published comparison. Where that leaves fewer than three markers, each gap group
  has a template of its own, and where it still does, each set of missing markers.
* Before that, as in the published comparison: the mean of the visible markers is taken out of each
  frame, coordinates are divided by their deviation, and markers weighted by nearness to gaps.
* Trajectories of `pca_frames` are pieces around each gap, not of the clip's length, and are centred
  on the frames that are measured; the published scripts take the truth's mean in one place and the
  last measured frame in another, and as many eigenvectors as a frame has coordinates: hardly fewer
  than there are measured frames. Coordinates that these tell little of are held back by how large
  they usually are, the more the worse each half of the trajectories completes the other, and until
  errors are not multiplied by more than `MOST_GAIN`; see `eigenspaces.whole_frames`. A gap in
  some markers is filled as well, by each marker's own trajectory.
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
from priorfill.methods.li2020.training_windows import TrainingWindow, choose_windows, is_learnable
from priorfill.methods.task import Estimate, Task
from priorfill.signal.resample import resample

__all__ = ["pca_frames", "pca_pieces", "pca_train"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

Solve = Callable[[list[Array], list[Array], Array, Li2020Options], Array]
"""Completes a masked clip, from pieces and masked pieces."""

FEWEST_VISIBLE = 3
"""A template that leaves fewer markers is split, if it can be: they tell next to nothing."""

FEWEST_TRAINING = 2
"""Frames; of one alone nothing can be said but itself."""

CHUNK = 256
"""Frames whose distances are held at once: some MB."""

CAUTIONS = (1.0, 10.0, 100.0)
"""Where trajectories are few, as those of long gaps, others are less like them than they are like
each other: what is left over is larger by one of these."""

MOST_GAIN = 15.0
"""Errors of the measured frames are multiplied by no more in the missing ones: caution is doubled
until they are not."""

MOST_TRAJECTORIES = 6000
"""As many are learnt from at most; they lie close to each other in time."""


def _train(full: list[Array], masked: list[Array], clip: Array, options: Li2020Options) -> Array:
    spaces = eigenspaces.train(
        np.concatenate(full), np.concatenate(masked), share=options.share, rank=options.rank
    )
    return spaces.complete(clip)


def _train_pieces(
    full: list[Array], masked: list[Array], clip: Array, options: Li2020Options
) -> Array:
    spaces = eigenspaces.train_pieces(full, masked, share=options.share, rank=options.rank)
    return spaces.complete(clip)


def _coordinates(positions: Array) -> Array:
    return positions.reshape(len(positions), -1)


@dataclass(frozen=True, eq=False)
class _Training:
    """What is learnt from.

    Attributes
    ----------
    markers : ndarray of int
        Those of the clip that all frames of all pieces show.
    pieces : list of ndarray [shape=(rows, 1 + 3 markers)]
        Each as the triangular factor of its frames, with a 1 before each: sums and products over
        rows are those over frames.
    apart : ndarray [shape=(markers, markers), mm]
        Mean distances of markers.
    takes : tuple of str
        Names of the recordings, the clip left out.
    """

    markers: Ints
    pieces: list[Array]
    apart: Array
    takes: tuple[str, ...]


def _condensed(frames: Array) -> Array:
    rows = np.concatenate([np.ones((len(frames), 1)), _coordinates(frames)], axis=1)
    return eigenspaces.triangular(rows)


def _mean_distances(pieces: list[Array]) -> Array:
    """Return mean distances of markers over all frames of some pieces."""
    markers = pieces[0].shape[1]
    total = np.zeros((markers, markers))
    for piece in pieces:
        for start in range(0, len(piece), CHUNK):
            some = piece[start : start + CHUNK]
            total += np.linalg.norm(some[:, :, None] - some[:, None], axis=3).sum(axis=0)
    distances: Array = total / sum(len(piece) for piece in pieces)
    return distances


def _whole(positions: Array) -> Array:
    """Return the frames that show every marker."""
    return positions[~np.isnan(positions[..., 0]).any(axis=1)]


def _marker_sets(task: Task) -> Iterator[Ints]:
    """Yield sets of markers to fill, the fullest first: takes need not show all of them."""
    seen = task.valid.any(axis=0)
    fullest = seen.copy()
    for take in task.takes:
        if is_learnable(take, np.flatnonzero(seen)):
            fullest |= take.shown > 0
    yield np.flatnonzero(fullest)
    if fullest.sum() > seen.sum():
        yield np.flatnonzero(seen)


def _training(task: Task, options: Li2020Options) -> _Training:
    """Collect what is learnt from."""
    for markers in _marker_sets(task):
        clip = task.positions[:, markers]
        chosen = choose_windows(clip, task.rate, task.takes, markers, options)
        pieces = [
            frames
            for frames in [_whole(clip), *(_whole(piece.positions) for piece in chosen)]
            if len(frames)
        ]
        if sum(len(frames) for frames in pieces) >= FEWEST_TRAINING:
            return _Training(
                markers,
                [_condensed(frames) for frames in pieces],
                _mean_distances(pieces),
                tuple(dict.fromkeys(piece.name for piece in chosen)),
            )
    raise MethodError(
        f"{task.name}: fewer than {FEWEST_TRAINING} frames, of the clip and of the recordings "
        "beside it, show all its markers; give a database with recordings that do"
    )


def _parts(missing: Bools) -> Iterator[tuple[Ints, Bools]]:
    """Yield frames that are filled together, and which markers their template masks."""
    seen = ~np.logical_and.reduce(missing, axis=1)
    if not missing[seen].any():
        return
    template = np.logical_or.reduce(missing[seen], axis=0)
    if (~template).sum() >= FEWEST_VISIBLE:
        yield np.flatnonzero(seen & missing.any(axis=1)), template
        return
    rest = []
    for start, stop in runs(np.logical_or.reduce(missing, axis=1) & seen):
        template = np.logical_or.reduce(missing[start:stop], axis=0)
        if (~template).sum() >= FEWEST_VISIBLE:
            yield np.arange(start, stop), template
        else:
            rest.append(np.arange(start, stop))
    if rest:
        frames = np.concatenate(rest)
        patterns, which = np.unique(missing[frames], axis=0, return_inverse=True)
        for number, pattern in enumerate(patterns):
            yield frames[which.ravel() == number], pattern


def _without_mean(rows: Array, visible: Bools) -> tuple[Array, Array]:
    """Take the mean of the visible markers out of rows of coordinates.

    Returns
    -------
    rest, mean : ndarray [shape=(rows, markers, 3)], [shape=(rows, 1, 3)]
    """
    points = rows.reshape(len(rows), -1, 3)
    mean = points[:, visible].mean(axis=1, keepdims=True)
    return points - mean, mean


def _filled_part(
    clip: Array, template: Bools, training: _Training, solve: Solve, options: Li2020Options
) -> Array:
    """Complete the masked markers of some frames [shape=(frames, markers, 3)]."""
    visible = ~template
    ones = [piece[:, :1] for piece in training.pieces]
    frames = sum(float((one**2).sum()) for one in ones)
    rests = [_coordinates(_without_mean(piece[:, 1:], visible)[0]) for piece in training.pieces]
    mean = np.sum([one.T @ rest for one, rest in zip(ones, rests, strict=True)], axis=0) / frames
    centred = [rest - one @ mean for one, rest in zip(ones, rests, strict=True)]
    squares = np.sum([(rows**2).sum(axis=0) for rows in centred], axis=0)
    expected_rms = np.sqrt(squares / max(frames - 1.0, 1.0))
    # a coordinate that never moves has rounding errors only
    expected_rms[expected_rms <= eigenspaces.SMALLEST * max(expected_rms.max(), 1.0)] = 1.0

    distance = training.apart[template].min(axis=0)
    weight = np.where(
        template, options.gap_weight, np.exp(-(distance**2) / (2.0 * options.sigma**2))
    )
    scale = np.repeat(weight, 3) / expected_rms
    shown = np.repeat(visible, 3)
    full = [rows * scale for rows in centred]
    masked = [rows * shown for rows in full]
    rest, middle = _without_mean(_coordinates(clip), visible)
    own = np.where(shown, (_coordinates(rest) - mean) * scale, 0.0)
    completed = solve(full, masked, own, options)
    filled = np.full_like(completed, np.nan)
    filled[:, ~shown] = completed[:, ~shown] / scale[~shown] + mean[0, ~shown]
    return filled.reshape(clip.shape) + middle


def _by_markers(
    task: Task, progress: Callable[[], None], options: Li2020Options, solve: Solve, how: str
) -> Estimate:
    """Fill from the markers that are visible beside those that are missing."""
    positions = task.positions.copy()
    takes: tuple[str, ...] = ()
    if task.groups:
        training = _training(task, options)
        takes = training.takes
        clip = task.positions[:, training.markers]
        for frames, template in _parts(np.isnan(clip[..., 0])):
            found = _filled_part(clip[frames], template, training, solve, options)
            here = np.ix_(frames, training.markers)
            positions[here] = np.where(np.isnan(positions[here]), found, positions[here])
    for _ in task.groups:
        progress()

    def reason(gap: Gap) -> str:
        if task.valid[:, gap.marker].any():
            return "no marker is visible; pca-frames fills whole frames"
        return "it is never seen, and no recording beside the clip shows it with the others"

    beside = f", with {len(takes)} recordings beside the clip" if takes else ""
    return Estimate.without_errors(task, positions, how + beside, reason, takes)


def pca_train(
    task: Task, progress: Callable[[], None] = lambda: None, options: Li2020Options | None = None
) -> Estimate:
    """Fill by the eigenvectors of training pieces, Eqs. (1)-(4).

    Parameters
    ----------
    task : Task
        The clip, and the takes to choose pieces from.
    progress : callable
        Called once a gap group.
    options : Li2020Options, optional
        The constants.

    Returns
    -------
    Estimate
        Frames without any marker stay missing.

    Raises
    ------
    MethodError
        Where no two frames, of the clip and the takes, show all markers.
    """
    return _by_markers(
        task, progress, options or Li2020Options(), _train, "eigenspaces of whole frames"
    )


def pca_pieces(
    task: Task, progress: Callable[[], None] = lambda: None, options: Li2020Options | None = None
) -> Estimate:
    """Fill by eigenvectors of its own for each masked piece, Eqs. (5)-(8); see `pca_train`."""
    how = "eigenspaces of each piece"
    return _by_markers(task, progress, options or Li2020Options(), _train_pieces, how)


class _Trajectories:
    """Trajectories of a length to learn from: of the clip itself, and of pieces of the database."""

    def __init__(self, task: Task, options: Li2020Options) -> None:
        self._options = options
        self._sources = [task.positions]
        self.takes: tuple[str, ...] = ()
        seen = np.flatnonzero(task.valid.any(axis=0))
        if len(seen):
            chosen = choose_windows(task.positions[:, seen], task.rate, task.takes, seen, options)
            self._sources += [_at_rate(piece, task.rate) for piece in chosen]
            self.takes = tuple(dict.fromkeys(piece.name for piece in chosen))
        self._known: dict[int, list[Array]] = {}

    def of(self, length: int) -> list[Array]:
        """Return the triangular factors of the earlier and the later trajectories of a length.

        Returns
        -------
        list of ndarray [shape=(n, length)]
            Two, of different frames; one where so long a stretch fits in but once; empty where
            there is none.
        """
        if length not in self._known:
            found = [
                part
                for positions in self._sources
                for start in range(
                    0,
                    len(positions) - length + 1,
                    max(1, int(self._options.stride * length)),
                )
                if (part := _unbroken(positions[start : start + length])).size
            ]
            found = found[:: 1 + sum(map(len, found)) // MOST_TRAJECTORIES]
            middle = (len(found) + 1) // 2
            halves = [found[:middle], found[middle:]]
            self._known[length] = [
                eigenspaces.triangular(np.concatenate(half)) for half in halves if half
            ]
        return self._known[length]


def _unbroken(window: Array) -> Array:
    """Return the trajectories of markers visible throughout, a row each."""
    visible = ~np.isnan(window[..., 0]).any(axis=0)
    return window[:, visible].reshape(len(window), -1).T


def _at_rate(piece: TrainingWindow, rate: float) -> Array:
    """Return a piece's positions at a rate (Hz)."""
    return resample(piece.positions, piece.rate, rate)


def pca_frames(
    task: Task, progress: Callable[[], None] = lambda: None, options: Li2020Options | None = None
) -> Estimate:
    """Fill missing frames by the eigenvectors of trajectories, Eqs. (9)-(16).

    Parameters
    ----------
    task : Task
        The clip, and the takes to choose pieces from.
    progress : callable
        Called once a gap group.
    options : Li2020Options, optional
        The constants.

    Returns
    -------
    Estimate
        Gaps longer than anything to learn from, and markers never seen, stay missing.
    """
    options = options or Li2020Options()
    learnt = _Trajectories(task, options) if task.groups else None
    positions = task.positions.copy()
    spans: dict[tuple[int, int], list[int]] = {}
    for gap in find_gaps(~task.valid):
        spans.setdefault((gap.start, gap.stop), []).append(gap.marker)
    for (start, stop), markers in spans.items():
        context = max(options.fewest_context, round(options.context * (stop - start)))
        begin, end = max(start - context, 0), min(stop + context, len(positions))
        window = task.positions[begin:end]
        assert learnt is not None
        halves = learnt.of(end - begin)
        if not halves:
            continue
        patterns, which = np.unique(task.valid[begin:end, markers], axis=1, return_inverse=True)
        for number, shown in enumerate(patterns.T):
            if not shown.any():
                continue
            those = np.array(markers)[which.ravel() == number]
            found = _completed(window[:, those], shown, halves, options)
            positions[start:stop, those] = found[start - begin : stop - begin]
    for _ in task.groups:
        progress()

    def reason(gap: Gap) -> str:
        if task.valid[:, gap.marker].any():
            return (
                f"no recording shows a marker for the {gap.frames} frames and those about them; "
                "give longer recordings"
            )
        return "it is never seen; use a method that learns from other markers"

    takes = learnt.takes if learnt is not None else ()
    return Estimate.without_errors(task, positions, "eigenspaces of trajectories", reason, takes)


def _caution(halves: list[Array], shown: Bools, options: Li2020Options) -> float:
    """Return the caution by which each half of some trajectories completes the other best.

    Trajectories of the same frames complete each other far too well: with one half alone it is the
    greatest.
    """
    if len(halves) < 2:
        return CAUTIONS[-1]
    errors = np.zeros(len(CAUTIONS))
    for one, other in permutations(halves, 2):
        space = eigenspaces.trajectory_space(one, share=options.trajectory_share, rank=options.rank)
        for number, caution in enumerate(CAUTIONS):
            found = eigenspaces.whole_frames(other[:, shown].T, space, shown, caution)
            errors[number] += ((found - other[:, ~shown].T) ** 2).sum()
    return CAUTIONS[int(errors.argmin())]


def _gain(space: eigenspaces.TrajectorySpace, shown: Bools, caution: float) -> float:
    """Return what errors of the measured frames are multiplied by in the others, at most."""
    unit = np.eye(int(shown.sum()))
    return float(np.linalg.norm(eigenspaces.whole_frames(unit, space, shown, caution), 2))


def _completed(window: Array, shown: Bools, halves: list[Array], options: Li2020Options) -> Array:
    """Complete markers that are missing in the same frames [shape=(frames, markers, 3)]."""
    centred = [half - half[:, shown].mean(axis=1, keepdims=True) for half in halves]
    space = eigenspaces.trajectory_space(
        np.concatenate(centred), share=options.trajectory_share, rank=options.rank
    )
    caution = _caution(centred, shown, options)
    while _gain(space, shown, caution) > MOST_GAIN and (space.doubt > 0).any():
        caution *= 2.0
    visible = window[shown].reshape(int(shown.sum()), -1)
    middle = visible.mean(axis=0)
    completed = np.array(window)
    found = eigenspaces.whole_frames(visible - middle, space, shown, caution)
    completed[~shown] = (found + middle).reshape(-1, *window.shape[1:])
    return completed
