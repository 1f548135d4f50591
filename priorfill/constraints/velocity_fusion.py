"""Fuse predicted positions with predicted velocities and with the samples measured nearby.

Whether a foot stands or an arm swings is predictable even where its position is uncertain. The
error of a predicted position changes within tenths of a second, so differences of predicted
positions describe the movement of a marker less well than velocities predicted directly. Positions,
velocities and measured samples are combined by the least squares

    sum_t |x[t] - p[t]|² / s²  +  sum_t |(x[t+1] - x[t]) / dt - u[t]|² / w[t]²

p is the predicted position, with expected error s. u is the mean of the predicted velocity and of
the derivative of p, weighted by their inverse variances, and w is the standard deviation of that
mean. The derivative has the error d = s / τ, where τ is the field ``error_time`` of
`VelocityFusionOptions`, and counts with the error d (1 + (s / a)²)^½, where a is the field
``slow_error``. A velocity with expected error r counts with the error r (1 + (r / (d b))²)^½, where
b is the field ``half_weight_ratio``. Measured samples enter with a
fixed, small error. Only the ratios of the errors matter, so they need not be calibrated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.velocities import VelocityPrediction
from priorfill.runtime.lapack import solve_positive_banded
from priorfill.runtime.option_checks import check_at_least

__all__ = ["VelocityFusionOptions", "fuse_velocity"]

MIN_ERROR = 1e-3
"""mm, and mm/s over ``error_time``. Least expected error: in a clip without any movement every
prediction is exact."""


@dataclass(frozen=True)
class VelocityFusionOptions:
    """How velocities are weighted against positions.

    Attributes
    ----------
    error_time : float
        s. Time in which the error of a predicted position changes: the rms error divided by the
        rms error of the derivative. It was 0.08 to 0.27 s in gaps of limbs; values from 0.1 to
        0.4 s fill equally well.
    half_weight_ratio : float
        A velocity whose error exceeds that of the derivative by this factor gets half its weight,
        because errors of velocities persist for longer than those of positions. Without this,
        predictions accurate to a millimetre degrade by a few per cent, some by a third.
    slow_error : float
        mm. Error of positions above which their derivative gets less than half its weight: small
        errors are nearly constant offsets, large ones change with the movement. Errors of limbs
        are 0.2 to 0.8 % smaller than with full weight; values from 30 to 50 mm differ by 0.1 %.
    measured_std : float
        mm. Error assigned to measured samples: nearly exact.
    """

    error_time: float = 0.2
    half_weight_ratio: float = 1.5
    slow_error: float = 50.0
    measured_std: float = 0.01

    def __post_init__(self) -> None:
        check_at_least(self, 1e-4, "error_time")
        check_at_least(self, 1e-3, "half_weight_ratio", "slow_error")
        check_at_least(self, 1e-6, "measured_std")


def fuse_velocity(
    positions: NDArray[np.float64],
    prediction: VelocityPrediction,
    measured: NDArray[np.float64],
    rate: float,
    options: VelocityFusionOptions = VelocityFusionOptions(),
) -> NDArray[np.float64]:
    """Combine predicted positions with predicted velocities and measured samples.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Predicted positions in consecutive frames.
    prediction : VelocityPrediction
        Predicted velocities in these frames.
    measured : ndarray [shape=(frames, markers, 3), mm]
        Measured samples; NaN where missing.
    rate : float
        Hz.
    options : VelocityFusionOptions

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]

    See Also
    --------
    priorfill.gp.velocities : Predicts velocities and their errors.
    """
    frames, markers = positions.shape[:2]
    if frames < 2:
        return positions
    error = np.maximum(prediction.position_rms, MIN_ERROR)
    velocity, precision = _fused_velocity(positions, prediction, error, rate, options)
    # the constraint of two consecutive frames: the mean velocity and precision between them
    step = 0.5 * (velocity[1:] + velocity[:-1]) / rate
    stiffness = 0.5 * (precision[1:] + precision[:-1]) * rate**2

    known = ~np.isnan(measured[..., 0])
    weight = 1.0 / np.where(known, options.measured_std, error) ** 2
    # upper banded form of one tridiagonal system per marker, the systems one after another; no
    # element links the last frame of a marker with the first frame of the next
    bands = np.zeros((2, markers, frames))
    bands[0, :, 1:] = -stiffness.T
    bands[1] = weight.T
    bands[1, :, 1:] += stiffness.T
    bands[1, :, :-1] += stiffness.T
    rhs = weight[..., None] * np.where(known[..., None], measured, positions)
    rhs[1:] += stiffness[..., None] * step
    rhs[:-1] -= stiffness[..., None] * step
    solved = solve_positive_banded(bands.reshape(2, -1), np.swapaxes(rhs, 0, 1).reshape(-1, 3))
    fused: NDArray[np.float64] = np.swapaxes(solved.reshape(markers, frames, 3), 0, 1)
    return fused


def _fused_velocity(
    positions: NDArray[np.float64],
    prediction: VelocityPrediction,
    error: NDArray[np.float64],
    rate: float,
    options: VelocityFusionOptions,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return u (frames, markers, 3; mm/s) and 1 / w² (frames, markers; s²/mm²)."""
    variance = np.maximum(prediction.expected_rms, MIN_ERROR / options.error_time) ** 2
    derivative_precision = (options.error_time / error) ** 2
    ratio = variance * derivative_precision / options.half_weight_ratio**2
    velocity_precision = 1.0 / (variance * (1.0 + ratio))
    derivative_precision = derivative_precision / (1.0 + (error / options.slow_error) ** 2)
    derivative = np.gradient(positions, axis=0) * rate
    precision = velocity_precision + derivative_precision
    fused = (
        velocity_precision[..., None] * prediction.velocity
        + derivative_precision[:, None] * derivative
    )
    return fused / precision[..., None], precision
