"""Curves through a blackout: drawn by what is seen beside it, and carried to all its frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from priorfill.gp.calibration import LEAST_DEVIATION
from priorfill.methods.gpr.blackout.window_layout import Stencil
from priorfill.signal.gp_interpolation import Curve, decaying_velocity, process_in_time

__all__ = ["curves_of", "draw", "profile", "through"]

_Floats = NDArray[np.float64]


def curves_of(stencil: Stencil, rate: float, asked: NDArray[np.intp]) -> list[Curve]:
    """Return the curves that lead through a blackout, at some of its frames."""
    both = len(stencil.before) and len(stencil.after)
    make = process_in_time if both else decaying_velocity
    return make(stencil.beside / rate, asked / rate)


def draw(curves: Sequence[Curve], beside: _Floats) -> _Floats:
    """Return the curves of windows [shape=(curves, windows, frames, markers, 3), mm]."""
    middle = beside.mean(axis=2, keepdims=True)
    drawn = []
    for curve in curves:
        line = np.tensordot(curve.each, beside, (1, 1)).transpose(1, 0, 2, 3)
        if curve.together is not None:
            line = line + np.tensordot(curve.together, middle, (1, 1)).transpose(1, 0, 2, 3)
        drawn.append(line)
    return np.array(drawn)


def through(stencil: Stencil, correction: _Floats, asked: NDArray[np.intp]) -> _Floats:
    """Carry a correction over to all frames; it begins and ends with nothing, without a kink."""
    nothing = np.zeros_like(correction[:1])
    time, values = [stencil.inside.astype(np.float64)], [correction]
    free: tuple[int, _Floats | float] = (2, nothing[0])
    ends = [free, free]
    if len(stencil.before):
        time.insert(0, np.array([-1.0]))
        values.insert(0, nothing)
        ends[0] = (1, nothing[0])
    if len(stencil.after):
        time.append(np.array([float(stencil.frames)]))
        values.append(nothing)
        ends[1] = (1, nothing[0])
    spline = CubicSpline(np.concatenate(time), np.concatenate(values), bc_type=tuple(ends))
    carried: _Floats = spline(asked)
    return carried


def profile(stencil: Stencil, expected_rms: _Floats, asked: NDArray[np.intp]) -> _Floats:
    """Carry an expected error [shape=(frames inside, markers)] over to all frames."""
    time, values = [stencil.inside], [expected_rms]
    if len(stencil.before):
        time.insert(0, np.array([-1]))
        values.insert(0, np.zeros_like(expected_rms[:1]))
    if len(stencil.after):
        time.append(np.array([stencil.frames]))
        values.append(np.zeros_like(expected_rms[:1]))
    at, known = np.concatenate(time), np.concatenate(values)
    carried = np.stack([np.interp(asked, at, column) for column in known.T], axis=1)
    floored: _Floats = np.maximum(carried, LEAST_DEVIATION)
    return floored
