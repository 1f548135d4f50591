"""Predicted velocities and their expected errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms

__all__ = ["Motion", "error_by_speed"]

SPEED_WIDTH = 0.3
"""Speeds that differ by this part of the median speed are much alike."""


LEAST_WIDTH = 20.0
"""mm/s. All speeds that differ by no more are alike."""


AT_ONCE = 100
"""Poses compared with all rows at once: their distances take a MB or two, not some hundred."""


@dataclass(frozen=True, eq=False)
class Motion:
    """How missing markers are predicted to move.

    Attributes
    ----------
    velocity : ndarray [shape=(poses, missing markers, 3), mm/s]
        Upright.
    deviation : ndarray [shape=(poses, missing markers), mm/s]
        Its expected rms error.
    error : ndarray [shape=(missing markers,), mm]
        Usual rms error of their positions.
    """

    velocity: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    error: NDArray[np.float64]


def error_by_speed(
    velocity: NDArray[np.float64],
    predicted: NDArray[np.float64],
    residuals: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Tell how wrong velocities are by what others of like speed got wrong.

    What stands still is known to do so far better than what moves.

    Parameters
    ----------
    velocity : ndarray [shape=(poses, markers, 3), mm/s]
        Predicted.
    predicted, residuals : ndarray [shape=(rows, markers, 3), mm/s]
        Predicted for other poses, and what is to be added to be right.

    Returns
    -------
    ndarray [shape=(poses, markers), mm/s]
        Rms error.
    """
    speed, others = norms(velocity), norms(predicted)
    square = (residuals**2).sum(axis=2)
    width = np.maximum(SPEED_WIDTH * np.median(others, axis=0), LEAST_WIDTH)
    error = np.empty(speed.shape)
    for start in range(0, len(speed), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        distance = (speed[some, None] - others) / width  # (poses, rows, markers)
        # where none is alike, all count
        alike = np.exp(-0.5 * distance**2) + 1e-6
        error[some] = np.sqrt((alike * square).sum(axis=1) / alike.sum(axis=1))
    return error
