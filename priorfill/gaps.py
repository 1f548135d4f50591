"""Gaps, and the gap groups that overlapping gaps form.

A gap is a run of frames in which one marker is missing; a gap group is the longest run of
frames in which at least one marker is missing. Inside a group the missing set may change
from frame to frame (a "long multi-segment gap").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["Gap", "GapGroup", "constant_spans", "find_gaps", "gap_groups", "runs"]


@dataclass(frozen=True, order=True)
class Gap:
    """A run of frames ``start <= frame < stop`` in which one marker is missing.

    Attributes
    ----------
    start, stop : int
        Frames, counted from the clip's first frame as 0.
    marker : int
        Index of the marker.
    """

    start: int
    stop: int
    marker: int

    @property
    def frames(self) -> int:
        """Number of missing frames."""
        return self.stop - self.start


@dataclass(frozen=True)
class GapGroup:
    """Gaps that overlap or touch in time.

    Attributes
    ----------
    start, stop : int
        The run of frames in which at least one marker is missing.
    gaps : tuple of Gap
        The gaps inside, in order of time.
    """

    start: int
    stop: int
    gaps: tuple[Gap, ...]

    @property
    def markers(self) -> tuple[int, ...]:
        """Indices of the markers that are missing in any of the group's frames."""
        return tuple(sorted({gap.marker for gap in self.gaps}))


def runs(mask: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield (start, stop) of each run of True in a mask [shape=(n,)]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    for start, stop in edges.reshape(-1, 2):
        yield int(start), int(stop)


def constant_spans(seen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return (start, stop) of the runs of frames in which the visible markers stay the same.

    Parameters
    ----------
    seen : ndarray of bool [shape=(frames, markers)]
        At least one frame.
    """
    changes = 1 + np.flatnonzero((seen[1:] != seen[:-1]).any(axis=1))
    return list(pairwise([0, *changes.tolist(), len(seen)]))


def find_gaps(missing: NDArray[np.bool_]) -> list[Gap]:
    """Find the gaps of a clip.

    Parameters
    ----------
    missing : ndarray of bool [shape=(frames, markers)]
        Which samples are missing.

    Returns
    -------
    list of Gap
        In order of time, then of marker.
    """
    return sorted(
        Gap(start, stop, marker)
        for marker in range(missing.shape[1])
        for start, stop in runs(missing[:, marker])
    )


def gap_groups(missing: NDArray[np.bool_]) -> list[GapGroup]:
    """Find the gap groups of a clip: runs of frames that are not complete.

    Parameters
    ----------
    missing : ndarray of bool [shape=(frames, markers)]
        Which samples are missing.

    Returns
    -------
    list of GapGroup
        In order of time.
    """
    gaps = find_gaps(missing)
    groups = []
    for start, stop in runs(np.logical_or.reduce(missing, axis=1)):
        inside = tuple(gap for gap in gaps if start <= gap.start < stop)
        groups.append(GapGroup(start, stop, inside))
    return groups
