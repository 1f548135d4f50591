"""Hold the distances between markers of one segment: bones neither stretch nor shrink.

A prediction is a mean over plausible poses, and averaging the directions of an arm shortens it.
Distances that hardly vary where they are measured are therefore held in the prediction, by the
second term of the least squares

    sum_i |x_i - p_i|² / σ_i²  +  sum_ij (|x_i - x_j| - L_ij)² / (c² s_ij² + r² σ_i²)

in each frame. p_i is the predicted position with standard deviation σ_i per coordinate, L_ij and
s_ij are mean and standard deviation of the distance in the clip, and c and r are the fields
``spread_factor`` and ``relative_tolerance`` of `SegmentLengthOptions`. The minimum is found by
Gauss-Newton steps, halved where a full step would increase the sum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.constraints.distance_terms import (
    MAX_CONSTRAINED_SPREAD,
    DistanceTerms,
    coordinate_variance,
    energy,
    gauss_newton_step,
    normal_equations,
)
from priorfill.runtime.option_checks import check_at_least

__all__ = ["LengthEdges", "SegmentLengthOptions", "choose_length_edges", "hold_lengths"]

MAX_ITERATIONS = 12
"""Gauss-Newton steps. Three nearly always come within a thousandth of the minimum."""

MAX_HALVINGS = 6
"""How often a step that increases the sum of squares is halved."""

CONVERGED = 1e-5
"""mm. Frames in which no coordinate moves farther in a step are finished; no file format stores
smaller differences."""

BATCH_SIZE = 500
"""Frames solved together: their matrices fit into the cache, however long the gap is."""


@dataclass(frozen=True)
class SegmentLengthOptions:
    """Which distances are held, and how tightly.

    Attributes
    ----------
    max_spread : float
        mm. Distances with a larger standard deviation in the clip are not held.
    spread_factor : float
        Multiple of a length's standard deviation used as its tolerance. A length changes with the
        pose, which a regression on a few markers predicts better than a mean does. With 1,
        predictions accurate to a millimetre degrade.
    relative_tolerance : float
        Additional tolerance, relative to the expected error of the prediction. Predictions are
        more accurate when they are drawn towards their lengths than when they are forced to them.
    """

    max_spread: float = MAX_CONSTRAINED_SPREAD
    spread_factor: float = 2.0
    relative_tolerance: float = 0.5

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "max_spread", "spread_factor")
        check_at_least(self, 1e-6, "relative_tolerance")


@dataclass(frozen=True, eq=False)
class LengthEdges:
    """Pairs of markers whose distance is to be held.

    Attributes
    ----------
    first, second : ndarray of int [shape=(edges,)]
        Columns of the markers: the missing ones come first, then the visible ones. ``first`` is a
        missing marker.
    length, spread : ndarray [shape=(edges,), mm]
        Mean and standard deviation of the distance.
    """

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    length: NDArray[np.float64]
    spread: NDArray[np.float64]

    def anchored(self, markers: int) -> tuple[NDArray[np.intp], LengthEdges]:
        """Return the visible markers that have an edge, and the edges renumbered to these alone.

        Parameters
        ----------
        markers : int
            Number of missing markers.

        Returns
        -------
        anchors : ndarray of int
            Ascending indices into the visible markers.
        edges : LengthEdges
            Columns: the missing markers, then the anchors.
        """
        to_visible = self.second >= markers
        anchors, column = np.unique(self.second[to_visible] - markers, return_inverse=True)
        second = self.second.copy()
        second[to_visible] = markers + column
        return anchors, replace(self, second=second)


def choose_length_edges(
    distance: NDArray[np.float64],
    spread: NDArray[np.float64],
    missing: NDArray[np.intp],
    visible: NDArray[np.intp],
    options: SegmentLengthOptions = SegmentLengthOptions(),
) -> LengthEdges:
    """Choose the distances to be held: a tree of the most constant ones.

    In the minimum spanning tree by standard deviation, each missing marker is linked to another
    missing one or to the visible marker to which its distance is most constant.

    Parameters
    ----------
    distance, spread : ndarray [shape=(markers, markers), mm]
        As returned by `priorfill.geometry.distances.pair_distances`.
    missing, visible : ndarray of int
        Markers that are predicted, and those that are measured.
    options : SegmentLengthOptions

    Returns
    -------
    LengthEdges
        At most one edge per missing marker.

    See Also
    --------
    hold_lengths : Applies them.
    """
    among_missing = spread[np.ix_(missing, missing)]
    to_visible = spread[np.ix_(missing, visible)]
    graph = np.full((len(missing) + 1, len(missing) + 1), np.inf)
    graph[:-1, :-1] = among_missing
    graph[:-1, -1] = to_visible.min(axis=1, initial=np.inf)  # the last node: all visible markers
    constrained = np.isfinite(graph) & (graph < options.max_spread)
    first, second = _spanning_tree(np.where(constrained, graph, np.inf))
    outward = second == len(missing)
    if outward.any():
        second[outward] += np.argmin(to_visible[first[outward]], axis=1)
    columns = np.concatenate([missing, visible])
    a, b = missing[first], columns[second]
    return LengthEdges(first.astype(np.intp), second.astype(np.intp), distance[a, b], spread[a, b])


def _spanning_tree(cost: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the ends of the edges of a minimum spanning forest (Kruskal), the lesser one first.

    Parameters
    ----------
    cost : ndarray [shape=(nodes, nodes)]
        Only the part above the diagonal is used; infinite where there is no edge.
    """
    first, second = np.nonzero(
        np.isfinite(np.triu(cost, 1)) & np.triu(np.ones(cost.shape, bool), 1)
    )
    component = np.arange(len(cost))
    chosen = []
    for edge in np.argsort(cost[first, second], kind="stable"):
        one, other = component[first[edge]], component[second[edge]]
        if one != other:
            component[component == other] = one
            chosen.append(edge)
    edges = np.sort(np.array(chosen, dtype=np.intp))
    return first[edges], second[edges]


def hold_lengths(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    visible: NDArray[np.float64],
    edges: LengthEdges,
    options: SegmentLengthOptions = SegmentLengthOptions(),
) -> NDArray[np.float64]:
    """Move predicted markers towards their known distances from each other and from visible ones.

    Parameters
    ----------
    predicted : ndarray [shape=(frames, missing markers, 3), mm]
    expected_rms : ndarray [shape=(frames, missing markers), mm]
        Expected rms Euclidean error of the predictions.
    visible : ndarray [shape=(frames, visible markers, 3), mm]
        Measured positions.
    edges : LengthEdges
        The distances to be held.
    options : SegmentLengthOptions

    Returns
    -------
    ndarray [shape=(frames, missing markers, 3), mm]

    See Also
    --------
    choose_length_edges : Chooses the distances.
    """
    if not len(edges.first):
        return predicted
    held = np.empty_like(predicted)
    for start in range(0, len(predicted), BATCH_SIZE):
        batch = slice(start, start + BATCH_SIZE)
        held[batch] = _hold_batch(
            predicted[batch], expected_rms[batch], visible[batch], edges, options
        )
    return held


def _hold_batch(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    visible: NDArray[np.float64],
    edges: LengthEdges,
    options: SegmentLengthOptions,
) -> NDArray[np.float64]:
    """Do the work of `hold_lengths` for a batch of frames."""
    markers = predicted.shape[1]
    points = np.concatenate([predicted, visible], axis=1)
    variance = coordinate_variance(expected_rms)
    relative = options.relative_tolerance**2 * variance[:, edges.first]  # (frames, edges)
    weight = 1.0 / ((options.spread_factor * edges.spread) ** 2 + relative)

    moving = np.arange(len(points))
    for _ in range(MAX_ITERATIONS):
        here, target, target_variance = points[moving], predicted[moving], variance[moving]
        terms = DistanceTerms(edges.first, edges.second, edges.length[:, None], weight[moving].T)
        reached = energy(here, target, target_variance, terms)
        move = np.zeros_like(here)
        move[:, :markers] = gauss_newton_step(
            *normal_equations(here, target, target_variance, terms)
        )
        # a full step can rotate short links so far that the sum increases
        for _ in range(MAX_HALVINGS):
            uphill = energy(here + move, target, target_variance, terms) > reached
            if not uphill.any():
                break
            move[uphill] *= 0.5
        points[moving] += move
        moving = moving[np.abs(move).max(axis=(1, 2)) > CONVERGED]
        if not len(moving):
            break
    return points[:, :markers]
