"""Regression problems of the clip's own frames, its mirror image and lag features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.mirror import reflected
from priorfill.geometry.poses import evenly_spaced
from priorfill.gp.problem import GPModel, PoseSamples, RegressionProblem
from priorfill.methods.gpr.ensembles import lags_of
from priorfill.methods.gpr.gap_segments import MIN_VISIBLE, SegmentBatch
from priorfill.methods.gpr.spline_nodes import SplineNodeOptions, spline_nodes
from priorfill.methods.gpr.training.lagged_poses import complete_lagged
from priorfill.methods.gpr.training.options import TrainingOptions
from priorfill.methods.gpr.training.subject_correlation import SubjectCorrelationOptions
from priorfill.methods.task import MIRROR_IMAGE, THIS_CLIP, Task

__all__ = ["OwnClipProblem", "OwnClipProblems"]


@dataclass(frozen=True, eq=False)
class OwnClipProblem:
    """A regression problem of the clip's own frames.

    Attributes
    ----------
    problem : RegressionProblem
        Training poses of the clip, and of its mirror image if it has been added.
    markers : ndarray of int
        The missing markers.
    query_frames : ndarray of int
        Frames of the queries: the spline nodes (`priorfill.methods.gpr.spline_nodes`).
    queries : tuple of slice
        Those of each segment of the batch.
    inside : ndarray of bool [shape=(queries,)]
        Which of them are in a segment, evenly spaced.
    visible : ndarray of int
        The visible markers, in the order of the problem: the nearest first.
    spaced_poses : int
        How many evenly spaced poses are wanted; fewer where the clip has fewer.
    adjacent : ndarray of int
        Training frames adjacent to segments, which are always kept.
    source : ndarray [shape=(frames, markers, 3), mm]
        The clip, in the second pass completed by the first one.
    complete : bool
        Whether a second pass has no more training poses.
    """

    problem: RegressionProblem
    markers: NDArray[np.intp]
    query_frames: NDArray[np.intp]
    queries: tuple[slice, ...]
    inside: NDArray[np.bool_]
    visible: NDArray[np.intp]
    spaced_poses: int
    adjacent: NDArray[np.intp]
    source: NDArray[np.float64]
    complete: bool


@dataclass(frozen=True, eq=False)
class _UsableFrames:
    """Visible markers, and the frames that show them with the missing ones."""

    visible: NDArray[np.intp]
    frames: NDArray[np.intp]
    showing: int  # number of frames that show the missing markers
    complete: bool


class OwnClipProblems:
    """Makes the regression problems of the clip of a task.

    Parameters
    ----------
    task : Task
        The clip.
    margin : int
        Frames around a segment to be predicted too, where the visible markers allow.
    options : TrainingOptions
        Number of training poses.
    nodes : SplineNodeOptions
        Frames to predict.
    correlation : SubjectCorrelationOptions
        Correlation with the mirror image.

    Attributes
    ----------
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    distance, spread : ndarray [shape=(markers, markers), mm]
        See `priorfill.markers.clip_geometry.ClipGeometry`.
    """

    def __init__(
        self,
        task: Task,
        margin: int,
        options: TrainingOptions,
        nodes: SplineNodeOptions,
        correlation: SubjectCorrelationOptions,
    ) -> None:
        self.valid = task.valid
        self.distance, self.spread = task.geometry.distance, task.geometry.spread
        self._task = task
        self._margin = margin
        self._options = options
        self._nodes = nodes
        self._correlation = correlation

    def problem_for(
        self, batch: SegmentBatch, completed: NDArray[np.float64] | None
    ) -> OwnClipProblem | None:
        """Make a problem of the frames that show the markers of a batch.

        Parameters
        ----------
        batch : SegmentBatch
            What to predict.
        completed : ndarray [shape=(frames, markers, 3), mm] or None
            The clip filled by the first pass, to complete training poses in the second one.

        Returns
        -------
        OwnClipProblem or None
            None where there are too few such frames.
        """
        options, rate, markers = self._options, self._task.rate, batch.markers
        source = self._task.positions if completed is None else completed
        usable = self._usable_frames(batch, source)
        if usable is None:
            return None
        visible = usable.visible
        margin = int(options.adjacent_seconds * rate) + 1
        near = np.zeros(len(self.valid), dtype=bool)
        for segment in batch.segments:
            near[max(segment.start - margin, 0) : segment.stop + margin] = True
        adjacent = usable.frames[near[usable.frames]]
        count = options.spaced_poses(batch, len(usable.frames) / rate)
        chosen = usable.frames[evenly_spaced(len(usable.frames), count)]
        frames = np.union1d(adjacent, chosen)
        query_frames, queries, inside = self._queries(batch, visible)
        problem = RegressionProblem(
            train=PoseSamples(
                source[np.ix_(frames, visible)],
                self._task.positions[np.ix_(frames, markers)],
                frames / rate,
                np.full(len(frames), THIS_CLIP),
            ),
            query=PoseSamples(
                self._task.positions[np.ix_(query_frames, visible)],
                np.empty((len(query_frames), 0, 3)),
                query_frames / rate,
                np.full(len(query_frames), THIS_CLIP),
            ),
            distance=self.distance[np.ix_(markers, visible)].min(axis=0),
            spread=self.spread[np.ix_(markers, visible)].min(axis=0),
        )
        complete = usable.complete
        complete = complete and len(usable.frames) >= options.second_pass_share * usable.showing
        return OwnClipProblem(
            problem,
            markers,
            query_frames,
            queries,
            inside,
            visible,
            count,
            adjacent,
            source,
            complete,
        )

    def _queries(
        self, batch: SegmentBatch, visible: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], tuple[slice, ...], NDArray[np.bool_]]:
        """Choose the frames to predict: all, those of each segment, and which are in it."""
        nodes = [
            spline_nodes(
                segment.with_margin(self.valid, visible, self._margin),
                segment,
                self._task.rate,
                self._nodes,
            )
            for segment in batch.segments
        ]
        stops = list(accumulate(len(frames) for frames, _ in nodes))
        queries = tuple(slice(*edges) for edges in pairwise([0, *stops]))
        frames, inside = (np.concatenate(parts) for parts in zip(*nodes, strict=True))
        return frames, queries, inside

    def _usable_frames(
        self, batch: SegmentBatch, source: NDArray[np.float64]
    ) -> _UsableFrames | None:
        """Choose the visible markers, dropping distant ones that would leave too few frames."""
        options = self._options
        nearest = self.distance[batch.markers].min(axis=0)
        visible = batch.visible[np.isfinite(nearest[batch.visible])]
        visible = visible[np.argsort(nearest[visible], kind="stable")]
        shown = np.logical_and.reduce(self.valid[:, batch.markers], axis=1)
        showing = np.flatnonzero(shown)
        # Row n: whether a frame shows the nearest n + 1 markers together. One marker at a time,
        # because the masks of a long clip are large.
        together = np.empty((len(visible), len(showing)), dtype=bool)
        for place, marker in enumerate(visible):
            known = self.valid[showing, marker]
            if source is not self._task.positions:
                known = ~np.isnan(source[showing, marker, 0])
            together[place] = known & together[place - 1] if place else known
        count = together.sum(axis=1)
        wanted = min(options.enough_poses, options.enough_share * len(showing))
        enough = np.flatnonzero(count >= wanted)
        kept = int(enough[-1]) + 1 if len(enough) else 0
        kept = max(kept, min(options.min_kept_markers, len(visible)))
        if kept < MIN_VISIBLE:
            return None
        frames = showing[together[kept - 1]]
        if len(frames) < options.min_poses:
            return None
        return _UsableFrames(visible[:kept], frames, len(showing), kept == len(batch.visible))

    def with_mirror_image(self, own: OwnClipProblem) -> OwnClipProblem:
        """Add poses of the clip's mirror image to a problem, unless too few are complete."""
        options, rate = self._options, self._task.rate
        problem, markers = own.problem, own.markers
        shown = np.logical_or.reduce(self.valid, axis=0)
        # the mirror image lacks markers without a contralateral one
        contralateral = self._task.contralateral
        kept = np.flatnonzero((contralateral[own.visible] >= 0) & shown[contralateral[own.visible]])
        visible = own.visible[kept]
        needed = contralateral[np.concatenate([visible, markers])]
        if len(kept) < MIN_VISIBLE or (needed < 0).any():
            return own
        usable = np.flatnonzero(np.logical_and.reduce(self.valid[:, needed], axis=1))
        if len(usable) < options.min_poses:
            return own
        mirrored_poses = round(own.spaced_poses * options.mirror_poses / options.max_poses)
        frames = usable[evenly_spaced(len(usable), mirrored_poses)]
        train = problem.train
        adjacent = np.flatnonzero(np.isin(train.time, own.adjacent / rate))
        spaced = evenly_spaced(len(train.time), own.spaced_poses - mirrored_poses)
        rows = np.union1d(adjacent, spaced)
        counts = [len(rows), len(frames)]
        mixed = PoseSamples(
            np.concatenate([train.visible[np.ix_(rows, kept)], self._image(frames, visible)]),
            np.concatenate([train.missing[rows], self._image(frames, markers)]),
            np.concatenate([train.time[rows], frames / rate]),
            np.repeat([THIS_CLIP, MIRROR_IMAGE], counts),
            np.repeat([1.0, self._correlation.mirror_image], counts),
        )
        query = replace(problem.query, visible=problem.query.visible[:, kept])
        mixed_problem = RegressionProblem(
            mixed, query, problem.distance[kept], problem.spread[kept]
        )
        return replace(own, problem=mixed_problem, visible=visible)

    def with_velocities(self, own: OwnClipProblem) -> OwnClipProblem:
        """Add the velocities of the missing markers to the training poses."""
        train = own.problem.train
        frames = np.round(train.time * self._task.rate).astype(np.intp)
        image = (train.recording == MIRROR_IMAGE)[:, None, None]
        step = max(1, round(self._options.velocity_seconds * self._task.rate))
        before, after = (
            self.positions_at(self._task.positions, frames + lag, own.markers, image)
            for lag in (-step, step)
        )
        before, after = complete_lagged(train.missing, before, after)
        velocity = (after - before) * (0.5 * self._task.rate / step)
        train = replace(train, velocity=velocity)
        return replace(own, problem=replace(own.problem, train=train))

    def with_lag_features(self, own: OwnClipProblem, models: Sequence[GPModel]) -> OwnClipProblem:
        """Add the lagged positions that models need to the training poses, and their source."""
        source = _ClipLagSource(self, own.source, own.visible, self._task.rate, lags_of(models))
        problem = replace(own.problem, train=source(own.problem.train), lag_source=source)
        return replace(own, problem=problem)

    def positions_at(
        self,
        source: NDArray[np.float64],
        frames: NDArray[np.intp],
        markers: NDArray[np.intp],
        image: NDArray[np.bool_],
    ) -> NDArray[np.float64]:
        """Return positions in frames of a clip or of its mirror image; NaN outside of it.

        Parameters
        ----------
        source : ndarray [shape=(frames, markers, 3), mm]
            The clip.
        frames, markers : ndarray of int [shapes=(poses,), (chosen markers,)]
            Which positions.
        image : ndarray of bool [shape=(poses, 1, 1)]
            Which poses are of the mirror image.
        """
        inside = np.clip(frames, 0, len(source) - 1)
        positions = source[np.ix_(inside, markers)]
        rows = np.flatnonzero(image)
        if len(rows):
            positions[rows] = self._image(inside[rows], markers)
        positions[(frames < 0) | (frames >= len(source))] = np.nan
        return positions

    def _image(self, frames: NDArray[np.intp], markers: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return markers of the mirror image in some frames; NaN where it lacks them."""
        contralateral = self._task.contralateral[markers]
        image = reflected(self._task.positions[np.ix_(frames, contralateral)])
        image[:, contralateral < 0] = np.nan
        return image


@dataclass(frozen=True, eq=False)
class _ClipLagSource:
    """Lagged positions of poses of the clip or of its mirror image."""

    problems: OwnClipProblems
    source: NDArray[np.float64]  # (frames, markers, 3)
    visible: NDArray[np.intp]
    rate: float
    lags: Sequence[float]  # s

    def __call__(self, poses: PoseSamples) -> PoseSamples:
        frames = np.round(poses.time * self.rate).astype(np.intp)
        image = (poses.recording == MIRROR_IMAGE)[:, None, None]

        def at(seconds: float) -> NDArray[np.float64]:
            moved = frames + round(seconds * self.rate)
            return self.problems.positions_at(self.source, moved, self.visible, image)

        lagged = {lag: complete_lagged(poses.visible, at(-lag), at(lag)) for lag in self.lags}
        return replace(poses, lagged=lagged)

    def restricted_to(self, visible: NDArray[np.intp]) -> _ClipLagSource:
        return replace(self, visible=self.visible[visible])
