"""The frames of a gap that windows of other recordings are compared and predicted in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gpr.gap_segments import GapSegment
from priorfill.methods.gpr.sources.options import GapWindowOptions

__all__ = ["GapLayout", "lay_out_gap"]

VELOCITY_SECONDS = 1.0 / 15.0
"""s. Velocities at the edges are differences over this time: a step of the database's poses."""


@dataclass(frozen=True, eq=False)
class GapLayout:
    """Frames of a gap and its edges.

    Attributes
    ----------
    nodes : ndarray of int
        Frames of the gap that are predicted.
    before, after : ndarray of int [shape=(2,)] or None
        The frame next to the gap, and one further away. None where the gap reaches the clip's end
        or a missing marker is not measured in both.
    rate : float
        Hz.
    """

    nodes: NDArray[np.intp]
    before: NDArray[np.intp] | None
    after: NDArray[np.intp] | None
    rate: float

    @property
    def edges(self) -> list[NDArray[np.intp]]:
        """The edges that there are."""
        return [edge for edge in (self.before, self.after) if edge is not None]

    @property
    def frames(self) -> NDArray[np.intp]:
        """All frames: those next to the gap, those further away, and the nodes."""
        edges = np.array(self.edges).T.ravel()
        return np.concatenate([edges, self.nodes])

    @property
    def seconds(self) -> NDArray[np.float64]:
        """Times of all frames (s), from the edge before, or else from the first node."""
        origin = self.nodes[0] if self.before is None else self.before[0]
        seconds: NDArray[np.float64] = (self.frames - origin) / self.rate
        return seconds

    @property
    def edge_seconds(self) -> float:
        """Time between the two frames of an edge (s)."""
        return float(abs(self.edges[0][0] - self.edges[0][1]) / self.rate)

    def fraction(self, frames: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return how far frames are from the edge before to the one after, from 0 to 1.

        With one edge it is that edge's value, 0 or 1.
        """
        if self.before is None or self.after is None:
            return np.full(len(frames), 0.0 if self.after is None else 1.0)
        first, last = self.before[0], self.after[0]
        fraction: NDArray[np.float64] = (frames - first) / (last - first)
        return fraction


def lay_out_gap(
    segment: GapSegment, valid: NDArray[np.bool_], rate: float, options: GapWindowOptions
) -> GapLayout | None:
    """Choose the frames of a gap segment.

    Parameters
    ----------
    segment : GapSegment
        The missing markers and frames.
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples of the clip are measured.
    rate : float
        Hz.
    options : GapWindowOptions
        Distance of the nodes, and lengths of gaps.

    Returns
    -------
    GapLayout or None
        None where the gap is too short or too long, or has no edge.

    Examples
    --------
    >>> valid = np.ones((60, 4), dtype=bool)
    >>> valid[20:40, 0] = False
    >>> arm = GapSegment(np.array([0]), 20, 40, np.array([1, 2, 3]))
    >>> layout = lay_out_gap(arm, valid, 30.0, GapWindowOptions())
    >>> layout.nodes, layout.before, layout.after
    (array([23, 27, 31, 35]), array([19, 17]), array([40, 42]))
    """
    start, stop = segment.start, segment.stop
    if stop - start < options.min_seconds * rate:
        return None
    spacing = max(1, round(options.node_seconds * rate))
    nodes = np.arange(start - 1 + spacing, stop - spacing // 2, spacing)
    step = max(1, round(VELOCITY_SECONDS * rate))
    before = _edge(segment, valid, start - 1, start - 1 - step)
    after = _edge(segment, valid, stop, stop + step)
    if not len(nodes) or len(nodes) > options.max_nodes or (before is None and after is None):
        return None
    return GapLayout(nodes, before, after, rate)


def _edge(
    segment: GapSegment, valid: NDArray[np.bool_], near: int, far: int
) -> NDArray[np.intp] | None:
    """Return the frames of an edge, if they show the missing markers."""
    if not 0 <= min(near, far) <= max(near, far) < len(valid):
        return None
    frames = np.array([near, far])
    return frames if valid[np.ix_(frames, segment.markers)].all() else None
