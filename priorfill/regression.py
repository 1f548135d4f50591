"""Gaussian-process regression from visible to missing markers.

The rows are poses in which the missing markers were seen. Poses are aligned near the gap (a
*view*), the visible markers' coordinates weighted by how near and how firmly they are tied to
the missing ones, and a Gaussian process (GP) predicts the missing coordinates in the aligned
frame. Its kernel has a linear part (bodies are nearly linear between near poses), a radial part
(k-nearest-neighbour like), and a part that decays with time, which carries the seam: rows right
beside the gap are followed closely there and forgotten further in.

Poses that look alike can belong to different movements. So the features may also hold a
*moment*: where the visible markers are shortly before and after, or how they move.

No view, moment and kernel is best for all movements. Each triple of them is a *member*; all
predict, and each counts by its error when blocks as long as the gap are left out of the rows, which
has a closed form [R06]_ Eq. (5.12), generalised to blocks: with the inverse kernel matrix G, the
residuals of block B are inv(G_BB) (G Y)_B and their covariance is inv(G_BB). A member that is less
sure of the gap than of those blocks counts less.

The mixture's own residuals of the blocks say how far its deviation is to be trusted.

Rows may also say how fast the missing markers move. Velocities are predicted in the same way,
from the same matrices, and mixed by their own errors. `priorfill.motion` joins them with the
positions.

References
----------
.. [R06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import groupby
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri

from priorfill.gaussian import shares
from priorfill.motion import Motion, by_speed
from priorfill.normalise import RootFrames, heading_frames, rigid_frames
from priorfill.uncertainty import BOUND_FACTOR, BOUND_SHARE

__all__ = [
    "Kernel",
    "Lesson",
    "Member",
    "Moment",
    "Regression",
    "Rows",
    "View",
    "block_residuals",
    "regress",
]

SELECTION_POWER = 8.0
"""Members count by (least error / own error) to this power: between the mean of all (0) and the
best alone (infinite), both of which fill worse."""

DOUBT_POWER = 0.35
"""In each frame members count by their left-out error times (deviation predicted there / in the
blocks left out) to this power: 0.25 to 0.5 fill alike, 0 and 1 worse by one or two parts in a
hundred, and far worse in the worst case."""

FADED = 0.5
"""What is left of the covariance of poses far apart in time, for kernels that fade."""

PRIOR_BLOCKS = 8.0
"""Blocks that `BOUND_FACTOR`, and a deviation that is right as predicted, count as against those
that were left out: a few blocks tell little of the tails."""

CHOICE = 1.3
"""So many times what left-out blocks tell is the deviation of what lessons beside the first say,
since they are weighed by the same blocks: without it, bounds that should hold for 90 % of samples
held for 85 % with a database, on 60 gaps, and for 90 % without."""

LEAST_DEVIATION = 1e-3
"""mm. Nothing is known better; a marker in the place of a visible one might seem to be."""

FEWEST_JUDGED = 20
"""Fewest rows that lessons must have in common for their mixture to be judged by them."""

ALIGNMENT_FLOOR = 1e-3
"""Least weight of a visible marker in the alignment, so that few near ones cannot leave it
undetermined."""

BODY_OFFSET = 10.0
"""Variance, in units of the kernel's constant, of what all poses of one body are off by: other
people's limbs are longer or shorter, and their markers sit elsewhere. Free, in effect."""


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
        covariance: NDArray[np.float64] = self.linear * product
        covariance += 1.0
        if self.radial:
            covariance += self.radial * np.exp(square * (-0.5 / self.length**2))
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


@dataclass(frozen=True, eq=False)
class Lesson:
    """Poses to learn from, and the poses to predict by the same visible markers.

    Attributes
    ----------
    rows : Rows
        What to learn from; at least two blocks of the queries' kin.
    query : Rows
        The poses to predict.
    distance, spread : ndarray [shape=(visible markers,), mm]
        Rms distance of each visible marker to the nearest missing one, and how much that varies.
    handicap : float
        How many times better than others its members must do with blocks left out to count as much.
    """

    rows: Rows
    query: Rows
    distance: NDArray[np.float64]
    spread: NDArray[np.float64]
    handicap: float = 1.0

    def shows(self, moment: Moment | None) -> bool:
        """Whether it has the features of a moment."""
        return moment is None or moment.seconds in self.rows.around


@dataclass(frozen=True, eq=False)
class Regression:
    """What the regression says of the missing markers.

    Attributes
    ----------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(poses, missing markers), mm]
        Expected rms Euclidean error.
    bound_factor : float
        Times the deviation: what 90 % of the errors are expected to lie within.
    motion : Motion or None
        How the missing markers move, if all lessons' rows say so.
    """

    positions: NDArray[np.float64]
    deviation: NDArray[np.float64]
    bound_factor: float
    motion: Motion | None = None


def block_residuals(
    inverse: NDArray[np.float64],
    targets: NDArray[np.float64],
    blocks: Sequence[NDArray[np.intp]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Residuals of a Gaussian process when blocks of rows are left out, in closed form.

    Parameters
    ----------
    inverse : ndarray [shape=(rows, rows)]
        Inverse of the kernel matrix with noise.
    targets : ndarray [shape=(rows, outputs)]
        What the rows should be predicted as.
    blocks : sequence of ndarray of int
        Rows of each block.

    Returns
    -------
    residuals : ndarray [shape=(rows, outputs)]
        Target minus prediction from all rows outside the row's block.
    variance : ndarray [shape=(rows,)]
        Predicted variance of each residual, noise included, in units of the kernel.
    """
    weights = inverse @ targets
    residuals = np.full_like(targets, np.nan)
    variance = np.full(len(targets), np.nan)
    by_length: dict[int, list[NDArray[np.intp]]] = {}
    for block in blocks:
        by_length.setdefault(len(block), []).append(block)
    for alike in by_length.values():
        rows = np.stack(alike)  # (blocks, rows of each)
        covariance = np.linalg.inv(inverse[rows[:, :, None], rows[:, None, :]])
        residuals[rows] = covariance @ weights[rows]
        variance[rows] = np.diagonal(covariance, axis1=1, axis2=2)
    return residuals, variance


def _inverse(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert a covariance matrix in half the time that it takes for any matrix."""
    factor, failed = dpotrf(covariance, lower=True, clean=False)
    if failed:  # not positive definite to the last bit
        return np.linalg.inv(covariance).astype(np.float64, copy=False)
    half, _ = dpotri(factor, lower=True, overwrite_c=True)
    lower = np.tril(half)
    inverse: NDArray[np.float64] = lower + lower.T
    inverse[np.diag_indices_from(inverse)] *= 0.5
    return inverse


@dataclass(frozen=True, eq=False)
class _Likeness:
    """Inner products of the features of rows and queries, centred."""

    rows: NDArray[np.float64]  # (rows, rows)
    asked: NDArray[np.float64]  # (queries, rows)
    asked_norm: NDArray[np.float64]  # (queries,)

    @classmethod
    def of(cls, known: NDArray[np.float64], asked: NDArray[np.float64]) -> _Likeness:
        """Compare features [shapes=(rows, features), (queries, features)]."""
        mean = known.mean(axis=0)
        known, asked = known - mean, asked - mean
        return cls(known @ known.T, asked @ known.T, (asked**2).sum(axis=1))

    def __add__(self, other: _Likeness) -> _Likeness:
        """Compare by the features of both."""
        return _Likeness(
            self.rows + other.rows, self.asked + other.asked, self.asked_norm + other.asked_norm
        )

    def scaled(self) -> _Likeness:
        """Return it with features scaled to a mean square norm of 1."""
        scale = float(np.trace(self.rows)) / len(self.rows) or 1.0
        return _Likeness(self.rows / scale, self.asked / scale, self.asked_norm / scale)


@dataclass(frozen=True, eq=False)
class _Aligned:
    """A lesson as a view sees it."""

    weight: NDArray[np.float64]  # (visible,), of the features
    row_frames: RootFrames
    frames: RootFrames  # of the queries
    targets: NDArray[np.float64]  # (rows, targets * 3), centred: positions (mm), then velocities
    centre: NDArray[np.float64]  # (targets * 3,)

    def to_world(self, local: NDArray[np.float64], positions: int) -> NDArray[np.float64]:
        """Turn what is predicted of so many positions, and velocities, into the world."""
        told = local + self.centre
        told = told.reshape(len(told), -1, 3)
        world = told @ np.swapaxes(self.frames.rotation, 1, 2)
        world[:, :positions] += self.frames.origin[:, None, :]
        return world

    def likeness(self, lesson: Lesson, moment: Moment | None) -> _Likeness:
        """Compare poses, or the moments around them."""
        return _Likeness.of(
            self._features(lesson.rows, self.row_frames, moment),
            self._features(lesson.query, self.frames, moment),
        )

    def _features(
        self, poses: Rows, frames: RootFrames, moment: Moment | None
    ) -> NDArray[np.float64]:
        """Return features of poses [shape=(poses, features)]."""
        if moment is None:
            parts = [frames.to_local(poses.visible)]
        elif moment.velocity:
            before, after = poses.around[moment.seconds]
            parts = [moment.weight * ((after - before) @ frames.rotation)]
        else:
            parts = [moment.weight * frames.to_local(x) for x in poses.around[moment.seconds]]
        weighted = np.concatenate([part * self.weight[:, None] for part in parts], axis=1)
        return weighted.reshape(len(weighted), -1)


def _align(view: View, lesson: Lesson) -> _Aligned:
    """Align a lesson's rows and queries as a view asks."""
    rows, query = lesson.rows, lesson.query
    nearness = np.exp(-(lesson.distance**2) / (2.0 * view.reach**2))
    firmness = np.ones_like(nearness)
    if view.slack is not None:
        firmness = 1.0 / (1.0 + (lesson.spread / view.slack) ** 2)
    alignment = nearness * firmness + ALIGNMENT_FLOOR
    weight = nearness * np.sqrt(firmness) + view.floor
    align = rigid_frames if view.frame == "rigid" else heading_frames
    template = rows.visible[len(rows.visible) // 2]
    row_frames = align(rows.visible, template, alignment)
    query_frames = align(query.visible, template, alignment)
    targets = row_frames.to_local(rows.missing)
    if rows.moving is not None:
        targets = np.concatenate([targets, rows.moving @ row_frames.rotation], axis=1)
    targets = targets.reshape(len(rows.time), -1)
    centre = targets.mean(axis=0)
    return _Aligned(weight, row_frames, query_frames, targets - centre, centre)


@dataclass(frozen=True, eq=False)
class _Shared:
    """What all members share in a lesson."""

    blocks: list[NDArray[np.intp]]
    judged: NDArray[np.intp]  # rows of the blocks, in order of time
    # by kernel, for rows and for queries: covariance in time with bodies' offsets; correlation
    temporal: dict[Kernel, tuple[NDArray[np.float64], NDArray[np.float64]]]
    correlation: dict[Kernel, tuple[NDArray[np.float64] | float, NDArray[np.float64] | float]]
    offset: float  # variance of a query's own


def _share(lesson: Lesson, kernels: Iterable[Kernel], block_seconds: float) -> _Shared:
    rows, query = lesson.rows, lesson.query
    blocks = rows.blocks(block_seconds, query)
    judged = np.concatenate(blocks)
    lag, asked_lag = rows.lag(rows), query.lag(rows)
    offset, asked_offset = rows.offset(rows), query.offset(rows)
    same, asked_same = rows.correlation(rows), query.correlation(rows)
    return _Shared(
        blocks,
        judged[np.argsort(rows.time[judged], kind="stable")],
        {k: (k.decay(lag) + offset, k.decay(asked_lag) + asked_offset) for k in kernels},
        {k: (same * k.memory(lag), asked_same * k.memory(asked_lag)) for k in kernels},
        BODY_OFFSET if rows.body is not None else 0.0,
    )


@dataclass(frozen=True, eq=False)
class _Prediction:
    """What a member says of targets: the positions (mm), then the velocities (mm/s)."""

    told: NDArray[np.float64]  # (queries, targets, 3), upright
    variance: NDArray[np.float64]  # (queries, targets)
    residuals: NDArray[np.float64]  # (judged rows, targets, 3), upright, blocks left out
    left_out: NDArray[np.float64]  # (judged rows, targets), their predicted variance
    doubt: NDArray[np.float64]  # (queries,), deviation predicted / in the blocks left out


def _predict(
    view: View,
    lesson: Lesson,
    members: Sequence[Member],
    shared: _Shared,
) -> list[_Prediction]:
    """Predict by the members of one view."""
    aligned = _align(view, lesson)
    poses = aligned.likeness(lesson, None)
    markers, targets = lesson.rows.missing.shape[1], aligned.targets.shape[1] // 3
    predictions = []
    for moment, some in groupby(members, key=lambda member: member.moment):
        likeness = poses if moment is None else poses + aligned.likeness(lesson, moment)
        likeness = likeness.scaled()
        norm = np.diag(likeness.rows)
        square = norm[:, None] + norm - 2.0 * likeness.rows
        asked_square = likeness.asked_norm[:, None] + norm - 2.0 * likeness.asked
        for kernel in (member.kernel for member in some):
            covariance = kernel.covariance(
                likeness.rows,
                square,
                shared.temporal[kernel][0],
                shared.correlation[kernel][0],
            )
            covariance[np.diag_indices_from(covariance)] += kernel.noise
            inverse = _inverse(covariance)
            residuals, left_out = block_residuals(inverse, aligned.targets, shared.blocks)
            residuals = residuals[shared.judged].reshape(-1, targets, 3)
            left_out = left_out[shared.judged, None]
            error = (residuals**2).sum(axis=2)
            # what one unit of the kernel's variance is in mm² or (mm/s)², target by target
            unit = (error / left_out).mean(axis=0)

            cross = kernel.covariance(
                likeness.asked,
                asked_square,
                shared.temporal[kernel][1],
                shared.correlation[kernel][1],
            )
            local = cross @ (inverse @ aligned.targets)
            own = 1.0 + shared.offset + kernel.linear * likeness.asked_norm
            own += kernel.radial + kernel.temporal
            left = own - np.einsum("qr,qr->q", cross @ inverse, cross) + kernel.noise
            variance = np.maximum(left, kernel.noise)[:, None]
            predictions.append(
                _Prediction(
                    aligned.to_world(local, markers),
                    variance * unit,
                    residuals @ np.swapaxes(aligned.row_frames.rotation[shared.judged], 1, 2),
                    left_out * unit,
                    np.sqrt(variance[:, 0] / left_out.mean()),
                )
            )
    return predictions


def _calibrate(
    share: NDArray[np.float64],
    residuals: NDArray[np.float64],
    left_out: NDArray[np.float64],
    blocks: int,
) -> tuple[float, float]:
    """Judge a mixture's deviation by what it got wrong on blocks left out.

    Parameters
    ----------
    share : ndarray [shape=(members,)]
        Sum 1.
    residuals : ndarray [shape=(members, rows, missing markers, 3), mm]
        Of the same rows.
    left_out : ndarray [shape=(members, rows, missing markers), mm²]
        Predicted variance of each.
    blocks : int
        How many blocks the rows are from.

    Returns
    -------
    factor : float
        What the mixture's deviation is to be multiplied by.
    bound : float
        What times that deviation 90 % of the errors lie within.
    """
    mean = np.einsum("k,krmi->rmi", share, residuals)
    disagreement = ((residuals - mean) ** 2).sum(axis=3)
    variance = np.einsum("k,krm->rm", share, left_out + disagreement)
    ratio = np.sqrt((mean**2).sum(axis=2) / np.maximum(variance, 1e-12))
    known = blocks / (blocks + PRIOR_BLOCKS)
    factor = float(np.sqrt((ratio**2).mean()))
    if factor < LEAST_DEVIATION:  # nothing was wrong at all
        return LEAST_DEVIATION, BOUND_FACTOR
    bound = float(np.quantile(ratio, BOUND_SHARE)) / factor
    return factor**known, bound**known * BOUND_FACTOR ** (1.0 - known)


@dataclass(frozen=True, eq=False)
class _Mixture:
    """What members say together of some of the targets, and what they got wrong of them."""

    mean: NDArray[np.float64]  # (queries, targets, 3)
    deviation: NDArray[np.float64]  # (queries, targets), as they predict it
    beside: float  # how much lessons beside the first count
    # of the members and rows by which the mixture can be judged
    share: NDArray[np.float64]  # (members,)
    residuals: NDArray[np.float64]  # (members, rows, targets, 3)
    left_out: NDArray[np.float64]  # (members, rows, targets)
    known: NDArray[np.float64]  # (rows, targets, 3), velocities; empty of positions
    blocks: int

    @property
    def wrong(self) -> NDArray[np.float64]:
        """The mixture's residuals [shape=(rows, targets, 3)]."""
        residuals: NDArray[np.float64] = np.einsum("k,krmi->rmi", self.share, self.residuals)
        return residuals


def _mix(
    lessons: Sequence[Lesson],
    shared: Sequence[_Shared],
    found: Sequence[_Prediction],
    of_lesson: NDArray[np.intp],
    inside: NDArray[np.bool_],
    targets: slice,
) -> _Mixture:
    """Mix members, frame by frame, by their left-out errors of some targets and their doubt."""
    handicap = np.array([lesson.handicap for lesson in lessons])[of_lesson, None]
    error = np.array([np.sqrt((x.residuals[:, targets] ** 2).sum(axis=2).mean()) for x in found])
    doubt = np.stack([x.doubt for x in found])
    # a clip that stands still has no error
    judged = np.maximum(error[:, None] * doubt**DOUBT_POWER, 1e-6) * handicap
    share = shares(judged, SELECTION_POWER)
    told = np.stack([x.told[:, targets] for x in found])
    mean = np.einsum("kq,kqmi->qmi", share, told)
    disagreement = ((told - mean) ** 2).sum(axis=3)
    variance = np.stack([x.variance[:, targets] for x in found]) + disagreement
    deviation = np.sqrt(np.einsum("kq,kqm->qm", share, variance))

    # judge the mixture by the rows that all lessons have, or else by those of the weightiest
    usual = share[:, inside].mean(axis=1)
    times = [lesson.rows.time[s.judged] for lesson, s in zip(lessons, shared, strict=True)]
    common = reduce(np.intersect1d, times)
    if len(lessons) > 1 and len(common) >= FEWEST_JUDGED:
        counted, by = np.arange(len(found)), 0
        rows = [np.searchsorted(time, common) for time in times]
    else:
        by = int(np.argmax(np.bincount(of_lesson, usual)))
        counted = np.flatnonzero(of_lesson == by)
        rows = [np.arange(len(time)) for time in times]
    moving = lessons[by].rows.moving
    known = np.empty((len(rows[by]), 0, 3))
    if moving is not None and targets.start:
        known = moving[shared[by].judged[rows[by]]]
    return _Mixture(
        mean,
        deviation,
        float(usual[of_lesson > 0].sum()),
        usual[counted] / usual[counted].sum(),
        np.stack([found[int(k)].residuals[rows[of_lesson[k]], targets] for k in counted]),
        np.stack([found[int(k)].left_out[rows[of_lesson[k]], targets] for k in counted]),
        known,
        min(len(s.blocks) for s in shared),
    )


def regress(
    lessons: Sequence[Lesson],
    members: Sequence[Member],
    block_seconds: float,
    inside: NDArray[np.bool_] | None = None,
    each: Callable[..., Iterable[list[_Prediction]]] = map,
) -> Regression:
    """Predict the missing markers of some poses.

    Parameters
    ----------
    lessons : sequence of Lesson
        Ways to learn the same thing: all have the same queries and missing markers.
    members : sequence of Member
        Ways to predict; each does by each lesson that has its moment. Those of one view, and in
        it of one moment, follow each other.
    block_seconds : float
        Length of the blocks left out: that of the gap.
    inside : ndarray of bool [shape=(poses,)], optional
        Which of the queries are in the gap, the others being beside it; all by default.
    each : callable
        How views are gone through: as `map` does, or several at a time.

    Returns
    -------
    Regression
        Members mixed by their left-out error.
    """
    if inside is None:
        inside = np.ones(len(lessons[0].query.time), dtype=bool)
    kernels = dict.fromkeys(member.kernel for member in members)
    shared = [_share(lesson, kernels, block_seconds) for lesson in lessons]
    able = [[m for m in members if lesson.shows(m.moment)] for lesson in lessons]
    tasks = [
        (view, lesson, list(some), share)
        for lesson, share, readers in zip(lessons, shared, able, strict=True)
        for view, some in groupby(readers, key=lambda member: member.view)
    ]
    found = [one for some in each(_predict, *zip(*tasks, strict=True)) for one in some]
    of_lesson = np.repeat(np.arange(len(lessons)), [len(readers) for readers in able])
    markers = lessons[0].rows.missing.shape[1]
    place = _mix(lessons, shared, found, of_lesson, inside, slice(0, markers))
    factor, bound = _calibrate(place.share, place.residuals, place.left_out, place.blocks)
    factor *= CHOICE**place.beside
    deviation = np.maximum(place.deviation * factor, LEAST_DEVIATION)
    motion = None
    if all(lesson.rows.moving is not None for lesson in lessons):
        pace = _mix(lessons, shared, found, of_lesson, inside, slice(markers, None))
        motion = Motion(
            pace.mean,
            np.sqrt(pace.deviation * by_speed(pace.mean, pace.known - pace.wrong, pace.wrong)),
            np.maximum(np.sqrt((place.wrong**2).sum(axis=2).mean(axis=0)), LEAST_DEVIATION),
        )
    return Regression(place.mean, deviation, bound, motion)
