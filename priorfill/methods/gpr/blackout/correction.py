"""Correct the curve through a blackout by its errors in windows with similar edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.kernels import Pairs
from priorfill.gp.linalg import power_weights
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.windows import BlackoutWindows
from priorfill.runtime.elementary import power

__all__ = ["correct_from_edges"]

_Floats = NDArray[np.float64]


def correct_from_edges(
    windows: BlackoutWindows,
    errors: _Floats,
    scale: _Floats,
    weight: _Floats,
    min_distance: int,
    options: BlackoutOptions,
) -> tuple[_Floats, _Floats]:
    """Predict the error of the blackout's curve from the edges, by Gaussian processes.

    Models, one for each process and exponent of the scale, are weighted by their error on held-out
    windows, with no correction among them. Their mean is multiplied by its cross-validated gain:
    the slope of the regression of the errors on their held-out predictions, within [0, 1].

    Parameters
    ----------
    windows : BlackoutWindows
        The blackout and the windows.
    errors : ndarray [shape=(windows, values), mm]
        Errors of the curves in the windows, in root frames.
    scale : ndarray [shape=(1 + windows,)]
        Relative size of the errors to be expected, of the blackout first.
    weight : ndarray [shape=(windows,)]
        Factor of each window's residuals in the cross-validation.
    min_distance : int
        Windows of one recording that start at a smaller distance (frames) have frames in common.
    options : BlackoutOptions
        Processes, exponents, and ``weight_power``.

    Returns
    -------
    correction : ndarray [shape=(values,), mm]
        For the blackout, in its root frame.
    residuals : ndarray [shape=(scored windows, values), mm]
        Errors that remain after the correction, cross-validated on the clip's own windows, or on
        all where it has fewer than ``options.min_windows``.

    See Also
    --------
    priorfill.methods.gpr.blackout.stacking.stack_curves : Combines the curves before.
    """
    scored = np.flatnonzero(windows.scored(options.min_windows))
    neighbours = _overlapping(windows, scored, min_distance)
    features = windows.edges - windows.edges[1:].mean(axis=0)
    features /= np.sqrt((features[1:] ** 2).sum(axis=1).mean()) + np.finfo(float).eps
    predictions, residuals = [np.zeros(errors.shape[1])], [errors[scored]]
    for prediction, left in _models(windows, features, errors, scale, scored, neighbours, options):
        predictions.append(prediction)
        residuals.append(left)
    share = weight[scored, None] / np.sqrt((weight[scored] ** 2).sum())
    rms = np.sqrt([((share * r) ** 2).sum() for r in residuals]) + np.finfo(float).eps
    by_model = power_weights(rms, options.weight_power)
    predicted = errors[scored] - np.tensordot(by_model, np.array(residuals), 1)
    slope = float((share**2 * predicted * errors[scored]).sum())
    slope /= float(((share * predicted) ** 2).sum() + np.finfo(float).eps)
    gain = min(max(slope, 0.0), 1.0)
    correction: _Floats = gain * (by_model @ np.array(predictions))
    return correction, errors[scored] - gain * predicted


def _models(
    windows: BlackoutWindows,
    features: _Floats,
    errors: _Floats,
    scale: _Floats,
    scored: NDArray[np.intp],
    neighbours: Sequence[NDArray[np.intp]],
    options: BlackoutOptions,
) -> list[tuple[_Floats, _Floats]]:
    """Return each model's prediction for the blackout, and its held-out residuals."""
    product = features @ features.T
    square = np.diag(product)
    correlation = windows.source_correlation()
    count = len(errors)
    train = Pairs((count, count), correlation=correlation[1:, 1:])
    train = train.with_features(product[1:, 1:], square[1:], square[1:])
    cross = Pairs((1, count), correlation=correlation[:1, 1:])
    cross = cross.with_features(product[:1, 1:], square[:1], square[1:])
    sizes = [power(scale, exponent) for exponent in options.correction_exponents]
    # one matrix serves all exponents, which only change the targets
    targets = np.concatenate([errors / size[1:, None] for size in sizes], axis=1)
    models = []
    for process in options.correction_processes:
        fitted = process.fit(train, targets)
        mean = np.split(fitted.predict(cross)[0][0], len(sizes))
        left = np.split(fitted.leave_neighbours_out(scored, neighbours)[0], len(sizes), axis=1)
        models += [
            (size[0] * m, size[1 + scored, None] * r)
            for size, m, r in zip(sizes, mean, left, strict=True)
        ]
    return models


def _overlapping(
    windows: BlackoutWindows, scored: NDArray[np.intp], min_distance: int
) -> list[NDArray[np.intp]]:
    """Return for each scored window those that have frames in common with it, and itself.

    The clip and its mirror image have the same frames.
    """
    own = (windows.own | windows.own_image)[1:]
    source, start = windows.source[1:], windows.start[1:]
    overlapping = []
    for window in scored:
        same = own if own[window] else source == source[window]
        near = np.abs(start - start[window]) < min_distance
        overlapping.append(np.flatnonzero(same & near))
    return overlapping
