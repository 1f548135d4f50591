"""Gaussian-process regression from visible to missing markers.

The rows are poses in which the missing markers were seen. Poses are aligned near the gap (a
*view*), the visible markers' coordinates weighted by how near and how firmly they are tied to
the missing ones, and a Gaussian process (GP) predicts the missing coordinates in the aligned
frame. Its kernel has a linear part (bodies are nearly linear between near poses), a radial part
(k-nearest-neighbour like), and a part that decays with time, which carries the seam: rows right
beside the gap are followed closely there and forgotten further in.

No view and kernel is best for all movements. Each pair of them is a *member*; all predict, and
each counts by its error when blocks as long as the gap are left out of the rows, which has a
closed form [R06]_ Eq. (5.12), generalised to blocks: with the inverse kernel matrix G, the
residuals of block B are inv(G_BB) (G Y)_B and their covariance is inv(G_BB).

References
----------
.. [R06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri

from priorfill.normalise import RootFrames, heading_frames, rigid_frames

__all__ = ["Kernel", "Lesson", "Regression", "Rows", "View", "block_residuals", "regress"]

SELECTION_POWER = 8.0
"""Members count by (least error / own error) to this power: between the mean of all (0) and the
best alone (infinite), both of which fill worse."""

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
    """

    linear: float
    radial: float
    length: float
    temporal: float
    seconds: float
    smooth: bool
    noise: float

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
    """

    visible: NDArray[np.float64]
    missing: NDArray[np.float64]
    time: NDArray[np.float64]
    take: NDArray[np.intp]
    kinship: NDArray[np.float64] | None = None
    body: NDArray[np.intp] | None = None

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

    def blocks(self, seconds: float) -> list[NDArray[np.intp]]:
        """Return indices of the poses of the queries' kin in blocks of some length."""
        number = np.floor(self.time / max(seconds, 1e-3)).astype(np.intp)
        _, block = np.unique(np.stack([self.take, number]), axis=1, return_inverse=True)
        block = block.ravel()
        blocks = [np.flatnonzero(block == b) for b in range(block.max() + 1)]
        if self.kinship is None:
            return blocks
        nearest = self.kinship.max()
        return [b for b in blocks if self.kinship[b[0]] == nearest]


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


@dataclass(frozen=True, eq=False)
class Regression:
    """What the regression says of the missing markers.

    Attributes
    ----------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(poses, missing markers), mm]
        Expected rms Euclidean error.
    error : float
        Rms Euclidean error (mm) of the mixture's members when blocks are left out.
    """

    positions: NDArray[np.float64]
    deviation: NDArray[np.float64]
    error: float


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
    for block in blocks:
        covariance = np.linalg.inv(inverse[np.ix_(block, block)])
        residuals[block] = covariance @ weights[block]
        variance[block] = np.diag(covariance)
    return residuals, variance


def _inverse(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert a covariance matrix in half the time that it takes for any matrix."""
    factor, failed = dpotrf(covariance, lower=True, clean=False)
    if failed:  # not positive definite to the last bit
        return np.linalg.inv(covariance).astype(np.float64, copy=False)
    half, _ = dpotri(factor, lower=True, overwrite_c=True)
    inverse: NDArray[np.float64] = np.tril(half) + np.tril(half, -1).T
    return inverse


@dataclass(frozen=True, eq=False)
class _Aligned:
    """Features and targets of one view."""

    features: NDArray[np.float64]  # (rows, visible * 3), mean square norm 1
    query_features: NDArray[np.float64]  # (queries, visible * 3)
    targets: NDArray[np.float64]  # (rows, missing * 3), mm, centred
    centre: NDArray[np.float64]  # (missing * 3,), mm
    frames: RootFrames  # of the queries


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

    def features(poses: Rows, frames: RootFrames) -> NDArray[np.float64]:
        return (frames.to_local(poses.visible) * weight[:, None]).reshape(len(poses.time), -1)

    known = features(rows, row_frames)
    asked = features(query, query_frames)
    mean = known.mean(axis=0)
    known, asked = known - mean, asked - mean
    scale = np.sqrt((known**2).sum(axis=1).mean()) or 1.0
    targets = row_frames.to_local(rows.missing).reshape(len(rows.time), -1)
    centre = targets.mean(axis=0)
    return _Aligned(known / scale, asked / scale, targets - centre, centre, query_frames)


@dataclass(frozen=True, eq=False)
class _Shared:
    """What all views of a lesson share."""

    blocks: list[NDArray[np.intp]]
    correlations: tuple[NDArray[np.float64] | float, NDArray[np.float64] | float]
    decays: list[tuple[NDArray[np.float64], NDArray[np.float64]]]  # and offsets; by kernel
    offset: float  # variance of a query's own


def _share(lesson: Lesson, kernels: Sequence[Kernel], block_seconds: float) -> _Shared:
    rows, query = lesson.rows, lesson.query
    lag, asked_lag = rows.lag(rows), query.lag(rows)
    offset, asked_offset = rows.offset(rows), query.offset(rows)
    return _Shared(
        rows.blocks(block_seconds),
        (rows.correlation(rows), query.correlation(rows)),
        [
            (kernel.decay(lag) + offset, kernel.decay(asked_lag) + asked_offset)
            for kernel in kernels
        ],
        BODY_OFFSET if rows.body is not None else 0.0,
    )


_Member = tuple[NDArray[np.float64], NDArray[np.float64], float]
"""Position and variance (queries, missing) that a member predicts, and its left-out error."""


def _predict(
    view: View, lesson: Lesson, kernels: Sequence[Kernel], shared: _Shared
) -> list[_Member]:
    """Predict by the members of one view, a kernel each."""
    aligned = _align(view, lesson)
    blocks, correlations = shared.blocks, shared.correlations
    judged = np.concatenate(blocks)
    features, asked = aligned.features, aligned.query_features
    product = features @ features.T
    asked_product = asked @ features.T
    norm = np.diag(product)
    asked_norm = (asked**2).sum(axis=1)
    square = norm[:, None] + norm - 2.0 * product
    asked_square = asked_norm[:, None] + norm - 2.0 * asked_product
    markers = aligned.targets.shape[1] // 3
    members = []
    for kernel, (decay, asked_decay) in zip(kernels, shared.decays, strict=True):
        covariance = kernel.covariance(product, square, decay, correlations[0])
        covariance[np.diag_indices_from(covariance)] += kernel.noise
        inverse = _inverse(covariance)
        residuals, variance = block_residuals(inverse, aligned.targets, blocks)
        residuals, variance = residuals[judged], variance[judged]
        # what one unit of the kernel's variance is in mm², marker by marker
        error = (residuals.reshape(len(residuals), markers, 3) ** 2).sum(axis=2)
        unit = (error / variance[:, None]).mean(axis=0)

        cross = kernel.covariance(asked_product, asked_square, asked_decay, correlations[1])
        local = (cross @ (inverse @ aligned.targets) + aligned.centre).reshape(-1, markers, 3)
        own = 1.0 + shared.offset + kernel.linear * asked_norm + kernel.radial + kernel.temporal
        left = own - np.einsum("qr,qr->q", cross @ inverse, cross) + kernel.noise
        predicted = np.maximum(left, kernel.noise)[:, None] * unit
        members.append((aligned.frames.to_world(local), predicted, float(np.sqrt(error.mean()))))
    return members


def regress(
    lessons: Sequence[Lesson],
    views: Sequence[View],
    kernels: Sequence[Kernel],
    block_seconds: float,
    each: Callable[..., Iterable[list[_Member]]] = map,
) -> Regression:
    """Predict the missing markers of some poses.

    Parameters
    ----------
    lessons : sequence of Lesson
        Ways to learn the same thing: all have the same queries and missing markers.
    views, kernels : sequences
        Members: each lesson in each view with each kernel.
    block_seconds : float
        Length of the blocks left out: that of the gap.
    each : callable
        How views are gone through: as `map` does, or several at a time.

    Returns
    -------
    Regression
        Members mixed by their left-out error.
    """
    tasks = []
    for lesson in lessons:
        shared = _share(lesson, kernels, block_seconds)
        tasks += [(view, lesson, kernels, shared) for view in views]
    members = [member for some in each(_predict, *zip(*tasks, strict=True)) for member in some]
    positions, variances, errors = zip(*members, strict=True)
    error_of = np.maximum(np.array(errors), 1e-6)  # mm; a clip that stands still has none
    judged = error_of * np.repeat([x.handicap for x in lessons], len(views) * len(kernels))
    share = (judged.min() / judged) ** SELECTION_POWER
    share /= share.sum()
    mean = np.einsum("k,kqmi->qmi", share, np.stack(positions))
    disagreement = ((np.stack(positions) - mean) ** 2).sum(axis=3)
    variance = np.einsum("k,kqm->qm", share, np.stack(variances) + disagreement)
    return Regression(mean, np.sqrt(np.maximum(variance, 1e-6)), float(share @ error_of))
