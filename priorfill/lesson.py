"""Lessons: poses to learn from and poses to predict, and the ways in which that is done.

The words of `priorfill.regression`, which says what they are for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ALIGNMENT_FLOOR",
    "Kernel",
    "Lesson",
    "Member",
    "Moment",
    "Rows",
    "Surroundings",
    "View",
]

FADED = 0.5
"""What is left of the covariance of poses far apart in time, for kernels that fade."""

BODY_OFFSET = 10.0
"""Variance, in units of the kernel's constant, of what all poses of one body are off by: other
people's limbs are longer or shorter, and their markers sit elsewhere. Free, in effect."""

ALIGNMENT_FLOOR = 1e-3
"""Least weight of a visible marker in the alignment, so that few near ones cannot leave it
undetermined."""


@dataclass(frozen=True)
class View:
    """How poses are aligned and visible markers weighted.

    Attributes
    ----------
    frame : {"rigid", "heading"}
        Whether the whole rotation is taken out or only the heading.
    reach : float
        mm; weights fall with distance from the missing markers as exp(-D² / 2 reach²).
    floor : float
        Least weight of a feature.
    slack : float or None
        mm; markers whose distance to the missing ones varies by this much count half. None:
        whatever their distance does.
    """

    frame: Literal["rigid", "heading"]
    reach: float
    floor: float
    slack: float | None = None


@dataclass(frozen=True)
class Moment:
    """What of the movement around a pose is a feature beside the pose itself.

    Attributes
    ----------
    seconds : float
        How long before and after.
    weight : float
        How much it counts, beside 1 for the pose.
    velocity : bool
        Whether the way from before to after is the feature; else both positions are.
    """

    seconds: float
    weight: float
    velocity: bool = False


@dataclass(frozen=True)
class Kernel:
    """Covariance of two poses, features scaled to a mean square norm of 1.

    Attributes
    ----------
    linear, radial : float
        Parts of the linear and of the radial covariance.
    length : float
        Length scale of the radial part.
    temporal : float
        Part of the covariance that decays with time.
    seconds : float
        Its time scale.
    smooth : bool
        Decay (1 + r) exp(-r), r = √3 |dt| / seconds, which continues velocities; else
        exp(-|dt| / seconds), which continues positions.
    noise : float
        Variance that rows do not share with anything.
    fading : float, optional
        s; how fast poses far apart in time lose what they have in common, down to `FADED`:
        markers slip, and movements change. By default they do not.
    """

    linear: float
    radial: float
    length: float
    temporal: float
    seconds: float
    smooth: bool
    noise: float
    fading: float | None = None

    def memory(self, lag: NDArray[np.float64]) -> NDArray[np.float64] | float:
        """Factor of the covariance of poses some time apart [shape=(a, b), s]."""
        if self.fading is None:
            return 1.0
        kept: NDArray[np.float64] = FADED + (1.0 - FADED) * np.exp(-lag / self.fading)
        return kept

    def decay(self, lag: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance of the temporal part.

        Parameters
        ----------
        lag : ndarray [shape=(a, b), s]
            Time between poses; infinite for those of different recordings.
        """
        if not self.smooth:
            exponential: NDArray[np.float64] = self.temporal * np.exp(-lag / self.seconds)
            return exponential
        # the exponential of more is 0, and infinity times 0 is not
        scaled = np.minimum(np.sqrt(3.0) / self.seconds * lag, 700.0)
        matern: NDArray[np.float64] = self.temporal * (1.0 + scaled) * np.exp(-scaled)
        return matern

    def covariance(
        self,
        product: NDArray[np.float64],
        square: NDArray[np.float64],
        decay: NDArray[np.float64],
        correlation: NDArray[np.float64] | float = 1.0,
    ) -> NDArray[np.float64]:
        """Covariance, without noise, of poses.

        Parameters
        ----------
        product, square : ndarray [shape=(a, b)]
            Inner product and squared distance of their features.
        decay : ndarray [shape=(a, b)]
            Covariance of the temporal part.
        correlation : ndarray [shape=(a, b)] or float
            Of the recordings that the poses are from; holds for all but the temporal part.
        """
        return self.combined(product, self.nearness(square), decay, correlation)

    def nearness(self, square: NDArray[np.float64]) -> NDArray[np.float64]:
        """Radial part of the covariance, in units of its own, by squared distances."""
        near: NDArray[np.float64] = np.exp(square * (-0.5 / self.length**2))
        return near

    def combined(
        self,
        product: NDArray[np.float64],
        nearness: NDArray[np.float64],
        decay: NDArray[np.float64],
        correlation: NDArray[np.float64] | float = 1.0,
    ) -> NDArray[np.float64]:
        """Covariance, without noise, by `nearness`, which kernels of one length have in common.

        Other parameters are those of `covariance`.
        """
        covariance: NDArray[np.float64] = self.linear * product
        covariance += 1.0
        if self.radial:
            covariance += self.radial * nearness
        if not isinstance(correlation, float) or correlation != 1.0:  # mostly it is
            covariance *= correlation
        covariance += decay
        return covariance


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
