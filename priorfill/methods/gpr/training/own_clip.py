"""A lesson of the clip's own frames, its mirror image beside it, and the moments around both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.mirror import mirrored
from priorfill.geometry.poses import evenly_spaced
from priorfill.gp.data import Lesson, Member, Rows
from priorfill.methods.gpr.ensembles import seconds_of
from priorfill.methods.gpr.gap_segments import FEWEST_VISIBLE, Piece
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.spline_nodes import knots
from priorfill.methods.gpr.training.lagged_poses import standing_in
from priorfill.methods.gpr.training.subject_correlation import MIRROR_KINSHIP
from priorfill.methods.task import Task

__all__ = ["IMAGE", "OWN", "VELOCITY_SECONDS", "OwnLesson", "OwnLessons"]

OWN, IMAGE = 0, 1
"""Numbers of the clip and its mirror image among the takes of rows; the database's follow."""

VELOCITY_SECONDS = 1.0 / 30.0
"""s. Velocities are taken from so long before to so long after: from twice as long they fill worse
by one part in a hundred."""

FEWEST_KEPT = 4
"""Visible markers that are not given up, however few frames show them together."""

ENOUGH_SHOWN = 0.5
"""Part of the frames that show the missing markers which is enough, where all are few."""


@dataclass(frozen=True, eq=False)
class OwnLesson:
    """A lesson of the clip's own frames.

    Attributes
    ----------
    lesson : Lesson
        Rows of the clip, and of its mirror image if it has been added.
    piece : Piece
        What to predict.
    asked : ndarray of int
        Frames of the queries, which are knots; see `priorfill.methods.gpr.spline_nodes`.
    even : ndarray of bool [shape=(queries,)]
        Which of them are in the piece, and evenly spread over it.
    visible : ndarray of int
        The visible markers of the lesson, in its order: the nearest first.
    near : ndarray of int
        Frames right beside the piece, of which none is given up.
    source : ndarray [shape=(frames, markers, 3), mm]
        The clip, its holes completed on a second reading.
    complete : bool
        Whether a second reading would gain nothing.
    """

    lesson: Lesson
    piece: Piece
    asked: NDArray[np.intp]
    even: NDArray[np.bool_]
    visible: NDArray[np.intp]
    near: NDArray[np.intp]
    source: NDArray[np.float64]
    complete: bool


class OwnLessons:
    """Makes lessons of the clip of a task.

    Parameters
    ----------
    task : Task
        The clip.
    margin : int
        Frames around a piece to be predicted too, where the visible markers allow.
    options : GPROptions
        How many rows.

    Attributes
    ----------
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    distance, spread : ndarray [shape=(markers, markers), mm]
        See `ClipGeometry`.
    """

    def __init__(self, task: Task, margin: int, options: GPROptions) -> None:
        self.valid = task.valid
        self.distance, self.spread = task.geometry.distance, task.geometry.spread
        self._task = task
        self._margin = margin
        self._options = options

    def read(self, piece: Piece, completed: NDArray[np.float64] | None) -> OwnLesson | None:
        """Make a lesson of the frames that show a piece's markers; None where they are too few.

        Parameters
        ----------
        piece : Piece
            What to predict.
        completed : ndarray [shape=(frames, markers, 3), mm] or None
            The clip after a first fill, to complete the rows.
        """
        options, rate = self._options, self._task.rate
        source = self._task.positions if completed is None else completed
        shown = np.logical_and.reduce(self.valid[:, piece.markers], axis=1)
        nearest = self.distance[piece.markers].min(axis=0)
        visible = piece.visible[np.isfinite(nearest[piece.visible])]
        visible = visible[np.argsort(nearest[visible], kind="stable")]
        showing = np.flatnonzero(shown)
        # which of these frames show the nearest n visible markers together; marker by marker, as
        # a long clip's masks are large
        together = np.empty((len(showing), len(visible)), dtype=bool)
        for place, marker in enumerate(visible):
            known = self.valid[showing, marker]
            if completed is not None:
                known = ~np.isnan(source[showing, marker, 0])
            together[:, place] = known & together[:, place - 1] if place else known
        count = together.sum(axis=0)
        enough = np.flatnonzero(count >= min(options.wished_rows, ENOUGH_SHOWN * shown.sum()))
        kept = max(int(enough[-1]) + 1 if len(enough) else 0, min(FEWEST_KEPT, len(visible)))
        if kept < FEWEST_VISIBLE:
            return None
        visible = visible[:kept]
        usable = showing[together[:, kept - 1]]
        if len(usable) < options.fewest_rows:
            return None

        beside = int(options.beside * rate) + 1
        near = usable[(usable >= piece.start - beside) & (usable < piece.stop + beside)]
        frames = np.union1d(near, usable[evenly_spaced(len(usable), options.rows)])
        asked, even = knots(piece.around(self.valid, visible, self._margin), piece, rate)
        rows = Rows(
            source[np.ix_(frames, visible)],
            self._task.positions[np.ix_(frames, piece.markers)],
            frames / rate,
            np.full(len(frames), OWN),
        )
        query = Rows(
            self._task.positions[np.ix_(asked, visible)],
            np.empty((len(asked), 0, 3)),
            asked / rate,
            np.full(len(asked), OWN),
        )
        spread = self.spread[np.ix_(piece.markers, visible)].min(axis=0)
        return OwnLesson(
            Lesson(rows, query, nearest[visible], spread),
            piece,
            asked,
            even,
            visible,
            near,
            source,
            kept == len(piece.visible) and len(usable) >= options.rereading * shown.sum(),
        )

    def with_mirror(self, own: OwnLesson) -> OwnLesson:
        """Add the clip's mirror image to a lesson, unless it shows too little."""
        options, rate = self._options, self._task.rate
        lesson, markers = own.lesson, own.piece.markers
        shown = np.logical_or.reduce(self.valid, axis=0)
        # visible markers without a partner are not in the mirror image
        contralateral = self._task.contralateral
        kept = np.flatnonzero((contralateral[own.visible] >= 0) & shown[contralateral[own.visible]])
        visible = own.visible[kept]
        needed = contralateral[np.concatenate([visible, markers])]
        usable = np.flatnonzero(np.logical_and.reduce(self.valid[:, needed], axis=1))
        if (needed < 0).any():
            usable = usable[:0]
        if len(kept) < FEWEST_VISIBLE or len(usable) < options.fewest_rows:
            return own
        frames = usable[evenly_spaced(len(usable), options.mirrored_rows)]
        rows = lesson.rows
        beside = np.flatnonzero(np.isin(rows.time, own.near / rate))
        some = np.union1d(
            beside, evenly_spaced(len(rows.time), options.rows - options.mirrored_rows)
        )
        added = Rows(
            np.concatenate([rows.visible[np.ix_(some, kept)], self._image(frames, visible)]),
            np.concatenate([rows.missing[some], self._image(frames, markers)]),
            np.concatenate([rows.time[some], frames / rate]),
            np.repeat([OWN, IMAGE], [len(some), len(frames)]),
            np.repeat([1.0, MIRROR_KINSHIP], [len(some), len(frames)]),
        )
        query = replace(lesson.query, visible=lesson.query.visible[:, kept])
        mixed = Lesson(added, query, lesson.distance[kept], lesson.spread[kept])
        return replace(own, lesson=mixed, visible=visible)

    def with_velocities(self, own: OwnLesson) -> OwnLesson:
        """Add to a lesson how fast the missing markers move."""
        rows = own.lesson.rows
        frames = np.round(rows.time * self._task.rate).astype(np.intp)
        image = (rows.take == IMAGE)[:, None, None]
        step = max(1, round(VELOCITY_SECONDS * self._task.rate))
        before, after = (
            self.at(self._task.positions, frames + way, own.piece.markers, image)
            for way in (-step, step)
        )
        before, after = standing_in(rows.missing, before, after)
        moving = (after - before) * (0.5 * self._task.rate / step)
        return replace(own, lesson=replace(own.lesson, rows=replace(rows, moving=moving)))

    def with_moments(self, own: OwnLesson, members: Sequence[Member]) -> OwnLesson:
        """Add the moments to a lesson that members ask for."""
        around = _Around(self, own.source, own.visible, self._task.rate, seconds_of(members))
        lesson = replace(own.lesson, rows=around(own.lesson.rows), surroundings=around)
        return replace(own, lesson=lesson)

    def at(
        self,
        source: NDArray[np.float64],
        frames: NDArray[np.intp],
        markers: NDArray[np.intp],
        image: NDArray[np.bool_],
    ) -> NDArray[np.float64]:
        """Return markers in frames of a clip, or of the mirror image; NaN outside of it."""
        inside = np.clip(frames, 0, len(source) - 1)
        positions = source[np.ix_(inside, markers)]
        if image.any():
            positions = np.where(image, self._image(inside, markers), positions)
        positions[(frames < 0) | (frames >= len(source))] = np.nan
        return positions

    def _image(self, frames: NDArray[np.intp], markers: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return markers of the clip's mirror image in some frames; NaN where it lacks them."""
        return mirrored(self._task.positions[frames], self._task.contralateral)[:, markers]


@dataclass(frozen=True, eq=False)
class _Around:
    """Knows what is around poses of the clip or its mirror image."""

    clip: OwnLessons
    source: NDArray[np.float64]  # (frames, markers, 3)
    visible: NDArray[np.intp]
    rate: float
    moments: Sequence[float]  # s

    def __call__(self, poses: Rows) -> Rows:
        frames = np.round(poses.time * self.rate).astype(np.intp)
        image = (poses.take == IMAGE)[:, None, None]

        def at(seconds: float) -> NDArray[np.float64]:
            moved = frames + round(seconds * self.rate)
            return self.clip.at(self.source, moved, self.visible, image)

        around = {
            seconds: standing_in(poses.visible, at(-seconds), at(seconds))
            for seconds in self.moments
        }
        return replace(poses, around=around)

    def among(self, some: NDArray[np.intp]) -> _Around:
        return replace(self, visible=self.visible[some])
