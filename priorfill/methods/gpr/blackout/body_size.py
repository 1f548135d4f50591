"""Size of other subjects, from distances that are constant in the clip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms
from priorfill.geometry.poses import sample_complete_poses

__all__ = ["ConstantDistances", "compare_sizes", "constant_distances"]

_Floats = NDArray[np.float64]
_Ints = NDArray[np.intp]

MAX_DISTANCES = 60
"""Distances that are compared, those that vary least relative to their length."""

MAX_SHARE = 1.0 / 3.0
"""Share of all distances that is compared at most: few markers have few constant ones."""

MIN_LENGTH, MAX_LENGTH = 60.0, 700.0
"""mm. Shorter distances say little about the size, and longer ones span several joints."""

MAX_POSES = 200
"""Poses of the clip in which the distances are measured, evenly spaced."""

MAX_OWN_DIFFERENCE = 3.0
"""mm. Median difference of the distances up to which a recording is of the clip's own subject, as
in `priorfill.markers.body_measures`; other people of the same height differ by 5 mm and more."""

MIN_DISTANCES = 6
"""With fewer distances no size is compared."""


@dataclass(frozen=True, eq=False)
class ConstantDistances:
    """Distances of markers that hardly vary in the clip.

    Attributes
    ----------
    first, second : ndarray of int [shape=(distances,)]
        The markers.
    length : ndarray [shape=(distances,), mm]
        Mean distance.
    """

    first: _Ints
    second: _Ints
    length: _Floats


def constant_distances(positions: _Floats) -> ConstantDistances:
    """Return the distances of markers that vary least in a clip.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    """
    first, second = np.triu_indices(positions.shape[1], 1)
    poses = sample_complete_poses(positions, MAX_POSES)
    distance = norms(poses[:, first] - poses[:, second])
    length = distance.mean(axis=0) if len(poses) else np.zeros(len(first))
    usable = np.flatnonzero((length > MIN_LENGTH) & (length < MAX_LENGTH))
    variation = distance[:, usable].std(axis=0) / length[usable] if len(poses) else length[usable]
    count = min(MAX_DISTANCES, int(MAX_SHARE * len(usable)))
    kept = usable[np.argsort(variation, kind="stable")[:count]]
    return ConstantDistances(first[kept], second[kept], length[kept])


def compare_sizes(
    body: ConstantDistances, poses: _Floats, subject: _Ints
) -> tuple[_Floats, NDArray[np.bool_]]:
    """Compare the clip's subject with others.

    Parameters
    ----------
    body : ConstantDistances
        Of the clip.
    poses : ndarray [shape=(poses, markers, 3), mm]
        Of other recordings, similar to poses of the clip.
    subject : ndarray of int [shape=(poses,)]
        Number of each pose's subject.

    Returns
    -------
    scale : ndarray [shape=(poses,)]
        Size of the clip's subject in units of the pose's subject.
    own : ndarray of bool [shape=(poses,)]
        Whether the pose's subject is the clip's, by its distances.
    """
    scale, own = np.ones(len(poses)), np.zeros(len(poses), dtype=bool)
    if len(body.length) < MIN_DISTANCES:
        return scale, own
    for number in np.unique(subject):
        of_subject = np.flatnonzero(subject == number)
        apart = poses[of_subject][:, body.first] - poses[of_subject][:, body.second]
        length = norms(apart).mean(axis=0)
        own[of_subject] = np.median(np.abs(length - body.length)) < MAX_OWN_DIFFERENCE
        scale[of_subject] = float(body.length @ length) / float(length @ length)
    scale[own] = 1.0
    return scale, own
