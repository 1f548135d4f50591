"""Predict a blackout: curves, their mixture, and what windows say of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.gpr.blackout.correction import correct
from priorfill.methods.gpr.blackout.curves import (
    curves_of,
    draw,
    profile,
    through,
)
from priorfill.methods.gpr.blackout.stacking import mix
from priorfill.methods.gpr.blackout.window_layout import Stencil, stencil_of
from priorfill.methods.gpr.blackout.windows import (
    FEWEST_WINDOWS,
    Recording,
    Windows,
    contralateral_among,
    gather,
)

__all__ = ["Blackout", "fill_blackout"]

_Floats = NDArray[np.float64]

ALIKE = 0.4
"""Windows count less in the mixture the more the logarithm of their scale differs from the
blackout's; this is the standard deviation."""

ANYHOW = 0.05
"""How much they count however much it differs."""

PROFILE_POWER = 0.7
"""The same for the expected error; there it leaves a third of the logarithms' variation."""

LEAST_SCALE = 0.2
"""A window's scale is not far below this part of the median: at rest all that is left is noise."""

UNLEARNT = 1.5
"""Expected error where there are too few windows, in units of how far the curves disagree."""

PREDICTABLE = 0.25
"""s. So long a movement goes on as it began; where no window tells better, all its way from then on
is expected to be wrong."""

LEAST_SPEED = 100.0
"""mm/s. Someone who stands still is expected to go on at this speed."""


@dataclass(frozen=True, eq=False)
class Blackout:
    """What is found for a blackout.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN for markers that are not known at the edges, which they are not if seen on one side
        while others are seen on both.
    deviation : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error.
    windows : int
        How many windows taught something; 0 where it is bridged over time alone.
    """

    positions: _Floats
    expected_rms: _Floats
    windows: int


def fill_blackout(
    recordings: Sequence[Recording],
    start: int,
    stop: int,
    rate: float,
    root: Callable[[NDArray[np.intp]], RootGroup | None],
    contralateral: NDArray[np.intp],
    wanted: NDArray[np.intp],
) -> Blackout | None:
    """Fill a blackout.

    Parameters
    ----------
    recordings : sequence of Recording
        The clip, in which nothing is known of the blackout, and others.
    start, stop : int
        Frames to find.
    rate : float
        Hz.
    root : callable
        Gives the root group among some markers.
    partner : ndarray of int [shape=(markers,)]
        Each marker's partner on the other side of the body; -1 where it has none.
    wanted : ndarray of int
        The markers to be found.

    Returns
    -------
    Blackout or None
        None where neither side shows two frames.
    """
    clip = recordings[0].positions
    known = ~np.isnan(clip[..., 0])
    stencil = stencil_of(known[:, wanted], start, stop, rate)
    if stencil is None:
        return None
    whole = known[start + stencil.first : start].all(axis=0)
    whole &= known[stop : start + stencil.last].all(axis=0)
    markers = np.flatnonzero(whole)
    group = root(markers)
    windows = None
    if group is not None:
        among = contralateral_among(contralateral, markers)
        windows = gather(recordings, markers, among, start, stencil, group.among(markers))
    asked = np.arange(stencil.frames)
    inside = curves_of(stencil, rate, stencil.inside)
    beside = clip[np.ix_(start + stencil.beside, markers)][None]
    plain = draw(curves_of(stencil, rate, asked)[:1], beside)[0, 0]
    count = 0 if windows is None else len(windows.start) - 1
    if windows is None or count < FEWEST_WINDOWS:
        count = 0
        curves = draw(inside, beside)
        found = curves.mean(axis=0)[0]
        expected_rms = _unlearnt(curves, beside[0], stencil, rate)
    else:
        found, expected_rms = _learn(windows, draw(inside, windows.beside), stencil)
    correction = found - plain[stencil.inside]
    positions = np.full((stencil.frames, clip.shape[1], 3), np.nan)
    positions[:, markers] = plain + through(stencil, correction, asked)
    spread = np.full((stencil.frames, clip.shape[1]), np.nan)
    spread[:, markers] = profile(stencil, expected_rms, asked)
    return Blackout(positions, spread, count)


def _unlearnt(curves: _Floats, beside: _Floats, stencil: Stencil, rate: float) -> _Floats:
    """Return an expected error [shape=(frames, markers), mm] where no window tells it.

    Parameters
    ----------
    curves : ndarray [shape=(curves, 1, frames, markers, 3), mm]
        Through the blackout.
    beside : ndarray [shape=(frames beside, markers, 3), mm]
        What is seen.
    stencil : Stencil
        Of the blackout.
    rate : float
        Hz.
    """
    disagree = np.sqrt(curves.var(axis=0).sum(axis=-1))[0]
    away = np.full(len(stencil.inside), np.inf)
    steps = np.diff(beside, axis=0) * rate / np.diff(stencil.beside)[:, None, None]
    if len(stencil.before):
        away = np.minimum(away, stencil.inside + 1)
    if len(stencil.after):
        away = np.minimum(away, stencil.frames - stencil.inside)
    speed = np.hypot(np.sqrt((steps**2).sum(axis=-1).mean()), LEAST_SPEED)
    lost = speed * np.maximum(away / rate - PREDICTABLE, 0.0)
    expected: _Floats = np.hypot(UNLEARNT * disagree, lost[:, None])
    return expected


def _learn(windows: Windows, curves: _Floats, stencil: Stencil) -> tuple[_Floats, _Floats]:
    """Return what is found at the frames inside a blackout, and its expected error.

    Parameters
    ----------
    windows : Windows
        The blackout and the windows.
    curves : ndarray [shape=(curves, 1 + windows, frames, markers, 3), mm]
        Theirs.
    stencil : Stencil
        Of the blackout.
    """
    truth = windows.inside[1:]
    disagree = np.sqrt(curves.var(axis=0).sum(axis=-1).mean(axis=(1, 2)))
    usual = float(np.median(disagree)) + np.finfo(float).eps
    scale = np.hypot(disagree, LEAST_SCALE * usual) / usual
    # a person who stands still is told by stretches of standing still
    alike = np.exp(-0.5 * (np.log(scale[1:] / scale[0]) / ALIKE) ** 2) + ANYHOW
    own = windows.source[1:] == 0
    enough = own.sum() >= FEWEST_WINDOWS
    judged = own if enough else np.ones_like(own)
    # a database's poses are smoothed: how smooth the clip is is for its own windows to say
    taught = windows.source[1:] <= 1 if enough else judged
    weight = taught * alike / scale[1:]
    mixed = mix(curves, truth, weight)
    shape = truth.shape[1:]
    wrong = np.einsum("wqmi,wij->wqmj", truth - mixed[1:], windows.rotation[1:])
    correction, left = correct(
        windows, wrong.reshape(len(wrong), -1), scale, weight, stencil.last - stencil.first
    )
    found: _Floats = mixed[0] + correction.reshape(shape) @ windows.rotation[0].T
    by = scale**PROFILE_POWER
    relative = left.reshape(-1, *shape) / by[1:][judged][:, None, None, None]
    part = alike[judged] / alike[judged].sum()
    square = np.tensordot(part, (relative**2).sum(axis=-1), 1)
    expected_rms: _Floats = by[0] * np.sqrt(square)
    if not enough:
        # nothing of the clip itself says how far other recordings can be trusted
        drawn = curves[:, 0].mean(axis=0)
        apart = np.sqrt(((found - drawn) ** 2).sum(axis=-1))
        found, expected_rms = (found + drawn) / 2.0, np.hypot(expected_rms, apart / 2.0)
    return found, expected_rms
