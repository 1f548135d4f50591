"""The method ``prior``: the published machinery with a prior that knows the body at hand.

The energy, the levels and the solver are those of Baumann et al. 2011 (`priorfill.energy`,
`priorfill.multiresolution`, `priorfill.solver`). What differs is where the prior comes from:

* the clip's own frames come first: same body, same markers, same day; the prior database speaks
  where the clip has too few of them, for a marker that it never shows above all;
* instead of the mean of the neighbours, the prior is a Gaussian-process regression from the
  visible markers (`priorfill.regression`), its weight the inverse of the predicted variance;
* velocities and accelerations come from the same prediction, across the gap's edges too, so that
  the fill joins the measured signal without a seam.

Gaps of neighbouring markers with the same frames are predicted jointly. Where the visible markers
change inside a gap, it is cut into pieces, but only where a piece would lose markers that matter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from priorfill.distances import pair_distances
from priorfill.gaps import GapGroup
from priorfill.methods.task import Estimate, Note, Task, take_names
from priorfill.multiresolution import levels_for, synthesise
from priorfill.normalise import choose_root
from priorfill.prior import Prior
from priorfill.regression import Kernel, Regression, Rows, View, regress
from priorfill.resample import Level
from priorfill.search.bank import PoseBank
from priorfill.solver import Descent, Solution, minimise
from priorfill.takes import own_take

__all__ = ["Options", "fill"]

FEW_VIEWS = (
    View("rigid", 220.0, 0.005, 10.0),
    View("rigid", 300.0, 0.002, 10.0),
    View("rigid", 160.0, 0.002),
    View("heading", 220.0, 0.005, 10.0),
)
FEW_KERNELS = (Kernel(1.0, 0.1, 1.0, 0.001, 0.1, smooth=False, noise=1e-4),)
"""Members for gaps of a few markers, whose neighbours on the same segment are visible."""

LIMB_VIEWS = tuple(
    View(frame, reach, 0.1) for reach in (200.0, 300.0) for frame in ("heading", "rigid")
)
LIMB_KERNELS = tuple(
    Kernel(linear, radial, length, temporal, seconds, smooth=True, noise=noise)
    for linear, radial, length in (
        (10.0, 0.1, 0.6),
        (30.0, 0.0, 1.0),
        (1.0, 0.3, 0.5),
        (0.3, 1.0, 0.6),
        (3.0, 3.0, 1.0),
        (0.1, 0.1, 0.4),
    )
    for temporal, seconds in ((0.001, 0.3), (0.05, 0.4))
    for noise in (1e-4, 1e-3)
)
"""Members for limbs and other large parts of the body."""

STRANGER_VIEWS = FEW_VIEWS
STRANGER_KERNELS = (
    Kernel(1.0, 0.3, 0.6, 0.0, 1.0, smooth=False, noise=1e-2),
    Kernel(0.3, 0.1, 1.0, 0.0, 1.0, smooth=False, noise=1e-1),
)
"""Members for other people's poses: no seam in time, and far more noise, since bodies and the
places of markers differ."""


LEAST_DEVIATION = 0.25
"""Least deviation that weighs in the energy, as a part of the greatest in the piece."""

DATABASE_RATE = 30.0
"""Hz. Resolution at which the database's poses are searched: they speak for poses, not for
detail in time."""


@dataclass(frozen=True)
class Options:
    """Options of the method.

    Attributes
    ----------
    joint_distance : float
        mm; markers missing in the same frames are predicted jointly when a chain of them is
        no further apart than this: the markers of a limb are, two limbs are not.
    few : int
        Up to this many markers are predicted by `FEW_VIEWS`, more by `LIMB_VIEWS`.
    rows : int
        Poses learnt from: evenly spread ones, and all right beside the gap. More gain nothing.
    beside : float
        s; what "right beside the gap" is.
    fewest_rows : int
        With fewer poses of its own, a clip asks the database.
    lost_weight : float
        A gap is cut where the visible markers change only if a piece would otherwise lose
        more than this part of its features' weight.
    rereading : float
        A piece is predicted a second time, its rows completed with the first fill, when the
        first time used less than this part of the frames in which its markers are seen.
    queries, neighbours, visible : int
        Database rows are the ``neighbours`` nearest poses of up to ``queries`` frames by the
        ``visible`` nearest markers.
    join_seconds : float
        s; reach of the velocity and acceleration terms. Fills differ from measured signals by
        about a millimetre at a gap's edge, which they spread over this time.
    """

    joint_distance: float = 350.0
    few: int = 3
    rows: int = 350
    beside: float = 0.03
    fewest_rows: int = 12
    lost_weight: float = 0.1
    rereading: float = 0.7
    queries: int = 40
    neighbours: int = 24
    visible: int = 12
    join_seconds: float = 0.03


@dataclass(frozen=True, eq=False)
class _Piece:
    """Markers missing together in frames ``start <= frame < stop``, and who is visible."""

    markers: NDArray[np.intp]
    start: int
    stop: int
    visible: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class _Prediction:
    """What was predicted for a piece, from frame ``first`` on (a little more than the piece)."""

    piece: _Piece
    first: int
    regression: Regression
    complete: bool  # whether the rows left nothing to be gained by a second reading
    how: str
    takes: tuple[str, ...]

    @property
    def last(self) -> int:
        return self.first + len(self.regression.positions)


def _joint_gaps(
    group: GapGroup, distance: NDArray[np.float64], options: Options
) -> list[tuple[NDArray[np.intp], int, int]]:
    """Markers, start and stop of gaps that are predicted jointly."""
    together: dict[tuple[int, int], list[int]] = {}
    for gap in group.gaps:
        together.setdefault((gap.start, gap.stop), []).append(gap.marker)
    joint = []
    for (start, stop), markers in together.items():
        chosen = np.array(markers, dtype=np.intp)
        cluster = np.ones(len(chosen), dtype=np.intp)
        if len(chosen) > 1:
            # markers never seen together are far apart for all we know
            apart = np.minimum(distance[np.ix_(chosen, chosen)], 1e6)
            np.fill_diagonal(apart, 0.0)
            tree = linkage(squareform(apart, checks=False), "single")
            cluster = fcluster(tree, options.joint_distance, "distance")
        joint += [(chosen[cluster == c], start, stop) for c in np.unique(cluster)]
    return joint


def _pieces(
    valid: NDArray[np.bool_],
    markers: NDArray[np.intp],
    start: int,
    stop: int,
    distance: NDArray[np.float64],
    options: Options,
) -> list[_Piece]:
    """Cut a joint gap where visible markers that matter come or go."""
    seen = valid[start:stop].copy()
    seen[:, markers] = False
    reach = FEW_VIEWS[0].reach
    weight = np.exp(-(distance[markers].min(axis=0) ** 2) / (2.0 * reach**2)) + FEW_VIEWS[0].floor
    changes = 1 + np.flatnonzero((seen[1:] != seen[:-1]).any(axis=1))
    cuts = [0, *changes.tolist(), stop - start]
    spans = [(a, b, seen[a]) for a, b in zip(cuts, cuts[1:], strict=False)]
    while len(spans) > 1:
        lost = []
        for (_, _, one), (_, _, other) in zip(spans, spans[1:], strict=False):
            most = max(weight[one].sum(), weight[other].sum())
            lost.append(1.0 - weight[one & other].sum() / most if most > 0 else 0.0)
        least = int(np.argmin(lost))
        if lost[least] > options.lost_weight:
            break
        (a, _, one), (_, b, other) = spans[least], spans[least + 1]
        spans[least : least + 2] = [(a, b, one & other)]
    return [
        _Piece(markers, start + a, start + b, np.flatnonzero(visible)) for a, b, visible in spans
    ]


def _stretch_around(
    usable: NDArray[np.bool_], start: int, stop: int, margin: int
) -> tuple[int, int]:
    """Widen start..stop by up to ``margin`` frames on either side while frames are usable."""
    first, last = start, stop
    while first > max(0, start - margin) and usable[first - 1]:
        first -= 1
    while last < min(len(usable), stop + margin) and usable[last]:
        last += 1
    return first, last


class _Filler:
    """Predicts the pieces of one task."""

    def __init__(self, task: Task, options: Options) -> None:
        self.task = task
        self.options = options
        self.valid = task.valid
        self.distance, self.spread = pair_distances(task.positions)
        self.levels = levels_for(task.rate)
        self._banks: dict[tuple[object, ...], PoseBank] = {}

    def predict(
        self, piece: _Piece, completed: NDArray[np.float64] | None
    ) -> list[tuple[_Prediction | None, list[Note]]]:
        """Predict a piece from the clip itself, else from the database.

        Markers that are never seen together are predicted one by one.

        Parameters
        ----------
        piece : _Piece
            What to predict.
        completed : ndarray [shape=(frames, markers, 3), mm] or None
            The clip after a first fill, to complete the poses that are learnt from.

        Returns
        -------
        list of (prediction or None, notes)
            One for the piece or for each of its markers; None where it stays missing.
        """
        if len(piece.visible) < 3:
            return [(None, self._notes(piece, "fewer than three other markers are visible"))]
        prediction = self._from_own(piece, completed) or self._from_database(piece)
        if prediction is not None:
            notes = self._notes(piece, prediction.how, filled=True, takes=prediction.takes)
            return [(prediction, notes)]
        if len(piece.markers) > 1:
            return [
                part
                for marker in piece.markers
                for part in self.predict(replace(piece, markers=marker[None]), completed)
            ]
        reason = "the clip never shows it together with the visible markers, "
        reason += "nor does the database" if self.task.takes else "and there is no database"
        return [(None, self._notes(piece, reason))]

    @staticmethod
    def _notes(
        piece: _Piece, how: str, *, filled: bool = False, takes: tuple[str, ...] = ()
    ) -> list[Note]:
        return [
            Note(int(marker), piece.start, piece.stop, how, filled, takes)
            for marker in piece.markers
        ]

    def _members(self, piece: _Piece) -> tuple[tuple[View, ...], tuple[Kernel, ...]]:
        if len(piece.markers) <= self.options.few:
            return FEW_VIEWS, FEW_KERNELS
        return LIMB_VIEWS, LIMB_KERNELS

    def _from_own(self, piece: _Piece, completed: NDArray[np.float64] | None) -> _Prediction | None:
        """Predict from the clip's own frames; None where too few can be learnt from."""
        options, rate = self.options, self.task.rate
        source = self.task.positions if completed is None else completed
        target_seen = self.valid[:, piece.markers].all(axis=1)
        nearest = self.distance[piece.markers].min(axis=0)
        visible = piece.visible[np.isfinite(nearest[piece.visible])]
        visible = visible[np.argsort(nearest[visible], kind="stable")]
        known = ~np.isnan(source[:, visible, 0])
        # how many frames show the targets together with the nearest n visible markers
        count = (np.logical_and.accumulate(known, axis=1) & target_seen[:, None]).sum(axis=0)
        enough = np.flatnonzero(count >= min(150, 0.5 * target_seen.sum()))
        kept = max(int(enough[-1]) + 1 if len(enough) else 0, min(4, len(visible)))
        if kept < 3:
            return None
        visible = visible[:kept]
        usable = np.flatnonzero(known[:, :kept].all(axis=1) & target_seen)
        if len(usable) < options.fewest_rows:
            return None

        beside = int(options.beside * rate) + 1
        near = usable[(usable >= piece.start - beside) & (usable < piece.stop + beside)]
        spread_out = usable[
            np.linspace(0, len(usable) - 1, min(options.rows, len(usable))).astype(int)
        ]
        frames = np.union1d(near, spread_out)
        here = self.valid[:, visible].all(axis=1)
        margin = 2 * 2 ** (self.levels - 1)
        first, last = _stretch_around(here, piece.start, piece.stop, margin)
        asked = np.arange(first, last)
        rows = Rows(
            source[np.ix_(frames, visible)],
            self.task.positions[np.ix_(frames, piece.markers)],
            frames / rate,
            np.zeros(len(frames), dtype=np.intp),
        )
        query = Rows(
            self.task.positions[np.ix_(asked, visible)],
            np.empty((len(asked), 0, 3)),
            asked / rate,
            np.zeros(len(asked), dtype=np.intp),
        )
        views, kernels = self._members(piece)
        regression = regress(
            rows,
            query,
            nearest[visible],
            self.spread[np.ix_(piece.markers, visible)].min(axis=0),
            views,
            kernels,
            (piece.stop - piece.start) / rate,
        )
        complete = (
            kept == len(piece.visible) and len(usable) >= options.rereading * target_seen.sum()
        )
        how = f"{len(frames)} frames of the clip, {kept} visible markers"
        return _Prediction(piece, first, regression, complete, how, (self.task.name,))

    def _from_database(self, piece: _Piece) -> _Prediction | None:
        """Predict from the database's nearest poses; None where it has none."""
        task, options = self.task, self.options
        if not task.takes:
            return None
        nearest = self.distance[piece.markers].min(axis=0)
        if not np.isfinite(nearest[piece.visible]).any():
            nearest = self._database_distances(piece.markers)[0]
        ranked = piece.visible[np.argsort(nearest[piece.visible], kind="stable")]
        ranked = ranked[np.isfinite(nearest[ranked])][: options.visible]
        if len(ranked) < 3:
            return None
        among = np.zeros(len(task.labels), dtype=bool)
        among[ranked] = True
        root = choose_root(task.marker_set, task.labels, task.positions, among)
        if root is None:
            return None
        key = (root.markers, tuple(ranked), tuple(piece.markers))
        if key not in self._banks:
            self._banks[key] = PoseBank(task.takes, root, ranked, piece.markers, DATABASE_RATE)
        bank = self._banks[key]
        if len(bank) < options.fewest_rows:
            return None
        here = self.valid[:, ranked].all(axis=1)
        first, last = _stretch_around(here, piece.start, piece.stop, 2 * 2 ** (self.levels - 1))
        asked = np.arange(first, last)
        some = asked[np.linspace(0, len(asked) - 1, min(options.queries, len(asked))).astype(int)]
        found = bank.nearest(
            task.positions[some], root.frames(task.positions[some]), options.neighbours
        )
        chosen = found.row.ravel()[np.argsort(found.distance.ravel(), kind="stable")]
        _, order = np.unique(chosen, return_index=True)
        chosen = chosen[np.sort(order)][: options.rows]  # each once, the nearest first
        distance, spread = pair_distances(
            bank.positions(chosen, np.concatenate([piece.markers, ranked]))
        )
        targets = len(piece.markers)
        rows = Rows(
            bank.positions(chosen, ranked),
            bank.positions(chosen, piece.markers),
            np.zeros(len(chosen)),
            bank.take(chosen),
        )
        query = Rows(
            task.positions[np.ix_(asked, ranked)],
            np.empty((len(asked), 0, 3)),
            asked / task.rate,
            np.full(len(asked), -1),
        )
        regression = regress(
            rows,
            query,
            distance[:targets, targets:].min(axis=0),
            spread[:targets, targets:].min(axis=0),
            STRANGER_VIEWS,
            STRANGER_KERNELS,
            (piece.stop - piece.start) / task.rate,
        )
        how = f"{len(chosen)} poses of the database, {len(ranked)} visible markers"
        names = take_names(task.takes, bank.take(chosen))
        return _Prediction(piece, first, regression, True, how, names)

    def _database_distances(
        self, markers: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distance and its spread of every marker to the nearest of some, in the takes."""
        poses = np.concatenate([take.levels[-1].positions for take in self.task.takes])
        distance, spread = pair_distances(poses)
        return distance[markers].min(axis=0), spread[markers].min(axis=0)

    def prior_of(
        self, predictions: list[_Prediction], group: GapGroup
    ) -> Callable[[Level, NDArray[np.intp]], Prior]:
        """Return the prior of a gap group's markers at any level, by its predictions."""

        def prior_at(level: Level, window: NDArray[np.intp]) -> Prior:
            prior = Prior.empty(len(window), len(group.markers))
            step = level.step
            # of Matérn's smoothness 3/2: an error forgotten after join_seconds
            stiffness = (self.options.join_seconds * level.rate) ** 2
            for prediction in predictions:
                piece = prediction.piece
                frames = window * step
                inner = (frames >= piece.start) & (frames < piece.stop)
                # differences one frame outside the piece reach into it: they are the seam
                differenced = (
                    (frames >= max(piece.start, prediction.first + step) - step)
                    & (frames < min(piece.stop, prediction.last - step) + step)
                    & (frames - step >= prediction.first)
                    & (frames + step < prediction.last)
                )
                columns = np.searchsorted(group.markers, piece.markers)
                predicted = prediction.regression.positions
                deviation = prediction.regression.deviation
                # rows right at the edge are known almost exactly, which only stiffens the solve
                weight = np.maximum(deviation, LEAST_DEVIATION * deviation.max(axis=0)) ** -2.0

                at = frames[inner] - prediction.first
                where = np.ix_(inner, columns)
                prior.pose[where] = predicted[at]
                prior.pose_weight[where] = weight[at]
                at = frames[differenced] - prediction.first
                before, here, after = predicted[at - step], predicted[at], predicted[at + step]
                where = np.ix_(differenced, columns)
                prior.velocity[where] = 0.5 * (after - before)
                prior.acceleration[where] = after - 2.0 * here + before
                prior.velocity_weight[where] = 2.0 * stiffness * weight[at]
                prior.acceleration_weight[where] = stiffness**2 * weight[at]
            return prior

        return prior_at


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
        Pieces with fewer than three visible markers, and markers that neither clip nor
        database show, stay missing and are noted.
    """
    options = options or Options()
    filler = _Filler(task, options)
    own = own_take(task.positions, task.rate, filler.levels, task.name, task.subject)
    estimate = Estimate.of(task)
    incomplete: list[tuple[GapGroup, list[_Piece]]] = []
    for group in task.groups:
        pieces = [
            piece
            for markers, start, stop in _joint_gaps(group, filler.distance, options)
            for piece in _pieces(filler.valid, markers, start, stop, filler.distance, options)
        ]
        complete = _fill_group(filler, own.levels, group, pieces, estimate, None)
        if not complete:
            incomplete.append((group, pieces))
        progress()
    # poses with holes were of no use the first time; now the first fill completes them
    completed = estimate.positions.copy()
    for group, pieces in incomplete:
        _fill_group(filler, own.levels, group, pieces, estimate, completed)
    return estimate


def _fill_group(
    filler: _Filler,
    levels: Sequence[Level],
    group: GapGroup,
    pieces: Sequence[_Piece],
    estimate: Estimate,
    completed: NDArray[np.float64] | None,
) -> bool:
    """Fill a gap group into the estimate; return whether a second reading would gain nothing."""
    predictions: list[_Prediction] = []
    notes: list[Note] = []
    for piece in pieces:
        for prediction, said in filler.predict(piece, completed):
            notes.extend(said)
            if prediction is not None:
                predictions.append(prediction)
    inside = synthesise(levels, group, filler.prior_of(predictions, group), _solver)
    estimate.positions[np.ix_(np.arange(group.start, group.stop), group.markers)] = inside
    for prediction in predictions:
        piece = prediction.piece
        at = np.arange(piece.start, piece.stop)
        deviation = prediction.regression.deviation[at - prediction.first]
        estimate.deviation[np.ix_(at, piece.markers)] = deviation
    kept = [n for n in estimate.notes if not group.start <= n.start < group.stop]
    estimate.notes[:] = kept + notes
    return all(prediction.complete for prediction in predictions)


def _solver(positions: NDArray[np.float64], free: NDArray[np.bool_], prior: Prior) -> Solution:
    return minimise(positions, free, prior, Descent())
