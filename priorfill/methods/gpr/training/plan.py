"""The lessons that a piece is learnt from, and the members that read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.data import Lesson, Member
from priorfill.methods.gpr.ensembles import (
    BASIC,
    BRIEF_MEMBERS,
    LIMB_MEMBERS,
    MARKER_MEMBERS,
)
from priorfill.methods.gpr.gap_segments import Piece
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.training.own_clip import OwnLessons
from priorfill.methods.gpr.training.with_database import shared_lesson
from priorfill.methods.task import Task

__all__ = ["Course", "Lessons"]


MOMENTARY = 0.1
"""s. Over no longer than this the seam says more than any way of learning."""


@dataclass(frozen=True, eq=False)
class Course:
    """What a piece is learnt from.

    Attributes
    ----------
    lessons : sequence of Lesson
        All predict the same poses.
    members : sequence of Member
        Who reads them.
    asked : ndarray of int
        Frames of the clip to be predicted: knots, through which curves are led.
    even : ndarray of bool [shape=(asked,)]
        Which of them are in the piece, and evenly spread over it.
    visible : ndarray of int
        Visible markers of the clip's own frames, the nearest first.
    complete : bool
        Whether a second reading would gain nothing.
    takes : tuple of str
        Recordings of the database in the lessons.
    """

    lessons: Sequence[Lesson]
    members: Sequence[Member]
    asked: NDArray[np.intp]
    even: NDArray[np.bool_]
    visible: NDArray[np.intp]
    complete: bool
    takes: tuple[str, ...]

    @property
    def poses(self) -> int:
        """Rows of the largest lesson."""
        return max(len(lesson.rows.time) for lesson in self.lessons)


class Lessons:
    """Makes the lessons of a task's pieces.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.
    search : PoseSearch
        Of these takes.
    margin : int
        Frames around a piece to be predicted too, where the visible markers allow.
    options : GPROptions
        How many rows of what.

    Attributes
    ----------
    own : OwnLessons
        The clip's.
    """

    def __init__(self, task: Task, search: PoseSearch, margin: int, options: GPROptions) -> None:
        self.own = OwnLessons(task, margin, options)
        self._task = task
        self._search = search
        self._options = options

    def of(self, piece: Piece, completed: NDArray[np.float64] | None) -> Course | None:
        """Return what a piece is learnt from; None where the clip shows too little of it.

        Parameters
        ----------
        piece : Piece
            What to predict.
        completed : ndarray [shape=(frames, markers, 3), mm] or None
            The clip after a first fill, to complete the poses that are learnt from.
        """
        own = self.own.read(piece, completed)
        if own is None:
            return None
        takes: tuple[str, ...] = ()
        members = LIMB_MEMBERS
        if completed is None and not own.complete:
            members = BASIC
            lessons = [own.lesson]
        elif (piece.stop - piece.start) / self._task.rate <= MOMENTARY:
            members = BRIEF_MEMBERS
            lessons = [own.lesson]
        elif len(piece.markers) == 1:
            members = MARKER_MEMBERS
            lessons = [self.own.with_moments(own, members).lesson]
        else:
            limb = self.own.with_moments(self.own.with_mirror(own), members)
            limb = self.own.with_velocities(limb)
            lessons = [limb.lesson]
            shared = shared_lesson(limb, self._task, self._search, self._options)
            if shared is not None:
                lessons.append(shared[0])
                takes = shared[1]
        return Course(lessons, members, own.asked, own.even, own.visible, own.complete, takes)
