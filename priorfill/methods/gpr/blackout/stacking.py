"""Combine the curves of a blackout by their errors in windows (stacking)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.linalg import power_weights, solve_blocks
from priorfill.methods.gpr.blackout.options import BlackoutOptions

__all__ = ["stack_curves"]

_Floats = NDArray[np.float64]

_HORIZONTAL_VERTICAL = ([0, 1], [2])
"""Axes that share stacking weights: the heading is arbitrary, so the horizontal axes are alike."""


def stack_curves(
    curves: _Floats, truth: _Floats, weight: _Floats, options: BlackoutOptions
) -> _Floats:
    """Combine curves linearly by their errors in windows.

    For each marker the curves are averaged with weights by their error. Ridge regression then
    refines the weights for each frame, with all markers together, from those of the average. The
    result is stacked generalisation [W92]_ that falls back on the average.

    Parameters
    ----------
    curves : ndarray [shape=(curves, 1 + windows, frames, markers, 3), mm]
        Of the blackout, which is the first, and of the windows.
    truth : ndarray [shape=(windows, frames, markers, 3), mm]
        Positions in the windows.
    weight : ndarray [shape=(windows,)]
        Factor of each window's residuals in the least squares.
    options : BlackoutOptions
        ``weight_power`` and ``stacking_ridge``.

    Returns
    -------
    ndarray [shape=(1 + windows, frames, markers, 3), mm]
        The combined curves.

    See Also
    --------
    priorfill.methods.gpr.blackout.correction.correct_from_edges : Corrects the combined curves.

    References
    ----------
    .. [W92] Wolpert, Stacked generalization, Neural Networks 5(2), 1992.
       https://doi.org/10.1016/S0893-6080(05)80023-1
    """
    average = _average(curves, truth, weight, options.weight_power)
    deviation = curves - average
    weighted = deviation[:, 1:] * weight[:, None, None, None]
    residual = (truth - average[1:]) * weight[:, None, None, None]
    result = average.copy()
    for axes in _HORIZONTAL_VERTICAL:
        for frame in range(truth.shape[1]):
            directions = weighted[:, :, frame][..., axes].reshape(len(curves), -1)
            normal = directions @ directions.T
            ridge = options.stacking_ridge * np.diag(normal)
            ridge += np.finfo(float).eps * (1.0 + np.trace(normal))
            normal[np.diag_indices_from(normal)] += ridge
            step = solve_blocks(
                normal[None], (directions @ residual[:, frame][..., axes].reshape(-1, 1))[None]
            ).reshape(-1)
            result[:, frame][..., axes] += np.tensordot(step, deviation[:, :, frame][..., axes], 1)
    return result


def _average(curves: _Floats, truth: _Floats, weight: _Floats, power: float) -> _Floats:
    """Average curves by their rms error, marker by marker; see `stack_curves`."""
    square = ((curves[:, 1:] - truth) ** 2).sum(axis=-1)
    share = weight**2 / (weight**2).sum()
    error = np.sqrt(np.einsum("w,cwqm->cm", share, square) / square.shape[2])
    error += np.finfo(float).eps
    average: _Floats = np.einsum("cm,cwqmi->wqmi", power_weights(error, power), curves)
    return average
