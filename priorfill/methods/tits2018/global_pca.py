"""Weighted PCA of Gløersen and Federolf 2016, one marker after another (``wpca``)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gloersen2016.strategies import PcaFrames, consecutive
from priorfill.methods.tits2018.tits2018_options import Tits2018Options

__all__ = ["predict"]

Array = NDArray[np.float64]


def predict(positions: Array, options: Tits2018Options) -> Array:
    """Predict every marker with gaps, each from measured samples only.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Relative to their centroid; NaN where missing. Every marker is visible in some frame.
    options : Tits2018Options
        Weights and number of components.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        NaN where measured, and where fewer than two frames show all markers used.
    """
    out = np.full(positions.shape, np.nan)
    frames = PcaFrames(positions)
    for missing in consecutive(frames, options.pca):
        predicted = frames.predict(missing, options.pca)
        if predicted is not None:
            out[np.ix_(predicted[0], missing.markers)] = predicted[1]
    return out
