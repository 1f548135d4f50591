"""Fit other bodies to the clip's: what their poses are constantly off by.

Limbs of other people are longer or shorter, and their markers sit elsewhere. Much of that is a
constant for each body in a frame that moves with it. So each body's poses are shifted by what they
are off by on average from the clip's own nearest poses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["shifts"]

ROUNDS = 3
"""Nearest poses change with the shift; after so many rounds hardly any does."""

DOUBT = 3.0
"""Poses that no shift counts as: a few poses may be off by what they are, not by whose they are."""


def shifts(
    own: NDArray[np.float64], others: NDArray[np.float64], body: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return what is to be added to other bodies' poses.

    Parameters
    ----------
    own : ndarray [shape=(own poses, markers, 3), mm]
        In root frames.
    others : ndarray [shape=(poses, markers, 3), mm]
        In root frames of the same kind.
    body : ndarray of int [shape=(poses,)]
        Whose they are.

    Returns
    -------
    ndarray [shape=(poses, markers, 3), mm]
        In the root frames; the same for all poses of a body.
    """
    mine = own.reshape(len(own), -1)
    theirs = others.reshape(len(others), -1)
    shift = np.zeros_like(theirs)
    square = (mine**2).sum(axis=1)
    for number in np.unique(body):
        rows = np.flatnonzero(body == number)
        poses, off = theirs[rows], np.zeros(theirs.shape[1])
        trust = len(rows) / (len(rows) + DOUBT)
        for _ in range(ROUNDS):
            nearest = np.argmin(square - 2.0 * (poses + off) @ mine.T, axis=1)
            off = trust * (mine[nearest] - poses).mean(axis=0)
        shift[rows] = off
    return shift.reshape(others.shape)
