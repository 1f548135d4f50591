"""Poses, and indices of poses: which are whole, and some of them, evenly spread."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["complete_poses", "evenly_spaced", "sample_complete_poses"]


def evenly_spaced(count: int, most: int) -> NDArray[np.intp]:
    """Return up to ``most`` indices below ``count``, evenly spread, the first and last among them.

    Parameters
    ----------
    count, most : int
        At least 0.
    """
    some: NDArray[np.intp] = np.linspace(0, count - 1, min(most, count)).astype(np.intp)
    return some


def complete_poses(poses: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return which poses [shape=(poses, markers, 3), mm] have all of their markers."""
    complete: NDArray[np.bool_] = np.logical_and.reduce(~np.isnan(poses[..., 0]), axis=1)
    return complete


def sample_complete_poses(poses: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """Return up to ``most`` of the whole poses, evenly spread [shape=(poses, markers, 3), mm]."""
    complete = poses[complete_poses(poses)]
    return complete[evenly_spaced(len(complete), most)]
