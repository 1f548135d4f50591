"""Predict the gap segments of a task that are blackouts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gpr.blackout.database_windows import similar_windows
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.predict_blackout import predict_blackout
from priorfill.methods.gpr.blackout.windows import MirrorImage, WindowSources
from priorfill.methods.gpr.gap_segments import GapSegment
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.prediction import OVER_TIME, SegmentPrediction
from priorfill.methods.gpr.training.subject_correlation import (
    SubjectCorrelationOptions,
    take_correlations,
)
from priorfill.methods.task import Task
from priorfill.signal.gp_interpolation import InterpolationOptions
from priorfill.signal.lone_samples import interpolate_marker

__all__ = ["BlackoutPredictor"]


class BlackoutPredictor:
    """Predicts the blackouts of one task.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    search : PoseSearch
        Of these takes.
    options : BlackoutOptions
        Windows and models.
    correlations : SubjectCorrelationOptions
        Of other subjects and of the mirror image with the clip's subject.
    interpolation : InterpolationOptions
        Of single markers over time.

    See Also
    --------
    priorfill.methods.gpr.dropout.fill_dropouts.DropoutPredictor : Where other markers are visible.
    """

    def __init__(
        self,
        task: Task,
        search: PoseSearch,
        options: BlackoutOptions,
        correlations: SubjectCorrelationOptions,
        interpolation: InterpolationOptions,
    ) -> None:
        self.task = task
        self._image = MirrorImage(task.contralateral, correlations.mirror_image)
        self._take_correlations = take_correlations(task.takes, search.subjects, correlations)
        self._search = search
        self._options = options
        self._interpolation = interpolation

    def predict(
        self, segments: Sequence[GapSegment], completed: NDArray[np.float64]
    ) -> list[SegmentPrediction]:
        """Predict the gap segments of one blackout together.

        Parameters
        ----------
        segments : sequence of GapSegment
            Segments with overlapping frames, in which fewer than three markers are visible.
        completed : ndarray [shape=(frames, markers, 3), mm]
            The clip, filled except in blackouts.

        Returns
        -------
        list of SegmentPrediction
            Each for some markers of a segment; none for markers that are hardly visible on
            both sides.
        """
        start, stop = min(s.start for s in segments), max(s.stop for s in segments)
        clip = completed
        if any(s.start > start or s.stop < stop for s in segments):
            clip = completed.copy()
            clip[start:stop] = np.nan
        others, takes = similar_windows(
            self.task, self._search, self._options, self._take_correlations, clip, start, stop
        )
        wanted = np.unique(np.concatenate([s.markers for s in segments]))
        positions, expected_rms, windows = self._predict_markers(
            WindowSources(clip, others), start, stop, wanted
        )
        source, clips = OVER_TIME, [self.task.name]
        if windows:
            source = "similar movements of the clip"
            source += self.task.and_sources(takes, "the database")
            clips += takes
        predictions: list[SegmentPrediction] = []
        for segment in segments:
            inside = slice(segment.start - start, segment.stop - start)
            known = ~np.isnan(positions[inside, segment.markers, 0]).any(axis=0)
            markers = segment.markers[known]
            offset = _edge_offsets(positions[:, markers], completed, segment, start, markers)
            found = SegmentPrediction(
                replace(segment, markers=markers),
                segment.start,
                positions[inside, markers] + offset,
                expected_rms[inside, markers],
                complete=True,
                source=source,
                source_clips=tuple(clips),
                training_poses=windows,
            )
            predictions += self._or_over_time(segment, found, completed, stop - start)
        return predictions

    def _or_over_time(
        self,
        segment: GapSegment,
        found: SegmentPrediction,
        completed: NDArray[np.float64],
        frames: int,
    ) -> list[SegmentPrediction]:
        """Interpolate markers of a segment over time where nothing better has been found.

        Parameters
        ----------
        segment : GapSegment
            Of a blackout.
        found : SegmentPrediction
            The prediction for some of its markers.
        completed : ndarray [shape=(frames, markers, 3), mm]
            The clip, filled except in blackouts.
        frames : int
            Length of the blackout.
        """
        wanted = segment.markers
        if segment.stop - segment.start >= self._options.max_gap_share * frames:
            wanted = np.setdiff1d(wanted, found.segment.markers)
        over_time = []
        for marker in wanted:
            interpolated = interpolate_marker(
                completed[:, marker],
                slice(segment.start, segment.stop),
                self.task.rate,
                self.task.speed,
                self._interpolation,
            )
            if interpolated is None:
                continue
            positions, expected_rms = interpolated
            column = np.flatnonzero(found.segment.markers == marker)
            if (
                (found.expected_rms[:, column] ** 2).mean(axis=0) <= (expected_rms**2).mean()
            ).any():
                continue
            found = found.for_markers(np.flatnonzero(found.segment.markers != marker))
            over_time.append(
                SegmentPrediction.over_time(segment, marker, positions, expected_rms, self.task)
            )
        return [found, *over_time] if len(found.segment.markers) else over_time

    def _predict_markers(
        self, sources: WindowSources, start: int, stop: int, wanted: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
        """Predict all markers of a blackout.

        Those visible on both sides come first, then those visible on one side only.

        Returns
        -------
        positions : ndarray [shape=(frames, markers, 3), mm]
            NaN for markers that are visible on neither side.
        expected_rms : ndarray [shape=(frames, markers), mm]
        windows : int
            Greatest number of windows used.
        """
        shape = (stop - start, len(self.task.labels))
        positions, expected_rms = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
        windows = 0
        while len(wanted):
            found = predict_blackout(
                sources,
                start,
                stop,
                self.task.rate,
                self.task.root_among,
                self._image,
                wanted,
                self._options,
            )
            if found is None:
                break
            known = wanted[~np.isnan(found.positions[:, wanted, 0]).any(axis=0)]
            if not len(known):
                break
            positions[:, known] = found.positions[:, known]
            expected_rms[:, known] = found.expected_rms[:, known]
            windows = max(windows, found.windows)
            wanted = np.setdiff1d(wanted, known)
        return positions, expected_rms, windows


def _edge_offsets(
    positions: NDArray[np.float64],
    completed: NDArray[np.float64],
    segment: GapSegment,
    start: int,
    markers: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Return offsets that join a segment shorter than its blackout to the samples at its own edges.

    Parameters
    ----------
    positions : ndarray [shape=(frames of the blackout, markers, 3), mm]
        Predicted.
    completed : ndarray [shape=(frames, all markers, 3), mm]
        The clip, filled except in blackouts.
    segment : GapSegment
        The segment.
    start : int
        First frame of the blackout.
    markers : ndarray of int
        Markers of the segment that are predicted.

    Returns
    -------
    ndarray [shape=(frames of the segment, markers, 3), mm]
        The differences at its two edges, interpolated linearly; 0 at an edge of the blackout.
    """
    frames = np.arange(segment.start, segment.stop)
    differences = []
    for frame in (segment.start - 1, segment.stop):
        difference = np.full((len(markers), 3), np.nan)
        if start <= frame < start + len(positions):
            difference = completed[frame, markers] - positions[frame - start]
        differences.append(np.where(np.isnan(difference), 0.0, difference))
    share = (frames - (segment.start - 1)) / (len(frames) + 1)
    before, after = differences
    offset: NDArray[np.float64] = before + share[:, None, None] * (after - before)
    return offset
