"""Hierarchical clustering of a few hundred items, given their distances.

SciPy's hierarchical clustering gives the same groups, but takes a third of a second to import,
most of the time that short gaps take to fill.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["complete_linkage", "single_linkage"]


def single_linkage(distance: NDArray[np.float64], max_step: float) -> list[NDArray[np.intp]]:
    """Group items that are connected by steps of limited length (single linkage).

    Parameters
    ----------
    distance : ndarray [shape=(items, items)]
        Symmetric.
    max_step : float
        Longest step between two items of a group.

    Returns
    -------
    list of ndarray of int
        Every item in exactly one group, ascending; groups in the order of their first items.

    See Also
    --------
    complete_linkage : Limits all distances within a group.

    Examples
    --------
    >>> places = np.array([0.0, 1.0, 2.0, 9.0])
    >>> [group.tolist() for group in single_linkage(np.abs(places[:, None] - places), 1.0)]
    [[0, 1, 2], [3]]
    """
    near = distance <= max_step
    ungrouped = np.ones(len(distance), dtype=bool)
    groups = []
    for first in range(len(distance)):
        if not ungrouped[first]:
            continue
        group = np.zeros(len(distance), dtype=bool)
        added = np.arange(len(distance)) == first
        while added.any():
            group |= added
            added = near[added].any(axis=0) & ~group
        ungrouped &= ~group
        groups.append(np.flatnonzero(group))
    return groups


def complete_linkage(distance: NDArray[np.float64], max_diameter: float) -> list[NDArray[np.intp]]:
    """Group items so that all distances within a group are limited (complete linkage).

    Repeatedly merges the two groups with the smallest distance between their farthest items, until
    that distance exceeds the limit.

    Parameters
    ----------
    distance : ndarray [shape=(items, items)]
        Symmetric; infinite for items that must not be in one group.
    max_diameter : float
        Largest distance within a group; finite.

    Returns
    -------
    list of ndarray of int
        Every item in exactly one group, ascending; groups in the order of their first items.

    See Also
    --------
    single_linkage : Limits the steps between neighbours only.

    Examples
    --------
    >>> places = np.array([0.0, 1.0, 2.0, 9.0])
    >>> [group.tolist() for group in complete_linkage(np.abs(places[:, None] - places), 1.0)]
    [[0, 1], [2], [3]]
    """
    farthest = distance.astype(np.float64)
    np.fill_diagonal(farthest, np.inf)
    group_of = np.arange(len(distance))
    while True:
        # a group is represented by its first item, whose row and column hold its distances
        one, other = np.unravel_index(np.argmin(farthest), farthest.shape)
        if not farthest[one, other] <= max_diameter:
            break
        group_of[group_of == other] = one
        farthest[one] = farthest[:, one] = np.maximum(farthest[one], farthest[other])
        farthest[other] = farthest[:, other] = np.inf
        farthest[one, one] = np.inf
    return [np.flatnonzero(group_of == first) for first in np.unique(group_of)]
