"""Predict a blackout: combine curves, correct them, and estimate the error, all from windows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.gpr.blackout.correction import correct_from_edges
from priorfill.methods.gpr.blackout.curves import (
    blackout_curves,
    evaluate_curves,
    gaussian_process_curves,
    interpolate_correction,
    interpolate_expected_rms,
)
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.stacking import combine_curves, stacking_weights
from priorfill.methods.gpr.blackout.window_layout import WindowLayout, lay_out_window
from priorfill.methods.gpr.blackout.windows import (
    BlackoutWindows,
    MirrorImage,
    WindowSources,
    collect_windows,
)
from priorfill.runtime.elementary import exp, hypot, log, power

__all__ = ["BlackoutPrediction", "predict_blackout"]

_Floats = NDArray[np.float64]

_CurvesOf = Callable[[slice | NDArray[np.intp]], _Floats]

WINDOWS_PER_BATCH = 100
"""Windows whose curves are evaluated at a time: a second of 41 markers takes 20 MB."""


@dataclass(frozen=True, eq=False)
class BlackoutPrediction:
    """Prediction of a blackout.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN for markers that are not visible at the edges that are used: if some markers are visible
        on both sides, those visible on one side only are not predicted.
    expected_rms : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error.
    windows : int
        Number of windows learnt from; 0 where it is interpolated over time alone.
    """

    positions: _Floats
    expected_rms: _Floats
    windows: int


def predict_blackout(
    sources: WindowSources,
    start: int,
    stop: int,
    rate: float,
    root: Callable[[NDArray[np.intp]], RootGroup | None],
    image: MirrorImage,
    wanted: NDArray[np.intp],
    options: BlackoutOptions,
) -> BlackoutPrediction | None:
    """Predict a blackout.

    Parameters
    ----------
    sources : WindowSources
        The clip, which is missing in the blackout, and windows of other recordings.
    start, stop : int
        First frame of the blackout, and the frame after its last one.
    rate : float
        Hz.
    root : callable
        Returns the root group among some markers.
    image : MirrorImage
        The clip's mirror image.
    wanted : ndarray of int
        The markers to be predicted.
    options : BlackoutOptions
        Windows and models.

    Returns
    -------
    BlackoutPrediction or None
        None where neither side shows two frames, or no marker in all frames of both sides.

    See Also
    --------
    priorfill.methods.gpr.blackout.fill_blackouts : Prediction of the blackouts of a task.
    """
    clip = sources.clip
    known = ~np.isnan(clip[..., 0])
    layout = lay_out_window(known[:, wanted], start, stop, rate, options)
    if layout is None:
        return None
    complete = known[start + layout.first : start].all(axis=0)
    complete &= known[stop : start + layout.last].all(axis=0)
    markers = np.flatnonzero(complete)
    if not np.isin(wanted, markers).any():
        return None
    windows = None
    group = root(markers)
    if group is not None:
        among = image.among(markers, options.min_paired_share)
        windows = collect_windows(
            sources, markers, among, start, layout, group.among(markers), options
        )
    frames = np.arange(layout.frames)
    curves = blackout_curves(layout, rate, layout.inside, options)
    context = clip[np.ix_(start + layout.context, markers)][None]
    base = evaluate_curves(blackout_curves(layout, rate, frames, options)[:1], context)[0, 0]
    count = 0
    if windows is not None and len(windows) >= options.min_windows:
        count = len(windows)

        usual = len(curves)
        if windows.of_takes.any() and len(layout.before) and len(layout.after):
            time, at = layout.context / rate, layout.inside / rate
            curves = [*curves, *gaussian_process_curves(options.rest_processes, time, at)]

        def of_windows(chosen: slice | NDArray[np.intp]) -> _Floats:
            return evaluate_curves(curves, windows.context[chosen])

        inside, expected_rms = _from_windows(windows, of_windows, usual, layout, options)
    else:
        values = evaluate_curves(curves, context)
        inside = values.mean(axis=0)[0]
        expected_rms = _error_without_windows(values, context[0], layout, rate, options)
    positions = np.full((layout.frames, clip.shape[1], 3), np.nan)
    correction = inside - base[layout.inside]
    positions[:, markers] = base + interpolate_correction(layout, correction, frames)
    expected = np.full((layout.frames, clip.shape[1]), np.nan)
    expected[:, markers] = interpolate_expected_rms(layout, expected_rms, frames)
    return BlackoutPrediction(positions, expected, count)


def _error_without_windows(
    curves: _Floats, context: _Floats, layout: WindowLayout, rate: float, options: BlackoutOptions
) -> _Floats:
    """Estimate the error from the disagreement of the curves and the distance covered.

    Parameters
    ----------
    curves : ndarray [shape=(curves, 1, frames inside, markers, 3), mm]
        Through the blackout.
    context : ndarray [shape=(context frames, markers, 3), mm]
        Samples on either side.
    layout : WindowLayout
        Of the blackout.
    rate : float
        Hz.
    options : BlackoutOptions
        `untrained_error_ratio`, `predictable_seconds` and `min_speed`.

    Returns
    -------
    ndarray [shape=(frames inside, markers), mm]
        Expected rms error.
    """
    disagreement = np.sqrt(curves.var(axis=0).sum(axis=-1))[0]
    steps = np.diff(context, axis=0) * rate / np.diff(layout.context)[:, None, None]
    speed = hypot(np.sqrt((steps**2).sum(axis=-1).mean()), options.min_speed)
    elapsed = np.full(len(layout.inside), np.inf)  # frames from the nearest visible edge
    if len(layout.before):
        elapsed = np.minimum(elapsed, layout.inside + 1)
    if len(layout.after):
        elapsed = np.minimum(elapsed, layout.frames - layout.inside)
    covered = speed * np.maximum(elapsed / rate - options.predictable_seconds, 0.0)
    expected: _Floats = hypot(options.untrained_error_ratio * disagreement, covered[:, None])
    return expected


def _from_windows(
    windows: BlackoutWindows,
    curves: _CurvesOf,
    usual: int,
    layout: WindowLayout,
    options: BlackoutOptions,
) -> tuple[_Floats, _Floats]:
    """Combine and correct the curves of the blackout by those of the windows.

    Parameters
    ----------
    windows : BlackoutWindows
        The blackout and the windows.
    curves : callable
        Returns the curves of some windows, the blackout among them
        [shape=(curves, windows, frames inside, markers, 3), mm].
    usual : int
        How many of the curves, the first ones, show by their disagreement how lively a window is.
    layout : WindowLayout
        Of the blackout.
    options : BlackoutOptions
        Models and weights of the windows.

    Returns
    -------
    positions : ndarray [shape=(frames inside, markers, 3), mm]
    expected_rms : ndarray [shape=(frames inside, markers), mm]
    """
    truth = windows.inside[1:]
    scale = _relative_scale(_disagreement(curves, usual, 1 + len(windows)), options)
    # windows are informative if their curves disagree as much as the blackout's
    difference = log(scale[1:] / scale[0]) / options.scale_log_std
    similarity = exp(-0.5 * difference**2) + options.min_similarity
    similarity *= windows.nearness(options)
    trained, scored = windows.trained(options), windows.scored(options)
    weight = similarity / scale[1:]
    stacking = stacking_weights(curves(1 + trained), truth[trained], weight[trained], options)
    combined = np.concatenate(
        [combine_curves(stacking, curves(part)) for part in _batches(1 + len(truth))]
    )
    errors = np.einsum("wqmi,wij->wqmj", truth - combined[1:], windows.rotation[1:])
    correction, residuals, variance = correct_from_edges(
        windows, errors.reshape(len(errors), -1), scale, weight, scored, layout.length, options
    )
    positions: _Floats = combined[0] + correction.reshape(truth.shape[1:]) @ windows.rotation[0].T
    size = power(scale, options.error_scale_exponent)
    relative = residuals.reshape(-1, *truth.shape[1:]) / size[1:][scored][:, None, None, None]
    if windows.of_takes.any():
        relative *= np.sqrt(np.maximum(variance, 1.0))[:, None, None, None]
    share = similarity[scored] / similarity[scored].sum()
    expected_rms: _Floats = size[0] * np.sqrt(np.tensordot(share, (relative**2).sum(axis=-1), 1))
    if windows.own[1:].sum() < options.min_windows and not windows.of_takes.any():
        # without own windows the error of other recordings on this clip cannot be validated
        mean = curves(np.zeros(1, dtype=np.intp))[:, 0].mean(axis=0)
        distance = np.sqrt(((positions - mean) ** 2).sum(axis=-1))
        positions = (positions + mean) / 2.0
        expected_rms = hypot(expected_rms, distance / 2.0)
    return positions, expected_rms


def _batches(count: int) -> list[slice]:
    """Return slices of up to `WINDOWS_PER_BATCH` windows."""
    return [slice(at, at + WINDOWS_PER_BATCH) for at in range(0, count, WINDOWS_PER_BATCH)]


def _disagreement(curves: _CurvesOf, usual: int, count: int) -> _Floats:
    """Return the rms distance of the curves from their mean [shape=(windows,), mm]."""
    parts = [
        np.sqrt(curves(part)[:usual].var(axis=0).sum(axis=-1).mean(axis=(1, 2)))
        for part in _batches(count)
    ]
    return np.concatenate(parts)


def _relative_scale(disagreement: _Floats, options: BlackoutOptions) -> _Floats:
    """Return how much the curves disagree in each window, relative to the median window.

    Parameters
    ----------
    disagreement : ndarray [shape=(1 + windows,), mm]
        Of the curves.
    options : BlackoutOptions
        `BlackoutOptions.min_relative_scale`.

    Returns
    -------
    ndarray [shape=(1 + windows,)]
        At least `BlackoutOptions.min_relative_scale`.
    """
    usual = float(np.median(disagreement)) + np.finfo(float).eps
    scale: _Floats = hypot(disagreement, options.min_relative_scale * usual) / usual
    return scale
