"""Poses of other bodies brought onto the clip's: lengths of limbs, places of markers along them.

A pose of another subject is read as directions of limbs. The vector between two markers keeps its
direction and gets the length that the distance of these markers has in the clip, in so far as that
distance is constant, and differs by more than it varies. The vectors of all pairs are joined by
weighted least squares (a graph Laplacian, as for deforming meshes: Sorkine et al. 2004,
doi:10.1145/1057432.1057456). The result is a linear function of the pose, so velocities and lagged
poses are mapped by the same matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.gp.linalg import inverse_root
from priorfill.methods.task import THIS_CLIP
from priorfill.runtime.elementary import exp, log
from priorfill.runtime.option_checks import check_at_least

__all__ = ["BodyMapOptions", "body_maps", "bring_onto_clip"]

MIN_CONSTANT = 0.8
"""Distances with standard deviations up to half of `BodyMapOptions.spread_scale` show whether a
body is the clip's own."""

POSES_PER_BATCH = 2**12
"""Poses mapped at a time, which take about 2 MB."""


@dataclass(frozen=True)
class BodyMapOptions:
    """How poses of other subjects are mapped onto the clip's body.

    Attributes
    ----------
    max_poses : int
        Poses of each subject, evenly spaced, in which its distances are measured.
    total_poses : int
        The same for all subjects together.
    spread_scale : float
        mm. A pair of markers whose distance has this standard deviation is scaled half way between
        the ratio of the two bodies and that of its own distance.
    noise : float
        mm. Added, in squares, to the standard deviation of a distance: a pair's weight is the
        inverse of the sum.
    distance_scale : float
        mm. The weight of a pair at the distance D is multiplied by exp(-D^2 / 2 distance_scale^2).
    place_weight : float
        Relative weight of each marker's place on the scaled body, which determines what the
        vectors leave open.
    same_body_distance : float
        mm. A subject is the clip's own if its constant distances differ from the clip's by at most
        this, in the median, as in `DropoutOptions`. Then nothing is mapped: poses of others as
        recorded are farther away, so the search prefers those of the clip's own subject, who
        moves like the clip. With the others mapped, errors of limbs are 4 % larger in that case.
    """

    max_poses: int = 60
    total_poses: int = 4000
    spread_scale: float = 20.0
    noise: float = 10.0
    distance_scale: float = 400.0
    place_weight: float = 1e-3
    same_body_distance: float = 2.8

    def __post_init__(self) -> None:
        check_at_least(self, 1, "max_poses", "total_poses")
        check_at_least(self, 1e-9, "spread_scale", "noise", "distance_scale", "place_weight")
        check_at_least(self, 0.0, "same_body_distance")


def body_maps(
    distance: NDArray[np.float64],
    spread: NDArray[np.float64],
    subjects: Sequence[NDArray[np.float64]],
    options: BodyMapOptions = BodyMapOptions(),
) -> list[NDArray[np.float64]]:
    """Return the matrix that maps poses of each subject onto the clip's body.

    Parameters
    ----------
    distance, spread : ndarray [shape=(markers, markers), mm]
        Rms distance of each pair of markers in the clip, and its standard deviation; infinite
        where unknown.
    subjects : sequence of ndarray [shape=(poses, markers, 3), mm]
        Complete poses of each subject.

    Returns
    -------
    list of ndarray [shape=(markers, markers)]
        ``matrix @ pose`` is the pose on the clip's body, its path in the world scaled by the ratio
        of the bodies. Empty where one of the subjects has the clip's body, see
        `BodyMapOptions.same_body_distance`.
    """
    measured = [_distances(poses) for poses in subjects]
    pooled = np.sqrt(np.mean([one[1] ** 2 for one in measured], axis=0))
    common = np.where(np.isfinite(spread), np.maximum(spread, pooled), np.inf)
    known = np.isfinite(distance) & np.isfinite(common) & (distance > 0.0)
    np.fill_diagonal(known, False)
    length, common = np.where(known, distance, 1.0), np.where(known, common, 0.0)
    weight = np.where(known, exp(-(length**2) / (2.0 * options.distance_scale**2)), 0.0)
    weight /= options.noise**2 + common**2
    constant = known / (1.0 + (common / options.spread_scale) ** 2)
    stiff = length * constant**2
    rigid = constant > MIN_CONSTANT
    if rigid.any() and any(
        np.median(np.abs(other - length)[rigid]) <= options.same_body_distance
        for other, _ in measured
    ):
        return []
    place = options.place_weight * max(float(weight.sum(axis=1).mean()), 1e-12)
    root = inverse_root(_laplacian(weight) + place * np.eye(len(weight)))
    inverse = root.T @ root
    maps = []
    for other, _ in measured:
        ratio = log(length / np.where(known, np.maximum(other, 1e-3), 1.0))
        scale = float((stiff * ratio).sum() / max(float(stiff.sum()), 1e-12))
        difference = (length * (ratio - scale)) ** 2
        share = constant * difference / np.maximum(difference + common**2, 1e-12)
        factor = exp(scale + share * (ratio - scale))
        size = float(exp(np.array([scale]))[0])
        maps.append(inverse @ (_laplacian(weight * factor) + place * size * np.eye(len(weight))))
    return maps


def bring_onto_clip(
    positions: NDArray[np.float32],
    subject: NDArray[np.intp],
    rows: NDArray[np.intp],
    clip: tuple[NDArray[np.float64], NDArray[np.float64]],
    options: BodyMapOptions = BodyMapOptions(),
) -> bool:
    """Map the poses of other subjects onto the clip's body, in place.

    Parameters
    ----------
    positions : ndarray [shape=(poses, markers, 3), mm]
        Of all takes; NaN where missing. A pose with a missing marker becomes NaN throughout.
    subject : ndarray of int [shape=(poses,)]
        Number of each one's subject; those of `THIS_CLIP` stay as they are.
    rows : ndarray of int
        Complete poses, in which distances are measured.
    clip : tuple of two ndarrays [shape=(markers, markers), mm]
        Distance and spread, as of `body_maps`.

    Returns
    -------
    bool
        Whether any pose is mapped.
    """
    shown = subject[rows]
    others = np.unique(shown[shown != THIS_CLIP])
    if not len(others):
        return False
    count = max(1, min(options.max_poses, options.total_poses // len(others)))
    samples = []
    for number in others:
        own = rows[shown == number]
        samples.append(positions[own[evenly_spaced(len(own), count)]].astype(np.float64))
    maps = dict(zip(others.tolist(), body_maps(*clip, samples, options), strict=False))
    bounds = np.flatnonzero(np.diff(subject)) + 1
    for start, stop in pairwise([0, *bounds.tolist(), len(subject)]):
        matrix = maps.get(int(subject[start]))
        if matrix is None:
            continue
        single = matrix.astype(np.float32)
        for begin in range(start, stop, POSES_PER_BATCH):
            batch = slice(begin, min(begin + POSES_PER_BATCH, stop))
            positions[batch] = np.matmul(single, positions[batch])
    return bool(maps)


def _laplacian(weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix L with ``(L x)_i = sum_j weight_ij (x_i - x_j)``."""
    return np.diag(weight.sum(axis=1)) - weight


def _distances(poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rms and standard deviation of the distances in complete poses."""
    centred = poses - poses.mean(axis=1, keepdims=True)
    product = centred @ np.swapaxes(centred, 1, 2)
    norm = np.einsum("pii->pi", product)
    square = np.maximum(norm[:, :, None] + norm[:, None] - 2.0 * product, 0.0)
    mean_square = square.mean(axis=0)
    variance = mean_square - np.sqrt(square).mean(axis=0) ** 2
    return np.sqrt(mean_square), np.sqrt(np.maximum(variance, 0.0))
