"""Combine a source's prediction with that of the regression of poses by their expected errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from priorfill.gp.ensemble import Regression
from priorfill.gp.linalg import power_weights
from priorfill.methods.gpr.sources.source import MIN_ERROR, SourcePrediction

__all__ = ["combined"]


def combined(
    found: Regression, source: SourcePrediction, first: int, power: float
) -> tuple[Regression, float]:
    """Return the weighted mean of two predictions.

    Parameters
    ----------
    found : Regression
        In consecutive frames, those of the segment among them.
    source : SourcePrediction
        For the frames of the segment.
    first : int
        Which frame of ``found`` is the first one of the segment.
    power : float
        Weights are proportional to the expected errors, those of the source times its penalty, to
        the power of minus this.

    Returns
    -------
    found : Regression
        Without velocities. The expected squared error is the weighted mean of both: their errors
        are correlated.
    weight : float
        Mean weight of the source.
    """
    frames = slice(first, first + len(source.positions))
    errors = np.maximum(np.stack([found.expected_rms[frames], source.expected_rms]), MIN_ERROR)
    weight = power_weights(np.stack([errors[0], source.error_penalty * errors[1]]), power)
    positions, expected = found.positions.copy(), found.expected_rms.copy()
    step = source.positions - positions[frames]
    before = float(expected[frames].mean())
    positions[frames] += weight[1][..., None] * step
    expected[frames] = np.sqrt((weight * errors**2).sum(axis=0))
    change = float(expected[frames].mean()) / max(before, MIN_ERROR)
    return (
        replace(
            found,
            positions=positions,
            expected_rms=expected,
            velocity=None,
            relative_error=found.relative_error * change,
        ),
        float(weight[1].mean()),
    )
