"""The mirror image of a recording: left and right swapped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["mirrored", "reflected"]

_ACROSS = np.array([-1.0, 1.0, 1.0])
"""Upright positions in a mirror that stands across x; which vertical one it is does not matter."""


def reflected(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points [shape=(..., 3), mm] in a mirror, each where its own image is."""
    image: NDArray[np.float64] = points * _ACROSS
    return image


def mirrored(poses: NDArray[np.float64], contralateral: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return poses in a mirror, each marker where its partner's image is.

    Parameters
    ----------
    poses : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing.
    partner : ndarray of int [shape=(markers,)]
        As `partners` gives it; the image of a marker without one is missing.
    """
    image = reflected(poses[:, contralateral])
    image[:, contralateral < 0] = np.nan
    return image
