"""Post-processing of predictions: the floor constraint, and smoothing of jitter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from priorfill.constraints.floor import FloorOptions, enforce_floor
from priorfill.methods.gpr.prediction import SegmentPrediction
from priorfill.methods.task import Task
from priorfill.signal.smoothing import SmoothingOptions, jitter_power, smooth_jitter

__all__ = ["PostProcessor"]


class PostProcessor:
    """Post-processes the predictions of one task, independently of each other.

    Parameters
    ----------
    task : Task
        The clip.
    floor : FloorOptions
        The floor constraint.
    smoothing : SmoothingOptions
        The smoothing.
    """

    def __init__(
        self,
        task: Task,
        floor: FloorOptions,
        smoothing: SmoothingOptions,
    ) -> None:
        self._task = task
        self._floor = floor
        self._smoothing = smoothing
        self._jitter: dict[int, float] = {}

    def __call__(self, prediction: SegmentPrediction) -> SegmentPrediction:
        """Enforce the floor, then smooth what jitters more than the measured samples."""
        raised = self.enforce_floor(prediction)
        measured = np.array([self._measured_jitter(int(m)) for m in prediction.segment.markers])
        positions = smooth_jitter(
            raised.positions, raised.expected_rms, measured, self._task.rate, self._smoothing
        )
        return replace(raised, positions=positions)

    def enforce_floor(self, prediction: SegmentPrediction) -> SegmentPrediction:
        """Raise markers that are predicted below the floor."""
        markers, visible = prediction.segment.markers, prediction.segment.visible
        spread = self._task.geometry.spread
        # the other visible markers are not linked to a missing one
        linked = visible[(spread[np.ix_(markers, visible)] < self._floor.max_spread).any(axis=0)]
        frames = slice(prediction.first, prediction.last)
        positions = enforce_floor(
            prediction.positions,
            prediction.expected_rms,
            self._task.positions[frames, linked],
            spread[np.ix_(markers, np.concatenate([markers, linked]))],
            self._task.geometry.floor[markers],
            self._task.rate,
            self._floor,
        )
        return replace(prediction, positions=positions)

    def _measured_jitter(self, marker: int) -> float:
        """Return the jitter of a marker's measured samples."""
        if marker not in self._jitter:
            path = self._task.positions[:, marker].astype(np.float64)
            self._jitter[marker] = jitter_power(path, self._task.rate, self._smoothing)
        return self._jitter[marker]
