"""Compiled loops for rotations that superpose points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled

__all__ = ["nearest_rotations"]

_Floats = NDArray[np.float64]

SWEEPS = 30
"""Maximum number of sweeps; five to eight suffice in double precision."""

ORTHOGONAL = 2.0**-52
"""Cosine of the angle between two columns up to which they count as orthogonal."""

RANK = 2.0**-40
"""Ratio of a column to the largest one below which its direction is arbitrary."""


@compiled()
def _orthogonalise(columns: _Floats, axes: _Floats) -> None:
    """Rotate three columns until they are orthogonal, and axes with them (Hestenes 1958).

    Row c of `columns` is column c of a matrix A. Afterwards its rows are the columns of A V, and
    those of `axes` the columns of V.
    """
    for _ in range(SWEEPS):
        rotated = False
        for p in range(2):
            for q in range(p + 1, 3):
                alpha, beta, gamma = 0.0, 0.0, 0.0
                for i in range(3):
                    alpha += columns[p, i] * columns[p, i]
                    beta += columns[q, i] * columns[q, i]
                    gamma += columns[p, i] * columns[q, i]
                if gamma == 0.0 or abs(gamma) <= ORTHOGONAL * math.sqrt(alpha) * math.sqrt(beta):
                    continue
                rotated = True
                zeta = (beta - alpha) / (2.0 * gamma)
                tangent = 1.0 / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
                tangent = tangent if zeta >= 0.0 else -tangent
                cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
                sine = cosine * tangent
                for i in range(3):
                    one, other = columns[p, i], columns[q, i]
                    columns[p, i] = cosine * one - sine * other
                    columns[q, i] = sine * one + cosine * other
                    one, other = axes[p, i], axes[q, i]
                    axes[p, i] = cosine * one - sine * other
                    axes[q, i] = sine * one + cosine * other
        if not rotated:
            break


@compiled()
def _cross(one: _Floats, other: _Floats, result: _Floats) -> None:
    """Write the cross product of two vectors."""
    result[0] = one[1] * other[2] - one[2] * other[1]
    result[1] = one[2] * other[0] - one[0] * other[2]
    result[2] = one[0] * other[1] - one[1] * other[0]


@compiled()
def _normalise(vector: _Floats) -> None:
    """Scale a vector to length 1."""
    length = math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    for i in range(3):
        vector[i] /= length


@compiled()
def _make_perpendicular(vector: _Floats, result: _Floats) -> None:
    """Write a unit vector perpendicular to a unit vector."""
    axis = 0
    for i in range(1, 3):
        if abs(vector[i]) < abs(vector[axis]):
            axis = i
    for i in range(3):
        result[i] = (1.0 if i == axis else 0.0) - vector[axis] * vector[i]
    _normalise(result)


def nearest_rotations(matrices: _Floats, rotations: _Floats) -> None:
    """Write the rotation R that maximises trace(R' A), for each 3 x 3 matrix A (Kabsch 1976).

    R is the identity for A = 0, and NaN where A has NaN.

    With the singular vectors u and v of A, in the order of falling singular values, R maps v1 to
    u1, v2 to u2, and v1 x v2 to u1 x u2: this reverses the least certain axis where the nearest
    orthogonal matrix would be a reflection.
    """
    largest = np.abs(matrices).max(axis=(1, 2), keepdims=True)
    scaled = np.ldexp(matrices, -np.frexp(largest)[1])  # so that no square overflows, or vanishes
    _rotate(scaled, np.empty((2, 3, 3)), np.empty(3), rotations)


@compiled()
def _rotate(matrices: _Floats, work: _Floats, size: _Floats, rotations: _Floats) -> None:
    """Write the nearest rotations of matrices whose largest values are about 1."""
    u, v = work[0], work[1]
    for k in range(len(matrices)):
        for i in range(3):
            size[i] = 0.0
            for j in range(3):
                u[j, i] = matrices[k, i, j]
                v[j, i] = 1.0 if i == j else 0.0
        _orthogonalise(u, v)
        for i in range(3):
            for j in range(3):
                size[i] += u[i, j] * u[i, j]
        first = 0
        for i in range(1, 3):
            if size[i] > size[first]:
                first = i
        second = 1 if first == 0 else 0
        third = 3 - first - second
        if size[third] > size[second]:
            second, third = third, second
        if size[first] == 0.0:
            for i in range(3):
                for j in range(3):
                    rotations[k, i, j] = 1.0 if i == j else 0.0
            continue
        _normalise(u[first])
        if size[second] > RANK * RANK * size[first]:
            _normalise(u[second])
        else:
            _make_perpendicular(u[first], u[second])
        _cross(u[first], u[second], u[third])
        _cross(v[first], v[second], v[third])
        for i in range(3):
            for j in range(3):
                rotations[k, i, j] = (
                    u[first, i] * v[first, j]
                    + u[second, i] * v[second, j]
                    + u[third, i] * v[third, j]
                )
