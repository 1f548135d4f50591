"""Select poses: complete ones, and evenly spaced ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["complete_poses", "evenly_spaced", "sample_complete_poses"]


def evenly_spaced(count: int, max_count: int) -> NDArray[np.intp]:
    """Return up to ``max_count`` evenly spaced indices below ``count``.

    Parameters
    ----------
    count, max_count : int
        At least 0.

    Returns
    -------
    ndarray of int
        Ascending; includes 0 and ``count - 1`` if it has more than one element.

    Examples
    --------
    >>> evenly_spaced(9, 3)
    array([0, 4, 8])
    """
    indices: NDArray[np.intp] = np.linspace(0, count - 1, min(max_count, count)).astype(np.intp)
    return indices


def complete_poses(poses: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return which poses [shape=(poses, markers, 3), mm] have no missing marker."""
    complete: NDArray[np.bool_] = np.logical_and.reduce(~np.isnan(poses[..., 0]), axis=1)
    return complete


def sample_complete_poses(poses: NDArray[np.float64], max_poses: int) -> NDArray[np.float64]:
    """Return up to ``max_poses`` complete poses, evenly spaced [shape=(poses, markers, 3), mm]."""
    complete = poses[complete_poses(poses)]
    return complete[evenly_spaced(len(complete), max_poses)]
