"""What a source predicts for a gap segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MIN_ERROR", "SourcePrediction"]

MIN_ERROR = 1e-3
"""mm. Least expected error in weights; next to the edges of a gap a source has none."""


@dataclass(frozen=True, eq=False)
class SourcePrediction:
    """Positions of a segment's missing markers, and their expected errors.

    Attributes
    ----------
    positions : ndarray [shape=(frames of the segment, missing markers, 3), mm]
        Upright.
    expected_rms : ndarray [shape=(frames of the segment, missing markers), mm]
        Expected rms error (Euclidean).
    error_penalty : float
        Factor of the expected errors, when they are weighted against those of other predictions.
    takes : tuple of str
        Names of the recordings.
    """

    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    error_penalty: float
    takes: tuple[str, ...]
