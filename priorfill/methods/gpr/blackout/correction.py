"""Correct the curve through a blackout by its errors in windows with similar edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.kernels import Pairs
from priorfill.gp.linalg import (
    explained_variance,
    inverse_root,
    power_weights,
    solve_blocks,
)
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.windows import OWN_SUBJECT, BlackoutWindows
from priorfill.runtime.elementary import power

__all__ = ["correct_from_edges"]

_Floats = NDArray[np.float64]

NEGLIGIBLE = 1e-10
"""Share of the square errors: a correction that explains less is due to rounding."""


@dataclass(frozen=True, eq=False)
class _Model:
    """What a model predicts of the curves' errors.

    Attributes
    ----------
    prediction : ndarray [shape=(values,), mm]
        For the blackout.
    residuals : ndarray [shape=(scored windows, values), mm]
        Of the scored windows, each left out.
    relative_variance : ndarray [shape=(scored windows,)]
        Posterior variance of the blackout in units of each residual's.
    """

    prediction: _Floats
    residuals: _Floats
    relative_variance: _Floats


def correct_from_edges(
    windows: BlackoutWindows,
    errors: _Floats,
    scale: _Floats,
    weight: _Floats,
    scored: NDArray[np.intp],
    min_distance: int,
    options: BlackoutOptions,
) -> tuple[_Floats, _Floats, _Floats]:
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
    scored : ndarray of int
        Windows on which errors are estimated.
    min_distance : int
        Windows of the clip that start at a smaller distance (frames) have frames in common.
    options : BlackoutOptions
        Processes, exponents, and ``weight_power``.

    Returns
    -------
    correction : ndarray [shape=(values,), mm]
        For the blackout, in its root frame.
    residuals : ndarray [shape=(scored windows, values), mm]
        Errors that remain after the correction when each window is left out with those that have
        frames in common with it, with all of its take, or with all of its subject.
    variance : ndarray [shape=(scored windows,)]
        Posterior variance of the blackout in units of each residual's: above 1 where the
        blackout's edges are farther from all windows than that window's from the others.

    See Also
    --------
    priorfill.methods.gpr.blackout.stacking.combine_curves : Combines the curves before.

    References
    ----------
    .. [RW06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
    """
    neighbours = _left_out_together(windows, scored, min_distance)
    features = windows.edges - windows.edges[1:].mean(axis=0)
    features /= np.sqrt((features[1:] ** 2).sum(axis=1).mean()) + np.finfo(float).eps
    share = weight[scored, None] / np.sqrt((weight[scored] ** 2).sum())
    nothing = _Model(np.zeros(errors.shape[1]), errors[scored], np.ones(len(scored)))
    models = [
        nothing,
        *_models(windows, features, errors, scale, scored, neighbours, options),
    ]
    residuals = np.array([model.residuals for model in models])
    rms = np.sqrt(((share * residuals) ** 2).sum(axis=(1, 2))) + np.finfo(float).eps
    by_model = power_weights(rms, options.weight_power)
    predicted = errors[scored] - np.tensordot(by_model, residuals, 1)
    product = float((share**2 * predicted * errors[scored]).sum())
    explained = float(((share * predicted) ** 2).sum())
    # where all windows are left out together, rounding is all that is predicted
    negligible = NEGLIGIBLE * float(((share * errors[scored]) ** 2).sum())
    slope = product / (explained + negligible + np.finfo(float).eps)
    gain = min(max(slope, 0.0), 1.0)
    correction: _Floats = gain * (by_model @ np.array([model.prediction for model in models]))
    variance = by_model @ np.array([model.relative_variance for model in models])
    return correction, errors[scored] - gain * predicted, variance


def _models(
    windows: BlackoutWindows,
    features: _Floats,
    errors: _Floats,
    scale: _Floats,
    scored: NDArray[np.intp],
    neighbours: Sequence[NDArray[np.intp]],
    options: BlackoutOptions,
) -> list[_Model]:
    """Return the models that predict errors."""
    product = features @ features.T
    square = np.diag(product)
    correlation = windows.source_correlation()
    count = len(errors)
    train = Pairs((count, count), correlation=correlation[1:, 1:])
    train = train.with_features(product[1:, 1:], square[1:], square[1:])
    cross = Pairs((1, count), correlation=correlation[:1, 1:])
    cross = cross.with_features(product[:1, 1:], square[:1], square[1:])
    sizes = [power(scale, exponent) for exponent in options.correction_exponents]
    held_out = np.unique(np.concatenate(neighbours))
    models = []
    for process in options.correction_processes:
        covariance = process.kernel(train)
        covariance[np.diag_indices_from(covariance)] += process.noise_variance
        root = inverse_root(covariance)
        # only the weights that are needed: errors have far more values than there are windows
        to_query = process.kernel(cross)
        query = root.T @ (root @ to_query[0])
        posterior = process.kernel.variance(cross) - explained_variance(root, to_query)
        rows = root[:, held_out].T @ root  # of the inverse covariance
        weights, variance = _left_out_weights(rows, held_out, scored, neighbours)
        for size in sizes:
            targets = errors / size[1:, None]
            left = weights @ targets
            models.append(
                _Model(
                    size[0] * (query @ targets),
                    size[1 + scored, None] * left,
                    (posterior[0] + process.noise_variance) / variance,
                )
            )
    return models


def _left_out_weights(
    rows: _Floats,
    held_out: NDArray[np.intp],
    scored: NDArray[np.intp],
    neighbours: Sequence[NDArray[np.intp]],
) -> tuple[_Floats, _Floats]:
    """Return the weights of the targets in the residuals of windows that are left out.

    With G the inverse covariance and B a block, the residuals are ``inv(G_BB) G_B y`` and their
    variances the diagonal of ``inv(G_BB)``; see `priorfill.gp.process.FittedGP.leave_blocks_out`.

    Parameters
    ----------
    rows : ndarray [shape=(held-out windows, windows)]
        Of the inverse covariance matrix.
    held_out : ndarray of int
        The windows of these rows, ascending.
    scored : ndarray of int
        Windows whose residuals are wanted.
    neighbours : sequence of ndarray of int
        Which windows are left out with each of them.

    Returns
    -------
    weights : ndarray [shape=(scored windows, windows)]
    variance : ndarray [shape=(scored windows,)]
        In the kernel's unit, noise included.
    """
    members: dict[bytes, list[int]] = {}  # windows of a take are left out together
    for place, block in enumerate(neighbours):
        members.setdefault(block.tobytes(), []).append(place)
    weights, variance = np.empty((len(scored), rows.shape[1])), np.empty(len(scored))
    for places in members.values():
        block = neighbours[places[0]]
        part = rows[np.searchsorted(held_out, block)]
        columns = np.searchsorted(block, scored[places])
        unit = np.zeros((len(block), len(places)))
        unit[columns, np.arange(len(places))] = 1.0
        inverse = solve_blocks(part[:, block][None], unit[None])[0]
        weights[places] = inverse.T @ part
        variance[places] = inverse[columns, np.arange(len(places))]
    return weights, variance


def _left_out_together(
    windows: BlackoutWindows, scored: NDArray[np.intp], min_distance: int
) -> list[NDArray[np.intp]]:
    """Return for each scored window those that are left out with it, itself included.

    For a window of the clip, those that have frames in common with it: the clip and its mirror
    image have the same frames. For a window of a take, all of its take; and all of its subject
    where no take is of the clip's, because the clip's subject is not among the takes either.
    """
    own = (windows.own | windows.own_image)[1:]
    start = windows.start[1:]
    same_subject = bool((windows.of_takes & (windows.subject[1:] == OWN_SUBJECT)).any())
    group = windows.source[1:] if same_subject else windows.subject[1:]
    together = []
    for window in scored:
        if own[window]:
            same = own & (np.abs(start - start[window]) < min_distance)
        else:
            same = ~own & (group == group[window])
        together.append(np.flatnonzero(same))
    return together
