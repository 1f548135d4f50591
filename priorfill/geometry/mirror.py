"""The mirror image of a recording: left and right swapped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["mirrored", "reflected"]

_ACROSS = np.array([-1.0, 1.0, 1.0])
"""Signs of a reflection in the plane x = 0; any vertical plane would do."""


def reflected(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the reflections of points [shape=(..., 3), mm]."""
    image: NDArray[np.float64] = points * _ACROSS
    return image


def mirrored(poses: NDArray[np.float64], contralateral: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return mirror images of poses: each marker at the reflection of its contralateral marker.

    Parameters
    ----------
    poses : ndarray [shape=(poses, markers, 3), mm]
        Upright; NaN where missing.
    contralateral : ndarray of int [shape=(markers,)]
        As returned by `priorfill.markers.left_right.contralateral_markers`; -1 where there is none.

    Returns
    -------
    ndarray [shape=(poses, markers, 3), mm]
        NaN for markers without a contralateral one.

    Examples
    --------
    >>> pose = np.array([[[-100.0, 0.0, 500.0], [90.0, 10.0, 500.0]]])  # left and right knee
    >>> mirrored(pose, np.array([1, 0]))
    array([[[-90.,  10., 500.],
            [100.,   0., 500.]]])
    """
    image = reflected(poses[:, contralateral])
    image[:, contralateral < 0] = np.nan
    return image
