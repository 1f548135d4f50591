"""Curves through a blackout: linear functions of the samples on either side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.calibration import MIN_EXPECTED_RMS
from priorfill.gp.process import GaussianProcess
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.window_layout import WindowLayout
from priorfill.runtime.elementary import exp
from priorfill.signal.gp_interpolation import interpolation_weights

__all__ = [
    "BlackoutCurve",
    "blackout_curves",
    "decaying_velocity_curves",
    "evaluate_curves",
    "gaussian_process_curves",
    "interpolate_correction",
    "interpolate_expected_rms",
]

_Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BlackoutCurve:
    """A curve through a blackout: a linear function of the samples on either side.

    Attributes
    ----------
    marker_weights : ndarray [shape=(requested, samples)]
        Applied to the samples of each marker.
    mean_weights : ndarray [shape=(requested, samples)] or None
        Applied to the mean of all markers; the result is added.
    """

    marker_weights: _Floats
    mean_weights: _Floats | None = None


def blackout_curves(
    layout: WindowLayout, rate: float, requested: NDArray[np.intp], options: BlackoutOptions
) -> list[BlackoutCurve]:
    """Return the curves through a blackout at some of its frames.

    Parameters
    ----------
    layout : WindowLayout
        Of the blackout.
    rate : float
        Hz.
    requested : ndarray of int
        Frames, counted from the first missing one.
    options : BlackoutOptions
        Processes for a blackout with two edges, decay times for one with one edge.
    """
    time, at = layout.context / rate, requested / rate
    if len(layout.before) and len(layout.after):
        return gaussian_process_curves(options.curve_processes, time, at)
    return decaying_velocity_curves(time, at, options)


def gaussian_process_curves(
    processes: Sequence[GaussianProcess], time: _Floats, requested: _Floats
) -> list[BlackoutCurve]:
    """Return the predictions of processes in time, each with a free line, as curves.

    Parameters
    ----------
    processes : sequence of GaussianProcess
        One for each curve.
    time, requested : ndarray [shapes=(samples,), (requested,), s]
        Times of the samples, and those at which the curves are evaluated.
    """
    return [BlackoutCurve(interpolation_weights(process, time, requested)) for process in processes]


def decaying_velocity_curves(
    time: _Floats, requested: _Floats, options: BlackoutOptions
) -> list[BlackoutCurve]:
    """Return curves that leave the visible edge at its velocity, which decays exponentially.

    The distance covered after the time t is ``v s (1 - exp(-t / s))`` for the decay time s.

    Parameters
    ----------
    time, requested : ndarray [shapes=(samples,), (requested,), s]
        Times of the samples, and those at which the curves are evaluated: all before the samples,
        or all after them.
    options : BlackoutOptions
        Decay times of the velocities of the markers and of the whole body.

    Returns
    -------
    list of BlackoutCurve
        One for each decay time of a marker, one for each of the whole body, and a constant one.
    """
    forward = requested[0] > time[-1]
    distance = np.abs(time - (time[-1] if forward else time[0]))
    elapsed = np.abs(requested - (time[-1] if forward else time[0]))
    used = (distance <= options.velocity_fit_seconds) | (distance <= np.sort(distance)[1])
    slope = np.zeros(len(time))
    centred = time[used] - time[used].mean()
    slope[used] = centred / (centred @ centred)
    velocity = slope if forward else -slope
    hold = np.zeros((len(requested), len(time)))
    hold[:, -1 if forward else 0] = 1.0

    def covered(decay: float) -> _Floats:
        """Return the weights of the samples in the distance covered."""
        return np.outer(decay * (1.0 - exp(-elapsed / decay)), velocity)

    own = [BlackoutCurve(hold + covered(decay)) for decay in options.marker_decay_seconds]
    short = covered(options.marker_decay_seconds[0])
    common = [
        BlackoutCurve(hold + short, covered(decay) - short)
        for decay in options.common_decay_seconds
    ]
    return [*own, *common, BlackoutCurve(hold)]


def evaluate_curves(curves: Sequence[BlackoutCurve], context: _Floats) -> _Floats:
    """Evaluate curves on the samples of windows.

    Parameters
    ----------
    curves : sequence of BlackoutCurve
        At some frames of the blackout.
    context : ndarray [shape=(windows, context frames, markers, 3), mm]
        The samples on either side.

    Returns
    -------
    ndarray [shape=(curves, windows, requested frames, markers, 3), mm]
    """
    mean = context.mean(axis=2, keepdims=True)
    positions = []
    for curve in curves:
        found = np.tensordot(curve.marker_weights, context, (1, 1)).transpose(1, 0, 2, 3)
        if curve.mean_weights is not None:
            found = found + np.tensordot(curve.mean_weights, mean, (1, 1)).transpose(1, 0, 2, 3)
        positions.append(found)
    return np.array(positions)


def interpolate_correction(
    layout: WindowLayout, correction: _Floats, requested: NDArray[np.intp]
) -> _Floats:
    """Interpolate a correction to all frames by a cubic spline.

    At a visible edge the correction and its velocity are 0, so that the curve stays continuous.

    Parameters
    ----------
    layout : WindowLayout
        Of the blackout.
    correction : ndarray [shape=(frames inside, ...), mm]
        At ``layout.inside``.
    requested : ndarray of int
        Frames, counted from the first missing one.
    """
    from scipy.interpolate import CubicSpline  # slow to import

    zero = np.zeros_like(correction[:1])
    time, values = [layout.inside.astype(np.float64)], [correction]
    no_curvature: tuple[int, _Floats] = (2, zero[0])
    no_slope: tuple[int, _Floats] = (1, zero[0])
    ends = [no_curvature, no_curvature]
    if len(layout.before):
        time.insert(0, np.array([-1.0]))
        values.insert(0, zero)
        ends[0] = no_slope
    if len(layout.after):
        time.append(np.array([float(layout.frames)]))
        values.append(zero)
        ends[1] = no_slope
    spline = CubicSpline(np.concatenate(time), np.concatenate(values), bc_type=tuple(ends))
    interpolated: _Floats = spline(requested)
    return interpolated


def interpolate_expected_rms(
    layout: WindowLayout, expected_rms: _Floats, requested: NDArray[np.intp]
) -> _Floats:
    """Interpolate an expected error linearly to all frames; it falls to 0 at a visible edge.

    Parameters
    ----------
    layout : WindowLayout
        Of the blackout.
    expected_rms : ndarray [shape=(frames inside, markers), mm]
        At ``layout.inside``.
    requested : ndarray of int
        Frames, counted from the first missing one.

    Returns
    -------
    ndarray [shape=(requested frames, markers), mm]
        At least the measurement noise.
    """
    time, values = [layout.inside], [expected_rms]
    if len(layout.before):
        time.insert(0, np.array([-1]))
        values.insert(0, np.zeros_like(expected_rms[:1]))
    if len(layout.after):
        time.append(np.array([layout.frames]))
        values.append(np.zeros_like(expected_rms[:1]))
    at, known = np.concatenate(time), np.concatenate(values)
    interpolated = np.stack([np.interp(requested, at, column) for column in known.T], axis=1)
    result: _Floats = np.maximum(interpolated, MIN_EXPECTED_RMS)
    return result
