"""How stiffly markers keep their distance, and which three are the references of a gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap
from priorfill.methods.tits2018.tits2018_options import Tits2018Options, spread_evenly

__all__ = ["Triad", "choose", "deviations"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REFERENCES = 3
"""Markers that make a frame."""


def deviations(positions: Array, options: Tits2018Options) -> Array:
    """Return the standard deviation of the distance of each pair of markers.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    options : Tits2018Options
        Which frames count.

    Returns
    -------
    ndarray [shape=(markers, markers), mm]
        Infinite for a marker and itself; NaN for pairs seen together in less than two frames.
    """
    whole = ~np.isnan(positions[..., 0]).any(axis=1)
    if whole.sum() > options.complete:
        positions = positions[whole]
    positions = positions[spread_evenly(len(positions), options.distance_rows)]
    markers = positions.shape[1]
    out = np.full((markers, markers), np.inf)
    for marker in range(markers - 1):
        apart = positions[:, marker + 1 :] - positions[:, marker : marker + 1]
        distance = np.sqrt(np.einsum("fmi,fmi->fm", apart, apart))
        known = ~np.isnan(distance)
        count = known.sum(axis=0)
        mean = np.where(known, distance, 0.0).sum(axis=0) / np.maximum(count, 1)
        square = np.where(known, distance - mean, 0.0) ** 2
        deviation = np.sqrt(square.sum(axis=0) / np.maximum(count - 1, 1))
        out[marker, marker + 1 :] = np.where(count > 1, deviation, np.nan)
        out[marker + 1 :, marker] = out[marker, marker + 1 :]
    return out


@dataclass(frozen=True)
class Triad:
    """Three references, and the gaps that they can fill.

    Attributes
    ----------
    markers : tuple of int
        The stiffest first.
    gaps : tuple of Gap
        Gaps beside which all three are seen, and in which they are seen together.
    """

    markers: tuple[int, int, int]
    gaps: tuple[Gap, ...]


def choose(seen: Mask, marker: int, gaps: list[Gap], deviation: Array) -> Triad | None:
    """Choose the stiffest three references that can fill at least one of a marker's gaps.

    Triads are tried in order of their first, then their second, then their third marker.

    Parameters
    ----------
    seen : ndarray of bool [shape=(frames, markers)]
        Which samples are known, filled ones included.
    marker : int
        The missing one.
    gaps : list of Gap
        Its gaps.
    deviation : ndarray [shape=(markers,), mm]
        Of its distance from each marker.

    Returns
    -------
    Triad or None
        None where no three markers can fill any gap.
    """
    order = np.argsort(deviation, kind="stable")
    order = order[(order != marker) & ~np.isnan(deviation[order])]
    usable = [_usable(seen, gap, order) for gap in gaps]
    first = [_first_together(inside, beside) for beside, inside in usable]
    known = [places for places in first if places is not None]
    if not known:
        return None
    best = min(known)
    at = list(best)
    good = tuple(
        gap
        for gap, (beside, inside) in zip(gaps, usable, strict=True)
        if beside[at].all() and inside[:, at].all(axis=1).any()
    )
    one, two, three = (int(order[place]) for place in best)
    return Triad((one, two, three), good)


def _usable(seen: Mask, gap: Gap, order: NDArray[np.intp]) -> tuple[Mask, Mask]:
    """Return which markers are seen beside a gap, and which in each of its frames.

    Beyond an end of the clip there is nothing to be seen.
    """
    beside = np.ones(len(order), dtype=bool)
    if gap.start > 0:
        beside &= seen[gap.start - 1, order]
    if gap.stop < len(seen):
        beside &= seen[gap.stop, order]
    return beside, seen[gap.start : gap.stop][:, order]


def _first_together(inside: Mask, beside: Mask) -> tuple[int, int, int] | None:
    """Return the first three markers, of those seen beside, that some frame shows together."""
    among = np.flatnonzero(beside & inside.any(axis=0))
    if len(among) < REFERENCES:
        return None
    shown = inside[:, among]
    for one in range(len(among) - 2):
        with_one = shown[shown[:, one]]
        for two in range(one + 1, len(among) - 1):
            three = with_one[with_one[:, two], two + 1 :].any(axis=0)
            if three.any():
                third = two + 1 + int(three.argmax())
                return int(among[one]), int(among[two]), int(among[third])
    return None
