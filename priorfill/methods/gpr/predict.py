"""Decide what a piece is predicted from: the clip's own frames, other recordings, or time alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.constraints.segment_lengths import choose_length_edges, hold_lengths
from priorfill.constraints.velocity_fusion import fuse_velocity
from priorfill.gp.ensemble import regress
from priorfill.methods.gpr.blackout import Blackouts
from priorfill.methods.gpr.dropout import DropoutOptions, DropoutPredictor
from priorfill.methods.gpr.gap_segments import Piece
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.prediction import Prediction
from priorfill.methods.gpr.spline_nodes import between
from priorfill.methods.gpr.training.plan import Lessons
from priorfill.methods.task import Task
from priorfill.signal.gp_interpolation import interpolate_gap

__all__ = ["Predictor"]

BRIEF = 0.1
"""s. Over no longer than this a marker's own movement is a better guess than any other body."""


class Predictor:
    """Predicts the pieces of one task. Predictions do not depend on each other.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.
    margin : int
        Frames around a piece to be predicted too, where the visible markers allow.
    options : GPROptions
        See there.

    Attributes
    ----------
    each : callable
        How the views of a piece are gone through: as `map` does, or several at a time.
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    distance, spread : ndarray [shape=(markers, markers), mm]
        See `priorfill.geometry.distances.pair_distances`.
    """

    def __init__(self, task: Task, margin: int, options: GPROptions) -> None:
        self.task = task
        self.each: Callable[..., Any] = map
        self._margin = margin
        search = PoseSearch(task, options)
        self._lessons = Lessons(task, search, margin, options)
        self._dropouts = DropoutPredictor(task, DropoutOptions())
        self._blackouts = Blackouts(task, search, options)
        self.valid = self._lessons.own.valid
        self.distance, self.spread = self._lessons.own.distance, self._lessons.own.spread

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
            bridged = self.interpolate_gap(piece, self.task.positions)
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

    def interpolate_gap(self, piece: Piece, completed: NDArray[np.float64]) -> list[Prediction]:
        """Bridge a piece over time, marker by marker; parameters as for `predict`."""
        found = []
        for marker in piece.markers:
            bridged = interpolate_gap(completed[:, marker], piece.start, piece.stop, self.task.rate)
            if bridged is not None:
                positions, expected_rms = bridged
                found.append(
                    Prediction(
                        replace(piece, markers=marker[None]),
                        piece.start,
                        positions[:, None],
                        expected_rms[:, None],
                        complete=True,
                        how="interpolation over time",
                        takes=(self.task.name,),
                    )
                )
        return found

    def lead_through(
        self, pieces: Sequence[Piece], completed: NDArray[np.float64]
    ) -> list[Prediction]:
        """Lead pieces through a blackout together; see `Blackouts.lead_through`."""
        return self._blackouts.lead_through(pieces, completed)

    def _from_own(self, piece: Piece, completed: NDArray[np.float64] | None) -> Prediction | None:
        """Predict from the clip's own frames; None where too few can be learnt from."""
        course = self._lessons.of(piece, completed)
        if course is None:
            return None
        asked, visible = course.asked, course.visible
        seconds = (piece.stop - piece.start) / self.task.rate
        found = regress(course.lessons, course.members, seconds, course.even, self.each)
        found, frames = between(found, asked), np.arange(asked[0], asked[-1] + 1)
        positions = found.positions
        if found.motion is not None:
            known = self.task.positions[np.ix_(frames, piece.markers)]
            positions = fuse_velocity(positions, found.motion, known, self.task.rate)
        edges = choose_length_edges(self.distance, self.spread, piece.markers, visible)
        anchors, edges = edges.anchored(len(piece.markers))
        seen = self.task.positions[np.ix_(frames, visible[anchors])]
        return Prediction(
            piece,
            int(frames[0]),
            hold_lengths(positions, found.expected_rms, seen, edges),
            found.expected_rms,
            complete=course.complete,
            how="the clip's own frames" + self.task.and_sources(course.takes, "the database's"),
            takes=(self.task.name, *course.takes),
            own=True,
            poses=course.poses,
            bound_factor=found.bound_factor,
        )

    def _from_others(self, piece: Piece) -> Prediction | None:
        """Predict from other recordings, other bodies and the mirror; None where none tells."""
        visible = self._dropouts.nearest_visible(piece.markers, piece.visible)
        asked = piece.around(self.valid, visible, self._margin)
        told = self._dropouts.predict(piece.markers, visible, asked)
        if told is None:
            return None
        return Prediction(
            piece,
            int(asked[0]),
            told.positions,
            told.expected_rms,
            complete=True,
            how=told.source,
            takes=told.source_clips,
            poses=told.training_poses,
        )
