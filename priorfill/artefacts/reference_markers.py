"""Which other markers each marker is judged by: those that it keeps its distance to.

Trouble must not choose its own judges: a spread of distances is taken within short blocks of
time, where a label that changed its marker half-way counts once, and then over the blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ReferenceMarkers", "choose_reference_markers", "distances", "sample_poses"]

PARTNERS = 4
"""Of each marker. Three make a frame of reference; one more, as one of them may be in trouble."""

BLOCKS = 12
"""Of time, spread over the clip."""

POSES = 20
"""Looked at in each block."""

FEWEST = 5
"""Poses of a block that must show a pair."""

MIDDLE = 0.5
"""Quantile of the blocks' spreads that is taken: in half of the blocks a marker may be in
trouble."""

REACH = 0.03
"""Of the distance, added to the spread: of two markers that are equally firm, the nearer is the
better judge. 1 mm at a hand's width, 30 mm at arm's length."""


@dataclass(frozen=True)
class ReferenceMarkers:
    """Who judges whom.

    Attributes
    ----------
    others : ndarray of int [shape=(markers, partners)]
        Partners of each marker, the firmest first.
    known : ndarray of bool [shape=(markers, partners)]
        Which of them are any; others of a marker without enough partners are itself.
    """

    others: NDArray[np.intp]
    known: NDArray[np.bool_]

    def of(self, marker: int) -> NDArray[np.intp]:
        """Return the partners of a marker, the firmest first."""
        others: NDArray[np.intp] = self.others[marker, self.known[marker]]
        return others


def choose_reference_markers(positions: NDArray[np.float64]) -> ReferenceMarkers:
    """Choose the partners of each marker.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    """
    frames, markers = positions.shape[:2]
    poses = sample_poses(frames)
    count = min(PARTNERS, markers - 1)
    own = np.arange(markers)[:, None]
    if count < 1:
        return ReferenceMarkers(own.astype(np.intp), np.zeros((markers, 1), dtype=bool))
    some = positions[poses]  # (blocks, poses, markers, 3)
    one, other = np.triu_indices(markers, 1)
    between = np.sqrt(((some[:, :, one] - some[:, :, other]) ** 2).sum(axis=3))
    seen = np.isfinite(between)
    number = seen.sum(axis=1)
    between = np.where(seen, between, 0.0)
    divisor = np.maximum(number, 1)
    mean = between.sum(axis=1) / divisor
    spread = np.sqrt(np.maximum((between**2).sum(axis=1) / divisor - mean**2, 0.0))
    enough = number >= min(FEWEST, poses.shape[1])
    spread = np.sort(np.where(enough, spread, np.inf), axis=0)
    valid = enough.sum(axis=0)
    at = np.minimum((MIDDLE * valid).astype(np.intp), np.maximum(valid - 1, 0))
    usual = np.where(enough, mean, 0.0).sum(axis=0) / np.maximum(valid, 1)
    score = spread[at, np.arange(len(one))] + REACH * usual
    table = np.full((markers, markers), np.inf)
    table[one, other] = table[other, one] = np.where(valid > 0, score, np.inf)
    order = np.argsort(table, axis=1, kind="stable")[:, :count]
    known = np.isfinite(np.take_along_axis(table, order, axis=1))
    return ReferenceMarkers(np.where(known, order, own).astype(np.intp), known)


def distances(
    positions: NDArray[np.float64], marker: int, others: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return how far a marker is from some others.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    marker : int
        The marker.
    others : ndarray of int [shape=(others,)]
        The others.

    Returns
    -------
    ndarray [shape=(frames, others), mm]
        NaN where one of the two is missing.
    """
    apart = positions[:, others] - positions[:, marker : marker + 1]
    length: NDArray[np.float64] = np.sqrt((apart**2).sum(axis=2))
    return length


def sample_poses(frames: int) -> NDArray[np.intp]:
    """Return frames all over a clip [shape=(blocks, poses)]; in a short one some twice."""
    blocks = max(1, min(BLOCKS, frames // POSES))
    length = frames / blocks
    start = np.arange(blocks)[:, None] * length
    inside = (np.arange(POSES) + 0.5) * (length / POSES)
    return np.minimum((start + inside).astype(np.intp), frames - 1)
