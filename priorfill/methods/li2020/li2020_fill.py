"""The methods of Li et al. 2020 on a task.

Departures from the paper, and from the program that its authors published:

* Eq. (3) is solved as a least-squares problem; see `eigenspaces.transformation`.
* U_i0 and U_B0 of `pca_pieces`, Eqs. (1) and (4), are rotated to be nearest to those of all masked
  pieces; see `eigenspaces.train_pieces`. The published program fits T with U_i0 and applies it to
  the eigenvectors of all.
* `pca_train` is a variant, with the eigenvectors of all masked pieces throughout.
* Pieces of the database are chosen by their similarity to the clip; see `training_windows`. The
  clip's own complete frames are a further piece, and the only one without a database.
* Unless `Li2020Options.mask` is ``"entries"``, as in the paper, the template of the clip masks
  markers, not samples: a marker with a gap is masked in all frames of all pieces, as in the
  published comparison. If that leaves fewer than three markers, each gap group has its own
  template; and if that does, too, each set of missing markers.
* As in the published comparison, the mean of the visible markers is first subtracted from each
  frame, and coordinates are divided by their standard deviations and weighted by the distance of
  their marker from the markers with gaps. The paper does not state how data are centred.
* The paper scales training data of different sources to the same level; see
  `Li2020Options.scale_sources`.

The two-dimensional tracking data of the paper (pixels in video) are out of scope.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MethodError
from priorfill.gaps import Gap, runs
from priorfill.methods.li2020 import eigenspaces
from priorfill.methods.li2020.li2020_options import Li2020Options
from priorfill.methods.li2020.normalisation import (
    coordinates,
    marker_weights,
    mean_distances,
    normalise,
)
from priorfill.methods.li2020.pieces_fill import Complete, fill_pieces
from priorfill.methods.li2020.training_windows import choose_windows, marker_sets
from priorfill.methods.task import Estimate, Progress, Task, no_progress

__all__ = ["pca_pieces", "pca_train"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

MIN_VISIBLE = 3
"""Markers that a template must leave visible; with fewer it is split, if possible."""

MIN_TRAINING_FRAMES = 2
"""Complete frames needed: the standard deviation of one is undefined."""


def _train(full: list[Array], masked: list[Array], clip: Array, options: Li2020Options) -> Array:
    spaces = eigenspaces.train(
        np.concatenate(full),
        np.concatenate(masked),
        share=options.min_singular_share,
        rank=options.rank,
    )
    return spaces.complete(clip)


def _train_pieces(
    full: list[Array], masked: list[Array], clip: Array, options: Li2020Options
) -> Array:
    spaces = eigenspaces.train_pieces(
        full, masked, share=options.min_singular_share, rank=options.rank
    )
    return spaces.complete(clip)


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
    rows = np.concatenate([np.ones((len(frames), 1)), coordinates(frames)], axis=1)
    return eigenspaces.triangular(rows)


def _complete(positions: Array) -> Array:
    """Return the frames that show every marker."""
    return positions[~np.isnan(positions[..., 0]).any(axis=1)]


def _training_data(task: Task, options: Li2020Options) -> _TrainingData:
    """Collect the training data of a task."""
    for markers in marker_sets(task.valid, task.takes):
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
                mean_distances(windows),
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
    rests = [coordinates(_without_mean(window[:, 1:], visible)[0]) for window in training.windows]
    weights = marker_weights(template, training.distances, options)
    normalisation = normalise(rests, ones, weights)
    shown = np.repeat(visible, 3)
    full = [normalisation.apply(rest, one) for rest, one in zip(rests, ones, strict=True)]
    masked = [rows * shown for rows in full]
    rest, middle = _without_mean(coordinates(clip), visible)
    own = np.where(shown, normalisation.apply(coordinates(rest)), 0.0)
    completed = complete(full, masked, own, options)
    filled = np.full_like(completed, np.nan)
    mean, scale = normalisation.mean[0], normalisation.scale
    filled[:, ~shown] = completed[:, ~shown] / scale[~shown] + mean[~shown]
    return filled.reshape(clip.shape) + middle


def _by_markers(
    task: Task,
    progress: Progress,
    options: Li2020Options,
    complete: Complete,
    source: str,
) -> Estimate:
    """Fill missing markers from the visible markers of the same frames."""
    if options.mask == "entries" or options.over == "frames":
        return fill_pieces(task, progress, options, complete, source)
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
    """Fill gaps by the eigenvectors of all masked training data: a variant of Eqs. (1)-(4).

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
        Where fewer than two frames of the clip and the takes show all markers; not with whole
        pieces (``mask="entries"``, ``over="frames"``), without which gaps stay missing.

    See Also
    --------
    pca_pieces : As in the paper, with eigenvectors of each masked piece.
    pca_frames : For gaps of all markers.
    """
    source = "eigenspaces of complete frames"
    return _by_markers(task, progress, options or Li2020Options(), _train, source)


def pca_pieces(
    task: Task, progress: Progress = no_progress, options: Li2020Options | None = None
) -> Estimate:
    """Fill gaps by the eigenvectors of each masked training piece, Eqs. (1)-(4); see `pca_train`.

    With ``over="frames"`` by Eqs. (5)-(8).
    """
    source = "eigenspaces of each piece"
    return _by_markers(task, progress, options or Li2020Options(), _train_pieces, source)
