"""Join where markers are predicted to be with how fast they are predicted to move.

A foot that stands is known to stand, wherever it is; an arm that swings is known to swing. What
a prediction of positions gets wrong changes within some tenths of a second, so its differences
over time tell less of how a marker moves than velocities that are predicted directly. Both are
joined, and with what is measured beside the gap, by the least squares

    sum_t |x[t] - p[t]|² / s²  +  sum_t |(x[t+1] - x[t]) / dt - u[t]|² / w[t]²

p is what is predicted of positions, with error s. u is the mean of the velocity that is predicted
and of the derivative of p, weighted by their errors, and w the error of this mean. The error of the
derivative is d = s / `CHANGE`; for a velocity that is expected to err by r it is
r (1 + (r / d / `BEARABLE`)²)^½. Measured samples are held fast. Errors of all kinds are taken to
change alike, so that nothing but their ratio counts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from priorfill.gp.velocities import (
    Motion,
)

__all__ = ["fuse_velocity"]

CHANGE = 0.2
"""s. How long an error of predicted positions takes to change: its size / the size of its
derivative. In gaps of limbs 0.08 to 0.27 s; 0.1 to 0.4 s fill alike."""

BEARABLE = 2.0
"""Velocities that err by so many times the error of the derivative count half: they err for longer
than positions do. Without it, what is known to a millimetre gets worse by a few parts in a hundred,
some of it by a third."""


HELD = 0.01
"""mm. Error that measured samples are held with."""

LEAST_ERROR = 1e-3
"""mm, and mm/s over `CHANGE`. Nothing is predicted better: in a clip that stands still all is."""


def fuse_velocity(
    positions: NDArray[np.float64],
    motion: Motion,
    measured: NDArray[np.float64],
    rate: float,
) -> NDArray[np.float64]:
    """Join predicted positions with predicted velocities and measured samples.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Predicted, of frames that follow each other.
    motion : Motion
        Of these.
    measured : ndarray [shape=(frames, markers, 3), mm]
        What is known of them; NaN where nothing is.
    rate : float
        Hz.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
    """
    frames, markers = positions.shape[:2]
    if frames < 2:
        return positions
    error = np.maximum(motion.error, LEAST_ERROR)
    square = np.maximum(motion.expected_rms, LEAST_ERROR / CHANGE) ** 2
    derived = (error / CHANGE) ** -2.0
    told = 1.0 / (square * (1.0 + square * derived / BEARABLE**2))
    derivative = np.gradient(positions, axis=0) * rate
    sure = told + derived
    velocity = (told[..., None] * motion.velocity + derived[:, None] * derivative) / sure[..., None]
    step = 0.5 * (velocity[1:] + velocity[:-1]) / rate
    stiffness = 0.5 * (sure[1:] + sure[:-1]) * rate**2

    known = ~np.isnan(measured[..., 0])
    pull = np.where(known, HELD, error) ** -2.0
    bands = np.zeros((2, markers, frames))
    bands[1] = pull.T
    bands[1, :, 1:] += stiffness.T
    bands[1, :, :-1] += stiffness.T
    bands[
        0, :, 1:
    ] = -stiffness.T  # nothing between one marker's last frame and the next one's first
    side = pull[..., None] * np.where(known[..., None], measured, positions)
    side[1:] += stiffness[..., None] * step
    side[:-1] -= stiffness[..., None] * step
    solved = solveh_banded(bands.reshape(2, -1), np.swapaxes(side, 0, 1).reshape(-1, 3))
    joined: NDArray[np.float64] = np.swapaxes(solved.reshape(markers, frames, 3), 0, 1)
    return joined
