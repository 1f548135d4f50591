"""The method ``prior``: the published machinery with a prior that knows the body at hand.

The energy, the levels and the solver are those of Baumann et al. 2011 (`priorfill.energy.terms`,
`priorfill.energy.multiresolution`, `priorfill.energy.solver`). What differs is where the prior
comes from:

* the clip's own frames come first: same body, same markers, same day; the prior database speaks
  where the clip has too few of them, for a marker that it never shows above all;
* instead of the mean of the neighbours, the prior is a Gaussian-process regression from the
  visible markers (`priorfill.gp.ensemble`), its weight the inverse of the predicted variance;
* predictions below the floor are lifted, and calmed where they shake more than what is measured
  (`priorfill.methods.gpr.postprocess`);
* velocities and accelerations come from the same prediction, across the gap's edges too, so that
  the fill joins the measured signal without a seam;
* frames with holes teach nothing at first; a second reading completes them with the first fill;
* short gaps that nothing else predicts are bridged over time (`priorfill.signal.gp_interpolation`);
* blackouts are filled by how the body moves before, after, and elsewhere
  (`priorfill.methods.gpr.blackout`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.energy.multiresolution import levels_for, solve_levels
from priorfill.energy.solver import minimise
from priorfill.energy.targets import Prior
from priorfill.gaps import GapGroup, runs
from priorfill.methods.gpr.gap_segments import Piece, pieces_of
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.postprocess import Finish
from priorfill.methods.gpr.predict import Predictor
from priorfill.methods.gpr.prediction import Prediction, unfilled
from priorfill.methods.task import Estimate, Note, Task
from priorfill.runtime.threads import thread_count
from priorfill.signal.resample import Resolution

__all__ = ["GPROptions", "fill"]

JOIN_SECONDS = 0.015
"""s. Reach of the velocity and acceleration terms of a marker whose expected error in the piece is
1 mm at most: over such a time the offset from the measured signal at a gap's edge is spread."""

JOIN_GROWTH = 0.4
"""The reach grows with the expected error to this power: what errs by centimetres does so for
longer than what errs by a millimetre. Better by 0.3 to 1 % than the same reach for all."""

LONGEST_JOIN = 0.1
"""s. The reach grows no further."""

LEAST_DEVIATION = 0.1
"""Least deviation that weighs in the energy, as a part of the greatest in the piece: frames right
at the edge are known almost exactly, which would only stiffen the solve."""

_Map = Callable[..., Iterable[Any]]
"""`map`, or one that works on several at a time."""

HOPELESS = 1000.0
"""mm. A sample with a greater expected error is left missing: it is as good as anywhere. The worst
that can be expected of a limb in sight of the body is some 400 mm."""


def fill(
    task: Task, progress: Callable[[], None] = lambda: None, options: GPROptions | None = None
) -> Estimate:
    """Fill the gaps of a task with a regression prior.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.
    progress : callable
        Called once a gap group.
    options : GPROptions, optional
        See `GPROptions`.

    Returns
    -------
    Estimate
        Markers that neither clip nor database show, and samples whose expected
        error is above `HOPELESS` stay missing and are noted.
    """
    count = levels_for(task.rate)
    # the coarsest level's differences reach two of its steps beyond a piece
    predictor = Predictor(task, 2 * 2 ** (count - 1), options or GPROptions())
    levels = [Resolution(task.positions, task.rate, 2**i) for i in range(count)]
    filling = _Filling(task, predictor, levels)
    cores = thread_count()
    # Pieces know nothing of each other, so however many are predicted at a time, each comes
    # out the same.
    with ThreadPoolExecutor(max_workers=cores) as pool:
        over_pieces: _Map = pool.map
        if len(filling.slots) < 2 * cores:
            over_pieces, predictor.each = map, pool.map
        filling.read(over_pieces, progress)
        filling.read_again(over_pieces)
    filling.interpolate_gap()
    filling.lead_through()
    for slot in filling.slots:
        told = {int(marker) for part in slot.parts for marker in part.piece.markers}
        filling.estimate.notes.extend(note for part in slot.parts for note in part.notes)
        filling.estimate.notes.extend(n for n in unfilled(slot.piece, task) if n.marker not in told)
    _give_up_hopeless(filling.estimate)
    return filling.estimate


@dataclass
class _Slot:
    """A piece, and what is predicted for it or for some of its markers."""

    group: int
    piece: Piece
    parts: list[Prediction] = field(default_factory=list)

    @property
    def told_by_clip(self) -> bool:
        """Whether the clip's own frames told all of it."""
        told = sum(len(part.piece.markers) for part in self.parts if part.own)
        return told == len(self.piece.markers)


class _Filling:
    """A task on its way from pieces to an estimate."""

    def __init__(self, task: Task, predictor: Predictor, levels: Sequence[Resolution]) -> None:
        self._groups = task.groups
        self._predictor = predictor
        self._finish = Finish(task, predictor.spread)
        self._levels = levels
        self._bound = np.full(task.positions.shape[:2], np.nan)
        self.estimate = replace(Estimate.of(task), error_bound_90=self._bound)
        self._by_group = [
            [_Slot(n, piece) for piece in pieces_of(group, predictor.valid, predictor.distance)]
            for n, group in enumerate(task.groups)
        ]
        self.slots = [slot for slots in self._by_group for slot in slots]

    def read(self, over_pieces: _Map, progress: Callable[[], None]) -> None:
        """Predict all pieces from what is measured."""
        found = iter(over_pieces(lambda slot: self._predict(slot, None), self.slots))
        for number in range(len(self._groups)):
            for slot in self._by_group[number]:
                slot.parts = next(found)
            self._synthesise(number)
            progress()

    def read_again(self, over_pieces: _Map) -> None:
        """Predict once more what learnt from few frames, now that a first fill completes more."""
        again = [slot for slot in self.slots if not all(part.complete for part in slot.parts)]
        # the estimate changes only when all of them are predicted
        found = over_pieces(lambda slot: self._predict(slot, self.estimate.positions), again)
        for slot, parts in zip(again, found, strict=True):
            slot.parts = parts
        for number in sorted({slot.group for slot in again}):
            self._synthesise(number)

    def _predict(self, slot: _Slot, completed: NDArray[np.float64] | None) -> list[Prediction]:
        """Predict a piece, and see to its looks; parameters as for `Predictor.predict`."""
        return [self._finish(part) for part in self._predictor.predict(slot.piece, completed)]

    def interpolate_gap(self) -> None:
        """Bridge over time what the clip's own frames do not tell; all around it is filled."""
        doubtful = [s for s in self.slots if s.piece.searchable and not s.told_by_clip]
        changed = set()
        with self._without(doubtful) as completed:
            for slot in doubtful:
                # other bodies are no better guess than the marker's own movement over a short gap
                better, rest = _better(
                    self._predictor.interpolate_gap(slot.piece, completed), slot.parts
                )
                slot.parts = [*rest, *better]
                if better:
                    changed.add(slot.group)
        for number in sorted(changed):
            self._synthesise(number)

    def lead_through(self) -> None:
        """Lead the body through blackouts, when all that is told by visible markers is filled."""
        blind = sorted(
            (slot for slot in self.slots if not slot.piece.searchable),
            key=lambda slot: slot.piece.start,
        )
        blackouts: list[list[_Slot]] = []
        stop = -1
        for slot in blind:
            if slot.piece.start > stop:  # what touches is one blackout
                blackouts.append([])
            blackouts[-1].append(slot)
            stop = max(stop, slot.piece.stop)
        with self._without(blind) as completed:
            for slots in blackouts:
                found = self._predictor.lead_through([slot.piece for slot in slots], completed)
                for slot in slots:
                    piece = slot.piece
                    slot.parts = [
                        self._finish.enforce_floor(part)  # curves over time do not shake
                        for part in found
                        if part.first == piece.start and part.piece.markers[0] in piece.markers
                    ]
        for number in sorted({slot.group for slot in blind}):
            self._synthesise(number)

    @contextmanager
    def _without(self, slots: Sequence[_Slot]) -> Iterator[NDArray[np.float64]]:
        """Give the positions so far with some pieces missing; nothing may be synthesised meanwhile.

        Those of the estimate themselves, as a copy of a long clip is large.
        """
        positions = self.estimate.positions
        places = [(slice(s.piece.start, s.piece.stop), s.piece.markers) for s in slots]
        hidden = [positions[place] for place in places]
        for place in places:
            positions[place] = np.nan
        try:
            yield positions
        finally:
            for place, some in zip(places, hidden, strict=True):
                positions[place] = some

    def _synthesise(self, number: int) -> None:
        """Minimise a gap group's energy under its predictions, into the estimate."""
        group = self._groups[number]
        parts = [part for slot in self._by_group[number] for part in slot.parts]
        inside = solve_levels(self._levels, group, _prior_of(parts, group), minimise)
        self.estimate.positions[group.start : group.stop, list(group.markers)] = inside
        for part in parts:
            piece = part.piece
            expected_rms = part.expected_rms[piece.start - part.first : piece.stop - part.first]
            self.estimate.expected_rms[piece.start : piece.stop, piece.markers] = expected_rms
            bound = part.bound_factor * expected_rms
            self._bound[piece.start : piece.stop, piece.markers] = bound


def _give_up_hopeless(estimate: Estimate) -> None:
    """Leave samples missing of which nothing is known but that they are somewhere."""
    hopeless = estimate.expected_rms > HOPELESS
    estimate.positions[hopeless] = np.nan
    reason = f"the visible markers say nothing of it: expected error above {HOPELESS:.0f} mm"
    for marker in np.flatnonzero(np.logical_or.reduce(hopeless, axis=0)):
        for start, stop in runs(hopeless[:, marker]):
            estimate.notes.append(Note(int(marker), start, stop, reason, filled=False))


def _better(
    bridged: Sequence[Prediction], found: Sequence[Prediction]
) -> tuple[list[Prediction], list[Prediction]]:
    """Choose the bridges that err less than what was found, and what is left of that."""
    expected = {
        int(marker): (0.0 if part.own else float(np.sqrt((expected_rms**2).mean())))
        for part in found
        for marker, expected_rms in zip(part.piece.markers, part.expected_rms.T, strict=True)
    }
    better = [
        part
        for part in bridged
        if np.sqrt((part.expected_rms**2).mean()) < expected.get(int(part.piece.markers[0]), np.inf)
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
                    expected_rms=part.expected_rms[:, kept],
                )
            )
    return better, rest


def _prior_of(
    predictions: Sequence[Prediction], group: GapGroup
) -> Callable[[Resolution, NDArray[np.intp]], Prior]:
    """Return the prior of a gap group's markers at any level, by its predictions."""

    def prior_at(level: Resolution, window: NDArray[np.intp]) -> Prior:
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
    level: Resolution,
) -> None:
    """Write a prediction, and its differences over a level's steps, into a prior."""
    piece, step = prediction.piece, level.step
    columns = np.searchsorted(group.markers, piece.markers)
    expected_rms = prediction.expected_rms
    weight = np.maximum(expected_rms, LEAST_DEVIATION * expected_rms.max(axis=0)) ** -2.0

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
    reach = JOIN_SECONDS * np.maximum(expected_rms.max(axis=0), 1.0) ** JOIN_GROWTH
    stiffness = (np.minimum(reach, LONGEST_JOIN) * level.rate) ** 2
    prior.velocity_weight[where] = 2.0 * stiffness * weight[at]
    prior.acceleration_weight[where] = stiffness**2 * weight[at]
