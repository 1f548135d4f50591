"""Coordinates in the frame of three markers: the *triad* of a missing marker.

The first marker is the origin, the second lies on the first axis, the second axis is the normal
of the plane of all three.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["axes", "into", "out_of", "shape_of"]

Array = NDArray[np.float64]

SHORTEST = 1e-6
"""mm (mm² for the normal): axes of anything shorter mean nothing."""


def _unit(vectors: Array) -> Array:
    """Return unit vectors; NaN for vectors without a direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > SHORTEST, length, np.nan)


def axes(triad: Array) -> Array:
    """Return the axes of a triad.

    Parameters
    ----------
    triad : ndarray [shape=(frames, 3, 3), mm]
        Its markers (second axis).

    Returns
    -------
    ndarray [shape=(frames, 3, 3)]
        One axis a row; NaN where a marker is missing or the three lie on one line.
    """
    first = _unit(triad[:, 1] - triad[:, 0])
    normal = _unit(np.cross(first, triad[:, 2] - triad[:, 0]))
    # the normal of a triad on a line is NaN: so is then the frame
    known = ~np.isnan(normal[:, :1])
    return np.stack([np.where(known, first, np.nan), normal, np.cross(normal, first)], axis=1)


def into(points: Array, triad: Array, frame: Array) -> Array:
    """Bring points into the frame of a triad [shape=(frames, 3), mm]."""
    local: Array = np.einsum("fij,fj->fi", frame, points - triad[:, 0])
    return local


def out_of(local: Array, triad: Array, frame: Array) -> Array:
    """Bring points back out of the frame of a triad [shape=(frames, 3), mm]."""
    points: Array = np.einsum("fij,fi->fj", frame, local) + triad[:, 0]
    return points


def shape_of(triad: Array, frame: Array) -> Array:
    """Return what is free in the shape of a triad [shape=(frames, 3), mm].

    The distance of the second marker, and the two coordinates of the third in the plane.
    """
    second = np.linalg.norm(triad[:, 1] - triad[:, 0], axis=1)
    third = into(triad[:, 2], triad, frame)
    return np.column_stack([np.where(np.isnan(third[:, 0]), np.nan, second), third[:, [0, 2]]])
