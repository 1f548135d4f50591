"""Local generalised regression neural network (``lgrnn``): a mean weighted by similarity of shape.

The marker in its triad's frame is the mean of its measured local positions with the weights
exp(-ln 2 (d / h)²), where d is the distance between scaled shapes of the triad. Such a network is
Nadaraya-Watson regression.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.tits2018.scaling import Scale

__all__ = ["predict"]

Array = NDArray[np.float64]

BATCH_FRAMES = 512
"""Frames predicted at once; limits the memory to about 10 MB."""


def predict(
    features: Array, local: Array, query: Array, scaled_by: Array, half_weight_distance: float
) -> Array:
    """Predict local coordinates from frames in which the triad has a similar shape.

    Parameters
    ----------
    features, local, query, scaled_by : ndarray [shape=(..., 3), mm]
        As in `priorfill.methods.tits2018.local_polynomial.predict`.
    half_weight_distance : float
        h, the distance between scaled shapes at which the weight is one half.

    Returns
    -------
    ndarray [shape=(query frames, 3), mm]
        NaN where the shape is missing.
    """
    scale = Scale.of(scaled_by)
    rows = scale.down(features)
    out = np.full(query.shape, np.nan)
    known = np.flatnonzero(~np.isnan(query).any(axis=1))
    for start in range(0, len(known), BATCH_FRAMES):
        some = known[start : start + BATCH_FRAMES]
        points = scale.down(query[some])
        # without the point's own square, which is the same for all rows
        square = (rows**2).sum(axis=1) - 2.0 * points @ rows.T
        # relative to the nearest row: the weights have the same ratios, but cannot all underflow
        square -= square.min(axis=1, keepdims=True)
        weight = np.exp(-np.log(2.0) / half_weight_distance**2 * square)
        out[some] = weight @ local / weight.sum(axis=1, keepdims=True)
    return out
