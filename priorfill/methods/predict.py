"""Predict a piece: from the clip's own frames, else from the prior database, else over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from priorfill.bridge import bridge
from priorfill.distances import pair_distances
from priorfill.lengths import hold_lengths, stiff_edges
from priorfill.methods.blackout import REACH, Recording, fill_blackout
from priorfill.methods.dropout import Dropouts
from priorfill.methods.members import (
    BASIC,
    FEW,
    FEW_MEMBERS,
    LIMB_MEMBERS,
    seconds_of,
)
from priorfill.methods.pieces import FEWEST_VISIBLE, Piece
from priorfill.methods.task import Note, Task, take_names
from priorfill.normalise import RootGroup, choose_root
from priorfill.regression import Lesson, Member, Rows, regress
from priorfill.search.bank import Banks, PoseBank
from priorfill.uncertainty import BOUND_FACTOR

__all__ = ["Options", "Prediction", "Predictor", "unfilled"]

DATABASE_RATE = 30.0
"""Hz. Resolution at which the database's poses are searched: they speak for poses, not for
detail in time."""

MOST_POSES = 1_000_000
"""Poses that are searched at most: of a larger database a coarser level, and of that every other
pose, say. Poses follow each other so closely that a part of them says as much."""

MOVEMENT_RATE = 15.0
"""Hz. Resolution of the database's poses that stand beside the clip's own: of as many rows, more
different ones."""

OWN, IMAGE = 0, 1
"""Numbers of the clip and its mirror image among the takes of rows; the database's follow."""

SIMILAR = 20
"""So many times the neighbours of a pose are asked for where those at both edges must agree."""

SPLINE_MARGIN = 3
"""Frames of the database beside what is read of it, for the spline to the clip's rate."""

OTHER_MOVEMENT = 130.0
"""mm a marker. Stretches whose edges differ by more from a blackout's are of another movement: the
most alike of other people's walks are at 60 to 90, and what is farther off taught nothing."""

BRIEF = 0.1
"""s. Over no longer than this a marker's own movement is a better guess than any other body."""

MIRROR_KINSHIP = 0.95
"""How far a body agrees with its mirror image; 0.7 to 0.95 fill about as well."""

STRANGER_KINSHIP = 0.9
"""How far a body agrees with others, offsets apart; 0.8 to 0.95 fill about as well."""

SELF_SUFFICIENT = 4.0
"""s. A clip that shows the missing markers for longer is less in need of other bodies."""

HANDICAP = 0.1
"""By how much better other bodies must do for each doubling of that."""


@dataclass(frozen=True)
class Options:
    """Options of the predictions.

    Attributes
    ----------
    rows : int
        Poses learnt from: evenly spread ones, and all right beside the gap. More gain nothing.
    beside : float
        s; what "right beside the gap" is.
    mirrored_rows : int
        As many of these come from the clip's mirror image in the lessons that it is part of.
    shared_rows : tuple of int
        In the lessons that the database adds to: rows of the clip, of its mirror image, of the
        database near the gap, of the database near the clip's rows. As many as in a lesson
        without the database, so that its lessons take no longer.
    fewest_rows : int
        With fewer poses of its own, a clip learns from other recordings alone.
    wished_rows : int
        Far visible markers are given up until this many frames, or half of those that show
        the missing markers, show the visible ones too.
    rereading : float
        A piece is predicted a second time, its rows completed with the first fill, when the
        first time used less than this part of the frames in which its markers are seen.
    queries, neighbours, visible : int
        Database rows are the ``neighbours`` nearest poses of up to ``queries`` frames by the
        ``visible`` nearest markers.
    movements : int
        Stretches of the database that a blackout is learnt from.
    """

    rows: int = 250
    mirrored_rows: int = 90
    shared_rows: tuple[int, int, int, int] = (100, 50, 70, 50)
    beside: float = 0.03
    fewest_rows: int = 12
    wished_rows: int = 150
    rereading: float = 0.7
    queries: int = 100
    neighbours: int = 12
    visible: int = 12
    movements: int = 60


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is predicted for a piece and a few frames around it.

    Attributes
    ----------
    piece : Piece
        What was asked for.
    first : int
        The first frame predicted; not after the piece's start.
    positions : ndarray [shape=(frames, piece's markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(frames, piece's markers), mm]
        Expected rms Euclidean error.
    complete : bool
        Whether the rows learnt from left nothing to be gained by a second reading.
    how : str
        What it was predicted from.
    takes : tuple of str
        Recordings learnt from.
    own : bool
        Whether it was predicted from the clip's own poses.
    poses : int
        Rows of the largest lesson; 0 where no poses were learnt from.
    bound_factor : float
        How many times the deviation 90 % of the errors are expected to lie below.
    """

    piece: Piece
    first: int
    positions: NDArray[np.float64]
    deviation: NDArray[np.float64]
    complete: bool
    how: str
    takes: tuple[str, ...] = ()
    own: bool = False
    poses: int = 0
    bound_factor: float = BOUND_FACTOR

    @property
    def last(self) -> int:
        """The frame after the last one predicted."""
        return self.first + len(self.positions)

    @property
    def notes(self) -> list[Note]:
        """What is to be said of it, marker by marker."""
        return [
            Note(
                int(m),
                self.piece.start,
                self.piece.stop,
                self.how,
                takes=self.takes,
                poses=self.poses,
            )
            for m in self.piece.markers
        ]


def unfilled(piece: Piece, task: Task) -> list[Note]:
    """Say why a piece stays missing, marker by marker."""
    if not piece.searchable:
        reason = "fewer than three other markers are visible, and it is not seen beside the gap"
    else:
        reason = "hardly a frame of the clip shows it together with the visible markers, "
        reason += "nor does another recording"
        if all(take.companion for take in task.takes):
            reason += ", and there is no database"
        if not task.takes:
            reason += "; give one (--database), or another clip of the same person (--with)"
    return [Note(int(m), piece.start, piece.stop, reason, filled=False) for m in piece.markers]


def _mirrored(task: Task) -> NDArray[np.float64]:
    """Return the clip in a mirror: left and right swapped; NaN for markers without a partner."""
    index = {label: i for i, label in enumerate(task.labels)}
    partner = np.array([index.get(task.marker_set.mirror.get(label, ""), -1) for label in index])
    mirrored = task.positions[:, partner] * [-1.0, 1.0, 1.0]
    mirrored[:, partner < 0] = np.nan
    return mirrored


def _in_turn(ranked: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return neighbours [shape=(frames, k)] in the order of their worth, each once.

    Every frame's nearest come first, then every frame's second nearest, and so on.
    """
    rows = ranked.T.ravel()
    _, once = np.unique(rows, return_index=True)
    return rows[np.sort(once)]


def _standing_in(
    now: NDArray[np.float64], before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return markers before and after poses [shape=(2, poses, markers, 3)], none missing.

    A marker that is missing on one side is taken to go on as from or to the other; on both
    sides, to stand still.
    """
    before = np.where(np.isnan(before), 2.0 * now - after, before)
    after = np.where(np.isnan(after), 2.0 * now - before, after)
    return np.stack([np.where(np.isnan(x), now, x) for x in (before, after)])


def _evenly(values: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return up to ``most`` of some values, evenly spread."""
    return values[np.linspace(0, len(values) - 1, min(most, len(values))).astype(np.intp)]


class Predictor:
    """Predicts the pieces of one task. Predictions do not depend on each other.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.
    margin : int
        Frames around a piece to be predicted too, where the visible markers allow.
    options : Options
        See there.

    Attributes
    ----------
    each : callable
        How the views of a piece are gone through: as `map` does, or several at a time.
    """

    def __init__(self, task: Task, margin: int, options: Options) -> None:
        self.task = task
        self.valid = task.valid
        self.distance, self.spread = pair_distances(task.positions)
        self._mirrored = _mirrored(task)
        self._margin = margin
        self._options = options
        self.each: Callable[..., Any] = map
        self._banks = Banks(task.takes)
        self._dropouts = Dropouts(task)

    def predict(self, piece: Piece, completed: NDArray[np.float64] | None) -> list[Prediction]:
        """Predict a piece from its visible markers.

        Parameters
        ----------
        piece : Piece
            What to predict.
        completed : ndarray [shape=(frames, markers, 3), mm] or None
            The clip after a first fill, to complete the poses that are learnt from.

        Returns
        -------
        list of Prediction
            For the piece, or, where its markers are never seen together, for each of them that
            can be predicted; empty where none can.
        """
        if not piece.searchable:
            return []
        prediction = self._from_own(piece, completed)
        if prediction is None and (piece.stop - piece.start) / self.task.rate <= BRIEF:
            bridged = self.bridge(piece, self.task.positions)
            if len(bridged) == len(piece.markers):
                return bridged
        prediction = prediction or self._from_others(piece)
        if prediction is not None:
            return [prediction]
        if len(piece.markers) == 1:
            return []
        return [
            part
            for marker in piece.markers
            for part in self.predict(replace(piece, markers=marker[None]), completed)
        ]

    def bridge(self, piece: Piece, completed: NDArray[np.float64]) -> list[Prediction]:
        """Bridge a piece over time, marker by marker; parameters as for `predict`."""
        found = []
        for marker in piece.markers:
            bridged = bridge(completed[:, marker], piece.start, piece.stop, self.task.rate)
            if bridged is not None:
                positions, deviation = bridged
                found.append(
                    Prediction(
                        replace(piece, markers=marker[None]),
                        piece.start,
                        positions[:, None],
                        deviation[:, None],
                        complete=True,
                        how="bridged over time",
                        takes=(self.task.name,),
                    )
                )
        return found

    def lead_through(
        self, pieces: Sequence[Piece], completed: NDArray[np.float64]
    ) -> list[Prediction]:
        """Lead pieces through a blackout together.

        Parameters
        ----------
        pieces : sequence of Piece
            Their frames overlap, and no three markers are visible in them.
        completed : ndarray [shape=(frames, markers, 3), mm]
            The clip, filled but for blackouts.

        Returns
        -------
        list of Prediction
            One for each piece, or for some of its markers; for what is seen on neither side, none.
        """
        start, stop = min(p.start for p in pieces), max(p.stop for p in pieces)
        around = completed.copy() if any(p.start > start or p.stop < stop for p in pieces) else None
        wanted = np.unique(np.concatenate([p.markers for p in pieces]))
        recording = Recording(completed)
        if around is not None:
            around[start:stop] = np.nan
            recording = Recording(around)
        others, takes = self._similar_movements(recording.positions, start, stop)
        shape = (stop - start, len(self.task.labels))
        positions, deviation = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
        windows = 0
        # markers that are seen on one side only are led on when those seen on both are done
        while len(wanted):
            found = fill_blackout(
                [recording, *others], start, stop, self.task.rate, self._root, self._partner, wanted
            )
            known = np.empty(0, dtype=np.intp)
            if found is not None:
                known = wanted[~np.isnan(found.positions[:, wanted, 0]).any(axis=0)]
                positions[:, known] = found.positions[:, known]
                deviation[:, known] = found.deviation[:, known]
                windows = max(windows, found.windows)
            if not len(known):
                break
            wanted = np.setdiff1d(wanted, known)
        how = "similar movements of the clip" if windows else "bridged over time"
        how += " and the database" if windows and takes else ""
        predictions = []
        for piece in pieces:
            inside = slice(piece.start - start, piece.stop - start)
            markers = piece.markers[~np.isnan(positions[inside, piece.markers, 0]).any(axis=0)]
            if len(markers):
                predictions.append(
                    Prediction(
                        replace(piece, markers=markers),
                        piece.start,
                        positions[inside, markers]
                        + self._steps(positions[:, markers], completed, piece, start, markers),
                        deviation[inside, markers],
                        complete=True,
                        how=how,
                        takes=(self.task.name, *(takes if windows else ())),
                    )
                )
        return predictions

    def _similar_movements(
        self, clip: NDArray[np.float64], start: int, stop: int
    ) -> tuple[list[Recording], tuple[str, ...]]:
        """Find stretches of the database with edges like those of a blackout.

        Parameters
        ----------
        clip : ndarray [shape=(frames, markers, 3), mm]
            Filled but for blackouts.
        start, stop : int
            Of the blackout.

        Returns
        -------
        recordings : list of Recording
            At the clip's rate, none longer than a window.
        takes : tuple of str
            Where they are from.
        """
        rate, options = self.task.rate, self._options
        edges = [f for f in (start - 1, stop) if 0 <= f < len(clip)]
        known = np.logical_and.reduce(~np.isnan(clip[edges, :, 0]))
        markers = np.flatnonzero(known)
        root = self._root(markers) if len(markers) >= FEWEST_VISIBLE else None
        if root is None or not self.task.takes or not self._shown_with(markers)[markers].all():
            return [], ()
        bank = self._bank(root, _evenly(markers, options.visible), markers, DATABASE_RATE)
        # what a window needs, in frames of the bank counted from the one before the blackout
        margin = int(np.ceil((REACH * rate + 2) / rate * bank.rate)) + SPLINE_MARGIN
        length = (stop - start + 1) / rate * bank.rate
        first = -margin if start > 0 else 0
        last = int(np.ceil(length)) + (margin if stop < len(clip) else 0)
        if not len(bank):
            return [], ()
        rows = []
        for frame in edges:
            at = 0 if frame < start else round(length)
            here = clip[frame][None]
            found = bank.nearest(here, root.frames(here), SIMILAR * options.neighbours).row[0]
            rows.append(found - at)
        begin = np.unique(np.concatenate(rows))
        begin = begin[(begin + first >= 0)]
        inside = begin + first
        whole = bank.moved(inside, last - first) != inside
        whole &= bank.moved(inside, -first) == begin if first < 0 else True
        begin = begin[whole]
        if not len(begin):
            return [], ()
        distance = np.zeros(len(begin))
        for frame in edges:
            at = 0 if frame < start else round(length)
            poses = np.full((1 + len(begin), clip.shape[1], 3), np.nan)
            poses[0], poses[1:, markers] = clip[frame], bank.positions(begin + at, markers)
            local = root.frames(poses).to_local(poses)[:, markers]
            distance += ((local[1:] - local[0]) ** 2).sum(axis=(1, 2))
        distance = np.sqrt(distance / (len(edges) * len(markers)))
        order = np.argsort(distance, kind="stable")
        chosen = begin[order[distance[order] < OTHER_MOVEMENT]]
        apart = max(1.0, 0.25 * length)
        kept: list[int] = []
        for row in chosen:
            if all(abs(row - other) >= apart for other in kept):
                kept.append(int(row))
            if len(kept) == options.movements:
                break
        time = np.arange(first, last + 1) / bank.rate
        # clip frames of the same stretch, counted from the blackout's first one
        low = int(np.ceil(time[0] * rate)) if first < 0 else 1
        frames = np.arange(low, int(time[-1] * rate) + 1) - 1
        recordings = []
        for row in kept:
            positions = np.full((len(frames), clip.shape[1], 3), np.nan)
            there = bank.positions(row + np.arange(first, last + 1), markers)
            if np.isnan(there).any():
                continue
            positions[:, markers] = CubicSpline(time, there)((frames + 1) / rate)
            recordings.append(
                Recording(positions, STRANGER_KINSHIP, np.array([-int(frames[0])], dtype=np.intp))
            )
        names = take_names(self.task.takes, bank.take(np.array(kept, dtype=np.intp)))
        return recordings, names if recordings else ()

    def _steps(
        self,
        found: NDArray[np.float64],
        completed: NDArray[np.float64],
        piece: Piece,
        start: int,
        markers: NDArray[np.intp],
    ) -> NDArray[np.float64]:
        """Return what joins what was found from ``start`` on to a shorter piece's own edges."""
        frames = np.arange(piece.start, piece.stop)
        away = []
        for frame in (piece.start - 1, piece.stop):
            step = np.full((len(markers), 3), np.nan)
            if start <= frame < start + len(found):
                step = completed[frame, markers] - found[frame - start]
            away.append(np.where(np.isnan(step), 0.0, step))
        share = (frames - (piece.start - 1)) / (len(frames) + 1)
        joined: NDArray[np.float64] = away[0] + share[:, None, None] * (away[1] - away[0])
        return joined

    @cached_property
    def _partner(self) -> NDArray[np.intp]:
        """Each marker's partner on the other side of the body; -1 where it has none."""
        index = {label: i for i, label in enumerate(self.task.labels)}
        mirror = self.task.marker_set.mirror
        return np.array([index.get(mirror.get(label, ""), -1) for label in self.task.labels])

    def _around(self, piece: Piece, visible: NDArray[np.intp]) -> NDArray[np.intp]:
        """Frames of a piece and its margins, as far as the visible markers are measured."""
        usable = np.logical_and.reduce(self.valid[:, visible], axis=1)
        first, last = piece.start, piece.stop
        while first > max(0, piece.start - self._margin) and usable[first - 1]:
            first -= 1
        while last < min(len(usable), piece.stop + self._margin) and usable[last]:
            last += 1
        return np.arange(first, last)

    def _query(self, frames: NDArray[np.intp], visible: NDArray[np.intp], *, take: int) -> Rows:
        """Return frames of the clip to be predicted; ``take`` is its number among the rows'."""
        return Rows(
            self.task.positions[np.ix_(frames, visible)],
            np.empty((len(frames), 0, 3)),
            frames / self.task.rate,
            np.full(len(frames), take),
        )

    def _from_own(self, piece: Piece, completed: NDArray[np.float64] | None) -> Prediction | None:
        """Predict from the clip's own frames; None where too few can be learnt from."""
        options, rate = self._options, self.task.rate
        source = self.task.positions if completed is None else completed
        shown = np.logical_and.reduce(self.valid[:, piece.markers], axis=1)
        nearest = self.distance[piece.markers].min(axis=0)
        visible = piece.visible[np.isfinite(nearest[piece.visible])]
        visible = visible[np.argsort(nearest[visible], kind="stable")]
        known = ~np.isnan(source[:, visible, 0])
        # how many frames show the markers together with the nearest n visible ones
        count = (np.logical_and.accumulate(known, axis=1) & shown[:, None]).sum(axis=0)
        enough = np.flatnonzero(count >= min(options.wished_rows, 0.5 * shown.sum()))
        kept = max(int(enough[-1]) + 1 if len(enough) else 0, min(4, len(visible)))
        if kept < FEWEST_VISIBLE:
            return None
        visible = visible[:kept]
        usable = np.flatnonzero(np.logical_and.reduce(known[:, :kept], axis=1) & shown)
        if len(usable) < options.fewest_rows:
            return None

        beside = int(options.beside * rate) + 1
        near = usable[(usable >= piece.start - beside) & (usable < piece.stop + beside)]
        frames = np.union1d(near, _evenly(usable, options.rows))
        asked = self._around(piece, visible)
        rows = Rows(
            source[np.ix_(frames, visible)],
            self.task.positions[np.ix_(frames, piece.markers)],
            frames / rate,
            np.full(len(frames), OWN),
        )
        query = self._query(asked, visible, take=OWN)
        spread = self.spread[np.ix_(piece.markers, visible)].min(axis=0)
        lesson = Lesson(rows, query, nearest[visible], spread)
        complete = kept == len(piece.visible) and len(usable) >= options.rereading * shown.sum()
        takes: tuple[str, ...] = ()
        if completed is None and not complete:
            lessons, members = [lesson], BASIC
        elif len(piece.markers) <= FEW:
            members = FEW_MEMBERS
            lessons = [self._moments(lesson, source, visible, members)]
        else:
            members = LIMB_MEMBERS
            lessons, takes = self._limb_lessons(lesson, source, piece, visible, near)
        prediction = self._learn(
            piece,
            int(asked[0]),
            lessons,
            members,
            complete=complete,
            how="the clip's own frames" + (" and the database's" if takes else ""),
            takes=(self.task.name, *takes),
            own=True,
        )
        edges = stiff_edges(self.distance, self.spread, piece.markers, visible)
        seen = self.task.positions[np.ix_(asked, visible)]
        positions = hold_lengths(prediction.positions, prediction.deviation, seen, edges)
        return replace(prediction, positions=positions)

    def _learn(
        self,
        piece: Piece,
        first: int,
        lessons: Sequence[Lesson],
        members: Sequence[Member],
        **told: Any,
    ) -> Prediction:
        """Predict a piece from lessons; ``told`` is what else is to be said of the prediction."""
        seconds = (piece.stop - piece.start) / self.task.rate
        frames = np.round(lessons[0].query.time * self.task.rate)
        inside = (frames >= piece.start) & (frames < piece.stop)
        found = regress(lessons, members, seconds, inside, self.each)
        return Prediction(
            piece,
            first,
            found.positions,
            found.deviation,
            bound_factor=found.bound_factor,
            poses=max(len(lesson.rows.time) for lesson in lessons),
            **told,
        )

    def _limb_lessons(
        self,
        lesson: Lesson,
        source: NDArray[np.float64],
        piece: Piece,
        visible: NDArray[np.intp],
        near: NDArray[np.intp],
    ) -> tuple[list[Lesson], tuple[str, ...]]:
        """Return what a limb is learnt from: the clip and its mirror image, and the database.

        Parameters
        ----------
        lesson : Lesson
            By the clip's own frames.
        source : ndarray [shape=(frames, markers, 3), mm]
            The clip, its holes completed on a second reading.
        piece : Piece
            What to predict.
        visible : ndarray of int
            The visible markers of the lesson, in its order.
        near : ndarray of int
            Frames right beside the piece, of which none is given up.

        Returns
        -------
        lessons : list of Lesson
        takes : tuple of str
            Recordings of the database in them.
        """
        lesson, visible = self._with_mirror(lesson, piece, visible, near)
        lessons = [self._moments(lesson, source, visible, LIMB_MEMBERS)]
        shared, takes = self._database_lesson(lessons[0], piece, visible, near)
        return [*lessons, *shared], takes

    def _moments(
        self,
        lesson: Lesson,
        source: NDArray[np.float64],
        visible: NDArray[np.intp],
        members: Sequence[Member],
    ) -> Lesson:
        """Return a lesson with the moments that members ask for.

        Parameters are those of `_limb_lessons`; the lesson is of the clip and its mirror image.
        """

        def with_moments(poses: Rows) -> Rows:
            frames = np.round(poses.time * self.task.rate).astype(np.intp)
            image = (poses.take == IMAGE)[:, None, None]

            def at(seconds: float) -> NDArray[np.float64]:
                there = frames + round(seconds * self.task.rate)
                where = np.ix_(np.clip(there, 0, len(source) - 1), visible)
                positions = np.where(image, self._mirrored[where], source[where])
                outside = (there < 0) | (there >= len(source))
                positions[outside] = np.nan
                return positions

            around = {
                seconds: _standing_in(poses.visible, at(-seconds), at(seconds))
                for seconds in seconds_of(members)
            }
            return replace(poses, around=around)

        return replace(lesson, rows=with_moments(lesson.rows), query=with_moments(lesson.query))

    def _with_mirror(
        self,
        lesson: Lesson,
        piece: Piece,
        visible: NDArray[np.intp],
        near: NDArray[np.intp],
    ) -> tuple[Lesson, NDArray[np.intp]]:
        """Add the clip's mirror image to a lesson, unless it shows too little.

        Parameters are those of `_limb_lessons`. Returns the lesson and its visible markers.
        """
        options, rate = self._options, self.task.rate
        mirrored = self._mirrored
        kept = self._paired(visible)
        needed = np.concatenate([visible[kept], piece.markers])
        usable = np.flatnonzero(~np.isnan(mirrored[:, needed, 0]).any(axis=1))
        if len(kept) < FEWEST_VISIBLE or len(usable) < options.fewest_rows:
            return lesson, visible
        frames = _evenly(usable, options.mirrored_rows)
        own = lesson.rows
        beside = np.flatnonzero(np.isin(own.time, near / rate))
        some = np.union1d(
            beside, _evenly(np.arange(len(own.time)), options.rows - options.mirrored_rows)
        )
        image = mirrored[frames]
        rows = Rows(
            np.concatenate([own.visible[np.ix_(some, kept)], image[:, visible[kept]]]),
            np.concatenate([own.missing[some], image[:, piece.markers]]),
            np.concatenate([own.time[some], frames / rate]),
            np.repeat([OWN, IMAGE], [len(some), len(frames)]),
            np.repeat([1.0, MIRROR_KINSHIP], [len(some), len(frames)]),
        )
        query = replace(lesson.query, visible=lesson.query.visible[:, kept])
        return Lesson(rows, query, lesson.distance[kept], lesson.spread[kept]), visible[kept]

    def _paired(self, visible: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return indices of the visible markers with a partner, which the mirror image shows."""
        return np.flatnonzero(~np.isnan(self._mirrored[:, visible, 0]).all(axis=0))

    def _database_lesson(
        self,
        lesson: Lesson,
        piece: Piece,
        visible: NDArray[np.intp],
        near: NDArray[np.intp],
    ) -> tuple[list[Lesson], tuple[str, ...]]:
        """Return a lesson that the database adds to; none where it shows too little.

        Parameters are those of `_limb_lessons`, but the lesson has moments, and the mirror
        image's poses where there are any.
        """
        options, rate = self._options, self.task.rate
        if not self.task.takes:
            return [], ()
        kept = np.flatnonzero(self._shown_with(piece.markers)[visible])
        markers = visible[kept]
        root = self._root(markers)
        if len(kept) < FEWEST_VISIBLE or root is None:
            return [], ()
        needed = np.concatenate([piece.markers, markers])
        bank = self._bank(root, markers[: options.visible], needed, MOVEMENT_RATE)
        if len(bank) < options.fewest_rows:
            return [], ()

        own_rows, image_rows, gap_rows, other_rows = options.shared_rows
        own, image = (np.flatnonzero(lesson.rows.take == take) for take in (OWN, IMAGE))
        frames = np.round(lesson.rows.time * rate).astype(np.intp)
        beside = own[np.isin(frames[own], near)]
        own, image = np.union1d(beside, _evenly(own, own_rows)), _evenly(image, image_rows)
        here, asked = lesson.rows.visible[:, kept], lesson.query.visible[:, kept]
        chosen = self._nearest(bank, root, markers, asked)[:gap_rows]
        more = self._nearest(bank, root, markers, here[own])
        chosen = np.concatenate([chosen, more[~np.isin(more, chosen)][:other_rows]])
        there = bank.positions(chosen, markers)

        some = np.concatenate([own, image])
        around = {}
        for seconds, now in lesson.rows.around.items():
            step = round(seconds * bank.rate)
            if step:  # a coarse resolution does not show short moments
                moved = [bank.positions(bank.moved(chosen, d), markers) for d in (-step, step)]
                moment = [now[:, some][:, :, kept], _standing_in(there, *moved)]
                around[seconds] = np.concatenate(moment, axis=1)
        # as takes, so bodies: OWN and IMAGE are the clip and its mirror image
        take = lesson.rows.take[some]
        rows = Rows(
            np.concatenate([here[some], there]),
            np.concatenate([lesson.rows.missing[some], bank.positions(chosen, piece.markers)]),
            np.concatenate([lesson.rows.time[some], chosen / bank.rate]),
            np.concatenate([take, IMAGE + 1 + bank.take(chosen)]),
            np.repeat([1.0, MIRROR_KINSHIP, STRANGER_KINSHIP], [len(own), len(image), len(chosen)]),
            np.concatenate([take, IMAGE + 1 + self._bodies[bank.take(chosen)]]),
            around,
        )
        query = replace(
            lesson.query,
            visible=asked,
            around={seconds: now[:, :, kept] for seconds, now in lesson.query.around.items()},
        )
        shown = np.logical_and.reduce(self.valid[:, piece.markers], axis=1).sum() / rate
        handicap = 1.0 + HANDICAP * max(0.0, float(np.log2(shown / SELF_SUFFICIENT)))
        distance, spread = lesson.distance[kept], lesson.spread[kept]
        names = take_names(self.task.takes, bank.take(chosen))
        return [Lesson(rows, query, distance, spread, handicap)], names

    def _root(self, visible: NDArray[np.intp]) -> RootGroup | None:
        """Choose a root group among visible markers."""
        among = np.zeros(len(self.task.labels), dtype=bool)
        among[visible] = True
        return choose_root(self.task.marker_set, self.task.labels, self.task.positions, among)

    def _nearest(
        self,
        bank: PoseBank,
        root: RootGroup,
        markers: NDArray[np.intp],
        poses: NDArray[np.float64],
    ) -> NDArray[np.intp]:
        """Return the rows of a bank nearest to poses of some markers, the nearest first."""
        some = poses[_evenly(np.arange(len(poses)), self._options.queries)]
        whole = np.full((len(some), len(self.task.labels), 3), np.nan)
        whole[:, markers] = some
        return _in_turn(bank.nearest(whole, root.frames(whole), self._options.neighbours).row)

    @cached_property
    def _bodies(self) -> NDArray[np.intp]:
        """Number of each take's subject; one whose subject is unknown has it to itself."""
        subjects = [take.subject or f"\0{i}" for i, take in enumerate(self.task.takes)]
        return np.unique(subjects, return_inverse=True)[1].astype(np.intp)

    def _bank(
        self, root: RootGroup, viable: NDArray[np.intp], wanted: NDArray[np.intp], rate: float
    ) -> PoseBank:
        """Return a bank of the database at a rate (Hz), or at a lower one if it is large."""
        return self._banks.get(root, viable, wanted, min(rate, self._highest_rate), MOST_POSES)

    @cached_property
    def _highest_rate(self) -> float:
        """The rate (Hz) up to which the database has few enough poses, or its coarsest."""
        takes, rate = self.task.takes, DATABASE_RATE
        while (
            rate > min(take.rates[-1] for take in takes)
            and sum(take.lengths[take.nearest_level(rate)] for take in takes) > MOST_POSES
        ):
            rate /= 2.0
        return rate

    def _shown_with(self, markers: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Which markers the takes that have all of some markers have too [shape=(markers,)]."""
        having = self._taken[np.logical_and.reduce(self._taken[:, markers], axis=1)]
        # rare ones are given up: a pose must have all that it is searched by
        often: NDArray[np.bool_] = having.sum(axis=0) >= max(1.0, 0.5 * len(having))
        return often

    @cached_property
    def _taken(self) -> NDArray[np.bool_]:
        """Which markers each take of the database has [shape=(takes, markers)]."""
        return np.array([take.shown > 0 for take in self.task.takes])

    def _from_others(self, piece: Piece) -> Prediction | None:
        """Predict from other recordings, other bodies and the mirror; None where none tells."""
        visible = self._dropouts.nearest_visible(piece.markers, piece.visible)
        asked = self._around(piece, visible)
        told = self._dropouts.predict(piece.markers, visible, asked)
        if told is None:
            return None
        return Prediction(
            piece,
            int(asked[0]),
            told.positions,
            told.deviation,
            complete=True,
            how=told.how,
            takes=told.takes,
        )
