"""Which markers the page connects by lines, so that a pose looks like a body.

The markers of a subject are joined by a minimum spanning tree. Markers are near to each other in it
if they are so in space and keep their distance. In a known marker set, those of one segment come
first, and segments are joined as in a body. Small segments become triangles and quadrilaterals.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise, permutations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.axes import to_upright
from priorfill.geometry.distances import pair_statistics
from priorfill.markers.left_right import contralateral_markers
from priorfill.markers.marker_set import DISCOVERED

if TYPE_CHECKING:
    from priorfill.filling.result import Result

__all__ = ["sticks_of"]

SPREAD_WEIGHT = 8.0
"""Length (mm) that 1 mm of standard deviation of a distance counts as: the knees of a walking
person are as near to each other as knee and thigh, but their distance varies by centimetres."""

SAME_SEGMENT = 0.3
"""Factor of lengths within a known segment, whose markers are connected first."""

NOT_ADJACENT = 2000.0
"""mm, added to lengths between two segments of a body that are not neighbours, such as an elbow and
the pelvis: it may stay on the hip through the whole clip. More than `MAX_LENGTH`."""

OTHER_SIDE = 3.0
"""Factor of lengths to the side of the contralateral marker: arms and legs hang on the trunk, not
on each other."""

CHAINS = (
    ("pelvis", "thorax", "head"),
    ("pelvis", "thorax", "shoulder", "upper_arm", "forearm", "wrist", "hand"),
    ("pelvis", "thigh", "shank", "foot"),
    ("pelvis", "thigh", "shank", "hindfoot", "forefoot", "hallux"),
)
"""Segments of the shipped marker sets from the trunk outwards, without their side."""

SIDES = ("left_", "right_")

MAX_SPREAD = 150.0
"""mm. Pairs whose distance has a greater standard deviation are not connected: an object that is
put down, or a hand without the markers of its arm."""

MAX_LENGTH = 1000.0
"""mm. No segment of a body is longer."""

CLOSED_MARKERS = (3, 4)
"""Numbers of markers of a segment that are drawn as a closed line; more would hide each other."""

MIN_COMMON = 3
"""Poses that must show both markers of a pair."""

MAX_POSES = 300
"""Poses that distances are taken from; more change no line."""

MIN_POSES = 12
"""The same for very many markers."""

MAX_PAIR_POSES = 3e7
"""Distances computed for all pairs and poses together: a second."""

MAX_MARKERS = 2500
"""Markers of a subject above which none are connected: a body has some hundred, and a table of all
distances would take more memory than the clip."""


def sticks_of(result: Result) -> list[list[int]]:
    """Return the pairs of markers that are connected.

    Parameters
    ----------
    result : Result
        Of a fill.

    Returns
    -------
    list of [int, int]
        Pairs of markers of the same subject, numbered as in the merged clip.
    """
    sticks: list[list[int]] = []
    first = 0
    for one in result.by_subject:
        clip = one.clip
        index = {label: number for number, label in enumerate(clip.labels)}
        found = _sticks(
            to_upright(clip.positions, clip.up),
            {
                segment: [index[label] for label in labels if label in index]
                for segment, labels in one.marker_set.segments.items()
            },
            contralateral_markers(clip.labels, one.marker_set),
            known=one.marker_set.name != DISCOVERED,
        )
        sticks += [[first + i, first + j] for i, j in found]
        first += len(clip.labels)
    return sticks


def _sticks(
    positions: NDArray[np.float64],
    segments: Mapping[str, Sequence[int]],
    contralateral: NDArray[np.intp],
    *,
    known: bool,
) -> list[tuple[int, int]]:
    """Return the sticks of one subject."""
    markers = positions.shape[1]
    if markers > MAX_MARKERS:
        return []
    pairs = pair_statistics(positions[_poses(positions, markers)])
    length, spread = pairs.of_common(MIN_COMMON)
    cost = length + SPREAD_WEIGHT * spread
    cost[(spread > MAX_SPREAD) | (length > MAX_LENGTH)] = np.inf
    if known:
        _prefer_known_neighbours(cost, segments)
    has_other = (contralateral >= 0) & (contralateral != np.arange(markers))
    if has_other.any():
        cost *= np.where(_on_other_sides(length, contralateral, has_other), OTHER_SIDE, 1.0)
    sticks = _spanning_tree(cost)
    drawn = set(sticks)
    within = np.where(np.isfinite(cost), length, np.inf)
    for members in segments.values():
        if len(members) in CLOSED_MARKERS:
            drawn |= _closed_line(members, within)
    return sorted(drawn)


def _prefer_known_neighbours(
    cost: NDArray[np.float64], segments: Mapping[str, Sequence[int]]
) -> None:
    """Change lengths in place so that segments are connected first, and then as in a body."""
    inner = {segment: _inner_segment(segment, segments) for segment in segments}
    for one, members in segments.items():
        cost[np.ix_(members, members)] *= SAME_SEGMENT
        for other, others in segments.items():
            named = inner[one] is not None and inner[other] is not None
            if one != other and named and one != inner[other] and other != inner[one]:
                cost[np.ix_(members, others)] += NOT_ADJACENT


def _inner_segment(segment: str, present: Collection[str]) -> str | None:
    """Return the next segment towards the trunk, empty for the innermost; None: it is unknown."""
    side = next((side for side in SIDES if segment.startswith(side)), "")
    part = segment.removeprefix(side)
    chain = next((chain for chain in CHAINS if part in chain), None)
    if chain is None:
        return None
    nearer = [name for inner in chain[: chain.index(part)] for name in (inner, f"{side}{inner}")]
    return next((name for name in reversed(nearer) if name in present), "")


def _poses(positions: NDArray[np.float64], markers: int) -> NDArray[np.intp]:
    """Return evenly spaced poses, few enough for the number of markers."""
    count = int(np.clip(MAX_PAIR_POSES / markers**2, MIN_POSES, MAX_POSES))
    steps = np.linspace(0, len(positions) - 1, min(count, len(positions)))
    return np.unique(np.rint(steps).astype(np.intp))


def _on_other_sides(
    length: NDArray[np.float64], contralateral: NDArray[np.intp], has_other: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return whether each pair of markers is nearer after one of them is mirrored."""
    mirrored = np.where(has_other, contralateral, np.arange(len(length)))
    across = length[:, mirrored]
    both = has_other[:, None] & has_other[None, :]
    return np.asarray(both & (across < length))


def _spanning_tree(cost: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return the edges of a minimum spanning tree, or of one for each part (Prim 1957)."""
    count = len(cost)
    nearest = np.full(count, np.inf)
    parent = np.full(count, -1)
    open_ = np.ones(count, dtype=bool)
    edges = []
    for _ in range(count):
        candidates = np.flatnonzero(open_)
        new = int(candidates[np.argmin(nearest[candidates])])
        open_[new] = False
        if parent[new] >= 0 and np.isfinite(nearest[new]):
            edges.append((min(new, int(parent[new])), max(new, int(parent[new]))))
        closer = open_ & (cost[new] < nearest)
        nearest[closer] = cost[new][closer]
        parent[closer] = new
    return edges


def _closed_line(members: Sequence[int], length: NDArray[np.float64]) -> set[tuple[int, int]]:
    """Return the edges of the shortest closed line through three or four markers."""
    first, *others = members
    lines = [[first, *order, first] for order in permutations(others) if order[0] <= order[-1]]
    totals = [sum(length[i, j] for i, j in pairwise(line)) for line in lines]
    best = int(np.argmin(totals))
    if not np.isfinite(totals[best]):
        return set()
    return {(min(i, j), max(i, j)) for i, j in pairwise(lines[best])}
