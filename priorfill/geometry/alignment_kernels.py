"""Compiled loops over poses that are aligned with a template."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled

__all__ = ["centroids_and_covariances", "to_local"]

_Floats = NDArray[np.float64]


@compiled()
def centroids_and_covariances(
    points: _Floats, shape: _Floats, weights: _Floats, share: _Floats, both: _Floats
) -> None:
    """Write the weighted centroid of each pose, and its covariance with a template.

    Parameters
    ----------
    points : ndarray [shape=(poses, markers, 3)]
    shape : ndarray [shape=(markers, 3)]
        The template, relative to its weighted centroid.
    weights, share : ndarray [shape=(markers,)]
        Of the covariance; of the centroid, with a sum of 1.
    both : ndarray [shape=(poses, 4, 3)]
        Receives the centroid, then the covariance: its row i is of coordinate i of the pose.
    """
    for f in range(len(points)):
        ox, oy, oz = 0.0, 0.0, 0.0
        for g in range(len(share)):
            ox += share[g] * points[f, g, 0]
            oy += share[g] * points[f, g, 1]
            oz += share[g] * points[f, g, 2]
        both[f, 0, 0], both[f, 0, 1], both[f, 0, 2] = ox, oy, oz
        for j in range(3):
            cx, cy, cz = 0.0, 0.0, 0.0
            for g in range(len(share)):
                scale = weights[g] * shape[g, j]
                cx += scale * (points[f, g, 0] - ox)
                cy += scale * (points[f, g, 1] - oy)
                cz += scale * (points[f, g, 2] - oz)
            both[f, 1, j], both[f, 2, j], both[f, 3, j] = cx, cy, cz


@compiled()
def to_local(points: _Floats, origin: _Floats, rotation: _Floats, local: _Floats) -> None:
    """Write ``(points - origin) @ rotation`` of each pose.

    Parameters
    ----------
    points, local : ndarray [shape=(poses, markers, 3)]
    origin : ndarray [shape=(poses, 3)]
    rotation : ndarray [shape=(poses, 3, 3)]
    """
    for f in range(len(points)):
        ox, oy, oz = origin[f, 0], origin[f, 1], origin[f, 2]
        a, b, c = rotation[f, 0, 0], rotation[f, 0, 1], rotation[f, 0, 2]
        d, e, h = rotation[f, 1, 0], rotation[f, 1, 1], rotation[f, 1, 2]
        k, m, n = rotation[f, 2, 0], rotation[f, 2, 1], rotation[f, 2, 2]
        for g in range(points.shape[1]):
            x, y, z = points[f, g, 0] - ox, points[f, g, 1] - oy, points[f, g, 2] - oz
            local[f, g, 0] = x * a + y * d + z * k
            local[f, g, 1] = x * b + y * e + z * m
            local[f, g, 2] = x * c + y * h + z * n
