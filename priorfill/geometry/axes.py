"""Axes: from a file's own axes to upright ones (+Z up), and back.

Coordinates and signs are exchanged only, so both directions are exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import OptionError

__all__ = ["UP_AXES", "from_upright", "to_upright"]

UP_AXES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")
"""Possible up axes of a file."""

UPRIGHT = "+Z"
"""The up axis of upright positions."""

# For each up axis: which coordinate becomes x, y, z, and its sign. Each is a proper rotation
# (determinant +1) by a right angle about one horizontal axis, or by two for -Z.
_ROTATIONS: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "+X": ((2, 1, 0), (-1, 1, 1)),
    "-X": ((2, 1, 0), (1, 1, -1)),
    "+Y": ((0, 2, 1), (1, -1, 1)),
    "-Y": ((0, 2, 1), (1, 1, -1)),
    "+Z": ((0, 1, 2), (1, 1, 1)),
    "-Z": ((0, 1, 2), (1, -1, -1)),
}


def to_upright(positions: NDArray[np.floating], up: str) -> NDArray[np.float64]:
    """Rotate positions so that `up` becomes +Z.

    Parameters
    ----------
    positions : ndarray [shape=(..., 3)]
        In a file's axes; `up` points up.
    up : str
        One of `UP_AXES`.

    Returns
    -------
    ndarray [shape=(..., 3)]
        The array given if +Z is up already, otherwise a new one.

    Raises
    ------
    OptionError
        If `up` is no axis.

    See Also
    --------
    from_upright : The inverse.

    Examples
    --------
    >>> to_upright(np.array([[1.0, 2.0, 3.0]]), "+Y")
    array([[ 1., -3.,  2.]])
    """
    order, signs = _rotation(up)
    given = np.asarray(positions, dtype=np.float64)
    if up == UPRIGHT:
        return given
    result = np.empty(given.shape)
    for place, (axis, sign) in enumerate(zip(order, signs, strict=True)):
        np.multiply(given[..., axis], sign, out=result[..., place])
    return result


def from_upright(positions: NDArray[np.floating], up: str) -> NDArray[np.float64]:
    """Rotate upright positions to axes in which `up` points up.

    The inverse of `to_upright`, with the same parameters.
    """
    order, signs = _rotation(up)
    given = np.asarray(positions, dtype=np.float64)
    if up == UPRIGHT:
        return given
    result = np.empty(given.shape)
    for place, (axis, sign) in enumerate(zip(order, signs, strict=True)):
        np.multiply(given[..., place], sign, out=result[..., axis])
    return result


def _rotation(up: str) -> tuple[list[int], NDArray[np.float64]]:
    if up not in _ROTATIONS:
        raise OptionError(f"up axis {up!r} is unknown; use one of {' '.join(UP_AXES)}")
    order, signs = _ROTATIONS[up]
    return list(order), np.array(signs, dtype=np.float64)
