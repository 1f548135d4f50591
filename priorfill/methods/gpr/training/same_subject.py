"""Which recordings of a database are of the clip's own subject, with markers at the same places.

Distances between markers of one body segment are measures of a body. Within a session they agree
to a few millimetres; those of other people, and of markers attached anew, differ by more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms

__all__ = ["body_differences"]

PAIRS_PER_MARKER = 2
"""Distances compared, per marker: those that vary least."""


def body_differences(
    own: NDArray[np.float64], others: NDArray[np.float64], recording: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return how much rigid distances in other recordings differ from the clip's.

    Parameters
    ----------
    own : ndarray [shape=(own poses, markers, 3), mm]
        The clip's poses, complete.
    others : ndarray [shape=(poses, markers, 3), mm]
        Poses of other recordings, complete.
    recording : ndarray of int [shape=(poses,)]
        Number of each one's recording.

    Returns
    -------
    ndarray [shape=(poses,), mm]
        The median absolute difference, the same for all poses of a recording.

    See Also
    --------
    priorfill.markers.body_measures.compare_bodies : The same for two whole recordings.

    Examples
    --------
    >>> own = np.zeros((2, 3, 3))
    >>> own[:, 1, 0], own[:, 2, 1] = 300.0, 400.0
    >>> body_differences(own, np.concatenate([own, 1.1 * own]), np.array([5, 5, 2, 2]))
    array([ 0.,  0., 40., 40.])
    """
    one, other = np.triu_indices(own.shape[1], 1)
    distance = norms(own[:, one] - own[:, other])
    mean, spread = distance.mean(axis=0), distance.std(axis=0)
    numbers, place = np.unique(recording, return_inverse=True)
    place = place.ravel()
    theirs = norms(others[:, one] - others[:, other])
    means = np.stack([theirs[place == k].mean(axis=0) for k in range(len(numbers))])
    # a clip without movement does not tell which distances are rigid; the others do
    within = np.sqrt(((theirs - means[place]) ** 2).mean(axis=0))
    count = PAIRS_PER_MARKER * own.shape[1]
    rigid = np.argsort(np.maximum(spread, within), kind="stable")[:count]
    difference: NDArray[np.float64] = np.median(np.abs(means - mean)[:, rigid], axis=1)
    return difference[place]
