"""Gaps filled from complete pieces as long as the gap and the frames around it.

Here the template of the clip is applied to each training piece entry by entry, as in the paper, and
the eigenvectors are over coordinates, Eqs. (1)-(4), or over frames, Eqs. (5)-(8). Both need pieces
with as many frames as the clip's. Over frames each trajectory is completed from its own visible
samples.

Departures from the paper:

* A piece is a gap group with the frames around it, not the clip. The pieces that are most like the
  clip's are used, at most `MAX_PIECES`.
* The mean of the visible markers is subtracted from each frame, and the mean pose of the pieces
  from all; the paper does not state how data are centred.
* Over frames, coordinates are not weighted by the distance of their marker from the gaps: the map F
  is common to all trajectories, and would be fitted to those without gaps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap
from priorfill.methods.li2020.li2020_options import Li2020Options
from priorfill.methods.li2020.normalisation import (
    coordinates,
    marker_weights,
    mean_distances,
    normalise,
)
from priorfill.methods.li2020.piece_sources import PieceSources, stretch
from priorfill.methods.li2020.training_windows import marker_sets
from priorfill.methods.task import Estimate, Progress, Task

__all__ = ["Complete", "fill_pieces"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

Complete = Callable[[list[Array], list[Array], Array, Li2020Options], Array]
"""Function that completes a masked clip from pieces and the same pieces masked."""

MIN_VISIBLE = 3
"""Markers visible throughout a piece whose mean is subtracted; with fewer, those of each frame."""

MAX_PIECES = 36
"""Most pieces used: the paper has 16 to 36."""


def fill_pieces(
    task: Task, progress: Progress, options: Li2020Options, complete: Complete, source: str
) -> Estimate:
    """Fill gaps from pieces of the clip and of the takes.

    Parameters
    ----------
    task : Task
        The clip, and the takes from which windows are chosen.
    progress : callable
        Called with the number of samples done since the last call.
    options : Li2020Options
        ``over``, and the choice of pieces.
    complete : callable
        The equations.
    source : str
        What gaps are filled from.

    Returns
    -------
    Estimate
        Gap groups for which there is no complete piece stay missing. Errors are not predicted.
    """
    positions = task.positions.copy()
    sources = [
        (markers, PieceSources(task, markers, options))
        for markers in (marker_sets(task.valid, task.takes) if task.groups else ())
    ]
    used: dict[str, None] = {}
    around: dict[int, tuple[int, int]] = {}  # the piece of each frame of a gap
    for group in task.groups:
        begin, end = stretch(group.start, group.stop, len(positions), options)
        around |= dict.fromkeys(range(group.start, group.stop), (begin, end))
        for markers, some in sources:
            piece = task.positions[begin:end][:, markers]
            training = [one for one in some.pieces(end - begin) if not np.isnan(one).any()]
            if not training:
                continue
            used |= dict.fromkeys(some.takes)
            found = _completed(piece, training, complete, options)
            here = np.ix_(np.arange(group.start, group.stop), markers)
            inside = found[group.start - begin : group.stop - begin]
            positions[here] = np.where(np.isnan(positions[here]), inside, positions[here])
            break
        progress(group.samples)

    def reason(gap: Gap) -> str:
        if (~task.valid[gap.start : gap.stop]).all():
            return "no marker is visible; pca-frames fills whole frames"
        # gaps outside the groups are not to be filled
        begin, end = around.get(gap.start, (gap.start, gap.stop))
        if options.over == "frames" and not task.valid[begin:end, gap.marker].any():
            return "it is not visible around the gap; use eigenvectors over coordinates"
        return (
            f"no recording shows all markers for {gap.frames} frames and the frames around them; "
            "give longer recordings"
        )

    takes = tuple(used)
    others = f", with {len(takes)} other recordings" if takes else ""
    return Estimate.without_errors(task, positions, source + others, reason, takes)


def _origin_weights(masked: Bools) -> Array:
    """Return how much each marker contributes to the origin of each frame.

    The origin is the mean of the markers visible throughout, or of those of the frame.
    """
    visible = ~masked
    steady = visible.all(axis=0)
    if steady.sum() >= MIN_VISIBLE:
        visible = np.broadcast_to(steady, masked.shape)
    weights: Array = visible / visible.sum(axis=1, keepdims=True)
    return weights


def _without_origin(piece: Array, weights: Array) -> tuple[Array, Array]:
    """Subtract the origin from each frame.

    Returns
    -------
    rest, origin : ndarray [shape=(frames, markers, 3)], [shape=(frames, 1, 3)]
    """
    known = np.where(weights[..., None] > 0.0, piece, 0.0)
    origin = np.einsum("fm,fmc->fc", weights, known)[:, None]
    return piece - origin, origin


def _completed(
    piece: Array, training: list[Array], complete: Complete, options: Li2020Options
) -> Array:
    """Complete the masked samples of a piece [shape=(frames, markers, 3)].

    Frames without any marker have no origin; they are left out, and stay missing. Where the others
    have no gaps, nothing is completed.
    """
    missing = np.isnan(piece[..., 0])
    shown = ~missing.all(axis=1)
    found = np.full_like(piece, np.nan)
    masked = missing[shown]
    if not masked.any():
        return found
    weights = _origin_weights(masked)
    clip, origin = _without_origin(piece[shown], weights)
    rests = [_without_origin(one[shown], weights)[0] for one in training]
    apart = [np.nanmean(((rest - clip)[~masked]) ** 2) for rest in rests]
    rests = [rests[i] for i in np.argsort(apart, kind="stable")[:MAX_PIECES]]

    over_frames = options.over == "frames"
    if over_frames:
        importance = np.ones(piece.shape[1])
    else:
        gappy: Bools = np.logical_or.reduce(masked, axis=0)
        importance = marker_weights(gappy, mean_distances(rests), options)
    rows = [coordinates(rest) for rest in rests]
    normalisation = normalise(rows, [np.ones((len(one), 1)) for one in rows], importance)
    seen = np.repeat(~masked, 3, axis=1)
    full = [normalisation.apply(one) for one in rows]
    own = np.where(seen, normalisation.apply(coordinates(clip)), 0.0)
    hidden = [one * seen for one in full]
    if over_frames:
        full, hidden = [one.T for one in full], [one.T for one in hidden]
        completed = complete(full, hidden, own.T, options).T
        completed[:, ~seen.any(axis=0)] = np.nan  # it would be the mean of the pieces
    else:
        completed = complete(full, hidden, own, options)
    restored = completed / normalisation.scale + normalisation.mean
    found[shown] = restored.reshape(clip.shape) + origin
    return found
