"""Gaussian-process regression from a window's features to its positions, and its held-out errors.

What is predicted is the residual of the missing markers to the straight line between their
positions at the edges, in the frame of reference of each pose. Windows of one recording, or of one
subject where none is of the clip's, are predicted from the others in closed form [RW06]_ (section
5.4.2). Their errors, in units of their predicted standard deviations and weighted by how near the
windows are to the gap, calibrate the expected errors in the gap.

References
----------
.. [RW06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.kernels import RBF, Linear, Pairs
from priorfill.gp.process import GaussianProcess
from priorfill.methods.gpr.sources.options import GapWindowOptions
from priorfill.runtime.elementary import exp

__all__ = ["WindowRegression", "regress_windows"]

_Floats = NDArray[np.float64]

NEIGHBOUR = 5
"""The length scale is in units of the distance from this neighbour (from 0) in another group."""

CALIBRATION_NEIGHBOURS = 20
"""Windows as far from the gap as this neighbour weigh ``exp(-1/2)`` in the calibration."""


@dataclass(frozen=True, eq=False)
class WindowRegression:
    """What windows predict for the gap.

    Attributes
    ----------
    mean : ndarray [shape=(values,), mm]
        The prediction.
    residuals : ndarray [shape=(windows, values), mm]
        Measured minus predicted values of each window without its group.
    similarity : ndarray [shape=(windows,)]
        Weight of each window by its nearness to the gap; they sum to 1.
    inflation : ndarray [shape=(windows,)]
        Predicted standard deviation of the gap in units of each window's.
    """

    mean: _Floats
    residuals: _Floats
    similarity: _Floats
    inflation: _Floats

    def expected_square(self) -> _Floats:
        """Return the expected squared error of each value [shape=(values,), mm²]."""
        square: _Floats = (self.similarity * self.inflation**2) @ self.residuals**2
        return square


def regress_windows(
    features: _Floats,
    targets: _Floats,
    query: _Floats,
    groups: NDArray[np.intp],
    options: GapWindowOptions,
) -> WindowRegression:
    """Predict the values of a gap from those of windows.

    Parameters
    ----------
    features : ndarray [shape=(windows, features), mm]
        Of the windows, at least two of them of different groups.
    targets : ndarray [shape=(windows, values), mm]
        What is predicted.
    query : ndarray [shape=(features,), mm]
        Of the gap.
    groups : ndarray of int [shape=(windows,)]
        Windows of one group are held out together.
    options : GapWindowOptions
        Covariance.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(0.0, 10.0, 30)[:, None]
    >>> found = regress_windows(x, x**2, np.array([5.1]), np.arange(30), GapWindowOptions())
    >>> found.mean.round(0), bool(found.expected_square().max() < 1.0)
    (array([26.]), True)
    """
    mean = features.mean(axis=0)
    centred, at = features - mean, (query - mean)[None]
    scale = np.sqrt((centred**2).sum(axis=1).mean()) + np.finfo(float).eps
    train = Pairs.of_features(centred / scale, centred / scale)
    cross = Pairs.of_features(at / scale, centred / scale)
    other = np.where(groups[:, None] == groups, np.inf, train.squared_distance)
    near = np.partition(other, min(NEIGHBOUR, len(other) - 1), axis=1)
    near = near[:, min(NEIGHBOUR, len(other) - 1)]
    near = near[np.isfinite(near)]
    length = np.sqrt(np.median(near)) if len(near) else 1.0
    length = max(options.length_scale * float(length), 1e-3)
    process = GaussianProcess(RBF(length) + options.linear * Linear(), options.noise_variance)
    fitted = process.fit(train, targets)
    predicted, variance = fitted.predict(cross)
    blocks = [np.flatnonzero(groups == group) for group in np.unique(groups)]
    residuals, held_out = fitted.leave_blocks_out(blocks)
    square = cross.squared_distance[0]
    scale_square = np.sort(square)[min(CALIBRATION_NEIGHBOURS, len(square) - 1)]
    similarity = exp(-0.5 * square / max(scale_square, np.finfo(float).tiny))
    inflation = np.sqrt((variance[0] + options.noise_variance) / held_out)
    return WindowRegression(predicted[0], residuals, similarity / similarity.sum(), inflation)
