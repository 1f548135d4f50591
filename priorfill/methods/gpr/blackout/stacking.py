"""Combine the curves of a blackout by their errors in windows (stacking)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.linalg import power_weights, solve_blocks
from priorfill.methods.gpr.blackout.options import BlackoutOptions

__all__ = ["combine_curves", "stacking_weights"]

_Floats = NDArray[np.float64]

_HORIZONTAL_VERTICAL = ([0, 1], [2])
"""Axes that share stacking weights: the heading is arbitrary, so the horizontal axes are alike."""


def stacking_weights(
    curves: _Floats, truth: _Floats, weight: _Floats, options: BlackoutOptions
) -> _Floats:
    """Return weights that combine curves linearly, by their errors in windows.

    For each marker the curves are averaged with weights by their error. Ridge regression then
    refines the weights for each frame, with all markers together, from those of the average. The
    result is stacked generalisation [W92]_ that falls back on the average.

    Parameters
    ----------
    curves : ndarray [shape=(curves, windows, frames, markers, 3), mm]
        Of the windows.
    truth : ndarray [shape=(windows, frames, markers, 3), mm]
        Positions in the windows.
    weight : ndarray [shape=(windows,)]
        Factor of each window's residuals in the least squares.
    options : BlackoutOptions
        ``weight_power`` and ``stacking_ridge``.

    Returns
    -------
    ndarray [shape=(curves, frames, markers, 3)]
        They sum to 1 over the curves.

    See Also
    --------
    combine_curves : Applies the weights.
    priorfill.methods.gpr.blackout.correction.correct_from_edges : Corrects the combined curves.

    References
    ----------
    .. [W92] Wolpert, Stacked generalization, Neural Networks 5(2), 1992.
       https://doi.org/10.1016/S0893-6080(05)80023-1
    """
    by_marker = _weights_by_error(curves, truth, weight, options.weight_power)
    average = np.einsum("cm,cwqmi->wqmi", by_marker, curves)
    deviation = (curves - average) * weight[:, None, None, None]
    residual = (truth - average) * weight[:, None, None, None]
    result = np.empty((len(curves), *truth.shape[1:]))
    for axes in _HORIZONTAL_VERTICAL:
        for frame in range(truth.shape[1]):
            directions = deviation[:, :, frame][..., axes].reshape(len(curves), -1)
            normal = directions @ directions.T
            ridge = options.stacking_ridge * np.diag(normal)
            ridge += np.finfo(float).eps * (1.0 + np.trace(normal))
            normal[np.diag_indices_from(normal)] += ridge
            step = solve_blocks(
                normal[None], (directions @ residual[:, frame][..., axes].reshape(-1, 1))[None]
            ).reshape(-1)
            refined = by_marker * (1.0 - step.sum()) + step[:, None]
            result[:, frame][..., axes] = refined[..., None]
    return result


def combine_curves(weights: _Floats, curves: _Floats) -> _Floats:
    """Combine curves [shape=(curves, windows, frames, markers, 3), mm] by `stacking_weights`."""
    combined: _Floats = np.einsum("cqmi,cwqmi->wqmi", weights, curves)
    return combined


def _weights_by_error(curves: _Floats, truth: _Floats, weight: _Floats, power: float) -> _Floats:
    """Return weights of curves by their rms error [shape=(curves, markers)]."""
    square = ((curves - truth) ** 2).sum(axis=-1)
    share = weight**2 / (weight**2).sum()
    error = np.sqrt(np.einsum("w,cwqm->cm", share, square) / square.shape[2])
    error += np.finfo(float).eps
    return power_weights(error, power)
