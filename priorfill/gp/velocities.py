"""Predicted velocities and their expected errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms
from priorfill.runtime.elementary import exp
from priorfill.runtime.option_checks import check_at_least

__all__ = ["VelocityErrorOptions", "VelocityPrediction", "error_by_speed"]

BATCH_SIZE = 100
"""Poses compared with all held-out poses at a time: the distances take some MB."""

MIN_WEIGHT = 1e-6
"""Added to each weight: where no held-out speed is similar, all count alike."""


@dataclass(frozen=True)
class VelocityErrorOptions:
    """Bandwidth of the kernel regression of velocity errors on speed.

    Attributes
    ----------
    relative_bandwidth : float
        In units of the median speed.
    min_bandwidth : float
        mm/s.
    """

    relative_bandwidth: float = 0.3
    min_bandwidth: float = 20.0

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "relative_bandwidth")
        check_at_least(self, 1e-6, "min_bandwidth")


@dataclass(frozen=True, eq=False)
class VelocityPrediction:
    """Predicted velocities of the missing markers.

    Attributes
    ----------
    velocity : ndarray [shape=(poses, missing markers, 3), mm/s]
        Upright.
    expected_rms : ndarray [shape=(poses, missing markers), mm/s]
        Expected rms error (Euclidean).
    position_rms : ndarray [shape=(missing markers,), mm]
        Rms error of the positions of held-out poses.
    """

    velocity: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    position_rms: NDArray[np.float64]

    def subset(self, chosen: slice) -> VelocityPrediction:
        """Return the prediction of some of the poses."""
        return replace(self, velocity=self.velocity[chosen], expected_rms=self.expected_rms[chosen])


def error_by_speed(
    velocity: NDArray[np.float64],
    held_out: NDArray[np.float64],
    residuals: NDArray[np.float64],
    options: VelocityErrorOptions = VelocityErrorOptions(),
) -> NDArray[np.float64]:
    """Estimate the errors of velocities from those of held-out velocities of similar speed.

    A marker at rest is predicted far better than a moving one. The estimate is a Nadaraya-Watson
    regression of the squared error on the predicted speed.

    Parameters
    ----------
    velocity : ndarray [shape=(poses, markers, 3), mm/s]
        Predicted velocities.
    held_out, residuals : ndarray [shape=(held-out poses, markers, 3), mm/s]
        Predicted velocities of held-out poses, and the true ones minus these.
    options : VelocityErrorOptions
        Bandwidth.

    Returns
    -------
    ndarray [shape=(poses, markers), mm/s]
        Expected rms error.

    Examples
    --------
    >>> import numpy as np
    >>> held_out = np.array([[[0.0, 0.0, 0.0]], [[900.0, 0.0, 0.0]]])
    >>> residuals = np.array([[[2.0, 0.0, 0.0]], [[50.0, 0.0, 0.0]]])
    >>> error_by_speed(held_out, held_out, residuals).round()
    array([[ 2.],
           [50.]])
    """
    speed, others = norms(velocity), norms(held_out)
    square = (residuals**2).sum(axis=2)
    bandwidth = np.maximum(
        options.relative_bandwidth * np.median(others, axis=0), options.min_bandwidth
    )
    error = np.empty(speed.shape)
    for start in range(0, len(speed), BATCH_SIZE):
        batch = slice(start, start + BATCH_SIZE)
        distance = (speed[batch, None] - others) / bandwidth  # (poses, held-out poses, markers)
        weight = exp(-0.5 * distance**2) + MIN_WEIGHT
        error[batch] = np.sqrt((weight * square).sum(axis=1) / weight.sum(axis=1))
    return error
