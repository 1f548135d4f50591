"""The method ``prior``: the published machinery with a prior that knows the body at hand.

The energy, the levels and the solver are those of Baumann et al. 2011 (`priorfill.energy`,
`priorfill.multiresolution`, `priorfill.solver`). What differs is where the prior comes from:

* the clip's own frames come first: same body, same markers, same day; the prior database speaks
  where the clip has too few of them, for a marker that it never shows above all;
* instead of the mean of the neighbours, the prior is a Gaussian-process regression from the
  visible markers (`priorfill.regression`), its weight the inverse of the predicted variance;
* velocities and accelerations come from the same prediction, across the gap's edges too, so that
  the fill joins the measured signal without a seam;
* frames with holes teach nothing at first; a second reading completes them with the first fill;
* short gaps that nothing else predicts are bridged over time (`priorfill.bridge`), blackouts above
  all.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import GapGroup, runs
from priorfill.methods.pieces import Piece, pieces_of
from priorfill.methods.predict import Options, Prediction, Predictor, unfilled
from priorfill.methods.task import Estimate, Note, Task
from priorfill.multiresolution import levels_for, synthesise
from priorfill.prior import Prior
from priorfill.resample import Level, pyramid
from priorfill.solver import minimise

__all__ = ["Options", "fill"]

JOIN_SECONDS = 0.03
"""s. Reach of the velocity and acceleration terms: predictions differ from the measured signal by
about a millimetre at a gap's edge, which is spread over this time."""

LEAST_DEVIATION = 0.25
"""Least deviation that weighs in the energy, as a part of the greatest in the piece: frames right
at the edge are known almost exactly, which would only stiffen the solve."""

_Map = Callable[..., Iterable[Any]]
"""`map`, or one that works on several at a time."""

HOPELESS = 1000.0
"""mm. A sample with a greater expected error is left missing: it is as good as anywhere. The worst
that can be expected of a limb in sight of the body is some 400 mm."""


def fill(
    task: Task, progress: Callable[[], None] = lambda: None, options: Options | None = None
) -> Estimate:
    """Fill the gaps of a task with a regression prior.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.
    progress : callable
        Called once a gap group.
    options : Options, optional
        See `Options`.

    Returns
    -------
    Estimate
        Long blackouts, markers that neither clip nor database show, and samples whose expected
        error is above `HOPELESS` stay missing and are noted.
    """
    count = levels_for(task.rate)
    levels = pyramid(task.positions, task.rate, count)
    # the coarsest level's differences reach two of its steps beyond a piece
    predictor = Predictor(task, 2 * 2 ** (count - 1), options or Options())
    pieces = [pieces_of(group, predictor.valid, predictor.distance) for group in task.groups]
    predictions: list[list[list[Prediction]]] = []
    estimate = Estimate.of(task)
    # Pieces know nothing of each other, so however many are predicted at a time, each comes
    # out the same.
    cores = os.cpu_count() or 1
    everything = [piece for some in pieces for piece in some]
    with ThreadPoolExecutor(max_workers=cores) as pool:
        over_pieces: _Map = pool.map
        if len(everything) < 2 * cores:
            over_pieces, predictor.each = map, pool.map
        first = iter(over_pieces(lambda piece: predictor.predict(piece, None), everything))
        for group, its_pieces in zip(task.groups, pieces, strict=True):
            predictions.append([next(first) for _ in its_pieces])
            _synthesise(levels, group, predictions[-1], estimate)
            progress()
        _read_again(task, predictor, levels, pieces, predictions, estimate, over_pieces)
    _bridge(task, predictor, levels, pieces, predictions, estimate)
    for its_pieces, found in zip(pieces, predictions, strict=True):
        for piece, parts in zip(its_pieces, found, strict=True):
            told = {int(marker) for part in parts for marker in part.piece.markers}
            estimate.notes.extend(note for part in parts for note in part.notes)
            estimate.notes.extend(n for n in unfilled(piece, task) if n.marker not in told)
    _give_up_hopeless(estimate)
    return estimate


def _give_up_hopeless(estimate: Estimate) -> None:
    """Leave samples missing of which nothing is known but that they are somewhere."""
    hopeless = estimate.deviation > HOPELESS
    estimate.positions[hopeless] = np.nan
    reason = f"the visible markers say nothing of it: expected error above {HOPELESS:.0f} mm"
    for marker in np.flatnonzero(np.logical_or.reduce(hopeless, axis=0)):
        for start, stop in runs(hopeless[:, marker]):
            estimate.notes.append(Note(int(marker), start, stop, reason, filled=False))


def _read_again(
    task: Task,
    predictor: Predictor,
    levels: Sequence[Level],
    pieces: Sequence[Sequence[Piece]],
    predictions: list[list[list[Prediction]]],
    estimate: Estimate,
    over_pieces: _Map,
) -> None:
    """Predict once more what learnt from few frames, now that a first fill completes more."""
    again = [
        (g, p)
        for g, found in enumerate(predictions)
        for p, parts in enumerate(found)
        if not all(part.complete for part in parts)
    ]
    if not again:
        return
    completed = estimate.positions.copy()
    second = over_pieces(lambda at: predictor.predict(pieces[at[0]][at[1]], completed), again)
    for (g, p), parts in zip(again, second, strict=True):
        predictions[g][p] = parts
    for g in sorted({g for g, _ in again}):
        _synthesise(levels, task.groups[g], predictions[g], estimate)


def _bridge(
    task: Task,
    predictor: Predictor,
    levels: Sequence[Level],
    pieces: Sequence[Sequence[Piece]],
    predictions: list[list[list[Prediction]]],
    estimate: Estimate,
) -> None:
    """Bridge over time what shows too few markers; all else around it is filled by now."""
    completed = estimate.positions.copy()
    for part in (part for found in predictions for parts in found for part in parts):
        if not part.own:
            completed[part.piece.start : part.piece.stop, part.piece.markers] = np.nan
    for g, its_pieces in enumerate(pieces):
        changed = False
        for p, piece in enumerate(its_pieces):
            bridged = predictor.bridge(piece, completed)
            # other bodies are no better guess than the marker's own movement over a short gap
            better, rest = _better(bridged, predictions[g][p])
            predictions[g][p] = [*rest, *better]
            changed = changed or bool(better)
        if changed:
            _synthesise(levels, task.groups[g], predictions[g], estimate)


def _better(
    bridged: Sequence[Prediction], found: Sequence[Prediction]
) -> tuple[list[Prediction], list[Prediction]]:
    """Choose the bridges that err less than what was found, and what is left of that."""
    expected = {
        int(marker): (0.0 if part.own else float(np.sqrt((deviation**2).mean())))
        for part in found
        for marker, deviation in zip(part.piece.markers, part.deviation.T, strict=True)
    }
    better = [
        part
        for part in bridged
        if np.sqrt((part.deviation**2).mean()) < expected.get(int(part.piece.markers[0]), np.inf)
    ]
    taken = [int(part.piece.markers[0]) for part in better]
    rest = []
    for part in found:
        kept = np.flatnonzero(~np.isin(part.piece.markers, taken))
        if len(kept):
            rest.append(
                replace(
                    part,
                    piece=replace(part.piece, markers=part.piece.markers[kept]),
                    positions=part.positions[:, kept],
                    deviation=part.deviation[:, kept],
                )
            )
    return better, rest


def _synthesise(
    levels: Sequence[Level],
    group: GapGroup,
    predictions: Sequence[Sequence[Prediction]],
    estimate: Estimate,
) -> None:
    """Minimise a gap group's energy under its predictions, into the estimate."""
    parts = [part for some in predictions for part in some]
    inside = synthesise(levels, group, _prior_of(parts, group), minimise)
    estimate.positions[group.start : group.stop, list(group.markers)] = inside
    for part in parts:
        piece = part.piece
        deviation = part.deviation[piece.start - part.first : piece.stop - part.first]
        estimate.deviation[piece.start : piece.stop, piece.markers] = deviation


def _prior_of(
    predictions: Sequence[Prediction], group: GapGroup
) -> Callable[[Level, NDArray[np.intp]], Prior]:
    """Return the prior of a gap group's markers at any level, by its predictions."""

    def prior_at(level: Level, window: NDArray[np.intp]) -> Prior:
        prior = Prior.empty(len(window), len(group.markers))
        for prediction in predictions:
            _place(prior, prediction, group, window * level.step, level)
        return prior

    return prior_at


def _place(
    prior: Prior,
    prediction: Prediction,
    group: GapGroup,
    frames: NDArray[np.intp],
    level: Level,
) -> None:
    """Write a prediction, and its differences over a level's steps, into a prior."""
    piece, step = prediction.piece, level.step
    columns = np.searchsorted(group.markers, piece.markers)
    deviation = prediction.deviation
    weight = np.maximum(deviation, LEAST_DEVIATION * deviation.max(axis=0)) ** -2.0

    rows = np.flatnonzero((frames >= piece.start) & (frames < piece.stop))
    at = frames[rows] - prediction.first
    prior.pose[np.ix_(rows, columns)] = prediction.positions[at]
    prior.pose_weight[np.ix_(rows, columns)] = weight[at]

    # differences one step outside the piece reach into it: they are the seam
    rows = np.flatnonzero(
        (frames >= max(piece.start - step, prediction.first + step))
        & (frames < min(piece.stop + step, prediction.last - step))
    )
    at = frames[rows] - prediction.first
    before, here, after = (prediction.positions[at + d] for d in (-step, 0, step))
    where = np.ix_(rows, columns)
    prior.velocity[where] = 0.5 * (after - before)
    prior.acceleration[where] = after - 2.0 * here + before
    # an error that is forgotten like a Matérn process of smoothness 3/2
    stiffness = (JOIN_SECONDS * level.rate) ** 2
    prior.velocity_weight[where] = 2.0 * stiffness * weight[at]
    prior.acceleration_weight[where] = stiffness**2 * weight[at]
