"""Divide very many markers into neighbourhoods, so that pairs of distant ones need no look.

The pairs of 10,000 markers are 100 million. No body has as many markers as `MAX_DENSE_MARKERS`;
files with more hold several bodies, a face or cloth, or every reflection in the room. What is far
away tells nothing about a marker there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced

__all__ = ["MAX_DENSE_MARKERS", "mean_places", "neighbourhoods"]

MAX_DENSE_MARKERS = 250
"""Markers up to which all pairs are considered: twice as many as on the body, hands and face of one
subject."""

NEIGHBOURHOOD_MARKERS = 64
"""Markers of a neighbourhood at most: about as many as on one body."""

MAX_FRAMES = 200
"""Frames, evenly spaced, whose mean position places a marker."""


def mean_places(positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the mean position of each marker [shape=(markers, 3), mm]; NaN where never visible.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing. A marker that none of `MAX_FRAMES` frames shows is looked for in all.
    """
    places = np.full(positions.shape[1:], np.nan)
    unseen = np.arange(positions.shape[1])
    for frames in (evenly_spaced(len(positions), MAX_FRAMES), slice(None)):
        sample = np.asarray(positions[frames][:, unseen], dtype=np.float64)
        count = (~np.isnan(sample[..., 0])).sum(axis=0)
        total = np.nansum(sample, axis=0)
        places[unseen] = np.where(count[:, None] > 0, total, np.nan) / np.maximum(count, 1)[:, None]
        unseen = unseen[count == 0]
        if not len(unseen):
            break
    return places


def neighbourhoods(
    positions: NDArray[np.floating], max_markers: int = NEIGHBOURHOOD_MARKERS
) -> list[NDArray[np.intp]]:
    """Divide markers into groups of neighbours, by halves along the longest extent.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    max_markers : int
        Markers of a group at most.

    Returns
    -------
    list of ndarray of int
        Every marker in exactly one group, ascending; groups in the order of their first markers.

    Examples
    --------
    >>> positions = np.zeros((5, 4, 3))
    >>> positions[:, :, 0] = [0.0, 900.0, 10.0, 910.0]
    >>> [group.tolist() for group in neighbourhoods(positions, 2)]
    [[0, 2], [1, 3]]
    """
    places = mean_places(positions)
    seen = ~np.isnan(places[:, 0])
    places[~seen] = places[seen].mean(axis=0) if seen.any() else 0.0
    groups = []
    waiting = [np.arange(len(places))]
    while waiting:
        group = waiting.pop()
        if len(group) <= max_markers:
            groups.append(group)
            continue
        axis = int(np.argmax(np.ptp(places[group], axis=0)))
        order = np.argsort(places[group, axis], kind="stable")
        half = len(group) // 2
        waiting += [np.sort(group[order[:half]]), np.sort(group[order[half:]])]
    return sorted(groups, key=lambda group: int(group[0]))
