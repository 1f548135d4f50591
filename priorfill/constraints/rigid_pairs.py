"""Hold the distances between the markers of a blackout that are nearly constant.

In a blackout no visible marker shows where a segment is: its markers are predicted one by one, and
the errors of each differ. A predicted segment is therefore deformed, and its true shape, the
measured distances of all its pairs of markers, corrects each of them by the others.

Markers are divided into groups by single linkage of the most constant distances, and each group is
solved by itself, by the least squares of `priorfill.constraints.segment_lengths`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.constraints.segment_lengths import LengthEdges, SegmentLengthOptions, hold_lengths
from priorfill.runtime.option_checks import check_at_least

__all__ = ["RigidPairOptions", "hold_rigid_pairs", "rigid_marker_groups"]


@dataclass(frozen=True)
class RigidPairOptions:
    """Which distances are held in blackouts, and how tightly.

    Chosen on 16 blackouts of 0.2 to 1.5 s in recordings and 16 in a library of virtual markers.

    Attributes
    ----------
    max_spread : float
        mm. Distances with a larger standard deviation in the clip are not held.
    spread_factor : float
        Multiple of a distance's standard deviation used as its tolerance: a marker is in many
        pairs, whose deviations are not independent. With 2, blackouts that are predicted to a few
        mm degrade by up to 4 %.
    relative_tolerance : float
        Additional tolerance, relative to the expected error of the prediction.
    max_markers : int
        Markers that are solved together at most: the time grows with the cube of their number.
    """

    max_spread: float = 10.0
    spread_factor: float = 4.0
    relative_tolerance: float = 0.5
    max_markers: int = 48

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "max_spread", "spread_factor")
        check_at_least(self, 1e-6, "relative_tolerance")
        check_at_least(self, 1, "max_markers")


def rigid_marker_groups(
    spread: NDArray[np.float64], options: RigidPairOptions = RigidPairOptions()
) -> list[NDArray[np.intp]]:
    """Divide markers into groups that nearly constant distances link, the most constant ones first.

    Parameters
    ----------
    spread : ndarray [shape=(markers, markers), mm]
        Standard deviation of the distance of each pair; infinite where unknown.
    options : RigidPairOptions
        Greatest spread, and number of markers of a group at most.

    Returns
    -------
    list of ndarray of int
        Ascending; groups of a single marker are left out.

    Examples
    --------
    >>> spread = np.full((4, 4), 90.0)
    >>> spread[0, 2] = spread[2, 0] = 1.5
    >>> rigid_marker_groups(spread)
    [array([0, 2])]
    """
    first, second = np.nonzero(np.triu(spread < options.max_spread, 1))
    group = np.arange(len(spread))
    size = np.ones(len(spread), dtype=np.intp)
    for pair in np.argsort(spread[first, second], kind="stable"):
        one, other = group[first[pair]], group[second[pair]]
        if one != other and size[one] + size[other] <= options.max_markers:
            group[group == other] = one
            size[one] += size[other]
    numbers, count = np.unique(group, return_counts=True)
    return [np.flatnonzero(group == number) for number in numbers[count > 1]]


def hold_rigid_pairs(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    distance: NDArray[np.float64],
    spread: NDArray[np.float64],
    options: RigidPairOptions = RigidPairOptions(),
) -> NDArray[np.float64]:
    """Move predicted markers towards their known distances from each other.

    Parameters
    ----------
    predicted : ndarray [shape=(frames, markers, 3), mm]
    expected_rms : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error of the predictions.
    distance, spread : ndarray [shape=(markers, markers), mm]
        As returned by `priorfill.geometry.distances.pair_distances`.
    options : RigidPairOptions
        Which distances are held, and how tightly.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]

    See Also
    --------
    priorfill.constraints.segment_lengths.hold_lengths : With visible markers.
    """
    held = predicted.copy()
    lengths = SegmentLengthOptions(
        options.max_spread, options.spread_factor, options.relative_tolerance
    )
    for group in rigid_marker_groups(spread, options):
        inside = np.ix_(group, group)
        first, second = np.nonzero(np.triu(spread[inside] < options.max_spread, 1))
        pair = group[first], group[second]
        edges = LengthEdges(first, second, distance[pair], spread[pair])
        none = np.empty((len(predicted), 0, 3))
        held[:, group] = hold_lengths(
            predicted[:, group], expected_rms[:, group], none, edges, lengths
        )
    return held
