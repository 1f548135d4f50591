"""Which markers move as one rigid body: how much their mutual distances vary.

Arrays only; `priorfill.markers.marker_set` makes a marker set of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.clustering import complete_linkage

__all__ = ["MIN_COMMON", "rigid_groups"]

MIN_COMMON = 25
"""Frames in which both markers must be seen before their distance says anything."""

SPREAD_SHARE = 0.15
"""Markers of one segment: the distance of any two of them varies by less than this share of
the median over all pairs; how far segments move against each other is a matter of the movement.
Chosen on 14 takes of known segments (HDM05, CMU, gait): of the pairs said to be on one segment
66 % are (61 % and 58 % in cuts of 120 and 50 frames), and 67 % of those that are get found.
0.1 gives 69 % and 58 %, 0.2 gives 60 % and 74 %. Fixed numbers of mm and average linkage did
slightly worse."""

MIN_SPREAD = 1.5
"""mm. Below this, distances are constant whatever the movement: noise of the cameras and
of the skin in someone who stands still."""

MAX_SPREAD = 10.0
"""mm. Above this, markers are not on one bone, however wild the movement: on eight of the takes
above, nine in ten pairs of one segment stay below 2.5 to 12 mm, by take."""

UNKNOWN = 1e6
"""mm. Stands for the spread of a pair of which nothing is known, which must not be joined."""


def rigid_groups(spread: NDArray[np.float64]) -> list[list[int]]:
    """Return groups of markers whose mutual distances hardly vary.

    Hierarchical clustering with complete linkage: the distances of *all* pairs in a group stay
    constant, so that a chain of joints does not become one group. Two markers that are hardly
    ever seen together are judged by the third marker to which both keep their distance best.

    Parameters
    ----------
    spread : ndarray [shape=(markers, markers), mm]
        Standard deviation of each pair's distance, as from
        `priorfill.geometry.distances.pair_distances`.

    Returns
    -------
    list of list of int
        Every marker in exactly one group; groups in the order of their first markers.
    """
    markers = spread.shape[0]
    if markers < 2:
        return [[marker] for marker in range(markers)]
    apart = _through_companions(spread)
    pairs = apart[np.triu_indices(markers, 1)]
    known = pairs[pairs < UNKNOWN]
    movement = float(np.median(known)) if known.size else 0.0
    threshold = min(max(SPREAD_SHARE * movement, MIN_SPREAD), MAX_SPREAD)
    return [group.tolist() for group in complete_linkage(apart, threshold)]


def _through_companions(spread: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `spread` with its infinite entries estimated from third markers, else `UNKNOWN`."""
    result = np.where(np.isfinite(spread), spread, UNKNOWN)
    for i, j in np.argwhere(np.triu(~np.isfinite(spread))):
        others = np.maximum(spread[i], spread[j])
        result[i, j] = result[j, i] = min(others.min(), UNKNOWN)
    return result
