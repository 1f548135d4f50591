"""Lessons: poses to learn from and poses to predict, and the ways in which that is done.

The words of `priorfill.gp.ensemble`, which says what they are for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.features import (
    Moment,
    View,
)
from priorfill.gp.pose_kernel import (
    Kernel,
)

__all__ = ["Lesson", "Member", "Rows", "Surroundings"]


BODY_OFFSET = 10.0
"""Variance, in units of the kernel's constant, of what all poses of one body are off by: other
people's limbs are longer or shorter, and their markers sit elsewhere. Free, in effect."""


@dataclass(frozen=True)
class Member:
    """One way to predict: how poses are aligned, what their features are, how they covary."""

    view: View
    moment: Moment | None
    kernel: Kernel


@dataclass(frozen=True, eq=False)
class Rows:
    """Poses to learn from, or to predict.

    Attributes
    ----------
    visible : ndarray [shape=(poses, visible markers, 3), mm]
        Upright, none missing.
    missing : ndarray [shape=(poses, missing markers, 3), mm]
        What is to be predicted; empty for the poses of a gap.
    time : ndarray [shape=(poses,), s]
        When in the recording.
    take : ndarray of int [shape=(poses,)]
        Which recording; poses of different ones are infinitely far apart in time.
    kinship : ndarray [shape=(poses,)], optional
        Correlation of what the recording says with the truth of the queries: 1 for the same
        body, the default; less for others.
    body : ndarray of int [shape=(poses,)], optional
        Whose the poses are. If given, each body has an offset of its own; by default a body is
        what one recording shows, without an offset.
    around : mapping, optional
        By seconds of a moment: the visible markers so long before and after
        [shape=(2, poses, visible markers, 3), mm], none missing.
    moving : ndarray [shape=(poses, missing markers, 3), mm/s], optional
        Velocities of the missing markers, if these are to be predicted too.
    """

    visible: NDArray[np.float64]
    missing: NDArray[np.float64]
    time: NDArray[np.float64]
    take: NDArray[np.intp]
    kinship: NDArray[np.float64] | None = None
    body: NDArray[np.intp] | None = None
    around: Mapping[float, NDArray[np.float64]] = field(default_factory=dict)
    moving: NDArray[np.float64] | None = None

    def part(self, some: slice) -> Rows:
        """Return some of the poses."""
        return replace(
            self,
            visible=self.visible[some],
            missing=self.missing[some],
            time=self.time[some],
            take=self.take[some],
            kinship=None if self.kinship is None else self.kinship[some],
            body=None if self.body is None else self.body[some],
            around={seconds: positions[:, some] for seconds, positions in self.around.items()},
            moving=None if self.moving is None else self.moving[some],
        )

    def _same_body(self, other: Rows) -> NDArray[np.bool_]:
        mine = self.take if self.body is None else self.body
        theirs = other.take if other.body is None else other.body
        same: NDArray[np.bool_] = mine[:, None] == theirs
        return same

    def offset(self, other: Rows) -> NDArray[np.float64] | float:
        """Covariance of the offsets of these poses' bodies and others' [shape=(poses, others)]."""
        if self.body is None and other.body is None:
            return 0.0
        return np.where(self._same_body(other), BODY_OFFSET, 0.0)

    def correlation(self, other: Rows) -> NDArray[np.float64] | float:
        """Correlation of these poses' recordings with others' [shape=(poses, others)].

        A body agrees with itself; what two of them have in common is what either has with the
        queries.
        """
        if self.kinship is None and other.kinship is None:
            return 1.0
        mine = np.ones(len(self.take)) if self.kinship is None else self.kinship
        theirs = np.ones(len(other.take)) if other.kinship is None else other.kinship
        return np.where(self._same_body(other), 1.0, mine[:, None] * theirs)

    def lag(self, other: Rows) -> NDArray[np.float64]:
        """Time between these poses and others [shape=(poses, others), s]."""
        lag = np.abs(self.time[:, None] - other.time)
        return np.where(self.take[:, None] == other.take, lag, np.inf)

    def blocks(self, seconds: float, queries: Rows | None = None) -> list[NDArray[np.intp]]:
        """Return indices of the poses of the queries' kin in blocks of some length.

        Parameters
        ----------
        seconds : float
            Length of a block.
        queries : Rows, optional
            If given, only poses of their recordings, where there are any: in a gap, other
            recordings of the same body are there to be learnt from.
        """
        number = np.floor(self.time / max(seconds, 1e-3)).astype(np.intp)
        _, block = np.unique(np.stack([self.take, number]), axis=1, return_inverse=True)
        block = block.ravel()
        blocks = [np.flatnonzero(block == b) for b in range(block.max() + 1)]
        if self.kinship is None:
            return blocks
        near = self.kinship == self.kinship.max()
        if queries is not None:
            own = near & np.isin(self.take, queries.take)
            near = own if own.any() else near
        return [b for b in blocks if near[b[0]]]


class Surroundings(Protocol):
    """Knows what is around the queries of a lesson.

    For all queries of a long gap at once that would be many times the memory of the answer.
    """

    def __call__(self, poses: Rows) -> Rows:
        """Return poses of the clip with what is around them."""
        ...

    def among(self, some: NDArray[np.intp]) -> Surroundings:
        """Return the same for some of the visible markers only."""
        ...


@dataclass(frozen=True, eq=False)
class Lesson:
    """Poses to learn from, and the poses to predict by the same visible markers.

    Attributes
    ----------
    rows : Rows
        What to learn from; at least two blocks of the queries' kin.
    query : Rows
        The poses to predict; what is around them is in `surroundings`.
    distance, spread : ndarray [shape=(visible markers,), mm]
        Rms distance of each visible marker to the nearest missing one, and how much that varies.
    handicap : float
        How many times better than others its members must do with blocks left out to count as much.
    surroundings : Surroundings, optional
        Of the queries; needed where the rows have something around them.
    """

    rows: Rows
    query: Rows
    distance: NDArray[np.float64]
    spread: NDArray[np.float64]
    handicap: float = 1.0
    surroundings: Surroundings | None = None

    def asked(self, some: slice) -> Rows:
        """Return some of the queries, with what is around them if the rows have it."""
        queries = self.query.part(some)
        return queries if self.surroundings is None else self.surroundings(queries)

    def shows(self, moment: Moment | None) -> bool:
        """Whether it has the features of a moment."""
        return moment is None or moment.seconds in self.rows.around
