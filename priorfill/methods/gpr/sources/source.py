"""What a source predicts for a gap segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["SourcePrediction"]


@dataclass(frozen=True, eq=False)
class SourcePrediction:
    """Positions of a segment's missing markers, and their expected errors.

    Attributes
    ----------
    positions : ndarray [shape=(frames of the segment, missing markers, 3), mm]
        Upright.
    expected_rms : ndarray [shape=(frames of the segment, missing markers), mm]
        Expected rms error (Euclidean).
    residuals : ndarray [shape=(held-out windows, nodes, missing markers, 3), mm]
        Measured minus predicted positions in recordings that are like the gap, each predicted
        without its take, or without its subject where the clip's is not among them. In the
        source's frame of reference.
    similarity : ndarray [shape=(held-out windows,)]
        Weight of each by its nearness to the gap; they sum to 1.
    error_penalty : float
        Factor of the expected errors, when they are weighted against those of other predictions.
    takes : tuple of str
        Names of the recordings.
    """

    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    residuals: NDArray[np.float64]
    similarity: NDArray[np.float64]
    error_penalty: float
    takes: tuple[str, ...]
