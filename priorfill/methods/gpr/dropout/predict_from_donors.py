"""What witnesses say: a Gaussian process of several bodies, and how far it is off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootFrames, heading_frames, rigid_frames
from priorfill.gp.calibration import LEAST_DEVIATION
from priorfill.gp.features import ALIGNMENT_FLOOR, View
from priorfill.gp.linalg import (
    explained,
    inverse_root,
    left_out_residuals,
    shares,
    squared_distances,
)
from priorfill.methods.gpr.dropout.donors import Witness
from priorfill.methods.gpr.dropout.marker_coupling import Ties
from priorfill.methods.gpr.dropout.subject_kernel import KINDS, Kin
from priorfill.methods.gpr.dropout.subjects import OWN

__all__ = ["VIEWS", "predict_by_all", "testify"]

OWN_NOISE = 0.1
"""Noise of rows of the clip's own body, of that of other rows."""

SELECTION_POWER = 4.0
"""Members count by (least error / own error) to this power when bodies are left out."""

LEAST_ERROR = 1e-9
"""mm. Even a member without an error has a finite share."""

CHUNK = 500
"""Frames predicted at a time."""

VIEWS = (
    View("rigid", 160.0, 0.002),
    View("rigid", 220.0, 0.005, 10.0),
    View("heading", 220.0, 0.005, 10.0),
)
"""How poses are aligned and visible markers weighted."""


@dataclass(frozen=True, eq=False)
class Members:
    """What all members predict."""

    positions: NDArray[np.float64]  # (members, poses, missing, 3)
    variance: NDArray[np.float64]  # (members, poses, missing)
    errors: NDArray[np.float64]  # (members,)


def testify(
    witnesses: Sequence[Witness],
    query: NDArray[np.float64],
    ties: Ties,
    errors: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Predict missing markers from witnesses.

    Parameters
    ----------
    witnesses : sequence of Witness
        At least one.
    query : ndarray [shape=(poses, visible markers, 3), mm]
        The clip's visible markers.
    ties : Ties
        Of the missing markers and the visible ones.
    errors : ndarray [shape=(members,), mm], optional
        Expected error of each member; without it, it is told by leaving other bodies out.

    Returns
    -------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(poses, missing markers), mm]
        Expected rms Euclidean error.
    """
    told = predict_by_all(witnesses, query, ties, errors)
    share = shares(np.maximum(told.errors, LEAST_ERROR), SELECTION_POWER)
    mean = np.einsum("k,kqmi->qmi", share, told.positions)
    variance = told.variance + ((told.positions - mean) ** 2).sum(axis=3)
    expected_rms = np.sqrt(np.einsum("k,kqm->qm", share, variance))
    return mean, np.maximum(expected_rms, LEAST_DEVIATION)


def predict_by_all(
    witnesses: Sequence[Witness],
    query: NDArray[np.float64],
    ties: Ties,
    errors: NDArray[np.float64] | float | None,
) -> Members:
    """Predict by all members; parameters as for `testify`."""
    rows = _Rows.of(witnesses, query, ties)
    found = [
        member for view in VIEWS for member in _predict(view, rows, query, ties, errors is None)
    ]
    positions, variances, judged = zip(*found, strict=True)
    variance = np.stack(variances)
    if errors is None:
        return Members(np.stack(positions), variance, np.array(judged))
    told = np.broadcast_to(errors, len(found)).astype(np.float64)
    return Members(
        np.stack(positions), np.broadcast_to(told[:, None, None] ** 2, variance.shape), told
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """The poses of all witnesses."""

    visible: NDArray[np.float64]  # (rows, visible, 3)
    missing: NDArray[np.float64]  # (rows, missing, 3)
    witness: NDArray[np.intp]  # (rows,) whose
    body: NDArray[np.intp]  # (witnesses and the clip,)
    mirrored: NDArray[np.bool_]  # (witnesses and the clip,)
    shapes: NDArray[np.float64]  # (witnesses and the clip, pairs)

    @classmethod
    def of(cls, witnesses: Sequence[Witness], query: NDArray[np.float64], ties: Ties) -> _Rows:
        # one body has one shape, whatever its takes show
        shapes = [
            ties.shape(query if w.body == OWN and not w.mirrored else w.visible) for w in witnesses
        ]
        return cls(
            np.concatenate([w.visible for w in witnesses]),
            np.concatenate([w.missing for w in witnesses]),
            np.repeat(np.arange(len(witnesses)), [len(w.visible) for w in witnesses]),
            np.array([*(w.body for w in witnesses), OWN]),
            np.array([*(w.mirrored for w in witnesses), False]),
            np.array([*shapes, ties.shape(query)]),
        )

    @property
    def own(self) -> NDArray[np.bool_]:
        """Which rows are of the clip's own body, and not in a mirror."""
        own: NDArray[np.bool_] = (self.body == OWN)[self.witness] & ~self.mirrored[self.witness]
        return own

    def blocks(self) -> list[NDArray[np.intp]]:
        """Rows of each other body; its image stays if the clip has one to learn from."""
        others = self.body[:-1] != OWN
        seen_in_mirror = bool(np.any(~others & self.mirrored[:-1]))
        blocks = []
        for number in np.flatnonzero(others):
            same = np.flatnonzero(self.body[:-1] == self.body[number])
            if seen_in_mirror:
                same = np.array([number])
            elif number != same[0]:
                continue  # done with the other side
            blocks.append(np.flatnonzero(np.isin(self.witness, same)))
        return blocks


_Member = tuple[NDArray[np.float64], NDArray[np.float64], float]
"""Position and variance (poses, missing) that a member predicts, and its left-out error."""


@dataclass(frozen=True, eq=False)
class _Aligned:
    """Rows and queries as a view sees them."""

    known: NDArray[np.float64]  # (rows, features), of mean 0 and mean square norm 1
    asked: NDArray[np.float64]  # (queries, features)
    frames: RootFrames  # of the queries
    targets: NDArray[np.float64]  # (rows, missing * 3), mm, about the centre
    centre: NDArray[np.float64]  # (missing * 3,), mm

    @classmethod
    def of(cls, view: View, rows: _Rows, query: NDArray[np.float64], ties: Ties) -> _Aligned:
        """Align poses as a view asks, and weigh their visible markers."""
        nearness = np.exp(-0.5 * (ties.distance / view.reach) ** 2)
        firmness = np.ones_like(nearness)
        if view.slack is not None:
            firmness = 1.0 / (1.0 + (ties.spread / view.slack) ** 2)
        alignment = nearness * firmness + ALIGNMENT_FLOOR
        weight = nearness * np.sqrt(firmness) + view.floor
        align = rigid_frames if view.frame == "rigid" else heading_frames
        template = query[len(query) // 2]
        row_frames = align(rows.visible, template, alignment)
        query_frames = align(query, template, alignment)

        known = (row_frames.to_local(rows.visible) * weight[:, None]).reshape(len(rows.visible), -1)
        asked = (query_frames.to_local(query) * weight[:, None]).reshape(len(query), -1)
        middle = known.mean(axis=0)
        known, asked = known - middle, asked - middle
        scale = float(np.sqrt((known**2).sum(axis=1).mean())) or 1.0
        targets = row_frames.to_local(rows.missing).reshape(len(known), -1)
        # the own body, where it is a witness, is what others are compared with
        centre = (targets[rows.own] if rows.own.any() else targets).mean(axis=0)
        return cls(known / scale, asked / scale, query_frames, targets - centre, centre)


def _predict(
    view: View, rows: _Rows, query: NDArray[np.float64], ties: Ties, judge: bool
) -> list[_Member]:
    """Predict by the members of one view; ``judge`` them by leaving bodies out, too."""
    aligned = _Aligned.of(view, rows, query, ties)
    product = aligned.known @ aligned.known.T
    norm = np.diag(product)
    square = squared_distances(product, norm, norm)
    blocks = rows.blocks() if judge else []
    markers = aligned.targets.shape[1] // 3
    members = []
    for kin in KINDS:
        shared = kin.shared(rows.shapes, rows.body, rows.mirrored)
        alike = kin.similarity(product, square)
        covariance = kin.covariance(alike, shared[np.ix_(rows.witness, rows.witness)])
        noise = kin.noise * np.where(rows.own, OWN_NOISE, 1.0)
        covariance[np.diag_indices_from(covariance)] += noise
        root = inverse_root(covariance)
        weights = root.T @ (root @ aligned.targets)
        local, left = _expect(kin, aligned, norm, shared[-1][rows.witness], root, weights)
        least = float(noise.min())
        left = np.maximum(left + least, least)
        positions = aligned.frames.to_world((local + aligned.centre).reshape(-1, markers, 3))
        unit, missed = np.ones(markers), np.nan
        if judge:
            unit, missed = _judge(root, weights, blocks, markers)
        members.append((positions, left[:, None] * unit, missed))
    return members


def _expect(
    kin: Kin,
    aligned: _Aligned,
    norm: NDArray[np.float64],
    shared: NDArray[np.float64],
    root: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the process's mean and variance, without noise, for the queries.

    Parameters
    ----------
    kin : Kin
        The covariance.
    aligned : _Aligned
        Rows and queries.
    norm : ndarray [shape=(rows,)]
        Inner product of each row's features with themselves.
    shared : ndarray [shape=(rows,)]
        What each row's body shares with the clip's.
    root : ndarray [shape=(rows, rows)]
        `inverse_root` of the rows' covariance with noise.
    weights : ndarray [shape=(rows, missing * 3)]
        Its inverse times the targets.

    Returns
    -------
    mean : ndarray [shape=(queries, missing * 3), mm]
        In the queries' frames, from the targets' centre.
    variance : ndarray [shape=(queries,)]
        In units of the kernel.
    """
    asked = aligned.asked
    mean = np.empty((len(asked), aligned.targets.shape[1]))
    variance = np.empty(len(asked))
    for start in range(0, len(asked), CHUNK):
        some = slice(start, start + CHUNK)
        product = asked[some] @ aligned.known.T
        length = (asked[some] ** 2).sum(axis=1)
        alike = kin.similarity(product, squared_distances(product, length, norm))
        cross = kin.covariance(alike, shared)
        itself = kin.linear * length + kin.radial
        mean[some] = cross @ weights
        variance[some] = 1.0 + itself + kin.offset + kin.movement * itself
        variance[some] -= explained(root, cross)
    return mean, variance


def _judge(
    root: NDArray[np.float64],
    weights: NDArray[np.float64],
    blocks: Sequence[NDArray[np.intp]],
    markers: int,
) -> tuple[NDArray[np.float64], float]:
    """Leave bodies out: what a unit of variance is in mm², by marker, and the rms error in mm."""
    residuals, variance = left_out_residuals(root, weights, blocks)
    judged = np.concatenate(blocks)
    square = (residuals[judged].reshape(len(judged), markers, 3) ** 2).sum(axis=2)
    unit = (square / variance[judged][:, None]).mean(axis=0)
    return unit, float(np.sqrt(square.mean()))
