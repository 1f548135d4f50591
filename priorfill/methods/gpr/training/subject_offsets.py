"""Constant offsets between other subjects' poses and the clip's.

Limbs of other people are longer or shorter, and their markers are placed elsewhere. In a frame
that moves with the body, much of the difference is constant for each subject. So the poses of each
subject are shifted by their mean difference from the clip's own nearest poses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["subject_offsets"]

ROUNDS = 3
"""The nearest poses depend on the offset; after this many rounds it hardly changes."""

SHRINKAGE_POSES = 3.0
"""Poses without offset that are counted in addition: a few poses may differ because they are other
poses, not because they are another subject's."""


def subject_offsets(
    own: NDArray[np.float64], others: NDArray[np.float64], subject: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return the offset to be added to each pose of other subjects.

    Parameters
    ----------
    own : ndarray [shape=(own poses, markers, 3), mm]
        The clip's poses, in root frames.
    others : ndarray [shape=(poses, markers, 3), mm]
        Poses of other subjects, in root frames of the same kind.
    subject : ndarray of int [shape=(poses,)]
        Number of each one's subject.

    Returns
    -------
    ndarray [shape=(poses, markers, 3), mm]
        In the root frames; the same for all poses of a subject.

    Examples
    --------
    >>> import numpy as np
    >>> own, others = np.zeros((4, 1, 3)), np.full((3, 1, 3), 10.0)
    >>> subject_offsets(own, others, np.array([0, 0, 0]))[0]
    array([[-5., -5., -5.]])
    """
    targets = own.reshape(len(own), -1)
    poses = others.reshape(len(others), -1)
    result = np.zeros_like(poses)
    squares = (targets**2).sum(axis=1)
    for number in np.unique(subject):
        rows = np.flatnonzero(subject == number)
        subject_poses, offset = poses[rows], np.zeros(poses.shape[1])
        shrinkage = len(rows) / (len(rows) + SHRINKAGE_POSES)
        for _ in range(ROUNDS):
            # squared distances, up to a term that is the same for all targets
            nearest = np.argmin(squares - 2.0 * (subject_poses + offset) @ targets.T, axis=1)
            offset = shrinkage * (targets[nearest] - subject_poses).mean(axis=0)
        result[rows] = offset
    return result.reshape(others.shape)
