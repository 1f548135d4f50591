"""Targets of the energy from predictions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.energy.targets import Prior
from priorfill.gaps import GapGroup
from priorfill.methods.gpr.options import JoiningOptions
from priorfill.methods.gpr.prediction import SegmentPrediction
from priorfill.runtime.elementary import power
from priorfill.signal.resample import Resolution

__all__ = ["targets_from"]

MIN_ERROR = 1e-6
"""mm. Least expected error in a weight: that of a marker that does not move at all may be 0."""


def targets_from(
    predictions: Sequence[SegmentPrediction], group: GapGroup, options: JoiningOptions
) -> Callable[[Resolution, NDArray[np.intp]], Prior]:
    """Return a function that gives the targets of a gap group at any resolution.

    Parameters
    ----------
    predictions : sequence of SegmentPrediction
        For the segments of the group.
    group : GapGroup
        The missing samples.
    options : JoiningOptions
        Weights of velocities and accelerations.

    Returns
    -------
    callable
        Called with a resolution and frames of it; see
        `priorfill.energy.multiresolution.solve_levels`.

    See Also
    --------
    priorfill.energy.multiresolution.solve_levels : Minimises the energy.
    """
    parts = [_Part.of(prediction, group, options) for prediction in predictions]

    def targets_at(level: Resolution, window: NDArray[np.intp]) -> Prior:
        targets = Prior.empty(len(window), len(group.markers))
        for part in parts:
            part.set_targets(targets, window * level.step, level)
        return targets

    return targets_at


@dataclass(frozen=True, eq=False)
class _Part:
    """A prediction, and what the targets of all resolutions have in common.

    Attributes
    ----------
    prediction : SegmentPrediction
        Of some markers of the group.
    columns : ndarray of int
        These markers' places among those of the group.
    weight : ndarray [shape=(predicted frames, markers), mm⁻²]
        Of the positions.
    seconds : ndarray [shape=(markers,), s]
        Over which an offset from the measured samples decays.
    """

    prediction: SegmentPrediction
    columns: NDArray[np.intp]
    weight: NDArray[np.float64]
    seconds: NDArray[np.float64]

    @classmethod
    def of(cls, prediction: SegmentPrediction, group: GapGroup, options: JoiningOptions) -> _Part:
        """Weight a prediction of some markers of a group."""
        expected_rms = prediction.expected_rms
        largest = expected_rms.max(axis=0)
        least = np.maximum(options.min_relative_error * largest, MIN_ERROR)
        seconds = options.seconds * power(np.maximum(largest, 1.0), options.growth)
        return cls(
            prediction,
            np.searchsorted(group.markers, prediction.segment.markers),
            1.0 / np.maximum(expected_rms, least) ** 2,
            np.minimum(seconds, options.max_seconds),
        )

    def set_targets(self, targets: Prior, frames: NDArray[np.intp], level: Resolution) -> None:
        """Write the prediction, and its differences over the steps of a resolution, into targets.

        Parameters
        ----------
        targets : Prior
            Of the frames of a window, changed in place.
        frames : ndarray of int
            These frames, in frames of the clip; ascending.
        level : Resolution
            The resolution.
        """
        prediction, columns, step = self.prediction, self.columns, level.step
        segment = prediction.segment
        rows = slice(*np.searchsorted(frames, (segment.start, segment.stop)))
        at = frames[rows] - prediction.first
        targets.pose[rows, columns] = prediction.positions[at]
        targets.pose_weight[rows, columns] = self.weight[at]

        # differences one step outside the segment involve its samples: they join it to the
        # measured ones
        first = max(segment.start - step, prediction.first + step)
        stop = min(segment.stop + step, prediction.last - step)
        rows = slice(*np.searchsorted(frames, (first, max(first, stop))))
        at = frames[rows] - prediction.first
        before, here, after = (prediction.positions[at + d] for d in (-step, 0, step))
        targets.velocity[rows, columns] = 0.5 * (after - before)
        targets.acceleration[rows, columns] = after - 2.0 * here + before
        stiffness = (self.seconds * level.rate) ** 2
        targets.velocity_weight[rows, columns] = 2.0 * stiffness * self.weight[at]
        targets.acceleration_weight[rows, columns] = stiffness**2 * self.weight[at]
