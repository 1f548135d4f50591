"""Reference markers: for each marker, the others to which it keeps its distance best.

An artefact must not influence the choice of the markers it is assessed by. The standard deviation
of a distance is therefore taken within short blocks of time, so that a label that moves to another
marker half-way through the clip affects a single block, and then the median over the blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = [
    "ReferenceMarkerOptions",
    "ReferenceMarkers",
    "choose_reference_markers",
    "distances",
    "sample_poses",
]

BLOCKS = 12
"""Blocks of time, spread over the clip."""

POSES_PER_BLOCK = 20
"""Poses used in each block."""


@dataclass(frozen=True)
class ReferenceMarkerOptions:
    """How reference markers are chosen.

    Attributes
    ----------
    count : int
        Reference markers per marker. Three define a frame of reference; the fourth is a spare, as
        one of them may itself be affected by an artefact.
    min_poses : int
        Poses of a block that must show both markers of a pair.
    block_quantile : float
        Quantile over the blocks of a distance's standard deviation. With the median, a marker may
        be affected in half of the blocks.
    distance_penalty : float
        Fraction of the distance added to its standard deviation: of two equally rigid markers the
        nearer one is the better reference. It adds 3 mm at a distance of 100 mm, and 20 mm at arm's
        length.
    """

    count: int = 4
    min_poses: int = 5
    block_quantile: float = 0.5
    distance_penalty: float = 0.03

    def __post_init__(self) -> None:
        check_at_least(self, 1, "count", "min_poses")
        check_between(self, 0.0, 1.0, "block_quantile")
        check_at_least(self, 0.0, "distance_penalty")


@dataclass(frozen=True)
class ReferenceMarkers:
    """The reference markers of every marker of a clip.

    Attributes
    ----------
    others : ndarray of int [shape=(markers, references)]
        Reference markers of each marker, the most rigidly connected first.
    known : ndarray of bool [shape=(markers, references)]
        Which entries are valid; a marker with too few references is padded with itself.
    """

    others: NDArray[np.intp]
    known: NDArray[np.bool_]

    def of(self, marker: int) -> NDArray[np.intp]:
        """Return the reference markers of one marker, the most rigidly connected first."""
        others: NDArray[np.intp] = self.others[marker, self.known[marker]]
        return others


def choose_reference_markers(
    positions: NDArray[np.float64], options: ReferenceMarkerOptions = ReferenceMarkerOptions()
) -> ReferenceMarkers:
    """Choose the reference markers of each marker.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    options : ReferenceMarkerOptions

    Returns
    -------
    ReferenceMarkers

    See Also
    --------
    priorfill.artefacts.find_artefacts : The search for artefacts, which uses them.
    """
    frames, markers = positions.shape[:2]
    count = min(options.count, markers - 1)
    own = np.arange(markers)[:, None]
    if count < 1:
        return ReferenceMarkers(own.astype(np.intp), np.zeros((markers, 1), dtype=bool))
    score = np.full((markers, markers), np.inf)
    first, second = np.triu_indices(markers, 1)
    score[first, second] = score[second, first] = _pair_scores(
        positions[sample_poses(frames)], first, second, options
    )
    order = np.argsort(score, axis=1, kind="stable")[:, :count]
    known = np.isfinite(np.take_along_axis(score, order, axis=1))
    return ReferenceMarkers(np.where(known, order, own).astype(np.intp), known)


def _pair_scores(
    blocks: NDArray[np.float64],
    first: NDArray[np.intp],
    second: NDArray[np.intp],
    options: ReferenceMarkerOptions,
) -> NDArray[np.float64]:
    """Return how poor a reference each pair gives (mm; infinite where unknown).

    ``blocks`` are poses by block [shape=(blocks, poses, markers, 3), mm].
    """
    # rows of memory are the poses of a pair in a block
    x, y, z = np.ascontiguousarray(blocks.transpose(3, 2, 0, 1))
    distance = np.sqrt(
        (x[first] - x[second]) ** 2 + (y[first] - y[second]) ** 2 + (z[first] - z[second]) ** 2
    )
    seen = np.isfinite(distance)
    count = seen.sum(axis=2).T
    distance[~seen] = 0.0
    divisor = np.maximum(count, 1)
    mean = distance.sum(axis=2).T / divisor
    spread = np.sqrt(np.maximum((distance**2).sum(axis=2).T / divisor - mean**2, 0.0))
    enough = count >= min(options.min_poses, blocks.shape[1])
    spread = np.sort(np.where(enough, spread, np.inf), axis=0)
    valid = enough.sum(axis=0)  # blocks that show the pair
    rank = np.minimum((options.block_quantile * valid).astype(np.intp), np.maximum(valid - 1, 0))
    mean_distance = np.where(enough, mean, 0.0).sum(axis=0) / np.maximum(valid, 1)
    score = spread[rank, np.arange(len(first))] + options.distance_penalty * mean_distance
    return np.where(valid > 0, score, np.inf)


def distances(
    positions: NDArray[np.float64], marker: int, others: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return the distance of a marker from some others.

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
    path = np.ascontiguousarray(positions[:, marker])
    distance = np.empty((len(positions), len(others)))
    for column, other in enumerate(others):  # all at once, temporary arrays leave the cache
        distance[:, column] = norms(positions[:, other] - path)
    return distance


def sample_poses(frames: int) -> NDArray[np.intp]:
    """Return frames spread over a clip [shape=(blocks, poses)]; in a short clip some repeat."""
    blocks = max(1, min(BLOCKS, frames // POSES_PER_BLOCK))
    length = frames / blocks
    start = np.arange(blocks)[:, None] * length
    inside = (np.arange(POSES_PER_BLOCK) + 0.5) * (length / POSES_PER_BLOCK)
    return np.minimum((start + inside).astype(np.intp), frames - 1)
