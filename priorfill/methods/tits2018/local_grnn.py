"""LGRNN, local generalised regression neural network: a mean weighed by likeness.

The marker in its triad's frame is the mean of what was measured, weighed by
exp(-ln 2 (d / spread)²), d the distance between the scaled shapes of the triad.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.tits2018.scaling import Scale

__all__ = ["predict"]

Array = NDArray[np.float64]

CHUNK = 512
"""Frames asked for at once: bounds the memory to some 10 MB."""


def predict(features: Array, local: Array, asked: Array, scaled_by: Array, spread: float) -> Array:
    """Predict local coordinates by what was measured with a like shape of the triad.

    Parameters
    ----------
    features, local, asked, scaled_by : ndarray [shape=(..., 3), mm]
        As in `priorfill.methods.tits2018.local_polynomial.predict`.
    spread : float
        Distance at which the weight is half.

    Returns
    -------
    ndarray [shape=(asked, 3), mm]
        NaN where the shape is missing.
    """
    scale = Scale.of(scaled_by)
    rows = scale.down(features)
    out = np.full(asked.shape, np.nan)
    known = np.flatnonzero(~np.isnan(asked).any(axis=1))
    for start in range(0, len(known), CHUNK):
        some = known[start : start + CHUNK]
        points = scale.down(asked[some])
        # less the point's own square, which is the same for all rows
        square = (rows**2).sum(axis=1) - 2.0 * points @ rows.T
        # relative to the nearest row: the same weights, and not all of them 0
        square -= square.min(axis=1, keepdims=True)
        weight = np.exp(-np.log(2.0) / spread**2 * square)
        out[some] = weight @ local / weight.sum(axis=1, keepdims=True)
    return out
