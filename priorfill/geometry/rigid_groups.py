"""Groups of markers that move like one rigid body, by how much their distances vary.

`priorfill.markers.discover` makes the segments of an unknown marker set from them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.clustering import complete_linkage

__all__ = ["MIN_COMMON", "rigid_groups"]

MIN_COMMON = 25
"""Frames that must show both markers of a pair for the spread of its distance to be used."""

SPREAD_SHARE = 0.15
"""Largest spread of a distance within a segment, as a fraction of the median over all pairs, which
depends on the movement. Chosen on 14 recordings with known segments (HDM05, CMU, gait): 66 % of the
pairs put on one segment are on one (61 % and 58 % in cuts of 120 and 50 frames), and 67 % of the
pairs on one segment are found. 0.1 gives 69 % and 58 %, 0.2 gives 60 % and 74 %. Fixed thresholds
in mm and average linkage did slightly worse."""

MIN_SPREAD = 1.5
"""mm. Distances with a smaller spread count as constant: noise and soft tissue of a person who
stands still cause as much."""

MAX_SPREAD = 10.0
"""mm. Largest spread within a segment, whatever the movement. In eight of the recordings above the
90 % quantile over pairs on one segment is 2.5 to 12 mm."""

UNKNOWN_SPREAD = 1e6
"""mm. Spread of unknown pairs, which keeps them in separate groups."""


def rigid_groups(spread: NDArray[np.float64]) -> list[list[int]]:
    """Group markers whose mutual distances hardly vary.

    Uses complete linkage: the distances of *all* pairs in a group are nearly constant, so that a
    chain of joints does not become one group. The spread of two markers that are hardly ever seen
    together is estimated by way of the third marker to which both distances are most constant.

    Parameters
    ----------
    spread : ndarray [shape=(markers, markers), mm]
        Standard deviation of each pair's distance, as from
        `priorfill.geometry.distances.pair_distances`.

    Returns
    -------
    list of list of int
        Every marker in exactly one group; groups in the order of their first markers.

    See Also
    --------
    priorfill.markers.discover.discover : Makes a marker set of the groups.

    Examples
    --------
    >>> spread = np.full((3, 3), 40.0)
    >>> spread[0, 1] = spread[1, 0] = 0.5
    >>> rigid_groups(spread)
    [[0, 1], [2]]
    """
    markers = spread.shape[0]
    if markers < 2:
        return [[marker] for marker in range(markers)]
    estimated = _with_estimates(spread)
    pairs = estimated[np.triu_indices(markers, 1)]
    known = pairs[pairs < UNKNOWN_SPREAD]
    movement = float(np.median(known)) if known.size else 0.0
    threshold = min(max(SPREAD_SHARE * movement, MIN_SPREAD), MAX_SPREAD)
    return [group.tolist() for group in complete_linkage(estimated, threshold)]


def _with_estimates(spread: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``spread`` with infinite entries estimated from third markers, or unknown."""
    result = np.where(np.isfinite(spread), spread, UNKNOWN_SPREAD)
    for i, j in np.argwhere(np.triu(~np.isfinite(spread))):
        others = np.maximum(spread[i], spread[j])
        result[i, j] = result[j, i] = min(others.min(), UNKNOWN_SPREAD)
    return result
