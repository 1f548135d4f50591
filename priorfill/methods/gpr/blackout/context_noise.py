"""Measurement noise of windows of a database, which are smoother than the clip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gpr.blackout.window_layout import WindowLayout

__all__ = ["match_noise"]

_Floats = NDArray[np.float64]

DIFFERENCE = np.array([-1.0, 3.0, -3.0, 1.0])
"""Third difference: movement of constant acceleration has none."""

SEED = 1
"""Of the noise that is added."""


def match_noise(context: _Floats, of_takes: NDArray[np.bool_], layout: WindowLayout) -> _Floats:
    """Return the samples around windows, with noise like the clip's added to those of takes.

    Poses of a database have a low rate, and resampled to the clip's they have less noise. Curves
    that follow every sample would do better on them than on the clip. The difference of the
    variances of third differences, of the clip next to the blackout and of the takes next to
    similar windows, is the variance of the noise that is added.

    Parameters
    ----------
    context : ndarray [shape=(windows, context frames, markers, 3), mm]
        The blackout's first.
    of_takes : ndarray of bool [shape=(windows,)]
        Which windows are of takes.
    layout : WindowLayout
        Of the windows.
    """
    if not of_takes.any():
        return context
    missing = _noise_variance(context[:1], layout) - _noise_variance(context[of_takes], layout)
    if missing <= 0.0:
        return context
    result = context.copy()
    uniform = np.random.default_rng(SEED).random(context[of_takes].shape)
    result[of_takes] += np.sqrt(12.0 * missing) * (uniform - 0.5)
    return result


def _noise_variance(context: _Floats, layout: WindowLayout) -> float:
    """Return the variance (mm²) that third differences of the samples imply; 0 with few samples."""
    squares = []
    count = len(layout.before)
    for side in (context[:, :count], context[:, count:]):
        for at in range(side.shape[1] - len(DIFFERENCE) + 1):
            third = np.tensordot(DIFFERENCE, side[:, at : at + len(DIFFERENCE)], (0, 1))
            squares.append((third**2).sum(axis=-1).ravel() / 3.0)
    if not squares:
        return 0.0
    # movement adds to some of them: the median of a normal variable's square is 0.79 for the mean
    # of three
    return float(np.median(np.concatenate(squares)) / (0.789 * (DIFFERENCE**2).sum()))
