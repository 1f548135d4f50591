"""Gaps, and the groups formed by overlapping gaps.

A gap is a run of frames in which one marker is missing. A gap group is a maximal run of frames in
which at least one marker is missing; the missing markers may change from frame to frame within it
(a "long multi-segment gap").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import OptionError
from priorfill.runtime.argument_types import check_type

__all__ = ["Gap", "GapGroup", "constant_spans", "find_gaps", "gap_groups", "runs"]


@dataclass(frozen=True, order=True)
class Gap:
    """A run of frames ``start <= frame < stop`` in which one marker is missing.

    Attributes
    ----------
    start, stop : int
        First frame, and frame after the last, counted from the clip's first frame as 0.
    marker : int
        Index of the marker.

    Examples
    --------
    >>> Gap(10, 25, marker=3).frames
    15

    See Also
    --------
    find_gaps : Find the gaps of a clip.
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
        The run of frames in which at least one marker is missing: its first frame, and the frame
        after its last.
    gaps : tuple of Gap
        The gaps of the group, in order of time.

    See Also
    --------
    gap_groups : Find the gap groups of a clip.

    Examples
    --------
    >>> GapGroup(10, 30, (Gap(10, 25, 0), Gap(20, 30, 4))).markers
    (0, 4)
    """

    start: int
    stop: int
    gaps: tuple[Gap, ...]

    @property
    def markers(self) -> tuple[int, ...]:
        """Indices of the markers missing in any frame of the group."""
        return tuple(sorted({gap.marker for gap in self.gaps}))

    @property
    def samples(self) -> int:
        """Number of missing samples."""
        return sum(gap.frames for gap in self.gaps)


def runs(mask: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield (start, stop) of each run of True in a mask [shape=(n,)]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    for start, stop in edges.reshape(-1, 2):
        yield int(start), int(stop)


def constant_spans(seen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return (start, stop) of the runs of frames with the same visible markers.

    Parameters
    ----------
    seen : ndarray of bool [shape=(frames, markers)]
        Which samples are visible; at least one frame.

    Returns
    -------
    list of (int, int)
        In order of time; together they cover all frames.
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

    Examples
    --------
    >>> import numpy as np
    >>> missing = np.array([[0, 1], [1, 1], [1, 0]], dtype=bool)
    >>> find_gaps(missing)
    [Gap(start=0, stop=2, marker=1), Gap(start=1, stop=3, marker=0)]

    See Also
    --------
    gap_groups : Group gaps that overlap or touch in time.
    priorfill.Clip.missing : The mask of a clip.
    """
    remedy = "an array of bool, (frames, markers), such as Clip.missing"
    check_type("missing", missing, np.ndarray, remedy)
    if missing.ndim != 2:
        raise OptionError(f"`missing` has the shape {missing.shape}; give {remedy}")
    frames, markers = missing.shape
    # edges in the order of frames; sorted by marker, beginnings and ends of gaps alternate
    edges = [
        np.flatnonzero(missing[:1]),
        markers + np.flatnonzero(missing[1:] != missing[:-1]),  # faster than of two axes
        frames * markers + np.flatnonzero(missing[-1:]),
    ]
    frame, marker = np.divmod(np.concatenate(edges), max(markers, 1))
    by_marker = np.argsort(marker, kind="stable")
    start, stop = frame[by_marker].reshape(-1, 2).T
    marker = marker[by_marker[::2]]
    order = np.lexsort((marker, stop, start))
    found = np.stack([start, stop, marker], axis=1)[order].tolist()
    return [Gap(*gap) for gap in found]


def gap_groups(missing: NDArray[np.bool_]) -> list[GapGroup]:
    """Find the gap groups of a clip: runs of incomplete frames.

    Parameters
    ----------
    missing : ndarray of bool [shape=(frames, markers)]
        Which samples are missing.

    Returns
    -------
    list of GapGroup
        In order of time.

    Examples
    --------
    >>> import numpy as np
    >>> missing = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=bool)
    >>> [(group.start, group.stop, group.markers) for group in gap_groups(missing)]
    [(0, 3, (0, 1))]

    See Also
    --------
    find_gaps : Find the single gaps.
    """
    gaps = find_gaps(missing)
    groups = []
    first = 0
    for start, stop in runs(np.logical_or.reduce(missing, axis=1)):
        last = first
        while last < len(gaps) and gaps[last].start < stop:
            last += 1
        groups.append(GapGroup(start, stop, tuple(gaps[first:last])))
        first = last
    return groups
