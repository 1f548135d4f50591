"""Groups of things that are near each other, by a matrix of distances.

For tens or hundreds of markers. SciPy's hierarchical clustering does the same, but takes a third of
a second to import, which is most of what a fill of short gaps takes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["complete_linkage", "single_linkage"]


def single_linkage(distance: NDArray[np.float64], most: float) -> list[NDArray[np.intp]]:
    """Group what a chain of steps of some length joins (single linkage).

    Parameters
    ----------
    distance : ndarray [shape=(things, things)]
        Symmetric.
    most : float
        Longest step of a chain.

    Returns
    -------
    list of ndarray of int
        Every thing in exactly one group, ascending; groups in the order of their first things.
    """
    near = distance <= most
    left = np.ones(len(distance), dtype=bool)
    groups = []
    for first in range(len(distance)):
        if not left[first]:
            continue
        group = np.zeros(len(distance), dtype=bool)
        added = np.arange(len(distance)) == first
        while added.any():
            group |= added
            added = near[added].any(axis=0) & ~group
        left &= ~group
        groups.append(np.flatnonzero(group))
    return groups


def complete_linkage(distance: NDArray[np.float64], most: float) -> list[NDArray[np.intp]]:
    """Group what is all near each other (complete linkage).

    The two groups whose farthest members are nearest to each other become one, again and again,
    while these are no farther apart than allowed.

    Parameters
    ----------
    distance : ndarray [shape=(things, things)]
        Symmetric; .
    most : float
        Greatest, finite distance inside a group.

    Returns
    -------
    list of ndarray of int
        Every thing in exactly one group, ascending; groups in the order of their first things.
    """
    farthest = distance.astype(np.float64)
    np.fill_diagonal(farthest, np.inf)
    group_of = np.arange(len(distance))
    while True:
        # a group is told by its first thing, whose row and column hold its distances
        one, other = np.unravel_index(np.argmin(farthest), farthest.shape)
        if not farthest[one, other] <= most:
            break
        group_of[group_of == other] = one
        farthest[one] = farthest[:, one] = np.maximum(farthest[one], farthest[other])
        farthest[other] = farthest[:, other] = np.inf
        farthest[one, one] = np.inf
    return [np.flatnonzero(group_of == first) for first in np.unique(group_of)]
