"""Prediction of gap segments: from the clip's own frames, other recordings, or over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from priorfill.constraints.rigid_pairs import hold_rigid_pairs
from priorfill.constraints.segment_lengths import choose_length_edges, hold_lengths
from priorfill.constraints.velocity_fusion import fuse_velocity
from priorfill.gp.ensemble import Regression, regress
from priorfill.methods.gpr.gap_segments import GapSegment, SegmentBatch
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.prediction import SegmentPrediction
from priorfill.methods.gpr.sources.combine import combined
from priorfill.methods.gpr.sources.gap_windows import GapWindows
from priorfill.methods.gpr.spline_nodes import interpolate_nodes
from priorfill.methods.gpr.training.plan import TrainingPlan, TrainingPlanner
from priorfill.methods.task import Task
from priorfill.signal.gp_interpolation import interpolate_gap
from priorfill.signal.lone_samples import interpolate_marker

if TYPE_CHECKING:
    from priorfill.methods.gpr.blackout.fill_blackouts import BlackoutPredictor
    from priorfill.methods.gpr.dropout.fill_dropouts import DropoutPredictor

__all__ = ["SegmentPredictor"]


class SegmentPredictor:
    """Predicts the gap segments of one task, independently of each other.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    margin : int
        Frames around a segment to be predicted too, where the visible markers allow.
    options : GPROptions
        Of the method.

    Attributes
    ----------
    map_function : callable
        `map`, or a function like it that works on several alignments of a segment at a time.
    """

    def __init__(self, task: Task, margin: int, options: GPROptions) -> None:
        self.task = task
        self.map_function: Callable[..., Any] = map
        self._margin = margin
        self._options = options
        self._search = PoseSearch(task, options.search)
        self._planner = TrainingPlanner(task, self._search, margin, options)
        self._windows = GapWindows(
            task, self._search, options.gap_windows, options.training.database.rate
        )

    # Their modules, which most fills do not need, take 0.02 s to import.
    @cached_property
    def _dropouts(self) -> DropoutPredictor:
        from priorfill.methods.gpr.dropout.fill_dropouts import DropoutPredictor

        return DropoutPredictor(self.task, self._options.dropout)

    @cached_property
    def _blackouts(self) -> BlackoutPredictor:
        from priorfill.methods.gpr.blackout.fill_blackouts import BlackoutPredictor

        of_subjects, over_time = self._options.correlation, self._options.interpolation
        return BlackoutPredictor(
            self.task, self._search, self._options.blackout, of_subjects, over_time
        )

    def predict_batch(
        self, batch: SegmentBatch, completed: NDArray[np.float64] | None
    ) -> list[list[SegmentPrediction]]:
        """Predict the segments of a batch by one regression, or else each by itself.

        Parameters
        ----------
        batch : SegmentBatch
            What to predict.
        completed : ndarray [shape=(frames, markers, 3), mm] or None
            The clip filled by the first pass, to complete training poses in the second one.

        Returns
        -------
        list of list of SegmentPrediction
            For each segment, as of `predict`.
        """
        if len(batch.segments) > 1 and batch.has_enough_visible and self.task.learn_from_clip:
            self.task.checkpoint()
            plan = self._planner.plan(batch, completed)
            if plan is not None:
                return [[part] for part in self._from_own_frames(batch, plan)]
        return [self.predict(segment, completed) for segment in batch.segments]

    def predict(
        self, segment: GapSegment, completed: NDArray[np.float64] | None
    ) -> list[SegmentPrediction]:
        """Predict a segment from its visible markers.

        Parameters
        ----------
        segment : GapSegment
            What to predict.
        completed : ndarray [shape=(frames, markers, 3), mm] or None
            The clip filled by the first pass, to complete training poses in the second one.

        Returns
        -------
        list of SegmentPrediction
            For the segment, or, where its markers are never visible together, for each marker
            that can be predicted; empty where none can.
        """
        self.task.checkpoint()
        if not segment.has_enough_visible:
            return []
        if self.task.learn_from_clip:
            batch = SegmentBatch((segment,))
            plan = self._planner.plan(batch, completed)
            if plan is not None:
                return self._from_own_frames(batch, plan)
            seconds = (segment.stop - segment.start) / self.task.rate
            if seconds <= self._options.short_gap_seconds:
                interpolated = self.interpolate(segment, self.task.positions)
                if len(interpolated) == len(segment.markers):
                    return interpolated
        prediction = self._from_donors(segment)
        if prediction is not None:
            return [prediction]
        if len(segment.markers) == 1:
            return []
        return [
            part
            for marker in segment.markers
            for part in self.predict(replace(segment, markers=marker[None]), completed)
        ]

    def interpolate(
        self, segment: GapSegment, completed: NDArray[np.float64]
    ) -> list[SegmentPrediction]:
        """Interpolate a segment over time, marker by marker; parameters as of `predict`."""
        start, stop = segment.start, segment.stop
        predictions = []
        for marker in segment.markers:
            found = interpolate_gap(
                completed[:, marker], start, stop, self.task.rate, self._options.interpolation
            )
            if found is None:
                continue
            predictions.append(SegmentPrediction.over_time(segment, marker, *found, self.task))
        return predictions

    def interpolate_remaining(
        self, segment: GapSegment, positions: NDArray[np.float64]
    ) -> list[SegmentPrediction]:
        """Interpolate markers that nothing else predicts between single samples on both sides."""
        predictions = []
        for marker in segment.markers:
            known = np.flatnonzero(~np.isnan(positions[:, marker, 0]))
            if not len(known) or not known[0] < segment.start < segment.stop <= known[-1]:
                continue
            found = interpolate_marker(
                positions[:, marker],
                slice(segment.start, segment.stop),
                self.task.rate,
                self.task.speed,
                self._options.interpolation,
            )
            if found is not None:
                predictions.append(SegmentPrediction.over_time(segment, marker, *found, self.task))
        return predictions

    def predict_blackout(
        self, segments: Sequence[GapSegment], completed: NDArray[np.float64]
    ) -> list[SegmentPrediction]:
        """Predict the segments of a blackout together; see `BlackoutPredictor.predict`."""
        self.task.checkpoint()
        return [self._kept_rigid(part) for part in self._blackouts.predict(segments, completed)]

    def _kept_rigid(self, found: SegmentPrediction) -> SegmentPrediction:
        """Return the prediction of a blackout with nearly constant distances kept."""
        inside = np.ix_(found.segment.markers, found.segment.markers)
        positions = hold_rigid_pairs(
            found.positions,
            found.expected_rms,
            self.task.geometry.distance[inside],
            self.task.geometry.spread[inside],
            self._options.rigid_pairs,
        )
        return replace(found, positions=positions)

    def _from_own_frames(self, batch: SegmentBatch, plan: TrainingPlan) -> list[SegmentPrediction]:
        """Predict a batch by regression on the clip's own frames, and the database's if planned."""
        found = regress(
            plan.problems,
            plan.models,
            self._options.segments.block_seconds(batch, self.task.rate),
            plan.inside,
            self._map_with_checkpoints,
            self._options.ensemble,
        )
        source = "the clip's own frames" + self.task.and_sources(plan.takes, "the database's")
        predictions = []
        for segment, queries in zip(batch.segments, plan.queries, strict=True):
            nodes = plan.query_frames[queries]
            part = interpolate_nodes(found.subset(queries), nodes)
            first, last = int(nodes[0]), int(nodes[-1])
            frames = slice(first, last + 1)
            part = self._fused(segment, part, frames)
            if plan.takes:
                part = self._with_windows(segment, part, plan.visible, first)
            predictions.append(
                SegmentPrediction(
                    segment,
                    first,
                    self._constrained(segment, part, plan.visible, frames),
                    part.expected_rms,
                    complete=plan.complete,
                    source=source,
                    source_clips=(self.task.name, *plan.takes),
                    from_own_frames=True,
                    training_poses=plan.training_poses,
                    bound_factor=part.bound_factor,
                    relative_error=part.relative_error,
                )
            )
        return predictions

    def _map_with_checkpoints(
        self, work: Callable[..., Any], *arguments: Iterable[Any]
    ) -> Iterable[Any]:
        """Call `map_function` with a function that can be stopped before each call."""

        def checked(*one: Any) -> Any:
            self.task.checkpoint()
            return work(*one)

        found: Iterable[Any] = self.map_function(checked, *arguments)
        return found

    def _fused(self, segment: GapSegment, found: Regression, frames: slice) -> Regression:
        """Return a prediction with its positions fused with its velocities, if it has any."""
        if found.velocity is None:
            return found
        positions = fuse_velocity(
            found.positions,
            found.velocity,
            self.task.positions[frames, segment.markers],
            self.task.rate,
            self._options.velocity_fusion,
        )
        return replace(found, positions=positions)

    def _with_windows(
        self, segment: GapSegment, found: Regression, visible: NDArray[np.intp], first: int
    ) -> Regression:
        """Combine a prediction, from a first frame on, with that of windows of the database."""
        self.task.checkpoint()
        windows = self._windows.predict(segment, visible)
        if windows is None:
            return found
        power = self._options.gap_windows.weight_power
        return combined(found, windows, segment.start - first, power)[0]

    def _constrained(
        self, segment: GapSegment, found: Regression, visible: NDArray[np.intp], frames: slice
    ) -> NDArray[np.float64]:
        """Return positions with the lengths of body segments kept."""
        markers, measured = segment.markers, self.task.positions[frames]
        positions = found.positions
        geometry, options = self.task.geometry, self._options.segment_lengths
        edges = choose_length_edges(geometry.distance, geometry.spread, markers, visible, options)
        anchors, edges = edges.anchored(len(markers))
        anchored = measured[:, visible[anchors]]
        return hold_lengths(positions, found.expected_rms, anchored, edges, options)

    def _from_donors(self, segment: GapSegment) -> SegmentPrediction | None:
        """Predict from other recordings, other subjects and the mirror image, if any."""
        visible = self._dropouts.nearest_visible(segment.markers, segment.visible)
        frames = segment.with_margin(self.task.valid, visible, self._margin)
        found = self._dropouts.predict(segment.markers, visible, frames)
        if found is None:
            return None
        return SegmentPrediction(
            segment,
            int(frames[0]),
            found.positions,
            found.expected_rms,
            complete=True,
            source=found.source,
            source_clips=found.source_clips,
            training_poses=found.training_poses,
        )
