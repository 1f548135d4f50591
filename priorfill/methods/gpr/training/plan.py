"""The regression problems and the ensemble of models for a batch of gap segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.problem import GPModel, RegressionProblem
from priorfill.methods.gpr.gap_segments import MIN_VISIBLE, SegmentBatch
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.training.own_clip import OwnClipProblem, OwnClipProblems
from priorfill.methods.gpr.training.with_database import problem_with_database
from priorfill.methods.task import MIRROR_IMAGE, Task

__all__ = ["TrainingPlan", "TrainingPlanner"]


@dataclass(frozen=True, eq=False)
class TrainingPlan:
    """The training data and models for a batch of gap segments.

    Attributes
    ----------
    problems : sequence of RegressionProblem
        All with the same queries: of the clip, and of the clip with the database.
    models : sequence of GPModel
        The ensemble of the problems without models of their own.
    query_frames : ndarray of int
        Frames of the queries; see `priorfill.methods.gpr.spline_nodes`.
    queries : tuple of slice
        Those of each segment of the batch.
    inside : ndarray of bool [shape=(queries,)]
        Which of them are in a segment, evenly spaced.
    visible : ndarray of int
        Visible markers of the clip's own problem, the nearest first.
    complete : bool
        Whether a second pass has no more training poses.
    takes : tuple of str
        Names of the recordings of the database that are used.
    """

    problems: Sequence[RegressionProblem]
    models: Sequence[GPModel]
    query_frames: NDArray[np.intp]
    queries: tuple[slice, ...]
    inside: NDArray[np.bool_]
    visible: NDArray[np.intp]
    complete: bool
    takes: tuple[str, ...] = ()

    @property
    def training_poses(self) -> int:
        """Number of training poses of the largest problem."""
        return max(len(problem.train.time) for problem in self.problems)


class TrainingPlanner:
    """Plans the training for the batches of segments of a task.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    search : PoseSearch
        Of these takes.
    margin : int
        Frames around a segment to be predicted too, where the visible markers allow.
    options : GPROptions
        Of the method.

    Attributes
    ----------
    own : OwnClipProblems
        The problems of the clip alone.
    """

    def __init__(self, task: Task, search: PoseSearch, margin: int, options: GPROptions) -> None:
        self.own = OwnClipProblems(
            task, margin, options.training, options.spline_nodes, options.correlation
        )
        self._task = task
        self._search = search
        self._options = options
        self._models = options.models

    def plan(
        self, batch: SegmentBatch, completed: NDArray[np.float64] | None
    ) -> TrainingPlan | None:
        """Choose the training data and the models for a batch.

        Parameters
        ----------
        batch : SegmentBatch
            What to predict.
        completed : ndarray [shape=(frames, markers, 3), mm] or None
            The clip filled by the first pass, to complete training poses in the second one.

        Returns
        -------
        TrainingPlan or None
            None where the clip shows the missing markers in too few frames.
        """
        own = self.own.problem_for(batch, completed)
        if own is None:
            return None
        if completed is None and not own.complete:  # the second pass will replace it
            return _plan_of(own, self._models.first_pass)
        seconds = batch.frames / self._task.rate
        if seconds <= self._options.training.short_segment_seconds:
            return _plan_of(own, self._models.short_segment)
        mixed = self.own.with_mirror_image(own)
        if len(batch.markers) > 1:
            return self._limb_plan(mixed, self._models.limb)
        if self._is_loose(mixed):
            return self._limb_plan(mixed, self._models.loose_marker)
        measured = np.count_nonzero(self._task.valid[:, batch.markers[0]])
        is_long = batch.frames > measured
        models = self._models.long_gap if is_long else self._models.single_marker
        return _plan_of(self.own.with_lag_features(mixed, models), models)

    def _is_loose(self, own: OwnClipProblem) -> bool:
        """Whether a marker moves relative to its neighbours, and there is more to learn from.

        Three neighbours at constant distances would define its position.
        """
        alignment = self._models.single_marker[0].alignment
        weights = alignment.marker_weights(own.problem.distance, own.problem.spread).alignment
        few = np.sort(weights)[-MIN_VISIBLE] < self._options.training.min_third_weight
        image = (own.problem.train.recording == MIRROR_IMAGE).any()
        return bool(few and (image or self._task.takes))

    def _limb_plan(self, own: OwnClipProblem, models: Sequence[GPModel]) -> TrainingPlan:
        """Plan with velocities, and with the database."""
        further = self._models.limb_with_database
        all_models = (*models, *further) if self._task.takes else models
        limb = self.own.with_velocities(self.own.with_lag_features(own, all_models))
        with_database = problem_with_database(
            limb,
            self._task,
            self._search,
            self._options.training,
            self._options.correlation,
            further,
            self._models.simulated_gap,
        )
        if with_database is None:
            return _plan_of(limb, models)
        problem, takes = with_database
        return _plan_of(limb, models, (problem,), takes)


def _plan_of(
    own: OwnClipProblem,
    models: Sequence[GPModel],
    further: tuple[RegressionProblem, ...] = (),
    takes: tuple[str, ...] = (),
) -> TrainingPlan:
    """Return the plan of a problem of the clip, and further ones."""
    return TrainingPlan(
        (own.problem, *further),
        models,
        own.query_frames,
        own.queries,
        own.inside,
        own.visible,
        own.complete,
        takes,
    )
