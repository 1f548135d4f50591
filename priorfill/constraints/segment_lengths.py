"""Hold the distances of markers on one segment: bones neither stretch nor shrink.

A prediction is a mean over movements that might have been, and the mean of an arm's directions is
a shorter arm. The distances that hardly vary where they are measured are held in what is predicted,
by a term of the least squares

    sum_i |x_i - p_i|² / σ_i²  +  sum_ij (|x_i - x_j| - L_ij)² / s_ij²

in each frame: p_i is what was predicted, with deviation σ_i a coordinate; L_ij and its spread are
measured in the clip. The minimum is found by Gauss-Newton steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import minimum_spanning_tree

from priorfill.constraints.distance_terms import (
    STIFF,
    coordinate_variance,
    energy,
    normal_equations,
    step,
)

__all__ = ["Edges", "hold_lengths", "stiff_edges"]

SOFTNESS = 0.5
"""How far lengths give way, in deviations of what is predicted: predictions are better pulled
towards their lengths than onto them."""

CAUTION = 2.0
"""How many times its spread a length is off by at worst: it changes with the pose, which a
regression of a few markers knows better. With 1, what is known to a millimetre gets worse."""

LEAST_SPREAD = 0.1
"""mm. No distance is known better."""

STEPS = 12
"""Gauss-Newton steps: to a part in a thousand of the least squares, nearly always in three."""

HALVINGS = 6
"""How often a step that leads uphill is halved."""

STILL = 1e-5
"""mm. Frames whose markers a step moves by no more are done: no file holds that much."""

AT_ONCE = 500
"""Frames that are solved together: their matrices stay in the cache, however long the gap is."""


@dataclass(frozen=True, eq=False)
class Edges:
    """Distances to be held.

    Attributes
    ----------
    one, other : ndarray of int [shape=(edges,)]
        Columns of the markers: missing ones come first, then visible ones. ``one`` is missing.
    length, spread : ndarray [shape=(edges,), mm]
        Distance and how much it varies.
    """

    one: NDArray[np.intp]
    other: NDArray[np.intp]
    length: NDArray[np.float64]
    spread: NDArray[np.float64]

    def anchored(self, markers: int) -> tuple[NDArray[np.intp], Edges]:
        """Return the visible markers that something hangs on, and edges to these alone.

        Parameters
        ----------
        markers : int
            How many are missing.

        Returns
        -------
        anchors : ndarray of int
            Among the visible markers.
        edges : Edges
            With columns of the missing markers and the anchors.
        """
        on_body = self.other >= markers
        anchors, place = np.unique(self.other[on_body] - markers, return_inverse=True)
        other = self.other.copy()
        other[on_body] = markers + place
        return anchors, replace(self, other=other)


def stiff_edges(
    distance: NDArray[np.float64],
    spread: NDArray[np.float64],
    missing: NDArray[np.intp],
    visible: NDArray[np.intp],
) -> Edges:
    """Choose the distances that are to be held.

    Parameters
    ----------
    distance, spread : ndarray [shape=(markers, markers), mm]
        As `priorfill.geometry.distances.pair_distances` gives them.
    missing, visible : ndarray of int
        Markers that are predicted, and those that are measured.
    """
    # a tree of the stiffest: each marker hangs on another missing one, or on the visible body
    inner = spread[np.ix_(missing, missing)]
    outer = spread[np.ix_(missing, visible)]
    graph = np.full((len(missing) + 1, len(missing) + 1), np.inf)
    graph[:-1, :-1] = inner
    graph[:-1, -1] = outer.min(axis=1, initial=np.inf)
    held = np.where(np.isfinite(graph) & (graph < STIFF), graph + LEAST_SPREAD, 0.0)
    one, other = minimum_spanning_tree(np.triu(held, 1)).nonzero()
    body = other == len(missing)
    if body.any():
        other[body] += np.argmin(outer[one[body]], axis=1)
    among = np.concatenate([missing, visible])
    a, b = missing[one], among[other]
    return Edges(one.astype(np.intp), other.astype(np.intp), distance[a, b], spread[a, b])


def hold_lengths(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    visible: NDArray[np.float64],
    edges: Edges,
) -> NDArray[np.float64]:
    """Pull predicted markers towards their distances from each other and from visible ones.

    Parameters
    ----------
    predicted : ndarray [shape=(frames, missing markers, 3), mm]
    deviation : ndarray [shape=(frames, missing markers), mm]
        Expected rms Euclidean error.
    visible : ndarray [shape=(frames, visible markers, 3), mm]
    edges : Edges
        Which distances.

    Returns
    -------
    ndarray [shape=(frames, missing markers, 3), mm]
    """
    if not len(edges.one):
        return predicted
    held = np.empty_like(predicted)
    for start in range(0, len(predicted), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        held[some] = _held(predicted[some], expected_rms[some], visible[some], edges)
    return held


def _held(
    predicted: NDArray[np.float64],
    expected_rms: NDArray[np.float64],
    visible: NDArray[np.float64],
    edges: Edges,
) -> NDArray[np.float64]:
    """Do the same to a part of the frames."""
    markers = predicted.shape[1]
    points = np.concatenate([predicted, visible], axis=1)
    variance = coordinate_variance(expected_rms)
    softness = SOFTNESS**2 * variance[:, edges.one]  # (frames, edges)
    weight = 1.0 / ((CAUTION * edges.spread) ** 2 + softness)

    moving = np.arange(len(points))
    for _ in range(STEPS):
        here, target, doubt = points[moving], predicted[moving], variance[moving]
        springs = list(zip(edges.one, edges.other, edges.length, weight[moving].T, strict=True))
        reached = energy(here, target, doubt, springs)
        move = np.zeros_like(here)
        move[:, :markers] = step(*normal_equations(here, target, doubt, springs))
        # short links turn under a whole step, which may then lead uphill
        for _ in range(HALVINGS):
            uphill = energy(here + move, target, doubt, springs) > reached
            if not uphill.any():
                break
            move[uphill] *= 0.5
        points[moving] += move
        moving = moving[np.abs(move).max(axis=(1, 2)) > STILL]
        if not len(moving):
            break
    return points[:, :markers]
