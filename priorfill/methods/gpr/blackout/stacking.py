"""Mix the curves of a blackout by what they get wrong in windows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.linalg import shares

__all__ = ["SHARPNESS", "mix"]

_Floats = NDArray[np.float64]

SHARPNESS = 8.0
"""A curve or a regression counts as its error to the power of minus this."""

RIDGE = 0.02
"""Ridge of the least squares, in units of each unknown's own square sum."""


def mix(curves: _Floats, truth: _Floats, weight: _Floats) -> _Floats:
    """Mix curves by what they get wrong in windows.

    Parameters
    ----------
    curves : ndarray [shape=(curves, 1 + windows, frames, markers, 3), mm]
        Of the blackout and the windows.
    truth : ndarray [shape=(windows, frames, markers, 3), mm]
        What the windows show.
    weight : ndarray [shape=(windows,)]
        How much each counts in the least squares.

    Returns
    -------
    ndarray [shape=(1 + windows, frames, markers, 3), mm]
        The mixture.
    """
    wrong = curves[:, 1:] - truth
    part = weight**2 / (weight**2).sum()
    error = np.sqrt(np.einsum("w,cwqm->cm", part, (wrong**2).sum(axis=-1)) / wrong.shape[2])
    error += np.finfo(float).eps
    mixed: _Floats = np.einsum("cm,cwqmi->wqmi", shares(error, SHARPNESS), curves)
    away = curves - mixed
    left = (truth - mixed[1:]) * weight[:, None, None, None]
    result = mixed.copy()
    # the vertical is another matter than the horizontal, whose two axes are alike
    for axes in ([0, 1], [2]):
        for frame in range(truth.shape[1]):
            directions = away[:, 1:, frame][..., axes] * weight[:, None, None]
            directions = directions.reshape(len(curves), -1)
            square = directions @ directions.T
            ridge = RIDGE * np.diag(square) + np.finfo(float).eps * (1.0 + np.trace(square))
            square[np.diag_indices_from(square)] += ridge
            step = np.linalg.solve(square, directions @ left[:, frame][..., axes].ravel())
            result[:, frame][..., axes] += np.tensordot(step, away[:, :, frame][..., axes], 1)
    return result
