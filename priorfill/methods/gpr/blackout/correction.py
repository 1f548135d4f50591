"""Correct a mixture of curves by what it gets wrong in windows with edges like the blackout's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.linalg import shares, squared_distances
from priorfill.methods.gpr.blackout.stacking import SHARPNESS
from priorfill.methods.gpr.blackout.windows import FEWEST_WINDOWS, Windows

__all__ = ["correct"]

_Floats = NDArray[np.float64]

LINEAR, CONSTANT = 0.1, 1.0
"""Parts of the kernel beside the radial one, which has 1."""

SCALES = (0.4, 0.7)
"""Length scales of the radial kernel, in units of the windows' rms distance from their mean."""

NOISES = (0.1, 0.5)
"""Variance of what the edges do not tell, in units of the kernel."""

POWERS = (0.5, 1.0)
"""What the curves get wrong grows with how far they disagree to about this power."""


def correct(
    windows: Windows, wrong: _Floats, scale: _Floats, weight: _Floats, apart: int
) -> tuple[_Floats, _Floats]:
    """Predict from the edges what the mixture gets wrong.

    Parameters
    ----------
    windows : Windows
        The blackout and the windows.
    wrong : ndarray [shape=(windows, values), mm]
        What is wrong in the windows, in root frames.
    scale : ndarray [shape=(1 + windows,)]
        How much is to be expected to be wrong.
    weight : ndarray [shape=(windows,)]
        How much each counts when it is judged.
    apart : int
        Windows of the clip and its mirror image that start nearer than this share frames.

    Returns
    -------
    correction : ndarray [shape=(values,), mm]
        For the blackout, in its root frame.
    left : ndarray [shape=(judged windows, values), mm]
        What would be left wrong in the clip's own windows, or in all if it has too few.
    """
    own = windows.source[1:] == 0
    judged = np.flatnonzero(own) if own.sum() >= FEWEST_WINDOWS else np.arange(len(own))
    blocks = _blocks(windows, judged, apart)
    features = windows.edges - windows.edges[1:].mean(axis=0)
    features /= np.sqrt((features[1:] ** 2).sum(axis=1).mean()) + np.finfo(float).eps
    product = features @ features.T
    square = np.diag(product)
    away = squared_distances(product, square, square)
    kin = windows.kinship[:, None] * windows.kinship
    kin = np.where(windows.source[:, None] == windows.source, 1.0, kin)
    predictions, residuals = [], []
    for length in SCALES:
        kernel = (LINEAR * product + np.exp(-away / (2.0 * length**2)) + CONSTANT) * kin
        for noise in NOISES:
            inverse = np.linalg.inv(kernel[1:, 1:] + noise * np.eye(len(own)))
            for power in POWERS:
                by = scale**power
                scaled = inverse @ (wrong / by[1:, None])
                predictions.append(by[0] * (kernel[0, 1:] @ scaled))
                left = np.empty((len(judged), wrong.shape[1]))
                for row, (window, block) in enumerate(zip(judged, blocks, strict=True)):
                    rest = np.linalg.solve(inverse[np.ix_(block, block)], scaled[block])
                    left[row] = by[1 + window] * rest[np.searchsorted(block, window)]
                residuals.append(left)
    predictions.append(np.zeros(wrong.shape[1]))
    residuals.append(wrong[judged])
    part = weight[judged, None] / np.sqrt((weight[judged] ** 2).sum())
    error = np.sqrt([((part * r) ** 2).sum() for r in residuals]) + np.finfo(float).eps
    share = shares(error, SHARPNESS)
    correction = share @ np.array(predictions)
    left = np.tensordot(share, np.array(residuals), 1)
    # as much of it as helps in the windows
    said = wrong[judged] - left
    explained = float((part**2 * said * wrong[judged]).sum())
    gain = explained / float(((part * said) ** 2).sum() + np.finfo(float).eps)
    gain = min(max(gain, 0.0), 1.0)
    return gain * correction, wrong[judged] - gain * said


def _blocks(windows: Windows, judged: NDArray[np.intp], apart: int) -> list[NDArray[np.intp]]:
    """Return for each judged window those that are left out with it, which share its frames."""
    here = windows.source[1:] <= 1
    time = windows.start[1:]
    blocks = []
    for window in judged:
        same = here if here[window] else windows.source[1:] == windows.source[1 + window]
        blocks.append(np.flatnonzero(same & (np.abs(time - time[window]) < apart)))
    return blocks
