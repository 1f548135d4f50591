"""WPCA: the weighted PCA of Gløersen and Federolf 2016, one marker after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gloersen2016.strategies import PcaFrames, one_by_one
from priorfill.methods.tits2018.tits2018_options import Tits2018Options

__all__ = ["predict"]

Array = NDArray[np.float64]


def predict(positions: Array, options: Tits2018Options) -> Array:
    """Predict every marker that has gaps, each from the measured samples alone.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        About their centre; NaN where missing. Every marker is seen somewhere.
    options : Tits2018Options
        Weights and components.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        NaN where measured, and where no whole frame is left to learn from.
    """
    out = np.full(positions.shape, np.nan)
    frames = PcaFrames(positions)
    for lost in one_by_one(frames, options.pca):
        told = frames.told(lost, options.pca)
        if told is not None:
            out[np.ix_(told[0], lost.markers)] = told[1]
    return out
