"""Variation of the distances between markers, and the choice of three references for a gap."""

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
"""Markers that define a coordinate frame."""


def deviations(positions: Array, options: Tits2018Options) -> Array:
    """Return the standard deviation of the distance of each pair of markers.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    options : Tits2018Options
        How many frames are used.

    Returns
    -------
    ndarray [shape=(markers, markers), mm]
        Infinite on the diagonal; NaN for pairs visible together in fewer than two frames.
    """
    complete = ~np.isnan(positions[..., 0]).any(axis=1)
    if complete.sum() > options.min_complete_frames:
        positions = positions[complete]
    positions = positions[spread_evenly(len(positions), options.max_distance_frames)]
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
    """Three reference markers, and the gaps that they can fill.

    Attributes
    ----------
    markers : tuple of int
        Those with the smallest standard deviation first.
    gaps : tuple of Gap
        Gaps adjacent to which all three are visible, with a frame that shows all three.
    """

    markers: tuple[int, int, int]
    gaps: tuple[Gap, ...]


def choose(seen: Mask, marker: int, gaps: list[Gap], deviation: Array) -> Triad | None:
    """Choose the three references with the most constant distances for a marker's gaps.

    Triads are ordered by their first, then their second, then their third marker.

    Parameters
    ----------
    seen : ndarray of bool [shape=(frames, markers)]
        Which samples are known, including filled ones.
    marker : int
        The missing marker.
    gaps : list of Gap
        Its gaps.
    deviation : ndarray [shape=(markers,), mm]
        Standard deviation of its distance from each marker.

    Returns
    -------
    Triad or None
        None where no three markers can fill any gap.
    """
    order = np.argsort(deviation, kind="stable")
    order = order[(order != marker) & ~np.isnan(deviation[order])]
    usable = [_usable(seen, gap, order) for gap in gaps]
    first = [_first_together(inside, adjacent) for adjacent, inside in usable]
    known = [places for places in first if places is not None]
    if not known:
        return None
    best = min(known)
    at = list(best)
    good = tuple(
        gap
        for gap, (adjacent, inside) in zip(gaps, usable, strict=True)
        if adjacent[at].all() and inside[:, at].all(axis=1).any()
    )
    one, two, three = (int(order[place]) for place in best)
    return Triad((one, two, three), good)


def _usable(seen: Mask, gap: Gap, order: NDArray[np.intp]) -> tuple[Mask, Mask]:
    """Return which markers are visible adjacent to a gap, and which in each of its frames.

    At an end of the clip only the other side counts.
    """
    adjacent = np.ones(len(order), dtype=bool)
    if gap.start > 0:
        adjacent &= seen[gap.start - 1, order]
    if gap.stop < len(seen):
        adjacent &= seen[gap.stop, order]
    return adjacent, seen[gap.start : gap.stop][:, order]


def _first_together(inside: Mask, adjacent: Mask) -> tuple[int, int, int] | None:
    """Return the first three of the adjacent markers that a frame of the gap shows together."""
    among = np.flatnonzero(adjacent & inside.any(axis=0))
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
