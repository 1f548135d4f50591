"""Targets of the energy from predictions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

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

    def targets_at(level: Resolution, window: NDArray[np.intp]) -> Prior:
        targets = Prior.empty(len(window), len(group.markers))
        for prediction in predictions:
            _set_targets(targets, prediction, group, window, level, options)
        return targets

    return targets_at


def _set_targets(
    targets: Prior,
    prediction: SegmentPrediction,
    group: GapGroup,
    window: NDArray[np.intp],
    level: Resolution,
    options: JoiningOptions,
) -> None:
    """Write a prediction, and its differences over the steps of a resolution, into targets."""
    segment, step = prediction.segment, level.step
    frames = window * step
    columns = np.searchsorted(group.markers, segment.markers)
    expected_rms = prediction.expected_rms
    largest = expected_rms.max(axis=0)
    least = np.maximum(options.min_relative_error * largest, MIN_ERROR)
    weight = 1.0 / np.maximum(expected_rms, least) ** 2

    rows = np.flatnonzero((frames >= segment.start) & (frames < segment.stop))
    at = frames[rows] - prediction.first
    targets.pose[np.ix_(rows, columns)] = prediction.positions[at]
    targets.pose_weight[np.ix_(rows, columns)] = weight[at]

    # differences one step outside the segment involve its samples: they join it to the measured
    # ones
    rows = np.flatnonzero(
        (frames >= max(segment.start - step, prediction.first + step))
        & (frames < min(segment.stop + step, prediction.last - step))
    )
    at = frames[rows] - prediction.first
    before, here, after = (prediction.positions[at + d] for d in (-step, 0, step))
    where = np.ix_(rows, columns)
    targets.velocity[where] = 0.5 * (after - before)
    targets.acceleration[where] = after - 2.0 * here + before
    seconds = options.seconds * power(np.maximum(largest, 1.0), options.growth)
    stiffness = (np.minimum(seconds, options.max_seconds) * level.rate) ** 2
    targets.velocity_weight[where] = 2.0 * stiffness * weight[at]
    targets.acceleration_weight[where] = stiffness**2 * weight[at]
