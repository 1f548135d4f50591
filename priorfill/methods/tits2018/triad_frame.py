"""Coordinates in the frame of a *triad*, the three reference markers of a missing marker.

The origin is the first marker, the first axis points to the second marker, and the second axis is
normal to the plane of all three.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["axes", "into", "out_of", "shape_of"]

Array = NDArray[np.float64]

MIN_LENGTH = 1e-6
"""mm (mm² for the normal). Shorter vectors have no defined direction."""


def _unit(vectors: Array) -> Array:
    """Return unit vectors; NaN for vectors shorter than `MIN_LENGTH`."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > MIN_LENGTH, length, np.nan)


def axes(triad: Array) -> Array:
    """Return the axes of the frame of a triad.

    Parameters
    ----------
    triad : ndarray [shape=(frames, 3, 3), mm]
        Its markers along the second axis.

    Returns
    -------
    ndarray [shape=(frames, 3, 3)]
        The axes as rows; NaN where a marker is missing or the three are collinear.
    """
    first = _unit(triad[:, 1] - triad[:, 0])
    normal = _unit(np.cross(first, triad[:, 2] - triad[:, 0]))
    # the normal of a collinear triad is NaN, and then the whole frame is
    known = ~np.isnan(normal[:, :1])
    return np.stack([np.where(known, first, np.nan), normal, np.cross(normal, first)], axis=1)


def into(points: Array, triad: Array, frame: Array) -> Array:
    """Return points in the frame of a triad [shape=(frames, 3), mm]."""
    local: Array = np.einsum("fij,fj->fi", frame, points - triad[:, 0])
    return local


def out_of(local: Array, triad: Array, frame: Array) -> Array:
    """Return points of the frame of a triad in the original frame [shape=(frames, 3), mm]."""
    points: Array = np.einsum("fij,fi->fj", frame, local) + triad[:, 0]
    return points


def shape_of(triad: Array, frame: Array) -> Array:
    """Return the features that describe the shape of a triad [shape=(frames, 3), mm].

    They are the distance of the second marker and the two coordinates of the third in the plane.
    """
    second = np.linalg.norm(triad[:, 1] - triad[:, 0], axis=1)
    third = into(triad[:, 2], triad, frame)
    return np.column_stack([np.where(np.isnan(third[:, 0]), np.nan, second), third[:, [0, 2]]])
