"""The mirror image of a recording: left and right swapped."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.markerset import MarkerSet

__all__ = ["mirrored", "partners", "reflected"]

_ACROSS = np.array([-1.0, 1.0, 1.0])
"""Upright positions in a mirror that stands across x; which vertical one it is does not matter."""


def partners(labels: Sequence[str], marker_set: MarkerSet) -> NDArray[np.intp]:
    """Return the partner of each marker on the other side of the body [shape=(markers,)].

    A marker in the middle is its own; -1 for those that have none among the labels.
    """
    index = {label: i for i, label in enumerate(labels)}
    found = (index.get(marker_set.mirror.get(label, ""), -1) for label in labels)
    return np.fromiter(found, dtype=np.intp, count=len(labels))


def reflected(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points [shape=(..., 3), mm] in a mirror, each where its own image is."""
    image: NDArray[np.float64] = points * _ACROSS
    return image


def mirrored(poses: NDArray[np.float64], partner: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return poses in a mirror, each marker where its partner's image is.

    Parameters
    ----------
    poses : ndarray [shape=(poses, markers, 3), mm]
        NaN where missing.
    partner : ndarray of int [shape=(markers,)]
        As `partners` gives it; the image of a marker without one is missing.
    """
    image = reflected(poses[:, partner])
    image[:, partner < 0] = np.nan
    return image
