"""Readers: one view's members, which learn from the rows of a lesson and predict its queries.

Learning costs what the rows cost, whatever the number of queries; queries are predicted a part at a
time, so that long gaps need no more memory than short ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootFrames, heading_frames, rigid_frames
from priorfill.gp.data import (
    BODY_OFFSET,
    Lesson,
    Member,
    Rows,
)
from priorfill.gp.features import ALIGNMENT_FLOOR, Moment, View
from priorfill.gp.linalg import explained, inverse_root, left_out_residuals
from priorfill.gp.pose_kernel import Kernel

__all__ = ["Learnt", "Reader", "Shared", "Told"]

_Decays = dict[Kernel, NDArray[np.float64]]
_Correlations = dict[Kernel, NDArray[np.float64] | float]


@dataclass(frozen=True, eq=False)
class Shared:
    """What all members share in a lesson, whatever their view.

    Attributes
    ----------
    blocks : list of ndarray of int
        Rows that are left out together.
    judged : ndarray of int
        Rows of the blocks, in order of time.
    decays, correlations : mapping of Kernel to ndarray [shape=(rows, rows)]
        Of the rows: covariance in time, bodies' offsets included, and correlation.
    """

    blocks: list[NDArray[np.intp]]
    judged: NDArray[np.intp]
    decays: _Decays
    correlations: _Correlations
    _rows: Rows

    @classmethod
    def of(cls, lesson: Lesson, kernels: Iterable[Kernel], block_seconds: float) -> Shared:
        """Return what is shared by some kernels, with blocks of some length (s)."""
        rows = lesson.rows
        blocks = rows.blocks(block_seconds, lesson.query)
        judged = np.concatenate(blocks)
        return cls(
            blocks,
            judged[np.argsort(rows.time[judged], kind="stable")],
            *_in_time(rows, rows, kernels),
            rows,
        )

    def asked(self, query: Rows) -> tuple[_Decays, _Correlations]:
        """Return covariance in time, and correlation, of queries with the rows, by kernel."""
        return _in_time(query, self._rows, self.decays)

    @property
    def offset(self) -> float:
        """Variance of the offset of a query's body."""
        return BODY_OFFSET if self._rows.body is not None else 0.0


def _in_time(poses: Rows, rows: Rows, kernels: Iterable[Kernel]) -> tuple[_Decays, _Correlations]:
    """Return covariance in time with bodies' offsets, and correlation, by kernel.

    Kernels that forget alike have the same array.
    """
    lag, offset, same = poses.lag(rows), poses.offset(rows), poses.correlation(rows)
    decays: dict[tuple[float, float, bool], NDArray[np.float64]] = {}
    correlations: dict[float | None, NDArray[np.float64] | float] = {}
    for kernel in kernels:
        way = (kernel.temporal, kernel.seconds, kernel.smooth)
        if way not in decays:
            decays[way] = kernel.decay(lag) + offset
        if kernel.fading not in correlations:
            correlations[kernel.fading] = same * kernel.memory(lag)
    return (
        {k: decays[k.temporal, k.seconds, k.smooth] for k in kernels},
        {k: correlations[k.fading] for k in kernels},
    )


@dataclass(frozen=True, eq=False)
class _Features:
    """Features of the rows, centred."""

    known: NDArray[np.float64]  # (rows, features)
    mean: NDArray[np.float64]  # (features,)

    @classmethod
    def of(cls, features: NDArray[np.float64]) -> _Features:
        mean = features.mean(axis=0)
        return cls(features - mean, mean)

    @property
    def product(self) -> NDArray[np.float64]:
        """Inner products of the rows' features."""
        product: NDArray[np.float64] = self.known @ self.known.T
        return product

    def asked(
        self, features: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Inner products of queries' features with the rows', and with themselves."""
        centred = features - self.mean
        return centred @ self.known.T, (centred**2).sum(axis=1)


@dataclass(frozen=True, eq=False)
class Learnt:
    """What a member has learnt from the rows.

    Attributes
    ----------
    residuals : ndarray [shape=(judged rows, targets, 3), mm and mm/s]
        Upright, blocks left out; of the positions, then of the velocities.
    left_out : ndarray [shape=(judged rows, targets)]
        Their predicted variance.
    """

    kernel: Kernel
    residuals: NDArray[np.float64]
    left_out: NDArray[np.float64]
    _root: NDArray[np.float64]  # (rows, rows), of the inverse covariance
    _weights: NDArray[np.float64]  # (rows, targets * 3)
    _unit: NDArray[np.float64]  # (targets,), of the kernel's variance in mm² or (mm/s)²
    _usual: float  # mean variance of the rows, their blocks left out

    @classmethod
    def by(
        cls,
        kernel: Kernel,
        covariance: NDArray[np.float64],
        targets: NDArray[np.float64],
        rotation: NDArray[np.float64],
        shared: Shared,
    ) -> Learnt:
        """Learn targets [shape=(rows, targets * 3)] in frames of some rotation."""
        covariance[np.diag_indices_from(covariance)] += kernel.noise
        root = inverse_root(covariance)
        weights = root.T @ (root @ targets)
        residuals, variance = left_out_residuals(root, weights, shared.blocks)
        residuals = residuals[shared.judged].reshape(len(shared.judged), -1, 3)
        left_out = variance[shared.judged, None]
        # what one unit of the kernel's variance is in mm² or (mm/s)², target by target
        unit = ((residuals**2).sum(axis=2) / left_out).mean(axis=0)
        return cls(
            kernel,
            residuals @ np.swapaxes(rotation[shared.judged], 1, 2),
            left_out * unit,
            root,
            weights,
            unit,
            float(left_out.mean()),
        )

    def tell(
        self, cross: NDArray[np.float64], norm: NDArray[np.float64], offset: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Predict queries.

        Parameters
        ----------
        cross : ndarray [shape=(queries, rows)]
            Covariance with the rows.
        norm : ndarray [shape=(queries,)]
            Inner product of their features with themselves.
        offset : float
            Variance of the offset of their body.

        Returns
        -------
        local : ndarray [shape=(queries, targets * 3)]
            In the root frames, centred.
        variance : ndarray [shape=(queries, targets)]
        doubt : ndarray [shape=(queries,)]
            Deviation predicted / that of the blocks left out.
        """
        kernel = self.kernel
        own = 1.0 + offset + kernel.linear * norm
        own += kernel.radial + kernel.temporal
        left = own - explained(self._root, cross) + kernel.noise
        variance = np.maximum(left, kernel.noise)
        return (
            cross @ self._weights,
            variance[:, None] * self._unit,
            np.sqrt(variance / self._usual),
        )


@dataclass(frozen=True, eq=False)
class Told:
    """What members say of targets: the positions (mm), then the velocities (mm/s).

    Attributes
    ----------
    told : ndarray [shape=(members, queries, targets, 3)]
        Upright.
    variance : ndarray [shape=(members, queries, targets)]
    doubt : ndarray [shape=(members, queries)]
        Deviation predicted / that of the blocks left out.
    """

    told: NDArray[np.float64]
    variance: NDArray[np.float64]
    doubt: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reader:
    """The members of one view, and what they have learnt from a lesson.

    Attributes
    ----------
    learnt : tuple of Learnt
        Of each member.
    lesson : Lesson
        What they learnt from.
    shared : Shared
        What they share with members of other views.
    """

    learnt: tuple[Learnt, ...]
    lesson: Lesson
    shared: Shared
    _members: tuple[Member, ...]
    _view: View
    _weight: NDArray[np.float64]  # (visible,), of the features
    _alignment: NDArray[np.float64]  # (visible,)
    _template: NDArray[np.float64]  # (visible, 3), mm
    _centre: NDArray[np.float64]  # (targets * 3,)
    _features: dict[Moment | None, _Features]
    _norm: dict[Moment | None, NDArray[np.float64]]  # (rows,), scaled
    _scale: dict[Moment | None, float]

    @classmethod
    def of(cls, view: View, lesson: Lesson, members: Sequence[Member], shared: Shared) -> Reader:
        """Let members of a view, those of one moment after each other, learn from a lesson."""
        rows = lesson.rows
        nearness = np.exp(-(lesson.distance**2) / (2.0 * view.reach**2))
        firmness = np.ones_like(nearness)
        if view.slack is not None:
            firmness = 1.0 / (1.0 + (lesson.spread / view.slack) ** 2)
        alignment = nearness * firmness + ALIGNMENT_FLOOR
        weight = nearness * np.sqrt(firmness) + view.floor
        template = rows.visible[len(rows.visible) // 2]
        frames = _align(view, rows.visible, template, alignment)
        targets = frames.to_local(rows.missing)
        if rows.moving is not None:
            targets = np.concatenate([targets, rows.moving @ frames.rotation], axis=1)
        targets = targets.reshape(len(rows.time), -1)
        centre = targets.mean(axis=0)
        targets = targets - centre

        features: dict[Moment | None, _Features] = {}
        features[None] = _Features.of(_features(rows, frames, weight, None))
        poses = features[None].product
        norms: dict[Moment | None, NDArray[np.float64]] = {}
        scales: dict[Moment | None, float] = {}
        learnt = []
        for moment, some in groupby(members, key=lambda member: member.moment):
            product = poses
            if moment is not None:
                features[moment] = _Features.of(_features(rows, frames, weight, moment))
                product = poses + features[moment].product
            scales[moment] = float(np.trace(product)) / len(product) or 1.0
            product = product / scales[moment]
            norms[moment] = np.diag(product)
            square = norms[moment][:, None] + norms[moment] - 2.0 * product
            near = _Nearness(square)
            for kernel in (member.kernel for member in some):
                covariance = kernel.combined(
                    product, near.of(kernel), shared.decays[kernel], shared.correlations[kernel]
                )
                learnt.append(Learnt.by(kernel, covariance, targets, frames.rotation, shared))
        return cls(
            tuple(learnt),
            lesson,
            shared,
            tuple(members),
            view,
            weight,
            alignment,
            template,
            centre,
            features,
            norms,
            scales,
        )

    def tell(self, query: Rows, decays: _Decays, correlations: _Correlations) -> Told:
        """Predict some of the queries.

        Parameters
        ----------
        query : Rows
            The queries.
        decays, correlations : mappings
            As `Shared.asked` gives them for these queries.
        """
        frames = _align(self._view, query.visible, self._template, self._alignment)
        count, targets = len(query.time), len(self._centre) // 3
        told = np.empty((len(self.learnt), count, targets, 3))
        variance = np.empty((len(self.learnt), count, targets))
        doubt = np.empty((len(self.learnt), count))
        poses, norm_of_poses = self._features[None].asked(
            _features(query, frames, self._weight, None)
        )
        numbered = enumerate(self._members)
        for moment, some in groupby(numbered, key=lambda pair: pair[1].moment):
            product, norm = poses, norm_of_poses
            if moment is not None:
                more, more_norm = self._features[moment].asked(
                    _features(query, frames, self._weight, moment)
                )
                product, norm = product + more, norm + more_norm
            product, norm = product / self._scale[moment], norm / self._scale[moment]
            near = _Nearness(norm[:, None] + self._norm[moment] - 2.0 * product)
            for place, member in some:
                kernel = member.kernel
                cross = kernel.combined(
                    product, near.of(kernel), decays[kernel], correlations[kernel]
                )
                local, variance[place], doubt[place] = self.learnt[place].tell(
                    cross, norm, self.shared.offset
                )
                told[place] = (local + self._centre).reshape(count, targets, 3)
        told = told @ np.swapaxes(frames.rotation, 1, 2)
        told[:, :, : self.lesson.rows.missing.shape[1]] += frames.origin[:, None, :]
        return Told(told, variance, doubt)


class _Nearness:
    """Radial parts of covariances by squared distances; kernels of one length share theirs."""

    def __init__(self, square: NDArray[np.float64]) -> None:
        self._square = square
        self._by_length: dict[float, NDArray[np.float64]] = {}

    def of(self, kernel: Kernel) -> NDArray[np.float64]:
        """Return that of a kernel; anything where it has no radial part."""
        if not kernel.radial:
            return self._square
        if kernel.length not in self._by_length:
            self._by_length[kernel.length] = kernel.nearness(self._square)
        return self._by_length[kernel.length]


def _align(
    view: View,
    poses: NDArray[np.float64],
    template: NDArray[np.float64],
    alignment: NDArray[np.float64],
) -> RootFrames:
    """Return root frames of poses [shape=(poses, visible markers, 3), mm] as a view asks."""
    align = rigid_frames if view.frame == "rigid" else heading_frames
    return align(poses, template, alignment)


def _features(
    poses: Rows, frames: RootFrames, weight: NDArray[np.float64], moment: Moment | None
) -> NDArray[np.float64]:
    """Return features of poses, or of a moment around them [shape=(poses, features)]."""
    if moment is None:
        parts = [frames.to_local(poses.visible)]
    elif moment.velocity:
        before, after = poses.around[moment.seconds]
        parts = [moment.weight * ((after - before) @ frames.rotation)]
    else:
        parts = [moment.weight * frames.to_local(x) for x in poses.around[moment.seconds]]
    weighted = np.concatenate([part * weight[:, None] for part in parts], axis=1)
    return weighted.reshape(len(weighted), -1)
